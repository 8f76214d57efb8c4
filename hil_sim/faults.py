"""Faults between receiver and bus, in three places: the content of fixes and pulses, their alive counters, the
encoded frames. What each kind's value means stands in fault_kinds.py. Every fault has its own random stream.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hil_sim.fault_kinds import KINDS, ON_THE_BUS
from hil_sim.frames import FrameSeries
from hil_sim.gps_time import NS, WEEK_NS
from hil_sim.scenario_schema import Fault
from hil_sim.sensors.gnss_receiver import FixSeries, PulseSeries

WEEK_ROLLOVER_NS = 1024 * WEEK_NS
_AXES = {name: np.array(axes) for name, axes in {"x": [0], "y": [1], "z": [2], "all": [0, 1, 2]}.items()}


class FaultInjector:
    """The faults of a run, in the order of the scenario."""

    def __init__(self, faults: tuple[Fault, ...], t_start_gps_ns: int, seeds: np.random.SeedSequence) -> None:
        self._t_start_gps_ns = t_start_gps_ns
        self._faults = faults
        self._streams = [np.random.default_rng(child) for child in seeds.spawn(len(faults))]
        # of the frames of other senders: what they send does not change what befalls the receiver's
        self._other_streams = [np.random.default_rng(child) for child in seeds.spawn(len(faults))]

    def corrupt_content(self, fixes: FixSeries, pulses: PulseSeries) -> None:
        """Apply faults of content, time and counters to the measurements, in place."""
        for fault, stream in zip(self._faults, self._streams, strict=True):
            fix_hit = self._hit(fault, fixes.t_true_gps_ns, stream)
            pulse_hit = self._hit(fault, pulses.t_true_gps_ns, stream)
            if fault.kind in _CONTENT:
                _CONTENT[fault.kind](fault, fixes, fix_hit)
            elif fault.kind in _RAMPS:
                self._ramp(fault, fixes, fix_hit)
            elif fault.kind in _TIME:
                if fault.kind != "sync_jump" and fault.target != "sync":
                    _TIME[fault.kind](fault, fixes, fix_hit)
                if fault.target in ("all", "sync"):
                    _TIME[fault.kind](fault, pulses, pulse_hit)
            elif fault.kind == "receiver_reset":
                self._reset(fault, fixes, pulses)
        for fault in self._faults:
            if fault.kind in ("repeat_counter", "skip_counter", "receiver_reset"):
                self._disturb_counters(fault, fixes, pulses)

    def corrupt_frames(self, frames: FrameSeries, receiver: bool = True) -> FrameSeries:
        """Apply drops, flipped bits and truncation; returns the frames that remain.

        receiver: whether they are the GNSS receiver's, or those of all other senders.
        """
        for fault, stream in zip(self._faults, self._streams if receiver else self._other_streams, strict=True):
            if fault.kind not in ON_THE_BUS:
                continue
            hit = self._hit(fault, frames.t_true_gps_ns, stream)
            if fault.target != "all":
                hit &= np.array([kind == fault.target for kind in frames.kind], dtype=bool)
            if fault.kind == "frame_drop":
                frames = frames.keep(~hit)
                continue
            for i in np.flatnonzero(hit):
                payload = bytearray(frames.payload[i])
                if fault.kind == "bit_flip":
                    bit = int(stream.integers(8 * len(payload)))
                    payload[bit // 8] ^= 1 << (bit % 8)
                else:
                    del payload[round(_value(fault)) :]
                frames.payload[i] = bytes(payload)
        return frames

    def _window(self, fault: Fault) -> tuple[int, int]:
        start = self._t_start_gps_ns + round(fault.start_s * NS)
        return start, start + round(fault.duration_s * NS)

    def _hit(self, fault: Fault, t_true_gps_ns: np.ndarray, stream: np.random.Generator) -> np.ndarray:
        start, stop = self._window(fault)
        chance = stream.random(len(t_true_gps_ns))
        return (t_true_gps_ns >= start) & (t_true_gps_ns < stop) & (chance < fault.probability)

    def _ramp(self, fault: Fault, fixes: FixSeries, hit: np.ndarray) -> None:
        """A drift of constant rate from the start of the window on; in ITRF, where its derivative is the velocity."""
        rate_mps, age_s = _value(fault), (fixes.t_true_gps_ns[hit] - self._window(fault)[0]) / NS
        axes = np.ix_(hit, _AXES[fault.axis])
        fixes.r_itrf_m[axes] += rate_mps * age_s[:, None]
        if fault.kind == "consistent_ramp":
            fixes.v_itrf_mps[axes] += rate_mps

    def _reset(self, fault: Fault, fixes: FixSeries, pulses: PulseSeries) -> None:
        start, stop = self._window(fault)
        for series in (fixes, pulses):
            series.sent &= ~((series.t_true_gps_ns >= start) & (series.t_true_gps_ns < stop))

    def _disturb_counters(self, fault: Fault, fixes: FixSeries, pulses: PulseSeries) -> None:
        start, stop = self._window(fault)
        columns = (
            ("position", fixes.t_true_gps_ns, fixes.counter_position),
            ("velocity", fixes.t_true_gps_ns, fixes.counter_velocity),
            ("sync", pulses.t_true_gps_ns, pulses.counter),
        )
        for target, t, counter in columns:
            if fault.target not in ("all", target):
                continue
            first, after = (int(np.searchsorted(t, edge)) for edge in (start, stop))
            if fault.kind == "skip_counter":
                counter[first:] += round(_value(fault))
            elif fault.kind == "receiver_reset" and after < len(counter):
                counter[after:] -= counter[after]
            elif fault.kind == "repeat_counter" and 0 < first < after:
                stood = counter[first - 1]
                counter[after:] -= counter[after - 1] - stood
                counter[first:after] = stood


def _value(fault: Fault) -> float:
    default = KINDS[fault.kind].default
    value = fault.value if fault.value is not None else default
    assert value is not None  # the schema's cross-check has seen to it
    return value


# -- content of a fix: (fault, fixes, (n,) bool) -------------------------------------------------------------


def _position_step(fault: Fault, fixes: FixSeries, hit: np.ndarray) -> None:
    fixes.r_itrf_m[np.ix_(hit, _AXES[fault.axis])] += _value(fault)


def _velocity_step(fault: Fault, fixes: FixSeries, hit: np.ndarray) -> None:
    fixes.v_itrf_mps[np.ix_(hit, _AXES[fault.axis])] += _value(fault)


def _nan(fault: Fault, fixes: FixSeries, hit: np.ndarray) -> None:
    axes = np.ix_(hit, _AXES[fault.axis])
    if fault.target in ("all", "position"):
        fixes.r_itrf_m[axes] = np.nan
    if fault.target in ("all", "velocity"):
        fixes.v_itrf_mps[axes] = np.nan


def _absurd(fault: Fault, fixes: FixSeries, hit: np.ndarray) -> None:
    fixes.r_itrf_m[np.ix_(hit, _AXES[fault.axis])] = _value(fault)


def _frozen_fix(fault: Fault, fixes: FixSeries, hit: np.ndarray) -> None:
    rows = np.flatnonzero(hit)
    if not len(rows) or rows[0] == 0:
        return
    last_good = rows[0] - 1
    fixes.r_itrf_m[rows] = fixes.r_itrf_m[last_good]
    fixes.v_itrf_mps[rows] = fixes.v_itrf_mps[last_good]
    if fault.hold_time:
        fixes.t_gps_ns[rows] = fixes.t_gps_ns[last_good]


_CONTENT: dict[str, Callable[[Fault, FixSeries, np.ndarray], None]] = {
    "position_step": _position_step,
    "velocity_step": _velocity_step,
    "nan": _nan,
    "absurd": _absurd,
    "frozen_fix": _frozen_fix,
}

_RAMPS = ("position_ramp", "consistent_ramp")

# -- time: (fault, fixes or pulses, (n,) bool) ---------------------------------------------------------------


def _jump(fault: Fault, series: FixSeries | PulseSeries, hit: np.ndarray) -> None:
    series.t_gps_ns[hit] += round(_value(fault) * NS)


def _week_rollover(fault: Fault, series: FixSeries | PulseSeries, hit: np.ndarray) -> None:
    series.t_gps_ns[hit] -= WEEK_ROLLOVER_NS


def _leap_second(fault: Fault, series: FixSeries | PulseSeries, hit: np.ndarray) -> None:
    """A receiver that applies a leap second it should not: time and the announced count are both wrong."""
    _jump(fault, series, hit)
    if isinstance(series, PulseSeries):
        series.leap_seconds[hit] += round(_value(fault))


def _backwards(fault: Fault, series: FixSeries | PulseSeries, hit: np.ndarray) -> None:
    rows = np.flatnonzero(hit)
    if len(rows):
        mirror = series.t_gps_ns[rows[0]]
        series.t_gps_ns[rows] = 2 * mirror - series.t_gps_ns[rows]


def _late(fault: Fault, series: FixSeries | PulseSeries, hit: np.ndarray) -> None:
    series.arrival_gps_ns[hit] += round(_value(fault) * NS)


_TIME: dict[str, Callable[[Fault, FixSeries | PulseSeries, np.ndarray], None]] = {
    "time_jump": _jump,
    "sync_jump": _jump,
    "week_rollover": _week_rollover,
    "leap_second": _leap_second,
    "time_backwards": _backwards,
    "late": _late,
}
