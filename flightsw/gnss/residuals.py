"""The space of residuals about a fix: what every set of exclusions would change, without solving again.

Whitened ranges y = A x + e give residuals r = S y, S = I - A (A'A)^-1 A', and a position x = K y. Without a set E

    RSS_E = RSS - r_E' S_EE^-1 r_E,    x_E = x - K_E S_EE^-1 r_E,    P_E = P + K_E S_EE^-1 K_E'

(Cook and Weisberg 1982, deletion diagnostics; Blanch et al. 2012 for solution separation). S_EE is factored row by row:
each satellite taken out adds one row of a partial Cholesky factor of [S | r | K']. A pivot that is zero belongs to a
satellite that nothing can contradict any more (the last of its constellation); taking it out changes no residual.
"""

from __future__ import annotations

import math

from flightsw.gnss.declare import kernel
from flightsw.gnss.records import AXES, SATELLITES

RESIDUAL = SATELLITES  # column of the residual in a row of the reduced system
SHIFT = SATELLITES + 1  # first of the columns of K'
FLOOR = 1e-8  # redundancy that is none
_ECCENTRICITY_SQUARED = 6.69437999014e-3  # WGS 84
_UNSEEN = 1e-3  # share of a sigma that an unobservable position may still depend on what was taken out


@kernel
def bit(row):
    """Mask of one row, as int64."""
    return 1 << row if row < 63 else -(1 << 63)


@kernel
def local_axes(r, axes):
    """Rows of axes (3,3): east, north, up at r [m], up along the normal of the ellipsoid; at the poles, east is y."""
    u0, u1, u2 = r[0], r[1], r[2] / (1.0 - _ECCENTRICITY_SQUARED)
    length = math.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
    if not (length > 1.0):
        u0, u1, u2, length = 1.0, 0.0, 0.0, 1.0
    u0, u1, u2 = u0 / length, u1 / length, u2 / length
    flat = math.sqrt(u0 * u0 + u1 * u1)
    e0, e1 = 0.0, 1.0
    if flat > 1e-9:
        e0, e1 = -u1 / flat, u0 / flat
    axes[0, 0], axes[0, 1], axes[0, 2] = e0, e1, 0.0
    axes[1, 0], axes[1, 1], axes[1, 2] = -u2 * e1, u2 * e0, u0 * e1 - u1 * e0
    axes[2, 0], axes[2, 1], axes[2, 2] = u0, u1, u2


@kernel
def reduce_system(work, n):
    """Fill the reduced system of the satellites used, from lines, misfits, sums and cofactor of `normal_equations`."""
    total, cofactor, right, white, reduced = (
        work["sum"],
        work["cofactor"],
        work["right"],
        work["white"],
        work["reduced"],
    )
    axes, step = work["axes"], work["place"]
    for a in range(3):
        step[a] = cofactor[a, 0] * right[0] + cofactor[a, 1] * right[1] + cofactor[a, 2] * right[2]
    for i in range(n):
        row = reduced[i]
        root = math.sqrt(work["weight"][i]) if work["used"][i] != 0 else 0.0
        share = 1.0 / total[work["clock_of"][i], 0] if root > 0.0 else 0.0
        j = work["clock_of"][i]
        left = root * (work["misfit_m"][i] - total[j, 4] * share)
        for a in range(3):
            white[i, a] = root * (work["line"][i, a] - total[j, 1 + a] * share)
            left -= white[i, a] * step[a]
        row[RESIDUAL] = left
        p0 = cofactor[0, 0] * white[i, 0] + cofactor[0, 1] * white[i, 1] + cofactor[0, 2] * white[i, 2]
        p1 = cofactor[1, 0] * white[i, 0] + cofactor[1, 1] * white[i, 1] + cofactor[1, 2] * white[i, 2]
        p2 = cofactor[2, 0] * white[i, 0] + cofactor[2, 1] * white[i, 1] + cofactor[2, 2] * white[i, 2]
        for q in range(AXES):
            row[SHIFT + q] = axes[q, 0] * p0 + axes[q, 1] * p1 + axes[q, 2] * p2
        for k in range(i):
            value = -(p0 * white[k, 0] + p1 * white[k, 1] + p2 * white[k, 2])
            if j == work["clock_of"][k] and work["used"][k] != 0:
                value -= root * math.sqrt(work["weight"][k]) * share
            row[k] = value
            reduced[k, i] = value
        row[i] = 0.0
        if root > 0.0:
            row[i] = 1.0 - root * root * share - (p0 * white[i, 0] + p1 * white[i, 1] + p2 * white[i, 2])


