"""Dense kernels on preallocated arrays, written along rows so that the compiler makes vectors of them."""

from __future__ import annotations

import math

from flightsw.crosslink.declare import kernel


@kernel
def factor_upper(a, n):
    """Cholesky factor of the leading n x n block of `a` (its upper triangle is read), in place: a = U'U.

    False where the block is not positive definite or not finite. The lower triangle is left as it was. Four pivots are
    taken at a time, so that a row is read and written once for all of them; every element sees the same operations in
    the same order as with one.
    """
    first = 0
    while first < n:
        last = min(first + 4, n)
        for j in range(first, last):
            row = a[j]
            for i in range(first, j):
                share = a[i, j]
                if share != 0.0:
                    other = a[i]
                    for k in range(j, n):
                        row[k] -= share * other[k]
            pivot = row[j]
            if not (pivot > 0.0) or pivot == math.inf:  # NaN fails the first comparison
                return False
            root = 1.0 / math.sqrt(pivot)
            for k in range(j, n):
                row[k] *= root
        if last == first + 4:
            row0, row1, row2, row3 = a[first], a[first + 1], a[first + 2], a[first + 3]
            for i in range(last, n):
                s0, s1, s2, s3 = row0[i], row1[i], row2[i], row3[i]
                if s0 != 0.0 or s1 != 0.0 or s2 != 0.0 or s3 != 0.0:
                    row = a[i]
                    for k in range(i, n):
                        row[k] = (((row[k] - s0 * row0[k]) - s1 * row1[k]) - s2 * row2[k]) - s3 * row3[k]
        first = last
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
    """Solve U' Y = X in place for the n rows of X, over its first `columns` columns; four rows at a time, as above."""
    first = 0
    while first < n:
        last = min(first + 4, n)
        for j in range(first, last):
            row = x[j]
            for i in range(first, j):
                share = u[i, j]
                if share != 0.0:
                    other = x[i]
                    for c in range(columns):
                        row[c] -= share * other[c]
            scale = 1.0 / u[j, j]
            for c in range(columns):
                row[c] *= scale
        if last == first + 4:
            row0, row1, row2, row3 = x[first], x[first + 1], x[first + 2], x[first + 3]
            for k in range(last, n):
                s0, s1, s2, s3 = u[first, k], u[first + 1, k], u[first + 2, k], u[first + 3, k]
                if s0 != 0.0 or s1 != 0.0 or s2 != 0.0 or s3 != 0.0:
                    row = x[k]
                    for c in range(columns):
                        row[c] = (((row[c] - s0 * row0[c]) - s1 * row1[c]) - s2 * row2[c]) - s3 * row3[c]
        first = last


@kernel
def gram(c, n, columns, out):
    """out = C'C, whole, of the n rows and the first `columns` columns of C; four rows at a time, as above.

    Both triangles are summed: loops of one length from the first column on cost less than half of their work.
    """
    for a in range(columns):
        for b in range(columns):
            out[a, b] = 0.0
    whole = n - n % 4
    for i in range(0, whole, 4):
        row0, row1, row2, row3 = c[i], c[i + 1], c[i + 2], c[i + 3]
        for a in range(columns):
            s0, s1, s2, s3 = row0[a], row1[a], row2[a], row3[a]
            if s0 != 0.0 or s1 != 0.0 or s2 != 0.0 or s3 != 0.0:
                target = out[a]
                for b in range(columns):
                    target[b] = (((target[b] + s0 * row0[b]) + s1 * row1[b]) + s2 * row2[b]) + s3 * row3[b]
    for i in range(whole, n):
        row = c[i]
        for a in range(columns):
            share = row[a]
            if share != 0.0:
                target = out[a]
                for b in range(columns):
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
