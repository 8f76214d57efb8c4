"""Makes the stimulus of a table: start, integrated flight, outage, burn, flag and return, in at most 200 steps.

Truth is the table's own model, coasting: a second memory that was given the state of the first at its start. What the
stimulus proves is that flight computes what the ground computed, not that this is right; that is what outages are for.
"""

from __future__ import annotations

import math

import numpy as np

from flightsw.icd.enums import BurnFrame, FixType, FlagState, Mode, SyncStatus
from flightsw.icd.table_file import TableImage
from flightsw.kernels import frames
from flightsw.kernels.registry import I8, MATRIX, VECTOR, entry, frozen_records, records
from flightsw.records import INPUT, ORIENTATION, OUTPUT, WORK
from flightsw.tables.stimulus import STEPS_MAX, T0_GPS_NS, memory_for, missing, say
from ground.errors import OperatorError

_NS = 1_000_000_000
_COUNTER_AT_T0_NS = 5 * _NS
_RADIUS_M, _MU_M3PS2, _INCLINATION_RAD = 6.878e6, 3.986004415e14, 0.9
_SIGMA_V_MPS = 0.05
_NOISE = 0.3  # of the fixes, as share of what they claim
_AIDED_STEPS = 44
_COAST_S = (1, 1, 1, 1, 2, 5, 10, 20, 40, 60, 60, 60, 60, 60)
_AFTER_BURN_S = 60
_AFTER_BURN_STEPS = 40
_BURN_AFTER_S, _BURN_S = 20, 15
_BURN_MPS = (0.02, 0.3, -0.05)


@entry(frozen_records(ORIENTATION), I8, VECTOR, VECTOR, records(WORK), MATRIX)
def _to_itrf(orientation, t_gps_ns, r, v, work, out):
    m = work[0].itrf_from_gcrf
    rate = work[0].itrf_from_gcrf_rate
    covered = frames.itrf_from_gcrf(orientation[0], t_gps_ns, work[0], m, rate)
    for i in range(3):
        out[0, i] = 0.0
        out[1, i] = 0.0
        for j in range(3):
            out[0, i] += m[i, j] * r[j]
            out[1, i] += m[i, j] * v[j] + rate[i, j] * r[j]
    return covered


