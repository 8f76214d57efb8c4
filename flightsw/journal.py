"""What flight drained and sent, in order: `can.log` in candump text and `link.tlog`.

In the tick a frame is copied into a preallocated ring and nothing more. Formatting and writing happen in the slack.
A full ring drops its oldest entry and counts it: a slow disk never delays navigation. A disk that takes nothing is
asked again in every slack; meanwhile the rings fill, and what falls out of them is counted and told.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

from flightsw.rotating_file import RotatingFile

CAN_LOG, LINK_LOG = "can.log", "link.tlog"

# Identifiers carry these flags as in Linux SocketCAN (can.h).
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000
# Flight's own notes about its bus: error frames that it "sent", which no bus ever carries (error classes of
# linux/can/error.h). Without them a replay could not know when flight was deaf.
BUS_LOST = ERROR | 0x40
BUS_REOPENED = ERROR | 0x100
# Likewise: from the next tick on another navigation table flies. A replay, which has one table, stops here.
TABLE_SWAPPED = ERROR | 0x200

_CAN_SLOTS = 4096
_CAN_ENTRY = struct.Struct("<qI?B64s")
_LINK_SLOTS = 1024
_LINK_ENTRY = struct.Struct("<qH280s")
_LINK_TIME = struct.Struct(">Q")
_SLICE = 512  # entries written by one slice of slack work


class Ring:
    """A fixed number of equal slots; pushing into a full ring overwrites the oldest slot and counts it."""

    __slots__ = ("_entry", "_first", "_slots", "_store", "count", "dropped")

    def __init__(self, entry: struct.Struct, slots: int) -> None:
        self._entry = entry
        self._slots = slots
        self._store = bytearray(entry.size * slots)
        self._first = 0
        self.count = 0
        self.dropped = 0

    def push(self, *values: int | bytes | bytearray) -> None:
        """Copy one entry in."""
        if self.count == self._slots:
            self._first = (self._first + 1) % self._slots
            self.count -= 1
            self.dropped += 1
        place = (self._first + self.count) % self._slots
        self._entry.pack_into(self._store, place * self._entry.size, *values)
        self.count += 1

    def pop(self) -> tuple[int, ...]:
        """Take the oldest entry out; the ring must not be empty."""
        values = self._entry.unpack_from(self._store, self._first * self._entry.size)
        self._first = (self._first + 1) % self._slots
        self.count -= 1
        return values


def candump_line(unix_ns: int, can_id: int, received: bool, payload: bytes) -> str:
    """One frame as `candump -L -x` writes it: channel can0, R received or T sent; data frames as CAN FD, BRS on."""
    seconds, rest = divmod(unix_ns, 1_000_000_000)
    if can_id & ERROR:
        frame = f"{can_id & 0x3FFFFFFF:08X}#{payload.hex().upper()}"
    else:
        name = f"{can_id & 0x1FFFFFFF:08X}" if can_id & EXTENDED else f"{can_id & 0x7FF:03X}"
        frame = f"{name}#R" if can_id & REMOTE else f"{name}##1{payload.hex().upper()}"
    return f"({seconds}.{rest // 1000:06d}) can0 {frame} {'R' if received else 'T'}\n"


class _Log:
    """A ring and the file its entries end in, in order. Nothing is lost to a failed write but what the ring drops."""

    __slots__ = ("_file", "_render", "_rest", "ring")

    def __init__(self, ring: Ring, file: RotatingFile | None, render: Callable[[Ring, int], bytes]) -> None:
        self.ring = ring
        self._render = render
        self._rest = b""  # rendered, not yet taken by the disk
        self._file = file

    def write_slice(self) -> bool:
        """Write a bounded part of what waits; False if the disk took nothing of it."""
        if not self._rest:
            if not self.ring.count:
                return True
            self._rest = self._render(self.ring, min(self.ring.count, _SLICE))
        if self._file is None:
            self._rest = b""
            return True
        try:
            written = self._file.write(self._rest)
        except OSError:
            return False
        self._rest = self._rest[written:]
        if not self._rest:
            self._file.turn()
        return written > 0

    def close(self) -> None:
        while (self._rest or self.ring.count) and self.write_slice():
            pass
        self.ring.dropped += self.ring.count + (1 if self._rest else 0)
        if self._file is not None:
            self._file.close()
        self._file = None


def _render_can(ring: Ring, count: int) -> bytes:
    lines = []
    for _ in range(count):
        unix_ns, can_id, received, length, payload = ring.pop()
        lines.append(candump_line(unix_ns, can_id, bool(received), payload[:length]))  # type: ignore[index]
    return "".join(lines).encode()


def _render_link(ring: Ring, count: int) -> bytes:
    parts = []
    for _ in range(count):
        unix_ns, length, message = ring.pop()
        parts.append(_LINK_TIME.pack(unix_ns // 1000) + message[:length])  # type: ignore[index]
    return b"".join(parts)


class Journal:
    """Both logs of one run. Without a folder it keeps nothing, at the same cost in the tick.

    limit_bytes: of each log; the oldest part of it goes before it is larger. None: no limit.
    """

    __slots__ = ("_can", "_can_log", "_link", "_link_log")

    def __init__(self, folder: Path | None, limit_bytes: int | None = None) -> None:
        self._can = Ring(_CAN_ENTRY, _CAN_SLOTS)
        self._link = Ring(_LINK_ENTRY, _LINK_SLOTS)
        self._can_log = _Log(self._can, RotatingFile(folder / CAN_LOG, limit_bytes) if folder else None, _render_can)
        link = RotatingFile(folder / LINK_LOG, limit_bytes) if folder else None
        self._link_log = _Log(self._link, link, _render_link)

    @property
    def dropped(self) -> int:
        """Entries lost to a full ring."""
        return self._can.dropped + self._link.dropped

    def frame(self, unix_ns: int, can_id: int, received: bool, payload: bytes | bytearray) -> None:
        """Note a frame that was drained or sent; the identifier with its flags."""
        self._can.push(unix_ns, can_id, received, len(payload), payload)

    def bus(self, unix_ns: int, note: int) -> None:
        """Note BUS_LOST or BUS_REOPENED."""
        self._can.push(unix_ns, note, False, 8, b"")

    def link(self, unix_ns: int, message: bytes | bytearray) -> None:
        """Note a MAVLink message that was sent or received."""
        self._link.push(unix_ns, len(message), message)

    def write_slice(self) -> None:
        """Write a bounded part of what waits; a slack job."""
        self._can_log.write_slice()
        self._link_log.write_slice()

    def close(self) -> None:
        """Write what waits, as far as the disk takes it, and close the files."""
        self._can_log.close()
        self._link_log.close()
