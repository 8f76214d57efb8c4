"""Is a receiver's velocity the derivative of its positions? A sequential test of one fix after the other.

Both are taken relative to the predicted orbit, so that hundreds of seconds of positions make one straight line. A
chain of two follows that line, from positions alone. Velocity less its slope, in sigmas, goes into a multivariate
CUSUM, which has no preferred direction (R. B. Crosier, Technometrics 30 (1988) 291): S = (S + u)(1 - k / |S + u|), a
fault where |S| passes the threshold. Errors that last count with their power over long times: what a sum over many
fixes sees of them. What the predicted orbit gets wrong, and what a biased velocity does to it through
the filter, is in both and drops out.
"""

from __future__ import annotations

import math

from flightsw.derivative.chain import begin, driven, predict, transition, update
from flightsw.derivative.declare import ROOM, entry, kernel
from flightsw.derivative.records import AXES, CHECK, CHECK_TABLE
from flightsw.kernels.registry import F8, VECTOR, frozen_records, records

_MEAN = 50.0  # fixes that the mean difference remembers
_MOST = 2.0  # thresholds that the sum is held to, so that a fault that ends is seen to end


@kernel
def _forget_sum(check):
    check["statistic"] = 0.0
    for axis in range(AXES):
        check["sum"][axis] = 0.0


@kernel
def _restart(table, check, t_s, dr_m, sigma_r_m):
    check["fixes"], check["armed"], check["fault"], check["t_s"] = 1, 0, 0, t_s
    _forget_sum(check)
    check["bias_count"] = 0.0
    check["step"][1] = table["start_sigma_mps"]
    for axis in range(AXES):
        check["difference_mps"][axis] = math.nan
        check["bias_mps"][axis] = 0.0
        begin(2, 2, dr_m[axis], sigma_r_m[axis] ** 2, check["step"], check["x"][axis], check["P"][axis])


@kernel
def _sum_up(table, check):
    """Crosier's recursion with the step in sigmas."""
    size = 0.0
    for axis in range(AXES):
        size += check["step"][axis] ** 2
    share = min(1.0, table["step_max"] / math.sqrt(max(size, 1e-300)))
    length = 0.0
    for axis in range(AXES):
        check["sum"][axis] += share * check["step"][axis]
        length += check["sum"][axis] ** 2
    length = math.sqrt(length)
    if length <= table["reference"]:
        _forget_sum(check)
        return
    left = min(length - table["reference"], _MOST * table["threshold"])
    for axis in range(AXES):
        check["sum"][axis] *= left / length
    check["statistic"] = left


@kernel
def take_fix(table, check, t_s, dr_m, dv_mps, sigma_r_m, sigma_v_mps):
    """`check_fix` for other kernels: records, not arrays of one."""
    good = math.isfinite(t_s)
    for axis in range(AXES):
        good = good and math.isfinite(dr_m[axis]) and math.isfinite(dv_mps[axis])
        good = good and sigma_r_m[axis] > 0.0 and sigma_r_m[axis] < math.inf
        good = good and sigma_v_mps[axis] > 0.0 and sigma_v_mps[axis] < math.inf
    if not good:
        return -1
    if check["fixes"] == 0 or t_s - check["t_s"] > table["gap_s"]:
        _restart(table, check, t_s, dr_m, sigma_r_m)
        return 0
    dt_s = t_s - check["t_s"]
    if not dt_s > 0.0:
        return -1
    check["t_s"] = t_s
    check["fixes"] += 1
    transition(2, dt_s, check["phi"])
    driven(2, dt_s, table["q_m2ps3"], check["noise"])
    armed = 1
    # of an autoregressive process, the variance of long sums over that of one term: (1 + c) / (1 - c)
    lasting = 1.0 / math.tanh(min(0.5 * dt_s / table["coloured_s"], 10.0))
    slow_r_m2, slow_v_m2ps2 = lasting * table["coloured_r_m"] ** 2, lasting * table["coloured_v_mps"] ** 2
    for axis in range(AXES):
        x, p = check["x"][axis], check["P"][axis]
        predict(2, check["phi"], check["noise"], x, p, check["square"])
        update(2, dr_m[axis], sigma_r_m[axis] ** 2 + slow_r_m2, x, p, check["gain"])
        if p[1, 1] > table["armed_sigma_mps"] ** 2:
            armed = 0
        check["difference_mps"][axis] = dv_mps[axis] - x[1]
        check["step"][axis] = check["difference_mps"][axis] / math.sqrt(sigma_v_mps[axis] ** 2 + slow_v_m2ps2 + p[1, 1])
    check["armed"] = armed
    if armed == 0:
        return check["fault"]
    check["bias_count"] = min(check["bias_count"] + 1.0, _MEAN)
    for axis in range(AXES):
        check["bias_mps"][axis] += (check["difference_mps"][axis] - check["bias_mps"][axis]) / check["bias_count"]
    _sum_up(table, check)
    if check["fault"] == 0 and check["statistic"] > table["threshold"]:
        check["fault"] = 1
        check["alarms"] += 1
    elif check["fault"] != 0 and check["statistic"] < table["clear"]:
        check["fault"] = 0
    return check["fault"]


@entry(frozen_records(CHECK_TABLE), records(CHECK), F8, VECTOR, VECTOR, VECTOR, VECTOR)
def check_fix(tables, states, t_s, dr_m, dv_mps, sigma_r_m, sigma_v_mps):
    """One fix at t_s [s]: position and velocity (3,) less the predicted orbit's, any fixed axes, with their sigmas.

    Returns 1 while a fault is held, 0 while none is, -1 where the fix is refused (not finite, not later, no sigma).
    """
    _ = ROOM
    return take_fix(tables[0], states[0], t_s, dr_m, dv_mps, sigma_r_m, sigma_v_mps)
