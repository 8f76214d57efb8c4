"""Replay: the journal of a run fed into flight alone. Same inputs, same tables: same outbound bytes.

Flight is a function of tables, checkpoint and journal. A tick's inputs are the frames noted as received before its
heartbeat, which also carries the counter the tick ran at and the slips counted until then, and the notes on a lost bus.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import can

from flightsw import app
from flightsw.can_port import CanPort
from flightsw.checkpoint import CheckpointRefused, Resume
from flightsw.clock import LockstepClock
from flightsw.icd.log_parts import lacks_beginning
from flightsw.icd.table_file import TableImage
from flightsw.journal import CAN_LOG, ERROR, EXTENDED, LINK_LOG, REMOTE, Journal
from flightsw.journal_reading import (
    Extent,
    ReplayRefused,
    Tick,
    first_difference,
    link_extent,
    read_orders,
    read_ticks,
)
from flightsw.link.access import Access
from flightsw.link.mavlink_out import Nowhere
from flightsw.link_port import LinkPort
from flightsw.main_loop import MainLoop
from flightsw.provenance import differences, identity


class _JournalBus:
    """Stands where the bus was: gives what was drained, takes what is sent, fails and comes back where it did."""

    def __init__(self) -> None:
        self._waiting: list[can.Message] = []
        self._tick = Tick()
        self._sent = 0
        self.may_open = True

    def open(self) -> _JournalBus:
        if not self.may_open:
            raise can.CanInitializationError("the bus of the run was off")
        return self

    def load(self, tick: Tick) -> None:
        self._tick, self._sent = tick, 0
        self._waiting = [_message(can_id, payload) for can_id, payload in reversed(tick.frames)]

    def recv(self, timeout: float | None = None) -> can.Message | None:
        del timeout
        if self._waiting:
            return self._waiting.pop()
        if self._tick.lost_receiving:
            raise can.CanOperationError("lost here in the run")
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        del msg, timeout
        self._sent += 1
        if self._sent - 1 == self._tick.lost_sending:
            raise can.CanOperationError("lost here in the run")

    def shutdown(self) -> None:
        self._waiting = []


def _message(can_id: int, payload: bytes) -> can.Message:
    return can.Message(
        arbitration_id=can_id & 0x1FFFFFFF,
        data=None if can_id & REMOTE else payload,
        is_extended_id=bool(can_id & EXTENDED),
        is_remote_frame=bool(can_id & REMOTE),
        is_error_frame=bool(can_id & ERROR),
        is_fd=not can_id & (REMOTE | ERROR),
    )


class Outcome(NamedTuple):
    """What a replay found: ticks flown, and where each log first differs (byte offset), or None."""

    ticks: int
    can_differs_at: int | None
    link_differs_at: int | None

    @property
    def identical(self) -> bool:
        """Whether flight said the same again, byte for byte."""
        return self.can_differs_at is None and self.link_differs_at is None


def is_two_way(run: dict[str, Any]) -> bool:
    """Whether the ground could speak in this run (its run.json).

    Then link.tlog is not compared: signatures need the key, and refusals, which it tells, are not in the journal. What
    the ground ordered is repeated all the same, so can.log must be the same.
    """
    return run.get("two_way_link") is True


class _OrdersOfTheRun:
    """Stands where the uplink was: gives every tick the frames it took."""

    def __init__(self, loop: MainLoop, frames: dict[int, list[bytes]]) -> None:
        self._frames = frames
        loop.listen(LinkPort([]), Access(tuple, None, loop.unix_start_ns), None)
        assert loop.ground is not None
        self._obey = loop.ground.uplink.obey
        loop.ground.take_in = self.take_in

    def take_in(self, unix_ns: int) -> None:
        """Obey what this tick obeyed in the run."""
        for frame in self._frames.get(unix_ns // 1000, ()):
            self._obey(frame, unix_ns)


def check_versions(run_dir: Path) -> list[str]:
    """What differs between the flight of the run and this one, in words; ReplayRefused if the folder is no run."""
    run = record_of(run_dir)
    navigation, orientation = _tables(run_dir, run)
    forces = app.load_force_tables(run_dir / "tables", navigation)
    functions = app.load_function_tables(run_dir / "tables")
    resume = _resume(run_dir, run, navigation)
    return differences(run, identity(navigation, orientation, *(forces or ()), *functions, resume=resume))


def record_of(run_dir: Path) -> dict[str, Any]:
    """run.json of a run; ReplayRefused where there is none."""
    try:
        run = json.loads((run_dir / "run.json").read_text())
    except (OSError, ValueError) as error:
        raise ReplayRefused(f"{run_dir}: no readable run.json; give the folder that a run left ({error})") from None
    if not isinstance(run, dict):
        raise ReplayRefused(f"{run_dir / 'run.json'}: not the record of a run")
    return run


def _tables(run_dir: Path, run: dict[str, Any]) -> tuple[TableImage, TableImage]:
    """The tables of the run; one whose bound settles below its limit only where the run was told to fly it."""
    return app.load_tables(run_dir / "tables", None, run.get("allow_saturating") is True)


def _resume(run_dir: Path, run: dict[str, Any], navigation: TableImage) -> Resume | None:
    """The checkpoint that the run began with, from its folder; None where it began without."""
    began = run.get("checkpoint")
    if not isinstance(began, dict):
        return None
    try:
        return app.load_resume(run_dir / app.RESUME_FILE, float(began.get("max_age_s", 0.0)), navigation)
    except CheckpointRefused as error:
        raise ReplayRefused(f"the run began with a checkpoint; {error}") from None
    except (TypeError, ValueError):
        raise ReplayRefused(f"{run_dir / 'run.json'}: max_age_s of the checkpoint is no number") from None


def replay(run_dir: Path, out_dir: Path, tell: Callable[[str], None] = lambda text: None) -> Outcome:
    """Fly the journal of `run_dir` again, writing can.log and link.tlog into `out_dir`, and compare the two.

    Logs that were cut off, as by a kill, are flown and compared as far as they are whole. tell: is told so.
    """
    for name in (CAN_LOG, LINK_LOG):
        if not (run_dir / name).is_file():
            raise ReplayRefused(f"{run_dir / name}: missing; give the folder that a run left")
    run = record_of(run_dir)
    navigation, orientation = _tables(run_dir, run)
    forces = app.load_force_tables(run_dir / "tables", navigation)
    functions = app.load_function_tables(run_dir / "tables")
    resume = _resume(run_dir, run, navigation)
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        if out_dir.samefile(run_dir):
            raise ReplayRefused(f"--out {out_dir}: is the run itself; name another folder")
        journal = Journal(out_dir)
    except OSError as error:
        raise ReplayRefused(f"--out {out_dir}: cannot be written ({error.strerror}); name another folder") from None
    bus = _JournalBus()
    loop = None
    two_way = is_two_way(run)
    no_link_beginning = lacks_beginning(run_dir / LINK_LOG)
    if no_link_beginning and two_way:
        raise ReplayRefused(
            f"{run_dir / LINK_LOG}: its beginning was dropped to keep the limit of its size, and with it what the "
            "ground ordered; give a run a larger --log-limit"
        )
    can_log, link_log = Extent(), link_extent(run_dir / LINK_LOG)
    try:
        for tick in read_ticks(run_dir / CAN_LOG, can_log):
            if loop is None:
                clock = LockstepClock(tick.counter_ns)
                port = CanPort(bus.open)  # type: ignore[arg-type]
                loop = app.build(
                    navigation,
                    orientation,
                    clock,
                    port,
                    journal,
                    Nowhere(),
                    tick.unix_ns,
                    None,
                    forces,
                    resume,
                    functions=functions,
                )
                if two_way:
                    _OrdersOfTheRun(loop, read_orders(run_dir / LINK_LOG))
            else:
                # the slack of the tick before, in which the bus came back or did not
                bus.may_open = tick.reopened
                loop.rest(tick.counter_ns)
            if tick.number < 0:
                break
            if tick.slips > loop.slips:
                loop.count_slips(tick.slips - loop.slips)
            bus.load(tick)
            clock.wait_until(tick.counter_ns)
            loop.run_tick()
    finally:
        journal.close()
    if loop is None:
        raise ReplayRefused(f"{run_dir / CAN_LOG}: holds no whole tick")
    cut = [extent.cut for extent in (can_log, link_log) if extent.cut]
    for words in cut:
        tell(f"{words}: the run was cut off there; replayed and compared up to tick {loop.tick - 1}")
    killed = bool(cut) or run.get("lockstep") is False  # in real time one log may be a tick ahead of the other
    if killed and not (cut or two_way or no_link_beginning) and (out_dir / LINK_LOG).stat().st_size != link_log.length:
        tell(f"{run_dir / LINK_LOG} ends at another tick than {CAN_LOG}: flight was killed; compared as far as both go")
    if no_link_beginning:
        tell(f"{run_dir / LINK_LOG}: not compared, its beginning was dropped to keep the limit of its size")
    return Outcome(
        loop.tick,
        first_difference(run_dir / CAN_LOG, out_dir / CAN_LOG, can_log.length if cut else None),
        None
        if two_way or no_link_beginning
        else first_difference(run_dir / LINK_LOG, out_dir / LINK_LOG, link_log.length if killed else None),
    )
