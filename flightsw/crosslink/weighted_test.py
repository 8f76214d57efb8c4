"""The weighted test over any set of links: per satellite a generalised likelihood ratio with its own parameters.

Residuals of healthy satellites are Gaussian with covariance S, made of the links' noise and of the errors that healthy
satellites broadcast, which their links share. A fault of satellite i adds A_i f with free f. Twice the logarithm of the
likelihood ratio is T_i = g_i' M_ii^-1 g_i with g = A' S^-1 r, M = A' S^-1 A; it is chi-square with as many degrees of
freedom as M_ii has rank, exactly. A satellite is excluded by estimating its f instead of assuming it healthy, which
takes the direction A_i out of everything else (Kay, Detection Theory, 1998, section 7.7).

Where a pair of satellites measures both ways with the same noise, the test works on the sum and the difference of the
two, each over sqrt 2: a rotation, which changes no statistic. Sums know positions alone and differences clocks alone,
so that S falls into two blocks. Where healthy errors are fewer than links and constant, S is not made at all
(information.py).
"""

from __future__ import annotations

import math

from flightsw.crosslink.declare import kernel
from flightsw.crosslink.information import healthy_errors, prepare_information, weigh_information
from flightsw.crosslink.matrices import (
    factor_upper,
    gram,
    near_diagonal,
    solve_upper_transposed,
    solve_upper_transposed_many,
)
from flightsw.crosslink.records import PARAMETERS, SATELLITES

_FLOOR = 1e-7  # share of a parameter's own information below which nothing of it is left
_ROOT_HALF = math.sqrt(0.5)


@kernel
def _rows(test):
    """Rows of the test: links alone, sums of links that go both ways, and last their differences."""
    links, receiver, sender = test["links"], test["receiver"], test["sender"]
    link_of, first, second = test["link_of"], test["first"], test["second"]
    for link in range(links):
        link_of[receiver[link] * SATELLITES + sender[link]] = link
    rows = 0
    for link in range(links):
        test["mate"][link] = -1
        back = link_of[sender[link] * SATELLITES + receiver[link]]  # of an older epoch, perhaps
        if (
            0 <= back < links
            and receiver[back] == sender[link]
            and sender[back] == receiver[link]
            and link_of[receiver[link] * SATELLITES + sender[link]] == link
            and test["noise_m2"][back] == test["noise_m2"][link]
        ):
            test["mate"][link] = back
        if test["mate"][link] < 0 or link < back:
            first[rows], second[rows] = link, test["mate"][link]
            test["sign"][rows] = 1.0
            rows += 1
    for link in range(links):
        if test["mate"][link] > link:
            first[rows], second[rows] = link, test["mate"][link]
            test["sign"][rows] = -1.0
            rows += 1


@kernel
def _ends(test, satellites, sigma_m, sigma_rate_mps):
    """Rows of white, not yet whitened, and of `bias` and `rate`: sensitivities to healthy errors, in their sigma."""
    links, columns = test["links"], satellites * PARAMETERS
    head, following = test["head"], test["following"]
    for satellite in range(satellites):
        head[satellite] = -1
    for row in range(links):
        link, back, sign = test["first"][row], test["second"][row], test["sign"][row]
        white = test["white"][row]
        for column in range(columns):
            white[column] = 0.0
        for end in range(2):
            satellite = test["receiver"][link] if end == 0 else test["sender"][link]
            at = satellite * PARAMETERS
            for k in range(PARAMETERS):
                h, bias, rate = test["h"][link, end, k], test["h_bias"][link, end, k], test["h_rate"][link, end, k]
                if back >= 0:
                    h = _ROOT_HALF * (h + sign * test["h"][back, 1 - end, k])
                    bias = _ROOT_HALF * (bias + sign * test["h_bias"][back, 1 - end, k])
                    rate = _ROOT_HALF * (rate + sign * test["h_rate"][back, 1 - end, k])
                white[at + k] = h
                test["bias"][row, end, k] = sigma_m[k] * bias
                test["rate"][row, end, k] = sigma_rate_mps[k] * rate
            place = 2 * row + end
            following[place] = head[satellite]
            head[satellite] = place


@kernel
def _covariance(test, satellites):
    """Upper triangle of S: noise, and what rows share by the healthy errors of a satellite of both."""
    links, factor, following = test["links"], test["factor"], test["following"]
    bias, rate = test["bias"], test["rate"]
    for row in range(links):
        for other in range(row, links):
            factor[row, other] = 0.0
        factor[row, row] = test["noise_m2"][test["first"][row]]
    for satellite in range(satellites):
        one = test["head"][satellite]
        while one >= 0:
            row, end = one // 2, one % 2
            other = one
            while other >= 0:
                column, other_end = other // 2, other % 2
                total = 0.0
                for k in range(PARAMETERS):
                    total += bias[row, end, k] * bias[column, other_end, k]
                    total += rate[row, end, k] * rate[column, other_end, k]
                factor[min(row, column), max(row, column)] += total
                other = following[other]
            one = following[one]


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
def _root_of_block(test, satellite, root):
    """Root of a satellite's matrix, in test["block"]; returns its rank. Below the floor of the whole is nothing."""
    scale = 0.0
    for i in range(PARAMETERS):
        scale = max(scale, test["diagonal"][satellite * PARAMETERS + i])
    return inverse_root(test["block"], _FLOOR * scale, test["eliminated"], test["used"], root)


