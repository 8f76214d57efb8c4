"""Protection levels by solution separation: how far the fix can be wrong, axis by axis, whatever single fault there is.

For every fault mode k (a satellite, a constellation, where needed a pair) the fix without it is within
|x - x_k| + K sigma_k of the truth. With prior p_k of the modes and p_hmi of the axis, the level L solves

    2 Q((L - b_0) / sigma_0) + sum_k p_k Q((L - T_k - b_k) / sigma_k) = p_hmi - P(what is no mode)

(Blanch et al., Advanced RAIM User Algorithm Description, ION GNSS 2012, eqs. 21 to 35). T_k is the separation a test
lets pass, or the one that is there if that is larger: the level then holds without a test of that mode.

The level is never below the root. It is above it by what _NEAR and _LEFT_OUT say and no more.
"""

from __future__ import annotations

import math

from flightsw.gnss.declare import ROOM, entry, kernel
from flightsw.gnss.records import AXES, CONSTELLATIONS, GNSS_TABLE, RESULT, WORK, Verdict
from flightsw.gnss.residuals import FLOOR, SHIFT, bit, factor_row, observed, take_out_all
from flightsw.kernels.registry import frozen_records, records

_NEAR = 1e-5  # of a level: how far above the root it may be
_LEFT_OUT = 1e-4  # of the allowed risk: for all modes that are too improbable to be added up
_STEPS = 80  # every fourth halves the bracket; four are usual
_FARTHEST_M = 1e9
_ROOT_2 = math.sqrt(2.0)
_HAZARD_0 = math.sqrt(2.0 / math.pi)  # of the normal distribution at zero
_EXCLUDED, _UNTESTED = int(Verdict.EXCLUDED), int(Verdict.UNTESTED)


@kernel
def _add(table, work, n, result, depth, seen, probability, modes, unmonitored):
    """Add the mode whose satellites are so many rows of the factor; returns (modes, unmonitored).

    Where the fix cannot do without them there is no such mode, and its probability is not monitored.
    """
    if not (probability > 0.0):
        return modes, unmonitored
    if not seen:
        return modes, unmonitored + probability
    levels, reduced = work["levels"], work["reduced"]
    work["mode_p"][modes] = probability
    work["mode_odds"][modes] = 2.0 * math.log(0.5 * probability)
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
        work["mode_reach_m"][modes, q] = passed + bias * table["bias_m"]
        work["mode_sigma_m"][modes, q] = math.sqrt(result["sigma_m"][q] ** 2 + spread)
    return modes + 1, unmonitored


@kernel
def _event(table, work, n, result, mask, probability, partners, modes, unmonitored):
    """Modes of satellites that fail together, a mask of places: alone, and with each of the partners, a mask too.

    A partner is one row more on the factor of the event, which is made once. Returns (modes, unmonitored).
    """
    _, depth, seen = take_out_all(work, n, mask)
    modes, unmonitored = _add(table, work, n, result, depth, seen, probability, modes, unmonitored)
    columns = n if table["bias_m"] > 0.0 else 0
    for k in range(n):
        if partners & bit(k):
            both = probability * table["p_satellite"][work["clock_of"][k]]
            if work["diagonal"][k] > FLOOR:
                factor_row(work, columns, depth, k)
                modes, unmonitored = _add(table, work, n, result, depth + 1, seen, both, modes, unmonitored)
            else:
                still = seen and observed(work, depth, k)
                modes, unmonitored = _add(table, work, n, result, depth, still, both, modes, unmonitored)
    return modes, unmonitored


@kernel
def _mask_of(work, n, system):
    mask = 0
    for i in range(n):
        if work["used"][i] != 0 and work["clock_of"][i] == system:
            mask |= bit(i)
    return mask


@kernel
def _make_modes(table, work, n, result):
    """Every fault mode, mode 0 none, two-sided; returns (modes, probability of what is no mode)."""
    priors, pairs_p = 0.0, 0.0
    present, used = 0, 0
    for j in range(CONSTELLATIONS):
        if work["sum"][j, 0] > 0.0:
            present += 1
            used |= _mask_of(work, n, j)
            pairs_p += priors * table["p_constellation"][j]
            priors += table["p_constellation"][j]
    for i in range(n):
        if used & bit(i):
            pairs_p += priors * table["p_satellite"][work["clock_of"][i]]
            priors += table["p_satellite"][work["clock_of"][i]]
    least = min(table["p_hmi"][0], min(table["p_hmi"][1], table["p_hmi"][2]))
    pairs = pairs_p > table["p_unmonitored"] * least
    # three faults at once are never a mode
    unmonitored = priors**3 / 6.0 + (0.0 if pairs else pairs_p)
    modes, unmonitored = _add(table, work, n, result, 0, True, 2.0, 0, unmonitored)
    for j in range(CONSTELLATIONS):
        p_j = table["p_constellation"][j]
        if work["sum"][j, 0] > 0.0 and p_j > 0.0:
            if present == 1:
                unmonitored += p_j
                continue
            mask = _mask_of(work, n, j)
            others = used & ~mask if pairs else 0
            modes, unmonitored = _event(table, work, n, result, mask, p_j, others, modes, unmonitored)
            for k in range(j + 1, CONSTELLATIONS):
                if pairs and work["sum"][k, 0] > 0.0:
                    both = mask | _mask_of(work, n, k)
                    p = p_j * table["p_constellation"][k]
                    modes, unmonitored = _event(table, work, n, result, both, p, 0, modes, unmonitored)
    before = 0
    for i in range(n):
        p_i = table["p_satellite"][work["clock_of"][i]]
        if used & bit(i):
            if p_i > 0.0:
                modes, unmonitored = _event(table, work, n, result, bit(i), p_i, before, modes, unmonitored)
            if pairs:
                before |= bit(i)
    return modes, unmonitored


