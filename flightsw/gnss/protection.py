"""Protection levels by solution separation: how far the fix can be wrong, axis by axis, whatever single fault there is.

For every fault mode k (a satellite, a constellation, where needed a pair) the fix without it is within
|x - x_k| + K sigma_k of the truth. With prior p_k of the modes and p_hmi of the axis, the level L solves

    2 Q((L - b_0) / sigma_0) + sum_k p_k Q((L - T_k - b_k) / sigma_k) = p_hmi - P(what is no mode)

(Blanch et al., Advanced RAIM User Algorithm Description, ION GNSS 2012, eqs. 21 to 35). T_k is the separation a test
lets pass, or the one that is there if that is larger: the level then holds without a test of that mode.
"""

from __future__ import annotations

import math

from flightsw.gnss.declare import kernel
from flightsw.gnss.records import AXES, CONSTELLATIONS
from flightsw.gnss.residuals import SHIFT, bit, take_out_all

_HALVINGS = 16
_ROOT_2 = math.sqrt(2.0)
_FAR = 9.0  # sigmas: 1e-19


@kernel
def _mode(table, work, n, result, mode, mask, probability):
    """Add a fault mode; returns how many there are, or the same number where the fix cannot do without it."""
    _, depth, seen = take_out_all(work, n, mask)
    if not seen:
        return mode
    levels, reduced = work["levels"], work["reduced"]
    work["mode_p"][mode] = probability
    for q in range(AXES):
        apart, spread = 0.0, 0.0
        for d in range(depth):
            share = levels[d, SHIFT + q]
            apart += share * levels[d, SHIFT - 1]
            spread += share * share
        bias = 0.0
        if table["bias_m"] > 0.0:
            for i in range(n):
                gain = reduced[i, SHIFT + q]
                for d in range(depth):
                    gain -= levels[d, SHIFT + q] * levels[d, i]
                bias += abs(gain) * math.sqrt(work["weight"][i])
        passed = max(table["k_false_alarm"] * math.sqrt(spread), abs(apart))
        work["mode_reach_m"][mode, q] = passed + bias * table["bias_m"]
        work["mode_sigma_m"][mode, q] = math.sqrt(result["sigma_m"][q] ** 2 + spread)
    return mode + 1


@kernel
def _risk(work, modes, axis, level_m):
    """Probability that the error of an axis exceeds the level, by all modes; mode 0 is no fault, two-sided."""
    total = 0.0
    for k in range(modes):
        z = (level_m - work["mode_reach_m"][k, axis]) / work["mode_sigma_m"][k, axis]
        if z < _FAR:
            total += work["mode_p"][k] * 0.5 * math.erfc(z / _ROOT_2)
    return total


@kernel
def _level(work, modes, axis, allowed):
    high = 4.0 * work["mode_sigma_m"][0, axis]
    while _risk(work, modes, axis, high) > allowed:
        high *= 2.0
        if not (high < 1e9):
            return math.inf
    low = 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if _risk(work, modes, axis, middle) > allowed:
            low = middle
        else:
            high = middle
    return high


@kernel
def _mask_of(work, n, system):
    mask = 0
    for i in range(n):
        if work["used"][i] != 0 and work["clock_of"][i] == system:
            mask |= bit(i)
    return mask


@kernel
def _add(table, work, n, result, modes, mask, probability, unmonitored):
    """A mode, or what its probability adds to what is monitored by none; returns (modes, unmonitored)."""
    if not (probability > 0.0):
        return modes, unmonitored
    more = _mode(table, work, n, result, modes, mask, probability)
    return more, unmonitored if more > modes else unmonitored + probability


@kernel
def _pairs_with_constellation(table, work, n, result, j, modes, unmonitored):
    """Modes of constellation j failing together with a later constellation, or with a satellite of another."""
    mask, p_j = _mask_of(work, n, j), table["p_constellation"][j]
    for k in range(j + 1, CONSTELLATIONS):
        if work["sum"][k, 0] > 0.0:
            both = mask | _mask_of(work, n, k)
            p = p_j * table["p_constellation"][k]
            modes, unmonitored = _add(table, work, n, result, modes, both, p, unmonitored)
    for i in range(n):
        if work["used"][i] != 0 and work["clock_of"][i] != j:
            p = p_j * table["p_satellite"][work["clock_of"][i]]
            modes, unmonitored = _add(table, work, n, result, modes, mask | bit(i), p, unmonitored)
    return modes, unmonitored


@kernel
def protect(table, work, n, result):
    """Fill protection levels (east, north, up), availability, number of modes, from the reduced system of the fix."""
    priors, pairs_p = 0.0, 0.0
    present = 0
    for j in range(CONSTELLATIONS):
        if work["sum"][j, 0] > 0.0:
            present += 1
            pairs_p += priors * table["p_constellation"][j]
            priors += table["p_constellation"][j]
    for i in range(n):
        if work["used"][i] != 0:
            pairs_p += priors * table["p_satellite"][work["clock_of"][i]]
            priors += table["p_satellite"][work["clock_of"][i]]
    least = min(table["p_hmi"][0], min(table["p_hmi"][1], table["p_hmi"][2]))
    pairs = pairs_p > table["p_unmonitored"] * least
    # three faults at once are never a mode
    unmonitored = priors**3 / 6.0 + (0.0 if pairs else pairs_p)
    modes = _mode(table, work, n, result, 0, 0, 2.0)
    for j in range(CONSTELLATIONS):
        p_j = table["p_constellation"][j]
        if work["sum"][j, 0] > 0.0 and p_j > 0.0:
            if present > 1:
                modes, unmonitored = _add(table, work, n, result, modes, _mask_of(work, n, j), p_j, unmonitored)
            else:
                unmonitored += p_j
            if pairs:
                modes, unmonitored = _pairs_with_constellation(table, work, n, result, j, modes, unmonitored)
    for i in range(n):
        p_i = table["p_satellite"][work["clock_of"][i]]
        if work["used"][i] != 0 and p_i > 0.0:
            modes, unmonitored = _add(table, work, n, result, modes, bit(i), p_i, unmonitored)
            if pairs:
                for k in range(i):
                    if work["used"][k] != 0:
                        p = p_i * table["p_satellite"][work["clock_of"][k]]
                        modes, unmonitored = _add(table, work, n, result, modes, bit(i) | bit(k), p, unmonitored)
    result["modes"] = modes
    result["available"] = 1
    for q in range(AXES):
        allowed = table["p_hmi"][q] - unmonitored
        result["protection_m"][q] = _level(work, modes, q, allowed) if allowed > 0.0 else math.inf
        if not (result["protection_m"][q] <= table["alert_limit_m"][q]):
            result["available"] = 0
