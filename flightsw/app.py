"""Composition: tables -> warm-up -> preflight -> loop. The composition roots call this; it opens nothing itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from flightsw.can_port import CanPort
from flightsw.clock import Clock
from flightsw.icd.table_file import TableImage, TableRefused, decode
from flightsw.journal import Journal
from flightsw.kernels import registry
from flightsw.link.mavlink_out import Sink
from flightsw.main_loop import MainLoop
from flightsw.memory import Memory
from flightsw.nav.step import step

NAVIGATION_FILE = "navigation.tbl"
EARTH_ORIENTATION_FILE = "earth_orientation.tbl"


class PreflightFailed(RuntimeError):
    """Flight must not start; the text says what is wrong."""


def load_tables(folder: Path) -> tuple[TableImage, TableImage]:
    """The two tables of a folder, validated; PreflightFailed names the file and the reason."""
    images = []
    for name, kind in ((NAVIGATION_FILE, "navigation"), (EARTH_ORIENTATION_FILE, "earth_orientation")):
        path = folder / name
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
        images.append(image)
    return images[0], images[1]


def build(
    navigation: TableImage,
    orientation: TableImage,
    clock: Clock,
    port: CanPort,
    journal: Journal,
    sink: Sink,
    unix_start_ns: int,
    progress: Callable[[int, int, str], None] | None = None,
) -> MainLoop:
    """A flight ready to tick: kernels compiled, tables loaded, one dry step flown and forgotten."""
    registry.warm_up(progress)
    memory = Memory()
    memory.load(navigation.values, orientation.values)
    _preflight(memory)
    return MainLoop(clock, port, journal, sink, memory, navigation, unix_start_ns)


def _preflight(memory: Memory) -> None:
    """Run one empty step: it must neither find a state nor touch anything but the output."""
    before = memory.nav.copy()
    step(memory.nav, memory.input, memory.table, memory.orientation, memory.work, memory.output)
    if memory.output["validity"][0] != 0 or not np.array_equal(before.view(np.uint8), memory.nav.view(np.uint8)):
        raise PreflightFailed("an empty navigation step changed state: the compiled code is not sound")
    memory.reset()
