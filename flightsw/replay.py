"""Replay: the journal of a run fed into flight alone. Same inputs, same tables: same outbound bytes.

Flight is a function of tables, checkpoint and journal. A tick's inputs are the frames noted as received before its
heartbeat, which also carries the counter the tick ran at and the slips counted until then, and the notes on a lost bus.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import can

from flightsw import app
from flightsw.can_port import CanPort
from flightsw.checkpoint import CheckpointRefused, Resume
from flightsw.clock import LockstepClock
from flightsw.icd.can_frames import FLIGHT_HEARTBEAT
from flightsw.icd.table_file import TableImage
from flightsw.journal import BUS_LOST, BUS_REOPENED, ERROR, EXTENDED, REMOTE, TABLE_SWAPPED, Journal
from flightsw.link.access import Access
from flightsw.link.mavlink_out import SYSTEM_ID, Nowhere
from flightsw.link_port import LinkPort
from flightsw.main_loop import MainLoop
from flightsw.provenance import differences, identity

_HEARTBEAT = struct.Struct(FLIGHT_HEARTBEAT.struct_format)
_LINE = re.compile(r"\((\d+)\.(\d{6})\) \S+ ([0-9A-F]{3}|[0-9A-F]{8})#(R|#1|)((?:[0-9A-F]{2})*) ([RT])")


class ReplayRefused(ValueError):
    """The folder cannot be replayed; the text says why."""


@dataclass
class Tick:
    """One tick of a journal: what it ran at, the frames it drained, and how its bus fared.

    `reopened`: the bus was brought back in the slack before this tick; after the last one such a tick has no number.
    A failure is noted by where it struck: `lost_receiving`, after the last of the frames, or `lost_sending`, the index
    of the frame that could not be sent.
    """

    frames: list[tuple[int, bytes]] = field(default_factory=list)
    number: int = -1
    counter_ns: int = 0
    unix_ns: int = 0
    slips: int = 0
    reopened: bool = False
    lost_receiving: bool = False
    lost_sending: int | None = None


def read_ticks(path: Path) -> Iterator[Tick]:
    """Ticks of a can.log, in order; ReplayRefused names the first line that is not of flight's making.

    A tick's heartbeat is the last frame it sends; a note that this very frame could not be sent follows it.
    """
    tick, sent, expected = Tick(), 0, 0
    ended: Tick | None = None
    with path.open(encoding="ascii", errors="replace") as lines:
        for line_number, line in enumerate(lines, 1):
            unix_ns, can_id, received, payload = _parse(path, line_number, line)
            lost = not received and can_id == BUS_LOST
            if ended is not None:
                if lost and unix_ns == ended.unix_ns:
                    ended.lost_sending = _FRAMES_OF_A_TICK - 1
                    continue
                yield ended
                ended = None
            if received:
                tick.frames.append((can_id, payload))
            elif lost and sent:
                tick.lost_sending = sent - 1
            elif lost:
                tick.lost_receiving = True
            elif can_id == TABLE_SWAPPED:
                raise ReplayRefused(
                    f"{path}: line {line_number}: another navigation table was activated in flight; such a flight can "
                    "be repeated up to here only"
                )
            elif can_id == BUS_REOPENED:
                tick.reopened = True
            elif can_id == FLIGHT_HEARTBEAT.frame_id:
                if len(payload) != FLIGHT_HEARTBEAT.length:
                    raise ReplayRefused(f"{path}: line {line_number}: a heartbeat of {len(payload)} bytes")
                tick.number, tick.counter_ns, tick.slips = _HEARTBEAT.unpack(payload)[:3]
                if tick.number != expected:
                    raise ReplayRefused(
                        f"{path}: line {line_number}: tick {tick.number} where {expected} should be: the journal lost "
                        "entries (LEONAV_COUNTERS.journal_dropped), such a flight cannot be repeated"
                    )
                tick.unix_ns = unix_ns
                ended, tick, sent, expected = tick, Tick(), 0, expected + 1
            else:
                sent += 1
    if ended is not None:
        yield ended
    if tick.reopened:  # in the slack of the last tick
        yield tick


_FRAMES_OF_A_TICK = 3  # NAV_STATE, INTEGRITY, FLIGHT_HEARTBEAT


def _parse(path: Path, line_number: int, line: str) -> tuple[int, int, bool, bytes]:
    match = _LINE.fullmatch(line.rstrip("\n"))
    if match is None:
        raise ReplayRefused(
            f"{path}: line {line_number} is not candump text with directions (candump -L -x) as flight writes it"
        )
    seconds, micros, name, kind, data, direction = match.groups()
    can_id = int(name, 16)
    if kind == "R":
        can_id |= REMOTE
    if len(name) == 8 and not (kind == "" and can_id & ERROR):
        can_id |= EXTENDED
    unix_ns = int(seconds) * 1_000_000_000 + int(micros) * 1000
    return unix_ns, can_id, direction == "R", bytes.fromhex(data)


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


def read_orders(path: Path) -> dict[int, list[bytes]]:
    """What the ground sent and flight took, by the log time [us] of the tick that took it: frames not of flight's."""
    data, at = path.read_bytes(), 0
    found: dict[int, list[bytes]] = {}
    while at + 8 + 12 <= len(data):
        length = 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
        frame = data[at + 8 : at + 8 + length]
        if frame[5] != SYSTEM_ID:
            found.setdefault(int.from_bytes(data[at : at + 8], "big"), []).append(frame)
        at += 8 + length
    return found


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
    resume = _resume(run_dir, run, navigation)
    return differences(run, identity(navigation, orientation, *(forces or ()), resume=resume))


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


def replay(run_dir: Path, out_dir: Path) -> Outcome:
    """Fly the journal of `run_dir` again, writing can.log and link.tlog into `out_dir`, and compare the two."""
    for name in ("can.log", "link.tlog"):
        if not (run_dir / name).is_file():
            raise ReplayRefused(f"{run_dir / name}: missing; give the folder that a run left")
    run = record_of(run_dir)
    navigation, orientation = _tables(run_dir, run)
    forces = app.load_force_tables(run_dir / "tables", navigation)
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
    try:
        for tick in read_ticks(run_dir / "can.log"):
            if loop is None:
                clock = LockstepClock(tick.counter_ns)
                port = CanPort(bus.open)  # type: ignore[arg-type]
                loop = app.build(
                    navigation, orientation, clock, port, journal, Nowhere(), tick.unix_ns, None, forces, resume
                )
                if two_way:
                    _OrdersOfTheRun(loop, read_orders(run_dir / "link.tlog"))
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
        raise ReplayRefused(f"{run_dir / 'can.log'}: holds no tick")
    return Outcome(
        loop.tick,
        first_difference(run_dir / "can.log", out_dir / "can.log"),
        None if two_way else first_difference(run_dir / "link.tlog", out_dir / "link.tlog"),
    )


def first_difference(first: Path, second: Path) -> int | None:
    """Offset of the first byte in which two files differ, or None if they are the same."""
    a, b = first.read_bytes(), second.read_bytes()
    if a == b:
        return None
    return next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
