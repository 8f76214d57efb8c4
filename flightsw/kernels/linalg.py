"""Small dense linear algebra on preallocated arrays."""

from __future__ import annotations

import math

from flightsw.kernels.registry import kernel


@kernel
def copy_vector(source, out):
    """out = source. An assignment of slices is the same, but numba takes a second to compile each kind of it."""
    for i in range(out.shape[0]):
        out[i] = source[i]


@kernel
def copy_matrix(source, out):
    """out = source, of two dimensions; see `copy_vector`."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]


@kernel
def multiply(a, b, out):
    """out = a b for matrices of matching shapes; `out` must be neither `a` nor `b`."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            total = 0.0
            for k in range(a.shape[1]):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@kernel
def cholesky(a, lower):
    """Lower Cholesky factor of symmetric `a`; False where `a` is not positive definite or not finite."""
    n = a.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i == j:
                if not (total > 0.0) or total == math.inf:  # NaN fails the first comparison
                    return False
                lower[i, i] = math.sqrt(total)
            else:
                lower[i, j] = total / lower[j, j]
        for j in range(i + 1, n):
            lower[i, j] = 0.0
    return True


@kernel
def solve_lower(lower, b, out):
    """Solve lower y = b by forward substitution; `out` may be `b`."""
    for i in range(lower.shape[0]):
        total = b[i]
        for k in range(i):
            total -= lower[i, k] * out[k]
        out[i] = total / lower[i, i]


@kernel
def solve_lower_transposed(lower, b, out):
    """Solve lower' y = b by backward substitution; `out` may be `b`."""
    n = lower.shape[0]
    for step in range(n):
        i = n - 1 - step
        total = b[i]
        for k in range(i + 1, n):
            total -= lower[k, i] * out[k]
        out[i] = total / lower[i, i]


@kernel
def largest_eigenvalue_3x3(a):
    """Largest eigenvalue of the symmetric 3x3 block at the top left of `a`, in closed form.

    Source: O. K. Smith, Eigenvalues of a symmetric 3x3 matrix, Comm. ACM 4 (1961) 168.
    """
    off = a[0, 1] * a[0, 1] + a[0, 2] * a[0, 2] + a[1, 2] * a[1, 2]
    mean = (a[0, 0] + a[1, 1] + a[2, 2]) / 3.0
    d0 = a[0, 0] - mean
    d1 = a[1, 1] - mean
    d2 = a[2, 2] - mean
    spread = math.sqrt((d0 * d0 + d1 * d1 + d2 * d2 + 2.0 * off) / 6.0)
    if not (spread > 0.0):  # a multiple of the identity, or not finite
        return mean + spread
    d0 /= spread
    d1 /= spread
    d2 /= spread
    o01 = a[0, 1] / spread
    o02 = a[0, 2] / spread
    o12 = a[1, 2] / spread
    half_det = 0.5 * (d0 * (d1 * d2 - o12 * o12) - o01 * (o01 * d2 - o12 * o02) + o02 * (o01 * o12 - d1 * o02))
    half_det = min(1.0, max(-1.0, half_det))
    return mean + 2.0 * spread * math.cos(math.acos(half_det) / 3.0)
