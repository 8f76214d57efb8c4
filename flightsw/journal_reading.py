"""A journal read back: ticks out of can.log, orders of the ground out of link.tlog, as far as they are whole.

A flight that was killed leaves logs that end anywhere. They are read up to the last whole tick, and what is missing is
said; damage before the end is refused.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from flightsw.icd.can_frames import FLIGHT_HEARTBEAT
from flightsw.icd.log_parts import all_parts, lacks_beginning
from flightsw.journal import BUS_LOST, BUS_REOPENED, ERROR, EXTENDED, REMOTE, TABLE_SWAPPED
from flightsw.link.mavlink_out import SYSTEM_ID

_HEARTBEAT = struct.Struct(FLIGHT_HEARTBEAT.struct_format)
_LINE = re.compile(rb"\((\d+)\.(\d{6})\) \S+ ([0-9A-F]{3}|[0-9A-F]{8})#(R|#1|)((?:[0-9A-F]{2})*) ([RT])")
_FRAMES_OF_A_TICK = 3  # NAV_STATE, INTEGRITY, FLIGHT_HEARTBEAT
_STAMP, _SHORTEST, _SIGNATURE = 8, 12, 13
_CHUNK = 1 << 20


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


@dataclass
class Extent:
    """How far a log is whole. `length`: bytes, over all parts. `cut`: how it ends beyond that, in words, or empty."""

    length: int = 0
    cut: str = ""


def read_ticks(path: Path, extent: Extent | None = None) -> Iterator[Tick]:
    """Ticks of a can.log and its parts, in order; ReplayRefused names the first line that is not of flight's making.

    A tick's heartbeat is the last frame it sends; a note that this very frame could not be sent follows it. extent:
    filled in with how far the log is whole.
    """
    extent = extent if extent is not None else Extent()
    if lacks_beginning(path):
        raise ReplayRefused(
            f"{path}: its beginning was dropped to keep the limit of its size; such a flight cannot be repeated: give "
            "a run a larger --log-limit"
        )
    tick, sent, expected, at = Tick(), 0, 0, 0
    ended: Tick | None = None
    for place, line in _lines(path):
        if not line.endswith(b"\n"):
            extent.cut = f"{place} is cut off"
            break
        unix_ns, can_id, received, payload = _parse(place, line)
        at += len(line)
        lost = not received and can_id == BUS_LOST
        if ended is not None:
            if lost and unix_ns == ended.unix_ns:
                ended.lost_sending = _FRAMES_OF_A_TICK - 1
                extent.length = at
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
                f"{place}: another navigation table was activated in flight; such a flight can be repeated up to here "
                "only"
            )
        elif can_id == BUS_REOPENED:
            tick.reopened = True
            extent.length = at
        elif can_id == FLIGHT_HEARTBEAT.frame_id:
            if len(payload) != FLIGHT_HEARTBEAT.length:
                raise ReplayRefused(f"{place}: a heartbeat of {len(payload)} bytes")
            tick.number, tick.counter_ns, tick.slips = _HEARTBEAT.unpack(payload)[:3]
            if tick.number != expected:
                raise ReplayRefused(
                    f"{place}: tick {tick.number} where {expected} should be: the journal lost entries "
                    "(LEONAV_COUNTERS.journal_dropped), such a flight cannot be repeated"
                )
            tick.unix_ns = unix_ns
            ended, tick, sent, expected = tick, Tick(), 0, expected + 1
            extent.length = at
        else:
            sent += 1
    if at != extent.length and not extent.cut:
        extent.cut = f"{path} ends within tick {expected}"
    if ended is not None:
        yield ended
    if tick.reopened:  # in the slack of the last tick
        yield tick


def _lines(path: Path) -> Iterator[tuple[str, bytes]]:
    """(where it stands, line) of all parts; a cut line is joined to nothing, for parts end with whole ones."""
    for part in all_parts(path):
        with part.open("rb") as lines:
            for number, line in enumerate(lines, 1):
                yield f"{part}: line {number}", line


def _parse(place: str, line: bytes) -> tuple[int, int, bool, bytes]:
    match = _LINE.fullmatch(line.rstrip(b"\n"))
    if match is None:
        raise ReplayRefused(f"{place} is not candump text with directions (candump -L -x) as flight writes it")
    seconds, micros, name, kind, data, direction = (text.decode("ascii") for text in match.groups())
    can_id = int(name, 16)
    if kind == "R":
        can_id |= REMOTE
    if len(name) == 8 and not (kind == "" and can_id & ERROR):
        can_id |= EXTENDED
    unix_ns = int(seconds) * 1_000_000_000 + int(micros) * 1000
    return unix_ns, can_id, direction == "R", bytes.fromhex(data)


def read_frames(path: Path, extent: Extent | None = None) -> Iterator[tuple[int, bytes]]:
    """(log time [us], frame) of a link.tlog and its parts, as far as they are whole."""
    extent = extent if extent is not None else Extent()
    for part in all_parts(path):
        data, at = part.read_bytes(), 0
        while at < len(data):
            whole = at + _STAMP + _SHORTEST <= len(data)
            length = 0
            if whole:
                length = _SHORTEST + data[at + _STAMP + 1] + (_SIGNATURE if data[at + _STAMP + 2] & 1 else 0)
            if not whole or at + _STAMP + length > len(data):
                extent.cut = f"{part} ends within a message, {len(data) - at} bytes of it"
                return
            yield int.from_bytes(data[at : at + _STAMP], "big"), data[at + _STAMP : at + _STAMP + length]
            at += _STAMP + length
            extent.length += _STAMP + length


def read_orders(path: Path) -> dict[int, list[bytes]]:
    """What the ground sent and flight took, by the log time [us] of the tick that took it: frames not of flight's."""
    found: dict[int, list[bytes]] = {}
    for t_us, frame in read_frames(path):
        if frame[5] != SYSTEM_ID:
            found.setdefault(t_us, []).append(frame)
    return found


def link_extent(path: Path) -> Extent:
    """How far a link.tlog is whole."""
    extent = Extent()
    for _ in read_frames(path, extent):
        pass
    return extent


def first_difference(run_log: Path, replayed: Path, length: int | None = None) -> int | None:
    """Offset of the first byte in which a log, all its parts, and a replayed one differ, or None.

    length: compare no more than so many bytes, and no end of either.
    """
    at = 0
    with replayed.open("rb") as other:
        for part in all_parts(run_log):
            with part.open("rb") as one:
                while chunk := one.read(_CHUNK):
                    if length is not None:
                        chunk = chunk[: max(0, length - at)]
                    again = other.read(len(chunk))
                    if chunk != again:
                        shared = min(len(chunk), len(again))
                        differs = next((i for i in range(shared) if chunk[i] != again[i]), shared)
                        if differs < shared or length is None:
                            return at + differs
                        return None
                    at += len(chunk)
        return at if length is None and other.read(1) else None
