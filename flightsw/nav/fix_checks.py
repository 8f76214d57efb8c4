"""What a fix must be before the filter sees it: its time, then its content."""

from __future__ import annotations

import math

from flightsw.icd.enums import FixType, RejectCause
from flightsw.kernels.registry import kernel
from flightsw.nav.clock import gps_at, tolerance_ns
from flightsw.nav.flight_model import FLIGHT as _FLIGHT

_NOT_FINITE = int(RejectCause.NOT_FINITE)
_OUT_OF_RANGE = int(RejectCause.OUT_OF_RANGE)
_FIX_TYPE = int(RejectCause.FIX_TYPE)
_SATELLITES = int(RejectCause.SATELLITES)
_SIGMA = int(RejectCause.SIGMA)
_TIME_STALE = int(RejectCause.TIME_STALE)
_TIME_FUTURE = int(RejectCause.TIME_FUTURE)
_TIME_JUMP = int(RejectCause.TIME_JUMP)
_TIME_REPEATED = int(RejectCause.TIME_REPEATED)
_FIX_3D = int(FixType.FIX_3D)
_POSITION_3D = int(FixType.POSITION_3D)

PASSED = -1


@kernel
def check_time(nav, table, inp):
    """PASSED or a RejectCause. The clock must be valid.

    A fix carries the counter latched when it was measured: its GPS time must be the one the clock gives for that
    reading. This sees a step of a millisecond, where the age of the fix alone would hide in the latency.
    """
    t_now = gps_at(nav, inp.counter_now_ns)
    slack_ns = tolerance_ns(nav, table, inp.counter_now_ns)
    # Compared in this order so that no difference can overflow: a garbage time is far outside both ends.
    if inp.fix_gps_ns < t_now - int(1e9 * table.latency_max_s + slack_ns):
        return _TIME_STALE
    if inp.fix_gps_ns > t_now + int(1e9 * table.future_max_s + slack_ns):
        return _TIME_FUTURE
    if inp.fix_gps_ns <= nav.t_seen_gps_ns:
        return _TIME_REPEATED
    if inp.fix_counter_ns > inp.counter_now_ns or inp.fix_counter_ns < inp.counter_now_ns - int(
        1e9 * (table.latency_max_s + table.future_max_s) + slack_ns
    ):
        return _TIME_JUMP
    if abs(gps_at(nav, inp.fix_counter_ns) - inp.fix_gps_ns) > tolerance_ns(nav, table, inp.fix_counter_ns):
        return _TIME_JUMP
    return PASSED


@kernel
def check_content(table, inp):
    """PASSED or a RejectCause: finite, in orbit, of a usable kind and quality."""
    r2 = 0.0
    v2 = 0.0
    for i in range(3):
        r2 += inp.fix_r_itrf_m[i] * inp.fix_r_itrf_m[i]
        if inp.fix_has_velocity:
            v2 += inp.fix_v_itrf_mps[i] * inp.fix_v_itrf_mps[i]
    for i in range(3):
        if not (math.isfinite(inp.fix_r_itrf_m[i]) and math.isfinite(inp.fix_sigma_r_m[i])):
            return _NOT_FINITE
        if inp.fix_has_velocity and not (
            math.isfinite(inp.fix_v_itrf_mps[i]) and math.isfinite(inp.fix_sigma_v_mps[i])
        ):
            return _NOT_FINITE
    if r2 < table.radius_min_m**2 or r2 > table.radius_max_m**2 or v2 > table.speed_max_mps**2:
        return _OUT_OF_RANGE
    if inp.fix_type != (_FIX_3D if inp.fix_has_velocity else _POSITION_3D):
        return _FIX_TYPE
    if not inp.fix_has_velocity and table.filter_model != _FLIGHT:
        return _FIX_TYPE  # the paper's filter corrects by position and velocity together
    if inp.fix_satellites < table.satellites_min:
        return _SATELLITES
    for i in range(3):
        # Zero is no sigma; at most the table's largest.
        if not (inp.fix_sigma_r_m[i] > 0.0) or inp.fix_sigma_r_m[i] > table.sigma_r_max_m:
            return _SIGMA
        if inp.fix_has_velocity and (
            not (inp.fix_sigma_v_mps[i] > 0.0) or inp.fix_sigma_v_mps[i] > table.sigma_v_max_mps
        ):
            return _SIGMA
    return PASSED
