"""Composition root of a flight in real time: opens the bus, the socket and the logs that the operator named."""

from __future__ import annotations

import json
import socket
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import can

from flightsw import app, realtime
from flightsw.can_port import CanPort
from flightsw.checkpoint import CheckpointRefused, Resume
from flightsw.clock import RealTimeClock, SharedClock
from flightsw.icd.table_file import TableImage, TableRefused, encode
from flightsw.journal import Journal
from flightsw.kernels import registry
from flightsw.link.mavlink_out import Nowhere, Sink
from flightsw.link_open import LinkOptions, LinkRefused, OpenedLink, open_ground_link
from flightsw.main_loop import MainLoop
from flightsw.process_account import ProcessAccount
from flightsw.provenance import identity
from flightsw.tables.service import TableService
from flightsw.tables.store import SLOTS, Booted, TableStore
from flightsw.tables.validate import Policy, accept_at_start

_POLL_S = 0.02
RESTART = 3  # exit status: start flight again


class Refused(ValueError):
    """An argument that flight cannot start with; the text names it and the remedy."""


class UdpSink:
    """Datagrams to one peer, non-blocking: what the socket does not take at once is lost and counted.

    Args: family and address as `socket.getaddrinfo` gives them: no name is looked up in the tick.
    """

    def __init__(self, family: int, address: tuple[Any, ...]) -> None:
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._peer = address
        self.lost = 0

    def send(self, message: bytes | bytearray) -> None:
        """Offer one datagram."""
        try:
            self._socket.sendto(message, self._peer)
        except OSError:
            self.lost += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def open_link(text: str | None) -> Sink:
    """The sink for `udp:HOST:PORT`, or one that goes nowhere for None."""
    if text is None:
        return Nowhere()
    kind, _, peer = text.partition(":")
    host, _, port = peer.rpartition(":")
    if kind != "udp" or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise Refused(f"--link {text}: write it as udp:HOST:PORT, for example udp:127.0.0.1:14550")
    try:
        found = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        raise Refused(f"--link {text}: no host {host} ({error}); give a known name or an address") from None
    family, _, _, _, address = found[0]
    return UdpSink(family, address)


def open_port(text: str) -> CanPort:
    """Flight's end of the bus named `interface:channel`."""
    interface, colon, channel = text.partition(":")
    if not colon or not channel:
        raise Refused(f"--can {text}: write it as INTERFACE:CHANNEL, for example socketcan:can0")
    try:
        if interface == "remote":
            return CanPort(_remote(channel))
        return CanPort(lambda: can.Bus(interface=interface, channel=channel, fd=True))
    except (can.CanError, OSError, ValueError, ImportError) as error:
        raise Refused(f"--can {text}: cannot be opened: {error}") from error


def _remote(channel: str) -> Callable[[], can.BusABC]:
    """Opens the bus of a hub: with patience the first time, without any in flight."""
    try:
        from flightsw.remote_bus import BoundedRemoteBus
    except ModuleNotFoundError as error:  # of the simulator: a satellite's bus has no hub
        raise Refused(
            f"--can remote:{channel}: {error.name} is not installed; pip install 'leonav[sim]', or name another bus"
        ) from None

    first = [True]

    def open_bus() -> can.BusABC:
        patient, first[0] = first[0], False
        return BoundedRemoteBus(channel, patient)

    return open_bus


