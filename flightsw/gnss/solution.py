"""A fix by weighted nonlinear least squares with one clock per constellation present.

Gauss-Newton (Misra and Enge 2011, section 6.1). Clocks are eliminated: each constellation's lines of sight and misfits
are taken from their weighted mean, which leaves three unknowns whatever the mix. The Earth turns under the signal in
flight.
"""

from __future__ import annotations

import math

from flightsw.gnss.declare import kernel
from flightsw.gnss.records import CONSTELLATIONS, Row

LIGHT_MPS = 299_792_458.0
_ITERATIONS = 15
_SETTLED_M = 1e-4
_SINGULAR = 1e-9  # least pivot of the normal matrix, as a share of its largest diagonal
_USED, _DUPLICATE = int(Row.USED), int(Row.DUPLICATE)
_NUMBER, _SYSTEM, _SIGMA = int(Row.BAD_NUMBER), int(Row.BAD_CONSTELLATION), int(Row.BAD_SIGMA)
_EPHEMERIS, _RANGE = int(Row.BAD_EPHEMERIS), int(Row.BAD_RANGE)


@kernel
def _judge_row(table, epoch, i):
    system = epoch["constellation"][i]
    if system < 0 or system >= CONSTELLATIONS:
        return _SYSTEM
    radius = 0.0
    for k in range(3):
        radius += epoch["r_m"][i, k] * epoch["r_m"][i, k]
    radius = math.sqrt(radius)
    range_m, sigma = epoch["range_m"][i], epoch["sigma_m"][i]
    if not (math.isfinite(range_m) and math.isfinite(sigma) and math.isfinite(radius)):
        return _NUMBER
    if not (sigma > 1e-3 and sigma < 1e6):
        return _SIGMA
    if not (radius > table["radius_min_m"] and radius < table["radius_max_m"]):
        return _EPHEMERIS
    if not (range_m > table["range_min_m"] and range_m < table["range_max_m"]):
        return _RANGE
    return _USED


@kernel
def screen(table, epoch, work, result):
    """Which rows can be used: `row_state` of each, and the usable ones in order in work; returns their number."""
    count = epoch["count"]
    state = result["row_state"]
    for i in range(count):
        state[i] = _judge_row(table, epoch, i)
    for i in range(count):
        for j in range(i):
            if (
                state[i] != _SYSTEM
                and epoch["satellite"][i] == epoch["satellite"][j]
                and epoch["constellation"][i] == epoch["constellation"][j]
            ):
                state[i] = state[j] = _DUPLICATE
    n = 0
    for i in range(count):
        if state[i] == _USED:
            work["row"][n] = i
            work["clock_of"][n] = epoch["constellation"][i]
            scaled = epoch["sigma_m"][i] * table["sigma_factor"]
            work["weight"][n] = 1.0 / (scaled * scaled)
            work["used"][n] = 1
            n += 1
    return n


@kernel
def enough(work, n):
    """(satellites used, constellations used); a lone satellite of a constellation gives its own clock only."""
    total = 0
    for j in range(CONSTELLATIONS):
        work["sum"][j, 0] = 0.0
    for i in range(n):
        if work["used"][i] != 0:
            total += 1
            work["sum"][work["clock_of"][i], 0] += 1.0
    present = 0
    for j in range(CONSTELLATIONS):
        if work["sum"][j, 0] > 0.0:
            present += 1
    return total, present


@kernel
def geometry(table, epoch, work, n, r):
    """Lines of sight (n,3), from satellite to r [m], and misfits (n,) [m]: range less distance. False: no distance."""
    for i in range(n):
        row = work["row"][i]
        x, y, z = epoch["r_m"][row, 0], epoch["r_m"][row, 1], epoch["r_m"][row, 2]
        d0, d1, d2 = r[0] - x, r[1] - y, r[2] - z
        flight_s = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2) / LIGHT_MPS
        # the turn is 5e-6 rad: its third power is 1e-9 m at most
        turn = table["earth_rate_radps"] * flight_s
        d0 = r[0] - (x + turn * y - 0.5 * turn * turn * x)
        d1 = r[1] - (y - turn * x - 0.5 * turn * turn * y)
        distance = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        if not (distance > 1e3):
            return False
        line = work["line"][i]
        line[0], line[1], line[2] = d0 / distance, d1 / distance, d2 / distance
        work["misfit_m"][i] = epoch["range_m"][row] - distance
    return True


