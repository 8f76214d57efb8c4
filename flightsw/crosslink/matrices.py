"""Dense kernels on preallocated arrays, written along rows so that the compiler makes vectors of them."""

from __future__ import annotations

import math

from flightsw.crosslink.declare import kernel


@kernel
def factor_upper(a, n):
    """Cholesky factor of the leading n x n block of `a` (its upper triangle is read), in place: a = U'U.

    False where the block is not positive definite or not finite. The lower triangle is left as it was.
    """
    for j in range(n):
        pivot = a[j, j]
        if not (pivot > 0.0) or pivot == math.inf:  # NaN fails the first comparison
            return False
        root = 1.0 / math.sqrt(pivot)
        row = a[j]
        for k in range(j, n):
            row[k] *= root
        for i in range(j + 1, n):
            share = row[i]
            if share != 0.0:
                other = a[i]
                for k in range(i, n):
                    other[k] -= share * row[k]
    return True


@kernel
def solve_upper_transposed(u, n, x):
    """Solve U' y = x in place for the vector x (n), U the upper factor of `factor_upper`."""
    for j in range(n):
        value = x[j] / u[j, j]
        x[j] = value
        row = u[j]
        for k in range(j + 1, n):
            x[k] -= row[k] * value


@kernel
def solve_upper_transposed_many(u, n, x, columns):
    """Solve U' Y = X in place for the n rows of X, over its first `columns` columns."""
    for j in range(n):
        row = x[j]
        scale = 1.0 / u[j, j]
        for c in range(columns):
            row[c] *= scale
        for k in range(j + 1, n):
            share = u[j, k]
            if share != 0.0:
                other = x[k]
                for c in range(columns):
                    other[c] -= share * row[c]


@kernel
def gram(c, n, columns, out):
    """out = C'C, whole, of the n rows and the first `columns` columns of C."""
    for a in range(columns):
        for b in range(columns):
            out[a, b] = 0.0
    for i in range(n):
        row = c[i]
        for a in range(columns):
            share = row[a]
            if share != 0.0:
                target = out[a]
                for b in range(a, columns):
                    target[b] += share * row[b]
    for a in range(columns):
        for b in range(a):
            out[a, b] = out[b, a]


@kernel
def pivoted_rank(a, n, tolerance):
    """Rank of the symmetric positive semidefinite leading n x n block of `a`; destroys it.

    Cholesky with diagonal pivoting (Higham 1990): pivots below `tolerance` of the first one are zero.
    """
    first = 0.0
    for step in range(n):
        best = step
        for i in range(step + 1, n):
            if a[i, i] > a[best, best]:
                best = i
        pivot = a[best, best]
        if step == 0:
            first = pivot
        if not (pivot > tolerance * first) or not (pivot > 0.0):
            return step
        if best != step:
            for k in range(n):
                kept = a[step, k]
                a[step, k] = a[best, k]
                a[best, k] = kept
            for k in range(n):
                kept = a[k, step]
                a[k, step] = a[k, best]
                a[k, best] = kept
        inverse = 1.0 / pivot
        source = a[step]
        for i in range(step + 1, n):
            share = a[i, step] * inverse
            if share != 0.0:
                target = a[i]
                for k in range(step + 1, n):
                    target[k] -= share * source[k]
    return n
