"""One epoch from pseudoranges to a fix that may be used: screen, solve, test; exclude, test again.

The search for what to exclude is a step of its own, since it may take longer than all before it.
Allocation-free; its time is bounded by the table's budget in candidates, three rounds of search and fifteen iterations
of a solution, whatever comes in. How far the fix can be wrong: protection.py.
"""

from __future__ import annotations

import math

from flightsw.gnss.declare import ROOM, entry, kernel
from flightsw.gnss.exclusion import greedy, probable
from flightsw.gnss.records import AXES, CONSTELLATIONS, EPOCH, GNSS_TABLE, RESULT, SATELLITES, WORK, Row, Rule, Verdict
from flightsw.gnss.residuals import FLOOR, begin, bit, largest_normalised, local_axes, reduce_system
from flightsw.gnss.solution import enough, geometry, normal_equations, screen, solve
from flightsw.kernels.registry import frozen_records, records

_ROUNDS = 3
_NEAR_M = 1_000.0  # a fix so near to the place of the linear search is described by it to 2.5 cm of range
_CONSISTENT, _EXCLUDED, _AMBIGUOUS = int(Verdict.CONSISTENT), int(Verdict.EXCLUDED), int(Verdict.AMBIGUOUS)
_UNTESTED, _INCONSISTENT, _TOO_FEW = int(Verdict.UNTESTED), int(Verdict.INCONSISTENT), int(Verdict.TOO_FEW)
_NO_SOLUTION, _TOO_MANY = int(Verdict.NO_SOLUTION), int(Verdict.TOO_MANY)
_SEARCH = -1
_GREEDY, _EMPTY, _OUT = int(Rule.GREEDY), int(Row.EMPTY), int(Row.EXCLUDED)


@kernel
def _clear(epoch, result):
    result["t_gps_ns"] = epoch["t_gps_ns"]
    result["usable"] = result["used"] = result["unknowns"] = result["dof"] = result["first_dof"] = 0
    result["statistic"] = result["threshold"] = result["first_statistic"] = result["largest"] = math.nan
    result["excluded"] = result["candidates"] = result["out_of_budget"] = result["rival"] = 0
    result["lone"] = result["iterations"] = result["available"] = result["modes"] = 0
    result["rival_gap"] = math.inf
    result["least_redundancy"] = result["inseparable"] = math.nan
    for a in range(3):
        result["r_m"][a] = result["sigma_m"][a] = math.nan
        result["protection_m"][a] = math.inf
        for b in range(3):
            result["covariance_m2"][a, b] = result["axes"][a, b] = math.nan
    for j in range(CONSTELLATIONS):
        result["clock_m"][j] = math.nan
    for i in range(SATELLITES):
        result["row_state"][i] = _EMPTY
        result["redundancy"][i] = result["residual_m"][i] = math.nan


@kernel
def _describe(table, work, n, r, result):
    """Result of the fix of the satellites used; the reduced system is theirs."""
    total, axes = work["sum"], work["axes"]
    used, present = 0, 0
    for j in range(CONSTELLATIONS):
        if total[j, 0] > 0.0:
            present += 1
            result["clock_m"][j] = total[j, 4] / total[j, 0]
    statistic = begin(work, n)
    result["largest"] = largest_normalised(work, n)[0]
    result["lone"] = 0
    least, alike = math.inf, 0.0
    for i in range(n):
        row, diagonal = work["row"][i], work["diagonal"][i]
        j = work["clock_of"][i]
        clock = total[j, 4] / total[j, 0] if total[j, 0] > 0.0 else math.nan
        result["residual_m"][row] = work["misfit_m"][i] - clock
        if work["used"][i] == 0:
            continue
        used += 1
        if diagonal > FLOOR:
            least = min(least, diagonal)
            for k in range(i):
                if work["diagonal"][k] > FLOOR:
                    cosine = abs(work["reduced"][i, k]) / math.sqrt(diagonal * work["diagonal"][k])
                    alike = max(alike, cosine)
        else:
            result["lone"] |= bit(row)
    result["used"], result["unknowns"] = used, 3 + present
    result["dof"] = used - 3 - present
    result["statistic"] = statistic
    result["threshold"] = table["threshold"][max(result["dof"], 0)]
    result["least_redundancy"], result["inseparable"] = least, alike
    cofactor = work["cofactor"]
    for a in range(3):
        result["r_m"][a] = r[a]
        for b in range(3):
            result["covariance_m2"][a, b] = cofactor[a, b]
            result["axes"][a, b] = axes[a, b]
    for q in range(AXES):
        variance = 0.0
        for a in range(3):
            for b in range(3):
                variance += axes[q, a] * cofactor[a, b] * axes[q, b]
        result["sigma_m"][q] = math.sqrt(variance)


@kernel
def _all_used(work, n):
    for i in range(n):
        work["used"][i] = 1


@kernel
def _reduce_at(table, epoch, work, n, r):
    """Reduced system of the satellites used, about r; False where there is no geometry."""
    if not geometry(table, epoch, work, n, r) or not normal_equations(work, n):
        return False
    local_axes(r, work["axes"])
    reduce_system(work, n)
    return True


@kernel
def _passes(table, work, n, dof):
    """Whether the satellites of the reduced system agree."""
    rss = begin(work, n)
    return rss <= table["threshold"][dof] and largest_normalised(work, n)[0] <= table["local_threshold"]


