"""Dense kernels on preallocated arrays, written along rows so that the compiler makes vectors of them."""

from __future__ import annotations

import math

from flightsw.crosslink.declare import kernel


@kernel
def factor_upper(a, n, reach):
    """Cholesky factor of the leading n x n block of `a` (its upper triangle is read), in place: a = U'U.

    reach (n) receives where the non-zero elements of each row of U end; what lies beyond is not touched, so that
    blocks that know nothing of each other cost what they cost alone (George and Liu 1981, envelope methods). Rows are
    taken four at a time: an element is loaded once for four updates. False where the block is not positive definite or
    not finite. The lower triangle is left as it was.
    """
    for j in range(n):
        end = j + 1
        for k in range(j + 1, n):
            if a[j, k] != 0.0:
                end = k + 1
        reach[j] = end
    j = 0
    while j < n:
        width = min(4, n - j)
        end = 0
        for row_number in range(j, j + width):
            row = a[row_number]
            pivot = row[row_number]
            if not (pivot > 0.0) or pivot == math.inf:  # NaN fails the first comparison
                return False
            root = 1.0 / math.sqrt(pivot)
            own_end = reach[row_number]
            end = max(end, own_end)
            for k in range(row_number, own_end):
                row[k] *= root
            for i in range(row_number + 1, j + width):
                share = row[i]
                if share != 0.0:
                    other = a[i]
                    reach[i] = max(reach[i], own_end)
                    for k in range(i, own_end):
                        other[k] -= share * row[k]
        if width == 4:
            r0, r1, r2, r3 = a[j], a[j + 1], a[j + 2], a[j + 3]
            for i in range(j + 4, end):
                s0, s1, s2, s3 = r0[i], r1[i], r2[i], r3[i]
                if s0 != 0.0 or s1 != 0.0 or s2 != 0.0 or s3 != 0.0:
                    other = a[i]
                    reach[i] = max(reach[i], end)
                    for k in range(i, end):
                        other[k] -= s0 * r0[k] + s1 * r1[k] + s2 * r2[k] + s3 * r3[k]
        j += width
    return True


@kernel
def solve_upper_transposed(u, n, x, reach):
    """Solve U' y = x in place for the vector x (n), U and reach as `factor_upper` leaves them."""
    for j in range(n):
        value = x[j] / u[j, j]
        x[j] = value
        row = u[j]
        for k in range(j + 1, reach[j]):
            x[k] -= row[k] * value


@kernel
def solve_upper_transposed_many(u, n, x, columns, reach, triangular):
    """Solve U' Y = X in place for the n rows of X, over its first `columns` columns; rows four at a time.

    triangular: X is lower triangular, its upper part zero, and so is Y.
    """
    j = 0
    while j < n:
        width = min(4, n - j)
        filled = min(columns, j + width) if triangular else columns
        end = 0
        for row_number in range(j, j + width):
            row = x[row_number]
            scale = 1.0 / u[row_number, row_number]
            end = max(end, reach[row_number])
            for c in range(filled):
                row[c] *= scale
            for i in range(row_number + 1, j + width):
                share = u[row_number, i]
                if share != 0.0:
                    other = x[i]
                    for c in range(filled):
                        other[c] -= share * row[c]
        if width == 4:
            x0, x1, x2, x3 = x[j], x[j + 1], x[j + 2], x[j + 3]
            for k in range(j + 4, end):
                s0, s1, s2, s3 = u[j, k], u[j + 1, k], u[j + 2, k], u[j + 3, k]
                if s0 != 0.0 or s1 != 0.0 or s2 != 0.0 or s3 != 0.0:
                    other = x[k]
                    for c in range(filled):
                        other[c] -= s0 * x0[c] + s1 * x1[c] + s2 * x2[c] + s3 * x3[c]
        j += width


@kernel
def invert_transposed(u, n, out, reach):
    """Inverse of U', lower triangular, into the leading n x n block of `out`; U, reach as of `factor_upper`."""
    for i in range(n):
        for c in range(n):
            out[i, c] = 0.0
        out[i, i] = 1.0
    solve_upper_transposed_many(u, n, out, n, reach, True)


@kernel
def near_diagonal(c, n, columns, out):
    """out (4, columns): products of each column of C with itself and the three after it, over its first n rows."""
    for offset in range(4):
        for a in range(columns):
            out[offset, a] = 0.0
    for i in range(n):
        row = c[i]
        for offset in range(4):
            target = out[offset]
            for a in range(columns - offset):
                target[a] += row[a] * row[a + offset]


@kernel
def gram(c, n, columns, out):
    """out = C'C, whole, of the n rows and the first `columns` columns of C; four rows at a time, zeros left out."""
    for a in range(columns):
        for b in range(columns):
            out[a, b] = 0.0
    i = 0
    while i + 3 < n:
        r0, r1, r2, r3 = c[i], c[i + 1], c[i + 2], c[i + 3]
        for a in range(columns):
            s0, s1, s2, s3 = r0[a], r1[a], r2[a], r3[a]
            if s0 != 0.0 or s1 != 0.0 or s2 != 0.0 or s3 != 0.0:
                target = out[a]
                for b in range(a, columns):
                    target[b] += s0 * r0[b] + s1 * r1[b] + s2 * r2[b] + s3 * r3[b]
        i += 4
    while i < n:
        row = c[i]
        for a in range(columns):
            share = row[a]
            target = out[a]
            for b in range(a, columns):
                target[b] += share * row[b]
        i += 1
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