def open_logs(
    out: Path | None,
    tables: Path,
    navigation: TableImage,
    orientation: TableImage,
    forces: app.ForceTables | None = None,
    resume: Resume | None = None,
    allow_saturating: bool = False,
    two_way: bool = False,
    log_limit_bytes: int | None = None,
    functions: Sequence[TableImage] = (),
) -> Journal:
    """The journal in `out`, with what a replay needs beside it: run.json, tables and checkpoint. None: no logs.

    log_limit_bytes: of can.log and of link.tlog, each with its older parts; None: no limit.
    """
    if out is None:
        return Journal(None)
    try:
        (out / "tables").mkdir(parents=True, exist_ok=True)
        names: tuple[str, ...] = (app.NAVIGATION_FILE, app.EARTH_ORIENTATION_FILE)
        if forces is not None:
            names = (*names, app.FORCES_FILE, app.GRAVITY_FIELD_FILE)
        for name in (*names, *(f"{table.kind}.tbl" for table in functions)):
            image = (tables / name).read_bytes()  # read before writing: the two folders may be one
            (out / "tables" / name).write_bytes(image)
        flown = navigation  # it may come from a store
        (out / "tables" / app.NAVIGATION_FILE).write_bytes(encode(*_encodable(flown)))
        if resume is not None:
            (out / app.RESUME_FILE).write_bytes(resume.image)
        flight = identity(
            navigation, orientation, *(forces or ()), *functions, resume=resume, allow_saturating=allow_saturating
        )
        record = {"lockstep": False, "two_way_link": two_way, **flight}
        (out / "run.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
        return Journal(out, log_limit_bytes)
    except OSError as error:
        raise Refused(f"--out {out}: cannot be written ({error.strerror}); name another folder") from error


def _write_timing(out: Path, loop: MainLoop, account: ProcessAccount) -> None:
    """timing.json of a flight that has ended; a disk that takes it no longer costs nothing but this."""
    record = {
        "lockstep": False,
        "scheduling": realtime.scheduling(),
        "wall_s": account.age_s(),
        "slips": loop.slips,
        "ticks": loop.tick,
        "process": account.summary(),
        "members": loop.schedule.summary(),
    }
    try:
        (out / "timing.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        print(f"flightsw: {out / 'timing.json'}: not written ({error.strerror})", file=sys.stderr)


def _encodable(table: TableImage) -> tuple[Any, ...]:
    return (*table[:4], table.valid_from_gps_ns, table.valid_to_gps_ns)


def run(
    can_bus: str,
    tables: Path,
    link: LinkOptions,
    out: Path | None,
    ticks: int | None,
    checkpoints: app.Checkpoints | None = None,
    resume: Path | None = None,
    resume_max_age_s: float = 0.0,
    table_key: Path | None = None,
    allow_saturating: bool = False,
    table_store: Path | None = None,
    require_certificate: bool = False,
    shared_clock: Path | None = None,
    log_limit_bytes: int | None = None,
    real_time: bool = True,
) -> int:
    """Fly until stopped, or for so many ticks. Returns the exit status, RESTART where the ground asked for one.

    A checkpoint that is missing or unfit is told and not used: it must not keep a satellite from navigating.
    table_key: file of the key that must have signed the navigation table. allow_saturating: for a study.
    shared_clock: file of the clock that a simulated world in another process keeps. real_time: ask for SCHED_FIFO and
    locked memory.
    """
    key = app.load_key(table_key) if table_key else None
    navigation, orientation = app.load_tables(tables, key, allow_saturating)
    policy = Policy(key, allow_saturating)
    store = booted = None
    if table_store is not None:
        store = TableStore(table_store, "navigation")
        booted = _boot(store, (tables / app.NAVIGATION_FILE).read_bytes(), policy)
        navigation = booted.table
    forces = app.load_force_tables(tables, navigation)
    functions = app.load_function_tables(tables)
    if checkpoints is not None and not checkpoints.path.parent.is_dir():
        raise Refused(f"--checkpoint {checkpoints.path}: no such folder; make it, or name another file")
    resumed = _load_resume(resume, resume_max_age_s, navigation)
    ground = _open_ground_link(link)
    sink: Sink = ground.port if ground is not None else Nowhere()
    try:
        port = open_port(can_bus)
        try:
            journal = open_logs(
                out,
                tables,
                navigation,
                orientation,
                forces,
                resumed,
                allow_saturating,
                ground is not None,
                log_limit_bytes,
                functions,
            )
        except Refused:
            port.close()
            raise
    except Refused:
        sink.close()
        raise
    loop = account = None
    try:
        loop = app.build(
            navigation,
            orientation,
            RealTimeClock(),
            port,
            journal,
            sink,
            time.time_ns(),
            _tell_progress,
            forces,
            resumed,
            checkpoints,
            functions,
        )
        loop.require_certificate = require_certificate
        for text in realtime.prepare(real_time):
            print(f"flightsw: {text}", file=sys.stderr)
        if shared_clock is not None:
            loop.clock = _await_clock(shared_clock)
        loop.anchor(time.time_ns())  # once more: compiling may have taken a minute
        if store is not None and booted is not None:
            record = loop.memory
            loop.keep_tables(
                TableService(loop, record.nav, record.table, navigation, policy, store, booted.slot, table_store)
            )
        if ground is not None:
            _listen(loop, ground, link, out)
        account = ProcessAccount()
        loop.run(ticks)
    finally:
        if loop is not None and account is not None and out is not None:
            _write_timing(out, loop, account)
        if loop is not None and loop.checkpoints is not None:
            loop.checkpoints.close()
        journal.close()
        port.close()
        sink.close()
    print(f"flightsw: {loop.tick} ticks, {loop.slips} slips")
    if loop.checkpoints is not None:
        print(f"flightsw: {loop.checkpoints.written} checkpoints written, {loop.checkpoints.failed} failed")
    if loop.restart:
        print("flightsw: ended to be started again, as the ground ordered")
        return RESTART
    return 0


def _await_clock(path: Path) -> SharedClock:
    """The clock that a world in another process keeps, once its file is there."""
    print("flightsw: ready", file=sys.stderr, flush=True)
    while not path.exists():
        time.sleep(_POLL_S)
    try:
        return SharedClock(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, TypeError, ValueError) as error:
        raise Refused(f"--shared-clock {path}: not a clock ({error})") from error


def _open_ground_link(options: LinkOptions) -> OpenedLink | None:
    if not options.addresses:
        return None
    try:
        return open_ground_link(options, time.time_ns())
    except LinkRefused as error:
        raise Refused(str(error)) from error


def _listen(loop: MainLoop, opened: OpenedLink, options: LinkOptions, out: Path | None) -> None:
    """Let the ground in; what it cannot have is said."""
    loop.listen(opened.port, opened.access, options.state, out)
    ground = loop.ground
    assert ground is not None
    for text in ground.parameters.told:
        print(f"flightsw: {text}", file=sys.stderr)
    if opened.keys is not None:
        ground.jobs.append(opened.keys.work_slice)
    if options.bench:
        print("flightsw: BENCH PROFILE: unsigned commands are taken, from this machine", file=sys.stderr)


def _boot(store: TableStore, first: bytes, policy: Policy) -> Booted:
    """The navigation table of a store; an empty one begins with `first`, which flight has accepted."""
    registry.warm_up(_tell_progress)
    try:
        if not any(store.path(slot).exists() for slot in SLOTS):
            store.begin_with(first, accept_at_start(first, policy))
    except OSError as error:
        raise Refused(f"--table-store {store.pointer.parent}: cannot be written ({error.strerror})") from error
    except TableRefused as error:
        raise Refused(f"--tables: {app.NAVIGATION_FILE}: refused: {error}") from error
    booted = store.boot(lambda raw: accept_at_start(raw, policy))
    if booted is None:
        raise Refused(f"--table-store {store.pointer.parent}: neither table of it can fly; empty it to begin anew")
    for text in booted.told:
        print(f"flightsw: {text}", file=sys.stderr)
    return booted


def _load_resume(path: Path | None, max_age_s: float, navigation: TableImage) -> Resume | None:
    if path is None:
        return None
    try:
        return app.load_resume(path, max_age_s, navigation)
    except CheckpointRefused as error:
        print(f"flightsw: --resume {error}; starting without it", file=sys.stderr)
        return None


def _tell_progress(done: int, total: int, name: str) -> None:
    print(f"flightsw: compiling {done}/{total} {name}", file=sys.stderr)
