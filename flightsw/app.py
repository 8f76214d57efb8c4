"""Composition: tables -> warm-up -> preflight -> loop. The composition roots call this; it opens nothing itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightsw.can_port import CanPort
from flightsw.checkpoint import CheckpointRefused, CheckpointWriter, Resume
from flightsw.clock import Clock
from flightsw.functions import KINDS, maker_of
from flightsw.icd.certificate import CertificateRefused, check_key, open_certificate
from flightsw.icd.table_checks import problems
from flightsw.icd.table_file import TableImage, TableRefused, decode
from flightsw.icd.table_saturation import saturation
from flightsw.journal import Journal
from flightsw.kernels import registry
from flightsw.link.mavlink_out import Sink
from flightsw.main_loop import MainLoop
from flightsw.memory import Memory
from flightsw.nav.flight_model import FLIGHT
from flightsw.nav.step import step
from flightsw.records import NAV
from flightsw.tables import stimulus

NAVIGATION_FILE = "navigation.tbl"
EARTH_ORIENTATION_FILE = "earth_orientation.tbl"
FORCES_FILE = "forces.tbl"
GRAVITY_FIELD_FILE = "gravity_field.tbl"
RESUME_FILE = "resume.ckpt"  # in the folder of a run: the checkpoint that it began with


class PreflightFailed(RuntimeError):
    """Flight must not start; the text says what is wrong."""


class ForceTables(NamedTuple):
    """The two tables that the flight filter needs besides."""

    forces: TableImage
    gravity_field: TableImage


class Checkpoints(NamedTuple):
    """Where a flight keeps its checkpoint, and how often it writes one."""

    path: Path
    period_s: float


def load_resume(path: Path, max_age_s: float, navigation: TableImage) -> Resume:
    """The checkpoint of a file, fit for this software and table; CheckpointRefused names the file and the reason."""
    try:
        return Resume(path.read_bytes(), NAV, navigation.crc32, max_age_s)
    except OSError as error:
        raise CheckpointRefused(f"{path}: cannot be read ({error.strerror})") from error
    except CheckpointRefused as error:
        raise CheckpointRefused(f"{path}: {error}") from error


def load_tables(
    folder: Path, key: bytes | None = None, allow_saturating: bool = False
) -> tuple[TableImage, TableImage]:
    """Navigation and Earth orientation of a folder, validated; PreflightFailed names the file and the reason.

    key: the navigation table must carry a certificate that was signed with it. allow_saturating: fly a
    bound that settles below its limit, for a study.
    """
    navigation, orientation = _load(folder, (NAVIGATION_FILE, EARTH_ORIENTATION_FILE))
    path = folder / NAVIGATION_FILE
    try:
        block = open_certificate(navigation, key)
    except CertificateRefused as error:
        raise PreflightFailed(f"{path}: refused: {error}") from error
    if not allow_saturating:
        certified_age_s = float(block.values["certified_age_s"][0]) if block is not None else 0.0
        if found := saturation(navigation.values, certified_age_s):
            raise PreflightFailed(f"{path}: refused: {'; also '.join(found)}; to study it, say --allow-saturating")
    return navigation, orientation


def load_key(path: Path) -> bytes:
    """The key of a file; PreflightFailed names the file and the reason."""
    try:
        return check_key(path.read_bytes(), str(path))
    except OSError as error:
        raise PreflightFailed(f"{path}: cannot be read ({error.strerror})") from error
    except CertificateRefused as error:
        raise PreflightFailed(str(error)) from error


def load_force_tables(folder: Path, navigation: TableImage) -> ForceTables | None:
    """The force tables of a folder if the navigation table flies them; None if it does not."""
    if int(navigation.values["filter_model"][0]) != FLIGHT:
        return None
    return ForceTables(*_load(folder, (FORCES_FILE, GRAVITY_FIELD_FILE)))


def load_function_tables(folder: Path) -> tuple[TableImage, ...]:
    """Tables of the functions beside navigation, those that a folder has; PreflightFailed as for the others."""
    names = (f"{kind}.tbl" for kind in KINDS)
    return tuple(_load(folder, tuple(name for name in names if (folder / name).exists())))


def _load(folder: Path, names: tuple[str, ...]) -> list[TableImage]:
    images = []
    for name in names:
        path, kind = folder / name, name.removesuffix(".tbl")
        try:
            image = decode(path.read_bytes())
        except OSError as error:
            raise PreflightFailed(
                f"{path}: cannot be read ({error.strerror}); build it with `ground table build`"
            ) from error
        except TableRefused as error:
            raise PreflightFailed(f"{path}: refused: {error}") from error
        if image.kind != kind:
            raise PreflightFailed(f"{path}: holds a table of kind {image.kind}; {kind} is needed here")
        if found := problems(kind, image.values):
            raise PreflightFailed(f"{path}: refused: {'; also '.join(found)}")
        images.append(image)
    return images


def build(
    navigation: TableImage,
    orientation: TableImage,
    clock: Clock,
    port: CanPort,
    journal: Journal,
    sink: Sink,
    unix_start_ns: int,
    progress: Callable[[int, int, str], None] | None = None,
    forces: ForceTables | None = None,
    resume: Resume | None = None,
    checkpoints: Checkpoints | None = None,
    functions: Sequence[TableImage] = (),
) -> MainLoop:
    """A flight ready to tick: kernels compiled, tables loaded, one dry step flown and forgotten.

    resume: a state to go on from once time is known. checkpoints: write them in the slack. functions: what else flies,
    each by its table.
    """
    makers = [maker_of(table.kind) for table in functions]
    registry.warm_up(progress)
    memory = Memory()
    memory.load(navigation.values, orientation.values)
    block = open_certificate(navigation, None)
    memory.load_envelope(block.values if block is not None else None)
    if forces is not None:
        try:
            memory.load_forces(forces.forces.values, forces.gravity_field.values)
        except ValueError as error:
            raise PreflightFailed(f"tables: {error}; build a field of that degree or fly fewer") from error
    elif int(navigation.values["filter_model"][0]) == FLIGHT:
        raise PreflightFailed(f"set {navigation.set_name} flies the full force model: {FORCES_FILE} is missing")
    _preflight(memory)
    _replay_stimulus(navigation)
    loop = MainLoop(clock, port, journal, sink, memory, navigation, unix_start_ns)
    loop.resume = resume
    services = loop.services()
    for maker, table in zip(makers, functions, strict=True):
        loop.add_function(maker(table, services))
    if checkpoints is not None:
        period_ns = round(checkpoints.period_s * 1e9)
        loop.keep_checkpoints(
            CheckpointWriter(
                checkpoints.path, memory.nav, navigation.crc32, period_ns, lambda: loop.counter_ns, clock.lockstep
            )
        )
    return loop


def _preflight(memory: Memory) -> None:
    """Run one empty step: it must neither find a state nor touch anything but the output."""
    before = memory.nav.copy()
    step(
        memory.nav,
        memory.input,
        memory.table,
        memory.orientation,
        memory.forces,
        memory.field,
        memory.work,
        memory.scratch,
        memory.output,
    )
    if memory.output["validity"][0] != 0 or not np.array_equal(before.view(np.uint8), memory.nav.view(np.uint8)):
        raise PreflightFailed("an empty navigation step changed state: the compiled code is not sound")
    memory.reset()


def _replay_stimulus(navigation: TableImage) -> None:
    """What was certified must be what this software computes."""
    block = open_certificate(navigation, None)
    if block is None or not block.stimulus:
        return
    try:
        stimulus.check(block.stimulus, navigation.values)
    except stimulus.StimulusRefused as error:
        raise PreflightFailed(f"set {navigation.set_name}: refused: {error}") from error