@kernel
def _exclude(table, epoch, work, n, r, dof, result):
    """Search, solve without what was found, search again about the new fix until nothing changes; the mask, or 0.

    A large fault bends the problem: what is left out is decided about a fix that it did not bend.
    """
    before = 0
    for _ in range(_ROUNDS):
        if table["rule"] == _GREEDY:
            mask = greedy(table, work, n, dof, result)
        else:
            result["rival"], result["rival_gap"] = 0, math.inf
            mask = probable(table, work, n, dof, result)
        if mask == 0:
            return 0
        for i in range(n):
            work["used"][i] = 0 if mask & bit(i) else 1
        x, y, z = r[0], r[1], r[2]
        if solve(table, epoch, work, n, r) == 0:
            return 0
        if mask == before or (r[0] - x) ** 2 + (r[1] - y) ** 2 + (r[2] - z) ** 2 < _NEAR_M * _NEAR_M:
            return mask
        before = mask
        _all_used(work, n)
        if not _reduce_at(table, epoch, work, n, r):
            return 0
    return 0


@kernel
def _rows(work, n, mask):
    """Mask of rows of the epoch, from one of places."""
    rows = 0
    for i in range(n):
        if mask & bit(i):
            rows |= bit(work["row"][i])
    return rows


@kernel
def _test(table, epoch, work, result):
    """The verdict of one epoch, _SEARCH where its satellites disagree; everything else is in result."""
    _clear(epoch, result)
    if epoch["count"] < 0 or epoch["count"] > SATELLITES:
        return _TOO_MANY
    n = screen(table, epoch, work, result)
    result["usable"] = work["count"] = n
    used, present = enough(work, n)
    result["used"], result["unknowns"] = used, 3 + present
    dof = used - 3 - present
    if used == 0 or dof < 0:
        return _TOO_FEW
    r = work["fix"]
    for a in range(3):
        r[a] = epoch["start_m"][a] if epoch["start_known"] != 0 and math.isfinite(epoch["start_m"][a]) else 0.0
    result["iterations"] = solve(table, epoch, work, n, r)
    if result["iterations"] == 0 and epoch["start_known"] != 0:
        for a in range(3):
            r[a] = 0.0
        result["iterations"] = solve(table, epoch, work, n, r)
    if result["iterations"] == 0:
        return _NO_SOLUTION
    local_axes(r, work["axes"])
    reduce_system(work, n)
    _describe(table, work, n, r, result)
    result["first_statistic"], result["first_dof"] = result["statistic"], dof
    for i in range(n):
        result["redundancy"][work["row"][i]] = max(work["reduced"][i, i], 0.0)
    if dof == 0:
        return _UNTESTED
    if _passes(table, work, n, dof):
        return _CONSISTENT
    return _SEARCH


@kernel
def _isolate(table, epoch, work, result):
    """The verdict of an epoch whose satellites disagree, once it is known who is to be left out."""
    n, r = work["count"], work["fix"]
    mask = _exclude(table, epoch, work, n, r, result["dof"], result)
    if mask == 0:
        return _INCONSISTENT
    if not _reduce_at(table, epoch, work, n, r):
        return _NO_SOLUTION
    _describe(table, work, n, r, result)
    result["excluded"] = _rows(work, n, mask)
    result["rival"] = _rows(work, n, result["rival"])
    for i in range(n):
        if mask & bit(i):
            result["row_state"][work["row"][i]] = _OUT
    passed = result["statistic"] <= result["threshold"] and result["largest"] <= table["local_threshold"]
    if result["dof"] < 1 or not passed:
        return _INCONSISTENT
    return _AMBIGUOUS if result["rival"] != 0 else _EXCLUDED


@kernel
def test(table, epoch, work, result, room):
    """A fix of all satellites with its verdict, or work["search"] = 1: who is to be left out is for `exclude` to say.

    work then holds the reduced system of the satellites used. INCONSISTENT stands until the search has an answer.
    """
    verdict = _test(table, epoch, work, result)
    work["search"] = 1 if verdict == _SEARCH else 0
    result["verdict"] = _INCONSISTENT if verdict == _SEARCH else verdict
    result["code"] = room


@kernel
def exclude(table, epoch, work, result):
    """The fix and the verdict of an epoch that was left to search, after `test` with the same records."""
    if work["search"] != 0:
        work["search"] = 0
        result["verdict"] = _isolate(table, epoch, work, result)


def _declare(room):
    @entry(frozen_records(GNSS_TABLE), records(EPOCH), records(WORK), records(RESULT))
    def gnss_test(tables, epochs, works, results):
        """Judge one epoch, but for who is to be left out. Levels are infinite until `gnss_levels` is called."""
        test(tables[0], epochs[0], works[0], results[0], room)

    @entry(frozen_records(GNSS_TABLE), records(EPOCH), records(WORK), records(RESULT))
    def gnss_exclude(tables, epochs, works, results):
        """Go on with an epoch that `gnss_test` has left to search; does nothing with any other."""
        exclude(tables[0], epochs[0], works[0], results[0])
        return room

    return gnss_test, gnss_exclude


gnss_test, gnss_exclude = _declare(ROOM)
