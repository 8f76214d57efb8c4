"""Replay: the journal of a run fed into flight alone. Same inputs, same tables: same outbound bytes.

Flight is a function of tables and journal. A tick's inputs are the sensor frames journalled before its heartbeat,
which also carries the counter the tick ran at.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import can

from flightsw import app
from flightsw.can_port import CanPort
from flightsw.clock import LockstepClock
from flightsw.icd.can_frames import FLIGHT_HEARTBEAT, LAYOUTS
from flightsw.journal import Journal
from flightsw.kernels.kernel_cache import source_hash
from flightsw.link.mavlink_out import Nowhere

_PUBLISHED = frozenset(layout.frame_id for layout in LAYOUTS.values() if layout.sender == FLIGHT_HEARTBEAT.sender)
_HEARTBEAT = struct.Struct(FLIGHT_HEARTBEAT.struct_format)


class ReplayRefused(ValueError):
    """The folder cannot be replayed; the text says why."""


class Tick(NamedTuple):
    """One tick of a journal: the counter it ran at, its log time, the frames it drained."""

    counter_ns: int
    unix_ns: int
    frames: list[tuple[int, bytes]]


def read_ticks(path: Path) -> Iterator[Tick]:
    """Ticks of a can.log, in order; ReplayRefused names the first line that is not of flight's making."""
    frames: list[tuple[int, bytes]] = []
    with path.open(encoding="ascii", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            try:
                stamp, _channel, content = line.split()
                frame_id_text, _, rest = content.partition("##")
                frame_id, payload = int(frame_id_text, 16), bytes.fromhex(rest[1:])
                seconds, _, micros = stamp.strip("()").partition(".")
                unix_ns = int(seconds) * 1_000_000_000 + int(micros) * 1000
            except ValueError:
                raise ReplayRefused(f"{path}: line {number} is not candump text of a CAN FD frame") from None
            if frame_id == FLIGHT_HEARTBEAT.frame_id:
                yield Tick(_HEARTBEAT.unpack(payload)[1], unix_ns, frames)
                frames = []
            elif frame_id not in _PUBLISHED:
                frames.append((frame_id, payload))


class _JournalBus:
    """Stands where the bus was: gives what was drained, takes what is sent and drops it (the journal has it)."""

    def __init__(self) -> None:
        self._waiting: list[can.Message] = []

    def load(self, frames: list[tuple[int, bytes]]) -> None:
        self._waiting = [
            can.Message(arbitration_id=frame_id, data=payload, is_extended_id=False, is_fd=True)
            for frame_id, payload in reversed(frames)
        ]

    def recv(self, timeout: float | None = None) -> can.Message | None:
        del timeout
        return self._waiting.pop() if self._waiting else None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        del msg, timeout

    def shutdown(self) -> None:
        self._waiting = []


class Outcome(NamedTuple):
    """What a replay found: ticks flown, and where each log first differs (byte offset), or None."""

    ticks: int
    can_differs_at: int | None
    link_differs_at: int | None

    @property
    def identical(self) -> bool:
        """Whether flight said the same again, byte for byte."""
        return self.can_differs_at is None and self.link_differs_at is None


def check_versions(run_dir: Path) -> list[str]:
    """What differs between the flight of the run and this one, in words; ReplayRefused if the folder is no run."""
    try:
        run = json.loads((run_dir / "run.json").read_text())
    except (OSError, ValueError) as error:
        raise ReplayRefused(f"{run_dir}: no readable run.json; give the folder that a run left ({error})") from None
    differences = []
    if run.get("flight_source_sha256") != source_hash():
        differences.append("the compiled flight code is not that of the run")
    for image, name in zip(app.load_tables(run_dir / "tables"), ("navigation", "earth_orientation"), strict=True):
        wanted = run.get("tables", {}).get(name, {}).get("crc32")
        if wanted != image.crc32:
            differences.append(f"table {name} has CRC {image.crc32:08x}, the run flew {wanted!r}")
    return differences


def replay(run_dir: Path, out_dir: Path) -> Outcome:
    """Fly the journal of `run_dir` again, writing can.log and link.tlog into `out_dir`, and compare the two."""
    for name in ("can.log", "link.tlog"):
        if not (run_dir / name).is_file():
            raise ReplayRefused(f"{run_dir / name}: missing; give the folder that a run left")
    navigation, orientation = app.load_tables(run_dir / "tables")
    out_dir.mkdir(parents=True, exist_ok=True)
    journal = Journal(out_dir)
    bus = _JournalBus()
    loop = None
    try:
        for tick in read_ticks(run_dir / "can.log"):
            if loop is None:
                clock = LockstepClock(tick.counter_ns)
                port = CanPort(lambda: bus)  # type: ignore[arg-type, return-value]
                loop = app.build(navigation, orientation, clock, port, journal, Nowhere(), tick.unix_ns)
            bus.load(tick.frames)
            clock.wait_until(tick.counter_ns)
            loop.run_tick()
            loop.rest(tick.counter_ns)
    finally:
        journal.close()
    if loop is None:
        raise ReplayRefused(f"{run_dir / 'can.log'}: holds no tick")
    return Outcome(
        loop.tick,
        first_difference(run_dir / "can.log", out_dir / "can.log"),
        first_difference(run_dir / "link.tlog", out_dir / "link.tlog"),
    )


def first_difference(first: Path, second: Path) -> int | None:
    """Offset of the first byte in which two files differ, or None if they are the same."""
    a, b = first.read_bytes(), second.read_bytes()
    if a == b:
        return None
    return next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