@kernel
def _root_left(test, satellite, root):
    """The same of what exclusions have left."""
    at = satellite * PARAMETERS
    for i in range(PARAMETERS):
        for j in range(PARAMETERS):
            test["block"][i, j] = test["gram_left"][at + i, at + j]
    return _root_of_block(test, satellite, root)


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
def _prepare_covariance(test, satellites, sigma_m, sigma_rate_mps):
    """Rows of links, their covariance factored, sensitivities whitened; False where it is not positive definite."""
    links = test["links"]
    _rows(test)
    _ends(test, satellites, sigma_m, sigma_rate_mps)
    _covariance(test, satellites)
    test["rows"] = links
    if not factor_upper(test["factor"], links, test["reach"]):
        return False
    solve_upper_transposed_many(test["factor"], links, test["white"], test["columns"], test["reach"], False)
    return True


@kernel
def prepare(test, satellites, sigma_m, sigma_rate_mps, constant):
    """Make a test ready from its links, sensitivities and noise; False where the covariance is not positive definite.

    sigma_m, sigma_rate_mps (4): of what a healthy satellite broadcasts. constant: its errors do not move, and show as a
    fault does (h_bias is h, h_rate zero). Of the two forms the test then takes the smaller one.
    """
    columns = satellites * PARAMETERS
    test["columns"] = columns
    test["ready"], test["whole"] = 0, 0
    if test["links"] == 0:
        return False
    test["informed"] = 1 if constant and healthy_errors(satellites, sigma_m) < test["links"] else 0
    if test["informed"] != 0:
        if not prepare_information(test, satellites, sigma_m):
            return False
    elif not _prepare_covariance(test, satellites, sigma_m, sigma_rate_mps):
        return False
    near, block = test["near"], test["block"]
    near_diagonal(test["white"], test["rows"], columns, near)
    if test["informed"] != 0:
        for offset in range(PARAMETERS):
            for column in range(columns - offset):
                near[offset, column] = test["information"][column, column + offset] - near[offset, column]
    for column in range(columns):
        test["diagonal"][column] = near[0, column]
    for satellite in range(satellites):
        at = satellite * PARAMETERS
        for i in range(PARAMETERS):
            for j in range(i, PARAMETERS):
                block[i, j] = near[j - i, at + i]
                block[j, i] = near[j - i, at + i]
        test["dof"][satellite] = _root_of_block(test, satellite, test["root"][satellite])
    test["ready"] = 1
    return True


@kernel
def _weigh_covariance(test, residual_m):
    """z: residuals (links,) [m] by rows, whitened. g: their products with the sensitivities."""
    links, columns = test["links"], test["columns"]
    z, g, white = test["z"], test["g"], test["white"]
    for row in range(links):
        value, back = residual_m[test["first"][row]], test["second"][row]
        z[row] = value if back < 0 else _ROOT_HALF * (value + test["sign"][row] * residual_m[back])
    solve_upper_transposed(test["factor"], links, z, test["reach"])
    for column in range(columns):
        g[column] = 0.0
    for link in range(links):
        value = z[link]
        row = white[link]
        for column in range(columns):
            g[column] += value * row[column]


@kernel
def evaluate(test, residual_m):
    """Fill g and every satellite's statistic from the residuals (links,) [m], none of them excluded."""
    if test["informed"] != 0:
        weigh_information(test, residual_m)
    else:
        _weigh_covariance(test, residual_m)
    for satellite in range(test["columns"] // PARAMETERS):
        test["statistic"][satellite] = _length(
            test["root"][satellite], test["dof"][satellite], test["g"], satellite * PARAMETERS
        )


@kernel
def restore(test):
    """Begin a search: nobody is excluded. What satellites share is needed from here on, and most epochs never do."""
    columns = test["columns"]
    if test["whole"] == 0:
        gram(test["white"], test["rows"], columns, test["gram"])
        if test["informed"] != 0:
            for a in range(columns):
                for b in range(columns):
                    test["gram"][a, b] = test["information"][a, b] - test["gram"][a, b]
        test["whole"] = 1
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
    rank = _root_left(test, satellite, root)
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
    rank = _root_left(test, satellite, test["root_left"])
    return _length(test["root_left"], rank, test["g_left"], satellite * PARAMETERS), rank