@kernel
def begin(work, n):
    """Nobody is taken out: redundancies and residuals as they are; returns the sum of squared residuals."""
    rss = 0.0
    for i in range(n):
        work["diagonal"][i] = work["reduced"][i, i]
        left = work["reduced"][i, RESIDUAL]
        work["left"][i] = left
        rss += left * left
    return rss


@kernel
def factor_row(work, columns, depth, i):
    """Row `depth` of the factor: satellite i, whose pivot is not zero, on top of those taken out before it.

    columns: how many of the residual space are wanted; residual and shifts always are. Nothing else changes.
    """
    levels, source = work["levels"], work["reduced"][i]
    row = levels[depth]
    scale = 1.0 / math.sqrt(work["diagonal"][i])
    for c in range(columns):
        row[c] = scale * source[c]
    for c in range(RESIDUAL, SHIFT + AXES):
        row[c] = scale * source[c]
    for d in range(depth):
        other = levels[d]
        share = scale * other[i]
        for c in range(columns):
            row[c] -= share * other[c]
        for c in range(RESIDUAL, SHIFT + AXES):
            row[c] -= share * other[c]


@kernel
def observed(work, depth, i):
    """Whether the position can still be seen without satellite i, which nothing contradicts, and those taken out."""
    # squared: a shift [m] per sigma, against the largest variance of the fix
    largest = max(work["cofactor"][0, 0], max(work["cofactor"][1, 1], work["cofactor"][2, 2]))
    for q in range(AXES):
        rest = work["reduced"][i, SHIFT + q]
        for d in range(depth):
            rest -= work["levels"][d, i] * work["levels"][d, SHIFT + q]
        if rest * rest > _UNSEEN * _UNSEEN * largest:
            return False
    return True


@kernel
def take_out(work, n, depth, i):
    """Take satellite i out as the depth-th; returns by how much RSS falls, or -1: nothing contradicts i any more."""
    diagonal, left = work["diagonal"], work["left"]
    if not (diagonal[i] > FLOOR):
        return -1.0
    factor_row(work, n, depth, i)
    row = work["levels"][depth]
    found = row[RESIDUAL]
    for c in range(n):
        diagonal[c] -= row[c] * row[c]
        left[c] -= row[c] * found
    diagonal[i] = 0.0
    left[i] = 0.0
    return found * found


@kernel
def take_out_all(work, n, mask):
    """Begin, then take out all of a mask of places; returns (RSS, rows of the factor, position still observable)."""
    rss = begin(work, n)
    depth = 0
    seen = True
    for i in range(n):
        if mask & bit(i):
            fall = take_out(work, n, depth, i)
            if fall >= 0.0:
                rss -= fall
                depth += 1
            elif not observed(work, depth, i):
                seen = False
    return rss, depth, seen


@kernel
def largest_normalised(work, n):
    """Largest squared normalised residual of what is left, and whose place it is (-1: nothing has redundancy)."""
    most, worst = 0.0, -1
    for i in range(n):
        if work["diagonal"][i] > FLOOR:
            value = work["left"][i] * work["left"][i] / work["diagonal"][i]
            if worst < 0 or value > most:
                most, worst = value, i
    return most, worst
