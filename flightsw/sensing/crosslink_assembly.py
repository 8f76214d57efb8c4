"""Frames of the crosslink terminal into epochs of the inter-satellite monitor.

An epoch is all ranges of one instant of reception: as many links as its frames announce. Only a complete one goes on;
anything else changes a counter and nothing more. Messages of satellites are kept as they come, and brought to the
instant of the epoch by two-body motion, for some seconds at most.
"""

from __future__ import annotations

import math
import struct
from array import array
from collections.abc import Callable

import numpy as np

from flightsw.crosslink.records import EPOCH, LINKS, SATELLITES
from flightsw.icd.can_frames import CROSSLINK_EPHEMERIS, CROSSLINK_RANGES
from flightsw.icd.enums import RejectCause

MU_M3PS2 = 3.986004418e14
NO_LINK = 255
_RESTART_NS = 60_000_000_000  # an epoch so much older than the last is no late one: the terminal began anew
_EPHEMERIS = struct.Struct(CROSSLINK_EPHEMERIS.struct_format)
_RANGES = struct.Struct(CROSSLINK_RANGES.struct_format)
_INCOMPLETE = int(RejectCause.INCOMPLETE_EPOCH)
_NOT_FINITE = int(RejectCause.NOT_FINITE)
_OUT_OF_RANGE = int(RejectCause.OUT_OF_RANGE)
_SIGMA = int(RejectCause.SIGMA)
_STALE = int(RejectCause.TIME_STALE)
_FUTURE = int(RejectCause.TIME_FUTURE)
_REPEATED = int(RejectCause.TIME_REPEATED)
_OVERFLOW = int(RejectCause.RECEIVE_OVERFLOW)


class _Pending:
    """Links of one epoch while they come in."""

    __slots__ = ("accounted", "fields", "links", "range_m", "receiver", "seen", "sender", "t_gps_ns", "total")

    def __init__(self) -> None:
        self.t_gps_ns = -1  # -1: nothing is under way
        self.total = 0  # links announced
        self.accounted = 0  # links that have come, used or not
        self.links = 0
        # Python writes into these element by element, which an ndarray is slow at
        self.receiver, self.sender = array("q", bytes(8 * LINKS)), array("q", bytes(8 * LINKS))
        self.range_m = array("d", bytes(8 * LINKS))
        self.fields = tuple(
            (name, np.frombuffer(values, dtype))
            for name, values, dtype in (
                ("receiver", self.receiver, np.int64),
                ("sender", self.sender, np.int64),
                ("range_m", self.range_m, np.float64),
            )
        )
        self.seen = bytearray(SATELLITES * SATELLITES)

    def begin(self, t_gps_ns: int, total: int) -> None:
        self.t_gps_ns, self.total = t_gps_ns, total
        self.accounted = self.links = 0
        self.seen[:] = bytes(SATELLITES * SATELLITES)