@kernel
def _bracket(work, modes, axis, allowed):
    """(low, high): levels between which the root is, since for z >= 0

    exp(-z z / 2 - z sqrt(2 / pi)) / 2 <= Q(z) <= exp(-z z / 2) / 2

    Below low one mode alone has more than is allowed, above high none has more than an equal share of it.
    """
    low, high = 0.0, 0.0
    limit, each = 2.0 * math.log(allowed), 2.0 * math.log(modes)
    for k in range(modes):
        reach, sigma = work["mode_reach_m"][k, axis], work["mode_sigma_m"][k, axis]
        odds = work["mode_odds"][k] - limit
        if odds > 0.0:
            low = max(low, reach + sigma * (math.sqrt(odds + _HAZARD_0 * _HAZARD_0) - _HAZARD_0))
        high = max(high, reach + sigma * math.sqrt(max(odds + each, 0.0)))
    return low, high


@kernel
def _gather(work, modes, axis, low, least):
    """Put the modes one after the other that have more risk than the least, at a level or above; returns how many."""
    near, limit = 0, 2.0 * math.log(least)
    for k in range(modes):
        reach, sigma = work["mode_reach_m"][k, axis], work["mode_sigma_m"][k, axis]
        z, odds = (low - reach) / sigma, work["mode_odds"][k] - limit
        # Q(z) <= exp(-z z / 2) / 2, and for a z that is not small <= exp(-z z / 2) / (z sqrt(2 pi))
        if z > 0.0 and (z * z > odds or z * z + 2.0 * math.log(z / _HAZARD_0) > odds):
            continue
        work["near_p"][near] = work["mode_p"][k]
        work["near_reach_m"][near] = reach
        work["near_sigma_m"][near] = sigma
        near += 1
    return near


@kernel
def _risk(work, near, level):
    """Probability that the error of an axis exceeds the level; by how much it falls with the level at least [1/m].

    Q(z) falls by (3 z + sqrt(z z + 8)) / 4 of itself at least (Sampford 1953), by a thousandth more beyond 3 sigmas.
    """
    total, fall = 0.0, 0.0
    for k in range(near):
        sigma = work["near_sigma_m"][k]
        z = (level - work["near_reach_m"][k]) / sigma
        risk = work["near_p"][k] * 0.5 * math.erfc(z / _ROOT_2)
        total += risk
        fall += risk * max(3.0 * z + math.sqrt(z * z + 8.0), 0.0) / sigma
    return total, 0.25 * fall


@kernel
def _level(work, modes, axis, allowed):
    """The level of an axis: Newton's steps in the logarithm of the risk, inside a bracket, whose upper end it is."""
    left_out = _LEFT_OUT * allowed
    allowed -= left_out
    low, high = _bracket(work, modes, axis, allowed)
    near = _gather(work, modes, axis, low, left_out / modes)
    level = low
    for step in range(_STEPS):
        risk, fall = _risk(work, near, level)
        if math.isnan(risk):
            return math.inf
        if risk <= allowed:
            high = level
            # beyond what the modes reach the risk is convex: its tangent says how far down the root can be
            if risk + fall * _NEAR * level >= allowed:
                break
        else:
            low = level
        if not (high - low > _NEAR * high):
            break
        if fall > 0.0:  # a little farther, to end above the root
            level += risk / fall * math.log(risk / allowed) + 0.5 * _NEAR * level
        if step % 4 == 3 or not (low < level < high):
            level = 0.5 * (low + high)
    return high if high < _FARTHEST_M else math.inf


@kernel
def protect(table, work, result):
    """Fill protection levels (east, north, up), availability, number of modes, where there is a fix to protect."""
    if table["protect"] == 0 or result["verdict"] > _UNTESTED:
        return
    modes, unmonitored = _make_modes(table, work, work["count"], result)
    result["modes"] = modes
    result["available"] = 1 if result["verdict"] <= _EXCLUDED else 0  # levels do not cover the other explanation
    for q in range(AXES):
        allowed = table["p_hmi"][q] - unmonitored
        result["protection_m"][q] = _level(work, modes, q, allowed) if allowed > 0.0 else math.inf
        if not (result["protection_m"][q] <= table["alert_limit_m"][q]):
            result["available"] = 0


def _declare(room):
    @entry(frozen_records(GNSS_TABLE), records(WORK), records(RESULT))
    def gnss_levels(tables, works, results):
        """Protection levels of the fix that is in work and result; nothing where there is none."""
        protect(tables[0], works[0], results[0])
        return room

    return gnss_levels


gnss_levels = _declare(ROOM)
