"""The weighted test over any set of links: per satellite a generalised likelihood ratio with its own parameters.

Residuals of healthy satellites are Gaussian with covariance S, made of the links' noise and of the errors that healthy
satellites broadcast, which their links share. A fault of satellite i adds A_i f with free f. Twice the logarithm of the
likelihood ratio is T_i = g_i' M_ii^-1 g_i with g = A' S^-1 r, M = A' S^-1 A; it is chi-square with as many degrees of
freedom as M_ii has rank, exactly. A satellite is excluded by estimating its f instead of assuming it healthy, which
takes the direction A_i out of everything else (Kay, Detection Theory, 1998, section 7.7).
"""

from __future__ import annotations

import math

from flightsw.crosslink.declare import kernel
from flightsw.crosslink.matrices import factor_upper, gram, solve_upper_transposed, solve_upper_transposed_many
from flightsw.crosslink.records import PARAMETERS

_FLOOR = 1e-7  # share of a parameter's own information below which nothing of it is left


@kernel
def _shared(test, first, second, sigma_m, sigma_rate_mps):
    """Covariance [m2] of two links by the errors of the satellites they share."""
    total = 0.0
    for a in range(2):
        one = test["receiver"][first] if a == 0 else test["sender"][first]
        for b in range(2):
            other = test["receiver"][second] if b == 0 else test["sender"][second]
            if one == other:
                for k in range(PARAMETERS):
                    total += test["h_bias"][first, a, k] * test["h_bias"][second, b, k] * sigma_m[k] * sigma_m[k]
                    total += (
                        test["h_rate"][first, a, k]
                        * test["h_rate"][second, b, k]
                        * sigma_rate_mps[k]
                        * sigma_rate_mps[k]
                    )
    return total


@kernel
def inverse_root(block, floor, eliminated, used, root):
    """root (4,4) with root' root a generalised inverse of `block`, by pivoted elimination; returns its rank.

    A pivot that does not exceed `floor` is no information. Rows beyond the rank are zero. `block` is destroyed.
    """
    n = PARAMETERS
    for i in range(n):
        used[i] = 0
        for j in range(n):
            root[i, j] = 0.0
            eliminated[i, j] = 1.0 if i == j else 0.0
    for step in range(n):
        best = -1
        for i in range(n):
            if used[i] == 0 and (best < 0 or block[i, i] > block[best, best]):
                best = i
        pivot = block[best, best]
        if not (pivot > floor):
            return step
        used[best] = 1
        scale = 1.0 / math.sqrt(pivot)
        for j in range(n):
            root[step, j] = scale * eliminated[best, j]
        for i in range(n):
            if used[i] == 0:
                share = block[i, best] / pivot
                for j in range(n):
                    block[i, j] -= share * block[best, j]
                    eliminated[i, j] -= share * eliminated[best, j]
    return n


@kernel
def _root_of(test, matrix, satellite, root):
    """Root of a satellite's block of `matrix`; returns its rank. What is below the floor of the whole is nothing."""
    at = satellite * PARAMETERS
    scale = 0.0
    for i in range(PARAMETERS):
        scale = max(scale, test["diagonal"][at + i])
        for j in range(PARAMETERS):
            test["block"][i, j] = matrix[at + i, at + j]
    return inverse_root(test["block"], _FLOOR * scale, test["eliminated"], test["used"], root)


@kernel
def _length(root, rank, g, at):
    """|root g|^2 of the block at `at`."""
    total = 0.0
    for i in range(rank):
        value = 0.0
        for j in range(PARAMETERS):
            value += root[i, j] * g[at + j]
        total += value * value
    return total


@kernel
def prepare(test, satellites, sigma_m, sigma_rate_mps):
    """Make a test ready from its links, sensitivities and noise; False where the covariance is not positive definite.

    sigma_m, sigma_rate_mps (4): of what a healthy satellite broadcasts.
    """
    links = test["links"]
    columns = satellites * PARAMETERS
    test["columns"] = columns
    test["ready"] = 0
    factor, white = test["factor"], test["white"]
    for first in range(links):
        for second in range(first, links):
            factor[first, second] = _shared(test, first, second, sigma_m, sigma_rate_mps)
        factor[first, first] += test["noise_m2"][first]
    if links == 0 or not factor_upper(factor, links):
        return False
    for link in range(links):
        for column in range(columns):
            white[link, column] = 0.0
        for k in range(PARAMETERS):
            white[link, test["receiver"][link] * PARAMETERS + k] = test["h"][link, 0, k]
            white[link, test["sender"][link] * PARAMETERS + k] = test["h"][link, 1, k]
    solve_upper_transposed_many(factor, links, white, columns)
    gram(white, links, columns, test["gram"])
    for column in range(columns):
        test["diagonal"][column] = test["gram"][column, column]
    for satellite in range(satellites):
        test["dof"][satellite] = _root_of(test, test["gram"], satellite, test["root"][satellite])
    test["ready"] = 1
    return True


@kernel
def evaluate(test, residual_m):
    """Fill z, g and every satellite's statistic from the residuals (links,) [m], none of them excluded."""
    links, columns = test["links"], test["columns"]
    z, g, white = test["z"], test["g"], test["white"]
    for link in range(links):
        z[link] = residual_m[link]
    solve_upper_transposed(test["factor"], links, z)
    for column in range(columns):
        g[column] = 0.0
    for link in range(links):
        value = z[link]
        row = white[link]
        for column in range(columns):
            g[column] += value * row[column]
    for satellite in range(columns // PARAMETERS):
        test["statistic"][satellite] = _length(
            test["root"][satellite], test["dof"][satellite], g, satellite * PARAMETERS
        )


@kernel
def restore(test):
    """Begin a search: nobody is excluded."""
    columns = test["columns"]
    for a in range(columns):
        test["g_left"][a] = test["g"][a]
        for b in range(columns):
            test["gram_left"][a, b] = test["gram"][a, b]


@kernel
def exclude(test, satellite):
    """Take out of what is left of the test all that a fault of this satellite could explain."""
    columns = test["columns"]
    at = satellite * PARAMETERS
    left, g_left, root = test["gram_left"], test["g_left"], test["root_left"]
    reduced, reduced_g = test["reduced"], test["reduced_g"]
    rank = _root_of(test, left, satellite, root)
    for i in range(rank):
        value = 0.0
        for k in range(PARAMETERS):
            value += root[i, k] * g_left[at + k]
        reduced_g[i] = value
        for column in range(columns):
            reduced[i, column] = 0.0
        for k in range(PARAMETERS):
            share = root[i, k]
            row = left[at + k]
            for column in range(columns):
                reduced[i, column] += share * row[column]
    for i in range(rank):
        row = reduced[i]
        for a in range(columns):
            share = row[a]
            if share != 0.0:
                g_left[a] -= share * reduced_g[i]
                target = left[a]
                for b in range(columns):
                    target[b] -= share * row[b]


@kernel
def statistic_left(test, satellite):
    """(statistic, degrees of freedom) of a satellite in what the exclusions have left."""
    rank = _root_of(test, test["gram_left"], satellite, test["root_left"])
    return _length(test["root_left"], rank, test["g_left"], satellite * PARAMETERS), rank