class CrosslinkAssembly:
    """Collects epochs in preallocated records. table: values (1,) of a crosslink table. rejected: by RejectCause.

    `ready` says that a complete epoch waits; `fill` puts it into a monitor's record. now_gps_ns: tells onboard time, 0
    while it is not known. `incomplete` counts epochs that never were complete, modulo 65536.
    """

    __slots__ = (
        *("_clock", "_done", "_last_gps_ns", "_pending", "_pull", "_states", "_step", "_t_ref_ns", "_table", "_weight"),
        *("_future_ns", "_latency_ns", "_now", "incomplete", "ready", "rejected"),
    )

    def __init__(self, table: np.ndarray, rejected: list[int], now_gps_ns: Callable[[], int]) -> None:
        record = table[0]
        self._table = {name: record[name].item() for name in table.dtype.names or () if np.ndim(record[name]) == 0}
        self._latency_ns = round(self._table["latency_max_s"] * 1e9)
        self._future_ns = round(self._table["future_max_s"] * 1e9)
        self.rejected = rejected
        self.ready = False
        self.incomplete = 0
        self._now = now_gps_ns
        self._last_gps_ns = -1  # of the newest epoch that was complete
        self._pending, self._done = _Pending(), _Pending()
        # of each satellite's last message: GPS time (0: none), r and v; clock, its rate, issue, healthy
        self._t_ref_ns = [0] * SATELLITES
        self._states = np.zeros((SATELLITES, 6))
        self._clock = np.zeros((SATELLITES, 4))
        self._step = np.zeros((SATELLITES, 1))
        self._pull = np.zeros((SATELLITES, 3))
        self._weight = np.zeros((SATELLITES, 1))

    # -- messages

    def take_ephemeris(self, frame: bytearray) -> None:
        """One CROSSLINK_EPHEMERIS frame, checked by the codec."""
        t_ref_ns, x, y, z, vx, vy, vz, clock_m, rate_mps, satellite, healthy, issue, _, _ = _EPHEMERIS.unpack(frame)
        table = self._table
        values = (x, y, z, vx, vy, vz, clock_m, rate_mps)
        if not all(map(math.isfinite, values)):
            self.rejected[_NOT_FINITE] += 1
            return
        radius_m, speed_mps = math.sqrt(x * x + y * y + z * z), math.sqrt(vx * vx + vy * vy + vz * vz)
        if (
            satellite >= table["satellites"]
            or t_ref_ns <= 0
            or not table["radius_min_m"] <= radius_m <= table["radius_max_m"]
            or not 0.0 < speed_mps <= table["speed_max_mps"]
            or abs(clock_m) > table["radius_max_m"]
        ):
            self.rejected[_OUT_OF_RANGE] += 1
            return
        self._t_ref_ns[satellite] = t_ref_ns
        self._states[satellite] = values[:6]
        self._clock[satellite] = (clock_m, rate_mps, issue, 1.0 if healthy else 0.0)

    # -- ranges

    def take_ranges(self, frame: bytearray) -> None:
        """One CROSSLINK_RANGES frame, checked by the codec."""
        told = _RANGES.unpack(frame)
        t_ns, ranges, sigma_m, receiver, senders, total, two_way = (
            *(told[0], told[1:6], told[6], told[7], told[8:13]),
            *(told[13], told[14]),
        )
        if not self._timely(t_ns):
            return
        if total > LINKS or total < 1 or two_way != self._table["two_way"] or receiver >= self._table["satellites"]:
            self.rejected[_OUT_OF_RANGE] += 1
            return
        pending = self._pending
        if pending.t_gps_ns != t_ns or pending.total != total:
            if pending.t_gps_ns >= 0:
                self._drop()
            pending.begin(t_ns, total)
        self._links(pending, receiver, senders, ranges, sigma_m)
        if pending.accounted >= pending.total:
            self._complete()

    def _timely(self, t_ns: int) -> bool:
        """Whether an epoch of this time can still be taken; counted if not."""
        now_ns = self._now()
        if t_ns == self._last_gps_ns:
            self.rejected[_REPEATED] += 1
        elif t_ns <= 0 or (now_ns and t_ns < now_ns - self._latency_ns):
            self.rejected[_STALE] += 1
        elif now_ns and t_ns > now_ns + self._future_ns:
            self.rejected[_FUTURE] += 1
        elif 0 < max(self._last_gps_ns, self._pending.t_gps_ns) - t_ns < _RESTART_NS:
            self.rejected[_STALE] += 1
        else:
            return True
        return False

    def _links(
        self, pending: _Pending, receiver: int, senders: tuple[int, ...], ranges: tuple[float, ...], sigma_m: float
    ) -> None:
        """Links of one frame, all of one receiver."""
        satellites, seen, pairs = self._table["satellites"], pending.seen, receiver * SATELLITES
        of_sigma = -1
        if not math.isfinite(sigma_m):
            of_sigma = _NOT_FINITE
        elif not 0.0 < sigma_m <= self._table["sigma_range_max_m"]:
            of_sigma = _SIGMA
        for sender, range_m in zip(senders, ranges, strict=True):
            if sender == NO_LINK:
                continue
            pending.accounted += 1
            if sender >= satellites or sender == receiver or pending.accounted > LINKS:
                self.rejected[_OUT_OF_RANGE] += 1
            elif not math.isfinite(range_m):
                self.rejected[_NOT_FINITE] += 1
            elif of_sigma >= 0:
                self.rejected[of_sigma] += 1
            elif seen[pairs + sender]:
                self.rejected[_REPEATED] += 1
            else:
                seen[pairs + sender] = 1
                place = pending.links
                pending.receiver[place], pending.sender[place], pending.range_m[place] = receiver, sender, range_m
                pending.links = place + 1

    def _drop(self) -> None:
        self.rejected[_INCOMPLETE] += 1
        self.incomplete = (self.incomplete + 1) & 0xFFFF

    def _complete(self) -> None:
        if self.ready:  # two in one tick: the older one is not judged
            self.rejected[_OVERFLOW] += 1
        self._pending, self._done = self._done, self._pending
        self._last_gps_ns = self._done.t_gps_ns
        self._pending.t_gps_ns = -1
        self.ready = True

    def fill(self, epoch: np.ndarray) -> None:
        """Put the complete epoch into a monitor's record (1,): every message at the instant of the epoch."""
        done, table, n = self._done, self._table, int(self._table["satellites"])
        self.ready = False
        step, states, clock = self._step, self._states, self._clock
        for satellite in range(n):
            t_ref_ns = self._t_ref_ns[satellite]
            dt_s = (done.t_gps_ns - t_ref_ns) * 1e-9
            known = t_ref_ns > 0 and abs(dt_s) <= table["ephemeris_age_max_s"]
            epoch["known"][0, satellite] = 1 if known else 0
            step[satellite, 0] = dt_s if known else 0.0
        # two-body motion, r to the third order, v to the second: better than a centimetre in five seconds
        r, v = epoch["r_m"][0, :n], epoch["v_mps"][0, :n]
        _advance(states[:n, :3], states[:n, 3:], step[:n], self._pull[:n], self._weight[:n], r, v)
        epoch["clock_m"][0, :n] = clock[:n, 0] + clock[:n, 1] * step[:n, 0]
        epoch["issue"][0, :n] = clock[:n, 2]
        epoch["healthy"][0, :n] = clock[:n, 3]
        epoch["t_gps_ns"] = done.t_gps_ns
        epoch["links"] = done.links
        for name, values in done.fields:
            epoch[name][0, : done.links] = values[: done.links]


def _advance(
    r0: np.ndarray, v0: np.ndarray, dt: np.ndarray, a: np.ndarray, w: np.ndarray, r: np.ndarray, v: np.ndarray
) -> None:
    """States (n,3) after dt (n,1) [s] of two-body motion into r and v; a (n,3), w (n,1) scratch. Taylor series."""
    np.sqrt(np.einsum("ij,ij->i", r0, r0)[:, None], out=w)
    w[w == 0.0] = 1.0
    a[:] = -MU_M3PS2 * r0 / w**3
    radial = 3.0 * np.einsum("ij,ij->i", r0, v0)[:, None] / w**2
    jerk = -MU_M3PS2 / w**3 * (v0 - radial * r0)
    r[:] = r0 + dt * (v0 + dt * (0.5 * a + dt / 6.0 * jerk))
    v[:] = v0 + dt * (a + 0.5 * dt * jerk)


assert EPOCH["known"].shape == (SATELLITES,)