class _Script:
    """The inputs so far, and the two memories that have heard them."""

    def __init__(self, table: TableImage) -> None:
        self.flown = memory_for(table.values)
        self.truth = memory_for(table.values)
        self.table = table.values[0]
        self.period_ns = max(_NS, int(self.table["nav_step_ns"]), int(self.table["tick_period_ns"]))
        self.inputs: list[np.ndarray] = []
        self.outputs: list[np.ndarray] = []
        self.t_gps_ns = T0_GPS_NS
        self.random = np.random.default_rng(20)
        row_m = float(self.table["tuning_sigma_fix_m"][0])
        self.sigma_m = min(max(row_m, 0.5), 5.0, float(self.table["sigma_r_max_m"]))

    @property
    def full(self) -> bool:
        return len(self.inputs) >= STEPS_MAX

    def _blank(self) -> np.ndarray:
        one = np.zeros(1, INPUT)
        one["counter_now_ns"] = _COUNTER_AT_T0_NS + self.t_gps_ns - T0_GPS_NS
        return one

    def _true_state(self) -> tuple[np.ndarray, np.ndarray]:
        if not self.truth.nav["initialised"][0]:
            rate = math.sqrt(_MU_M3PS2 / _RADIUS_M**3)
            u = 0.3 + rate * (self.t_gps_ns - T0_GPS_NS) * 1e-9
            across = np.array([0.0, math.cos(_INCLINATION_RAD), math.sin(_INCLINATION_RAD)])
            along = np.array([1.0, 0.0, 0.0])
            r = _RADIUS_M * (math.cos(u) * along + math.sin(u) * across)
            return r, _RADIUS_M * rate * (math.cos(u) * across - math.sin(u) * along)
        say(self.truth, self._blank())
        return self.truth.output["r_gcrf_m"][0].copy(), self.truth.output["v_gcrf_mps"][0].copy()

    def step(self, after_ns: int, aided: bool, burn: bool = False) -> np.void:
        """One step, so long after the one before; returns its output."""
        self.t_gps_ns += after_ns
        one = self._blank()
        if aided:
            one["pulse_present"], one["pulse_status"] = 1, int(SyncStatus.VALID)
            one["pulse_gps_ns"], one["pulse_counter_ns"] = self.t_gps_ns, one["counter_now_ns"]
            one["pulse_sigma_ns"] = 20.0
            self._put_fix(one)
        if burn:
            self._put_burn(one)
            say(self.truth, one)
        say(self.flown, one)
        if self.flown.nav["initialised"][0] and not self.truth.nav["initialised"][0]:
            self.truth.nav[:] = self.flown.nav
        self.inputs.append(one)
        self.outputs.append(self.flown.output.copy())
        return self.flown.output[0]

    def _put_fix(self, one: np.ndarray) -> None:
        r, v = self._true_state()
        r = r + _NOISE * self.sigma_m * self.random.standard_normal(3)
        v = v + _NOISE * _SIGMA_V_MPS * self.random.standard_normal(3)
        both = np.zeros((2, 3))
        if not _to_itrf(self.flown.orientation, self.t_gps_ns, r, v, self.flown.work, both):
            raise OperatorError("stimulus: outlasts the Earth orientation of its world; shorten the table's steps")
        one["fix_present"], one["fix_type"], one["fix_has_velocity"] = 1, int(FixType.FIX_3D), 1
        one["fix_gps_ns"], one["fix_counter_ns"] = self.t_gps_ns, one["counter_now_ns"]
        one["fix_r_itrf_m"], one["fix_v_itrf_mps"] = both
        one["fix_sigma_r_m"], one["fix_sigma_v_mps"] = self.sigma_m, _SIGMA_V_MPS
        one["fix_satellites"] = max(9, int(self.table["satellites_min"]))

    def _put_burn(self, one: np.ndarray) -> None:
        """A burn so uncertain that the bound crosses the limit within minutes, as it does in days of an outage."""
        limit_m = float(self.table["limit_m"])
        one["burn_present"], one["burn_id"], one["burn_frame"] = 1, 7, int(BurnFrame.RTN)
        one["burn_start_gps_ns"] = self.t_gps_ns + _BURN_AFTER_S * _NS
        one["burn_duration_ns"] = _BURN_S * _NS
        one["burn_dv_mps"] = _BURN_MPS
        one["burn_sigma_mps"] = min(limit_m / 100.0, float(self.table["burn_dv_max_mps"]))


def make(table: TableImage) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (n,) of INPUT and outputs (n,) of OUTPUT of the stimulus of a navigation table; n at most 200.

    Raises OperatorError where the table cannot be led through every mode in 200 steps.
    """
    script = _Script(table)
    for _ in range(_AIDED_STEPS):
        script.step(script.period_ns, aided=True)
    for after_s in _COAST_S:
        script.step(after_s * script.period_ns, aided=False)
    script.step(script.period_ns, aided=False, burn=True)
    for after_s in (10, 15, 5, 5):
        script.step(after_s * _NS, aided=False)
    for _ in range(_AFTER_BURN_STEPS):
        if script.step(_AFTER_BURN_S * _NS, aided=False)["flag"] == FlagState.RAISED:
            break
    script.step(script.period_ns, aided=False)
    while not script.full:
        out = script.step(script.period_ns, aided=True)
        if out["flag"] == FlagState.CLEAR and out["mode"] == Mode.INTEGRATED:
            break
    for _ in range(min(5, STEPS_MAX - len(script.inputs))):
        script.step(script.period_ns, aided=True)
    inputs, outputs = np.concatenate(script.inputs), np.concatenate(script.outputs)
    assert inputs.dtype == INPUT
    assert outputs.dtype == OUTPUT
    if lacking := missing(inputs, outputs):
        raise OperatorError(
            f"stimulus of set {table.set_name}: does not reach {', '.join(lacking)} in {len(inputs)} steps; "
            "a table that holds flight back for so long cannot be shown in every mode: shorten its counts of fixes"
        )
    return inputs, outputs
