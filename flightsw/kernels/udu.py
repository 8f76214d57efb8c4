"""Factorised covariance P = U D U': U unit upper triangular, D diagonal, both in one array with D on its diagonal.

A matrix held so is symmetric and positive semidefinite whatever the rounding, and keeps twice the digits of P. All
kernels work on the leading `n` rows of larger arrays. Sources: G. J. Bierman, Factorization Methods for Discrete
Sequential Estimation, Academic Press 1977, chapters V and VI; C. L. Thornton, JPL TM 33-798, 1976.
"""

from __future__ import annotations

import math

from flightsw.kernels.registry import kernel


@kernel
def factorise(p, n, ud):
    """U and D of a symmetric positive semidefinite p (Bierman, III.4); False where it is not. `ud` may be `p`."""
    for i in range(n):
        for j in range(n):
            ud[i, j] = p[i, j]
    for j in range(n - 1, -1, -1):
        d = ud[j, j]
        if not (d >= 0.0) or d == math.inf:  # NaN fails the first comparison
            return False
        for i in range(j):
            if d == 0.0 and ud[i, j] != 0.0:  # what does not vary is correlated with nothing
                return False
            u = ud[i, j] / d if d > 0.0 else 0.0
            for k in range(i + 1):  # the column is scaled afterwards: it serves the rows below this one
                ud[k, i] -= u * ud[k, j]
        for i in range(j):
            ud[i, j] = ud[i, j] / d if d > 0.0 else 0.0
    for i in range(n):
        for j in range(i):
            ud[i, j] = 0.0
    return True


@kernel
def covariance(ud, n, size, out):
    """The leading size x size block of P = U D U' into `out`."""
    for i in range(size):
        for j in range(i, size):
            total = ud[i, j] * ud[j, j] if i != j else ud[j, j]
            for k in range(j + 1, n):
                total += ud[i, k] * ud[k, k] * ud[j, k]
            out[i, j] = total
            out[j, i] = total


@kernel
def orthogonalise(w, q, n, columns, scaled, ud):
    """Factors of W diag(q) W' into `ud`, W (n x columns) being used up: modified weighted Gram-Schmidt.

    q >= 0; `scaled` is scratch of a row. columns must be a multiple of four: pad with zeros. Bierman, VI.4.
    """
    for j in range(n - 1, -1, -1):
        t0 = 0.0
        t1 = 0.0
        t2 = 0.0
        t3 = 0.0
        for k in range(0, columns, 4):  # four sums at a time: a single one would wait for every addition
            scaled[k] = q[k] * w[j, k]
            scaled[k + 1] = q[k + 1] * w[j, k + 1]
            scaled[k + 2] = q[k + 2] * w[j, k + 2]
            scaled[k + 3] = q[k + 3] * w[j, k + 3]
            t0 += scaled[k] * w[j, k]
            t1 += scaled[k + 1] * w[j, k + 1]
            t2 += scaled[k + 2] * w[j, k + 2]
            t3 += scaled[k + 3] * w[j, k + 3]
        d = (t0 + t1) + (t2 + t3)
        ud[j, j] = d
        for i in range(j):
            if not (d > 0.0):
                ud[i, j] = 0.0
                continue
            t0 = 0.0
            t1 = 0.0
            t2 = 0.0
            t3 = 0.0
            for k in range(0, columns, 4):
                t0 += w[i, k] * scaled[k]
                t1 += w[i, k + 1] * scaled[k + 1]
                t2 += w[i, k + 2] * scaled[k + 2]
                t3 += w[i, k + 3] * scaled[k + 3]
            u = ((t0 + t1) + (t2 + t3)) / d
            ud[i, j] = u
            for k in range(columns):
                w[i, k] -= u * w[j, k]
        for i in range(j + 1, n):
            ud[i, j] = 0.0


@kernel
def project(ud, n, h, f):
    """f = U' h; then h' P h is the sum of f_j D_j f_j."""
    for j in range(n):
        total = h[j]
        for i in range(j):
            total += ud[i, j] * h[i]
        f[j] = total


@kernel
def correct(ud, n, h, variance, f, gain):
    """Update of the factors by one scalar measurement z = h x + noise; Bierman, V.3.

    variance > 0 is that of the noise. Leaves the Kalman gain in `gain` (n) and returns the variance of the
    innovation, h' P h + variance. `f` is scratch.
    """
    project(ud, n, h, f)
    alpha = variance
    for j in range(n):
        v = ud[j, j] * f[j]
        beta = alpha
        alpha += f[j] * v
        ud[j, j] *= beta / alpha
        shift = -f[j] / beta
        gain[j] = v
        for i in range(j):
            u = ud[i, j]
            ud[i, j] = u + shift * gain[i]
            gain[i] += v * u
    for j in range(n):
        gain[j] /= alpha
    return alpha
