"""Frames of the crosslink terminal, kept as they come and taken together: flightsw/crosslink/assembly.py.

A frame of the terminal comes two dozen times in a tick of the second; read one by one in Python they would be a third
of the longest ticks.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flightsw.crosslink.assembly import crosslink_fill, crosslink_take
from flightsw.crosslink.records import ASSEMBLY, ASSEMBLY_TABLE
from flightsw.icd.can_frames import CROSSLINK_EPHEMERIS, CROSSLINK_RANGES
from flightsw.icd.frame_layout import FrameLayout

_FRAMES = 64  # of one kind that wait; what is more is taken at once


class _Pile:
    """Frames of one kind, one after the other."""

    __slots__ = ("_length", "_view", "count", "frames")

    def __init__(self, layout: FrameLayout) -> None:
        memory = bytearray(_FRAMES * layout.length)
        self.frames = np.frombuffer(memory, layout.dtype)
        self.count = 0
        self._view = memoryview(memory)
        self._length = layout.length

    def put(self, frame: bytearray) -> bool:
        """Keep a copy; True where no other has room."""
        place = self.count * self._length
        self._view[place : place + self._length] = frame
        self.count += 1
        return self.count == _FRAMES


class CrosslinkAssembly:
    """Collects epochs in preallocated records. table: values (1,) of a crosslink table. rejected: by RejectCause.

    `assemble` takes what has come; `ready` then says that a complete epoch waits, `fill` puts it into a monitor's
    record. now_gps_ns: tells onboard time, 0 while it is not known.
    """

    __slots__ = ("_messages", "_now", "_ranges", "_record", "_refused", "_state", "_table", "rejected")

    def __init__(self, table: np.ndarray, rejected: list[int], now_gps_ns: Callable[[], int]) -> None:
        self._table = np.zeros(1, ASSEMBLY_TABLE)
        given = table[0]
        for name in ASSEMBLY_TABLE.names or ():
            if not name.endswith("_ns"):
                self._table[name] = given[name]
        self._table["latency_ns"] = round(float(given["latency_max_s"]) * 1e9)
        self._table["future_ns"] = round(float(given["future_max_s"]) * 1e9)
        self._table.flags.writeable = False
        self._state = np.zeros(1, ASSEMBLY)
        self._state["last_gps_ns"] = self._state["t_gps_ns"] = -1
        self._record = self._state[0]
        self._refused = self._state["rejected"][0]
        self._messages, self._ranges = _Pile(CROSSLINK_EPHEMERIS), _Pile(CROSSLINK_RANGES)
        self._now = now_gps_ns
        self.rejected = rejected

    @property
    def ready(self) -> bool:
        """Whether a complete epoch waits."""
        return bool(self._record["ready"])

    @property
    def incomplete(self) -> int:
        """Epochs that never were complete, modulo 65536."""
        return int(self._record["incomplete"])

    def take_ephemeris(self, frame: bytearray) -> None:
        """One CROSSLINK_EPHEMERIS frame, checked by the codec."""
        if self._messages.put(frame):
            self.assemble()

    def take_ranges(self, frame: bytearray) -> None:
        """One CROSSLINK_RANGES frame, checked by the codec."""
        if self._ranges.put(frame):
            self.assemble()

    def assemble(self) -> None:
        """Take the frames that wait, and count what of them is refused."""
        messages, ranges = self._messages, self._ranges
        if not messages.count and not ranges.count:
            return
        crosslink_take(
            *(self._table, self._state, messages.frames, messages.count, ranges.frames, ranges.count, self._now())
        )
        messages.count = ranges.count = 0
        if self._refused.any():
            for cause in self._refused.nonzero()[0].tolist():
                self.rejected[cause] += int(self._refused[cause])
            self._refused[:] = 0

    def fill(self, epoch: np.ndarray) -> None:
        """Put the complete epoch into a monitor's record (1,): every message at the instant of the epoch."""
        crosslink_fill(self._table, self._state, epoch)
