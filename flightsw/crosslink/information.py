"""The weighted test in information form: as large as the satellites' errors are many, however many links there are.

Where all that healthy satellites broadcast is a constant error, a column of the same sensitivities A for each, the
covariance of the residuals is S = N + A D^2 A', with the noise N of the links and the standard deviations D. By the
matrix inversion lemma (Woodbury 1950), with G = A' N^-1 A and U'U = I + D G D,

    A' S^-1 A = G - W'W,    A' S^-1 r = A' N^-1 r - W' U'^-1 D A' N^-1 r,    W = U'^-1 D G

and as D G D = U'U - I, what W holds of these same errors is (U - U'^-1) D^-1: no product has to be made. Errors with
D = 0, clocks in most tables, have columns in A and W, and none in U.
"""

from __future__ import annotations

from flightsw.crosslink.declare import kernel
from flightsw.crosslink.matrices import factor_upper, invert_transposed, solve_upper_transposed
from flightsw.crosslink.records import PARAMETERS


@kernel
def healthy_errors(satellites, sigma_m):
    """How many errors healthy satellites broadcast, all together: the size of U."""
    count = 0
    for k in range(PARAMETERS):
        if sigma_m[k] > 0.0:
            count += satellites
    return count


@kernel
def _information(test, columns):
    """Fill G."""
    g = test["information"]
    for a in range(columns):
        for b in range(columns):
            g[a, b] = 0.0
    for link in range(test["links"]):
        weight = 1.0 / test["noise_m2"][link]
        h_one, h_other = test["h"][link, 0], test["h"][link, 1]
        one, other = test["receiver"][link] * PARAMETERS, test["sender"][link] * PARAMETERS
        for j in range(PARAMETERS):
            of_one, of_other = weight * h_one[j], weight * h_other[j]
            row_one, row_other = g[one + j], g[other + j]
            for k in range(PARAMETERS):
                row_one[one + k] += of_one * h_one[k]
                row_one[other + k] += of_one * h_other[k]
                row_other[one + k] += of_other * h_one[k]
                row_other[other + k] += of_other * h_other[k]


@kernel
def _unshared(test, columns, sigma_m):
    """Columns of W of the errors that healthy satellites do not broadcast; the test has no search under way yet."""
    g, inverse, w, packed = test["information"], test["inverse"], test["white"], test["gram_left"]
    size = test["rows"]
    for k in range(PARAMETERS):
        if sigma_m[k] > 0.0:
            continue
        satellites = columns // PARAMETERS
        for j in range(size):
            for satellite in range(satellites):
                packed[j, satellite] = test["deviation"][j] * g[test["shared"][j], satellite * PARAMETERS + k]
        for i in range(size):
            row = test["g_left"]
            for satellite in range(satellites):
                row[satellite] = 0.0
            for j in range(i + 1):
                share = inverse[i, j]
                if share != 0.0:
                    of = packed[j]
                    for satellite in range(satellites):
                        row[satellite] += share * of[satellite]
            for satellite in range(satellites):
                w[i, satellite * PARAMETERS + k] = row[satellite]


@kernel
def prepare_information(test, satellites, sigma_m):
    """Fill G, U and W from links, sensitivities and noise; False where S is not positive definite."""
    columns = satellites * PARAMETERS
    _information(test, columns)
    g, u, inverse, w = test["information"], test["factor"], test["inverse"], test["white"]
    shared, deviation = test["shared"], test["deviation"]
    size = 0
    for column in range(columns):
        if sigma_m[column % PARAMETERS] > 0.0:
            shared[size], deviation[size] = column, sigma_m[column % PARAMETERS]
            size += 1
    test["rows"] = size
    for i in range(size):
        of, row = g[shared[i]], u[i]
        for j in range(i, size):
            row[j] = deviation[i] * of[shared[j]] * deviation[j]
        row[i] += 1.0
    if not factor_upper(u, size, test["reach"]):
        return False
    invert_transposed(u, size, inverse, test["reach"])
    for i in range(size):
        row = w[i]
        for column in range(columns):
            row[column] = 0.0
        for j in range(i):
            row[shared[j]] = -inverse[i, j] / deviation[j]
        row[shared[i]] = (u[i, i] - inverse[i, i]) / deviation[i]
        for j in range(i + 1, size):
            row[shared[j]] = u[i, j] / deviation[j]
    if size < columns:
        _unshared(test, columns, sigma_m)
    return True


@kernel
def weigh_information(test, residual_m):
    """Fill z = U'^-1 D A' N^-1 r and g = A' S^-1 r from the residuals (links,) [m]."""
    g, z, w, columns, size = test["g"], test["z"], test["white"], test["columns"], test["rows"]
    for column in range(columns):
        g[column] = 0.0
    for link in range(test["links"]):
        value = residual_m[link] / test["noise_m2"][link]
        one, other = test["receiver"][link] * PARAMETERS, test["sender"][link] * PARAMETERS
        for k in range(PARAMETERS):
            g[one + k] += test["h"][link, 0, k] * value
            g[other + k] += test["h"][link, 1, k] * value
    for i in range(size):
        z[i] = test["deviation"][i] * g[test["shared"][i]]
    solve_upper_transposed(test["factor"], size, z, test["reach"])
    for i in range(size):
        value, row = z[i], w[i]
        for column in range(columns):
            g[column] -= value * row[column]
