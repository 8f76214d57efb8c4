"""Frames into epochs of pseudoranges: rows of one time, and the count that ends them.

Only a complete epoch, newer than the last and measured not long ago, goes on; anything else changes a counter and
nothing more. What the rows say is not judged here: a number that is none goes on to the test, which names it.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from flightsw.gnss.records import CONSTELLATIONS, EPHEMERIDES, RAW, SATELLITES
from flightsw.icd.can_frames import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_RANGES
from flightsw.icd.enums import RejectCause, SyncStatus

EPOCHS = 4  # complete epochs that one tick can hold
PER_FRAME = 3

_RANGES = struct.Struct(GNSS_RANGES.struct_format)
_EPOCH = struct.Struct(GNSS_EPOCH.struct_format)
_EPHEMERIS = struct.Struct(GNSS_EPHEMERIS.struct_format)
_VALID = int(SyncStatus.VALID)
_INCOMPLETE = int(RejectCause.INCOMPLETE_EPOCH)
_OUT_OF_RANGE = int(RejectCause.OUT_OF_RANGE)
_NOT_FINITE = int(RejectCause.NOT_FINITE)
_STALE = int(RejectCause.TIME_STALE)
_FUTURE = int(RejectCause.TIME_FUTURE)
_REPEATED = int(RejectCause.TIME_REPEATED)
_OVERFLOW = int(RejectCause.RECEIVE_OVERFLOW)
_NO_TIME = -(2**63)


class RawAssembly:
    """Collects epochs in preallocated records: `raws` of RAW, the first `count` are complete, the next is being filled.

    `ephemerides` (1,): the last place of every satellite. Epochs are in order of the onboard counter: a receiver whose
    clock once jumps ahead must not be refused for ever.
    """

    __slots__ = (
        *("_fields", "_known", "_last_counter_ns", "_latency_ns", "_rejected", "_rows", "_t_gps_ns"),
        *("count", "ephemerides", "raws"),
    )

    def __init__(self, rejected: list[int], latency_max_s: float) -> None:
        self._rejected = rejected
        self._latency_ns = round(latency_max_s * 1e9)
        self.raws = np.zeros(EPOCHS + 1, RAW)
        self._fields = {name: self.raws[name] for name in RAW.names or ()}
        self.ephemerides = np.zeros(1, EPHEMERIDES)
        self._known = {name: self.ephemerides[name][0] for name in EPHEMERIDES.names or ()}
        self._t_gps_ns = _NO_TIME  # of the epoch that is being collected
        self._rows = 0
        self._last_counter_ns = _NO_TIME
        self.count = 0

    def clear(self) -> None:
        """Forget the complete epochs; the one that is being collected moves to the front."""
        if self.count and self._rows:
            self.raws[0] = self.raws[self.count]
        self.count = 0

    def times(self, index: int) -> tuple[int, int]:
        """Time of a complete epoch by the receiver, and by the onboard counter [ns]."""
        return int(self._fields["t_gps_ns"][index]), int(self._fields["t_counter_ns"][index])

    def take_ranges(self, frame: bytearray) -> None:
        """One GNSS_RANGES frame, checked by the codec."""
        values = _RANGES.unpack(frame)
        t_gps_ns, count = values[0], values[1]
        if not 1 <= count <= PER_FRAME:
            self._rejected[_OUT_OF_RANGE] += 1
            return
        if t_gps_ns != self._t_gps_ns:
            self._begin(t_gps_ns)
        place = self.count
        fields = self._fields
        for k in range(count):
            range_m, sigma_m, satellite, constellation, _cn0 = values[2 + 5 * k : 7 + 5 * k]
            row = self._rows
            self._rows += 1
            if row < SATELLITES:
                fields["satellite"][place, row] = satellite
                fields["constellation"][place, row] = constellation
                fields["range_m"][place, row] = range_m
                fields["sigma_m"][place, row] = sigma_m

    def take_epoch(self, frame: bytearray, counter_now_ns: int) -> None:
        """One GNSS_EPOCH frame, checked by the codec. counter_now_ns: of this tick."""
        t_gps_ns, t_counter_ns, count = _EPOCH.unpack(frame)[:3]
        rows, same = self._rows, self._t_gps_ns == t_gps_ns
        self._t_gps_ns, self._rows = _NO_TIME, 0
        if same != (rows > 0) or rows != count:  # an epoch of no satellite has no rows
            self._rejected[_INCOMPLETE] += 1
        elif t_counter_ns > counter_now_ns:
            self._rejected[_FUTURE] += 1
        elif t_counter_ns < counter_now_ns - self._latency_ns:
            self._rejected[_STALE] += 1
        elif t_counter_ns <= self._last_counter_ns:
            self._rejected[_REPEATED] += 1
        elif self.count == EPOCHS:
            self._rejected[_OVERFLOW] += 1
        else:
            self._last_counter_ns = t_counter_ns
            fields, place = self._fields, self.count
            fields["t_gps_ns"][place] = t_gps_ns
            fields["t_counter_ns"][place] = t_counter_ns
            fields["count"][place] = count
            self.count += 1

    def take_ephemeris(self, frame: bytearray) -> None:
        """One GNSS_EPHEMERIS frame, checked by the codec: a new place, or that there is none to use."""
        values = _EPHEMERIS.unpack(frame)
        issue, satellite, constellation, status = values[9:13]
        if not (1 <= satellite <= SATELLITES and constellation < CONSTELLATIONS):
            self._rejected[_OUT_OF_RANGE] += 1
            return
        known, at = self._known, (constellation, satellite - 1)
        if status != _VALID:
            known["known"][at] = 0
            return
        if not math.isfinite(sum(values[1:9])):
            # what went before is not believed any longer either: the sender has changed its mind
            known["known"][at] = 0
            self._rejected[_NOT_FINITE] += 1
            return
        known["known"][at] = 1
        known["issue"][at] = issue
        known["t_ref_gps_ns"][at] = values[0]
        known["r_m"][at] = values[1:4]
        known["clock_m"][at] = values[4]
        known["v_mps"][at] = values[5:8]
        known["clock_drift_mps"][at] = values[8]

    def _begin(self, t_gps_ns: int) -> None:
        if self._rows:
            self._rejected[_INCOMPLETE] += 1
        self._t_gps_ns, self._rows = t_gps_ns, 0