@kernel
def invert_3(a, out):
    """Inverse of a symmetric positive definite 3x3 matrix by Cholesky; False where it is not, or nearly so."""
    largest = max(a[0, 0], max(a[1, 1], a[2, 2]))
    floor = _SINGULAR * largest
    if not (largest > 0.0) or not (a[0, 0] > floor):
        return False
    l00 = math.sqrt(a[0, 0])
    l10, l20 = a[1, 0] / l00, a[2, 0] / l00
    p1 = a[1, 1] - l10 * l10
    if not (p1 > floor):
        return False
    l11 = math.sqrt(p1)
    l21 = (a[2, 1] - l20 * l10) / l11
    p2 = a[2, 2] - l20 * l20 - l21 * l21
    if not (p2 > floor):
        return False
    l22 = math.sqrt(p2)
    i00, i11, i22 = 1.0 / l00, 1.0 / l11, 1.0 / l22
    i10 = -l10 * i00 * i11
    i21 = -l21 * i11 * i22
    i20 = -(l20 * i00 + l21 * i10) * i22
    out[0, 0] = i00 * i00 + i10 * i10 + i20 * i20
    out[1, 0] = out[0, 1] = i10 * i11 + i20 * i21
    out[2, 0] = out[0, 2] = i20 * i22
    out[1, 1] = i11 * i11 + i21 * i21
    out[2, 1] = out[1, 2] = i21 * i22
    out[2, 2] = i22 * i22
    return True


@kernel
def normal_equations(work, n):
    """Sums by constellation, normal matrix with the clocks eliminated, its inverse; False where it has none."""
    total, normal, right = work["sum"], work["normal"], work["right"]
    for j in range(CONSTELLATIONS):
        for k in range(5):
            total[j, k] = 0.0
    for i in range(n):
        if work["used"][i] != 0:
            j, w = work["clock_of"][i], work["weight"][i]
            total[j, 0] += w
            for k in range(3):
                total[j, 1 + k] += w * work["line"][i, k]
            total[j, 4] += w * work["misfit_m"][i]
    for a in range(3):
        right[a] = 0.0
        for b in range(3):
            normal[a, b] = 0.0
    for i in range(n):
        if work["used"][i] != 0:
            j, w = work["clock_of"][i], work["weight"][i]
            share = 1.0 / total[j, 0]
            g0 = work["line"][i, 0] - total[j, 1] * share
            g1 = work["line"][i, 1] - total[j, 2] * share
            g2 = work["line"][i, 2] - total[j, 3] * share
            y = w * (work["misfit_m"][i] - total[j, 4] * share)
            right[0] += g0 * y
            right[1] += g1 * y
            right[2] += g2 * y
            normal[0, 0] += w * g0 * g0
            normal[1, 0] += w * g1 * g0
            normal[1, 1] += w * g1 * g1
            normal[2, 0] += w * g2 * g0
            normal[2, 1] += w * g2 * g1
            normal[2, 2] += w * g2 * g2
    return invert_3(normal, work["cofactor"])


@kernel
def solve(table, epoch, work, n, r):
    """Move r [m] to the fix of the satellites used; returns iterations, 0 where there is no solution.

    Leaves lines, misfits, sums and cofactors of the fix in work.
    """
    cofactor, right = work["cofactor"], work["right"]
    for iteration in range(1, _ITERATIONS + 1):
        if not geometry(table, epoch, work, n, r) or not normal_equations(work, n):
            return 0
        largest = 0.0
        for a in range(3):
            step = 0.0
            for b in range(3):
                step += cofactor[a, b] * right[b]
            r[a] += step
            largest = max(largest, abs(step))
        if not (largest < 1e9):
            return 0
        if largest < _SETTLED_M:
            return iteration
    return 0
