"""What flight drained and sent, in order: `can.log` in candump text and `link.tlog`.

In the tick a frame is copied into a preallocated ring and nothing more. Formatting and writing happen in the slack.
A full ring drops its oldest entry and counts it: a slow disk never delays navigation.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path

_CAN_SLOTS = 4096
_CAN_ENTRY = struct.Struct("<qHH64s")
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


def candump_line(unix_ns: int, frame_id: int, payload: bytes) -> str:
    """One frame as `candump -L` writes it: CAN FD, bit-rate switch on, channel can0."""
    seconds, rest = divmod(unix_ns, 1_000_000_000)
    return f"({seconds}.{rest // 1000:06d}) can0 {frame_id:03X}##1{payload.hex().upper()}\n"


class Journal:
    """Both logs of one run. Without a folder it keeps nothing, at the same cost in the tick."""

    __slots__ = ("_can", "_can_fd", "_link", "_link_fd")

    def __init__(self, folder: Path | None) -> None:
        self._can = Ring(_CAN_ENTRY, _CAN_SLOTS)
        self._link = Ring(_LINK_ENTRY, _LINK_SLOTS)
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        self._can_fd = os.open(folder / "can.log", flags, 0o644) if folder else -1
        self._link_fd = os.open(folder / "link.tlog", flags, 0o644) if folder else -1

    @property
    def dropped(self) -> int:
        """Entries lost to a full ring."""
        return self._can.dropped + self._link.dropped

    def frame(self, unix_ns: int, frame_id: int, payload: bytes | bytearray) -> None:
        """Note a frame that was drained or sent."""
        self._can.push(unix_ns, frame_id, len(payload), payload)

    def link(self, unix_ns: int, message: bytes | bytearray) -> None:
        """Note a MAVLink message that was sent or received."""
        self._link.push(unix_ns, len(message), message)

    def write_slice(self) -> None:
        """Write a bounded part of what waits; a slack job."""
        if self._can.count:
            lines = []
            for _ in range(min(self._can.count, _SLICE)):
                unix_ns, frame_id, length, payload = self._can.pop()
                lines.append(candump_line(unix_ns, frame_id, payload[:length]))  # type: ignore[index]
            if self._can_fd >= 0:
                os.write(self._can_fd, "".join(lines).encode())
        if self._link.count:
            parts = []
            for _ in range(min(self._link.count, _SLICE)):
                unix_ns, length, message = self._link.pop()
                parts.append(_LINK_TIME.pack(unix_ns // 1000) + message[:length])  # type: ignore[index]
            if self._link_fd >= 0:
                os.write(self._link_fd, b"".join(parts))

    def close(self) -> None:
        """Write everything that waits and close the files."""
        while self._can.count or self._link.count:
            self.write_slice()
        for fd in (self._can_fd, self._link_fd):
            if fd >= 0:
                os.close(fd)
        self._can_fd = self._link_fd = -1
