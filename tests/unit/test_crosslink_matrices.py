"""The dense kernels of the crosslink monitor, four rows at a time, against the same sums one row after the other."""

import math

import numpy as np
import pytest

from flightsw.crosslink.matrices import factor_upper, gram, solve_upper_transposed_many

SIZES = (1, 3, 4, 5, 8, 11, 17)


def block(n: int, room: int) -> np.ndarray:
    """Positive definite, with zeros in it as links that share no satellite leave; what lies around it is noise."""
    rng = np.random.default_rng(n)
    root = rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.4)
    a = rng.standard_normal((room, room))
    a[:n, :n] = root @ root.T + np.eye(n)
    return a


def factor_one_by_one(a: np.ndarray, n: int) -> None:
    for j in range(n):
        root = 1.0 / math.sqrt(a[j, j])
        for k in range(j, n):
            a[j, k] *= root
        for i in range(j + 1, n):
            for k in range(i, n):
                a[i, k] -= a[j, i] * a[j, k]


def solve_one_by_one(u: np.ndarray, n: int, x: np.ndarray, columns: int) -> None:
    for j in range(n):
        scale = 1.0 / u[j, j]
        for c in range(columns):
            x[j, c] *= scale
        for k in range(j + 1, n):
            for c in range(columns):
                x[k, c] -= u[j, k] * x[j, c]


@pytest.mark.parametrize("n", SIZES)
def test_every_element_has_the_same_bits(n: int) -> None:
    """GIVEN a system of any size WHEN factored, solved and squared four rows at a time THEN every number is that of one
    row at a time, to the last bit, and what lies outside is left alone."""
    room, columns = 20, 7
    a = block(n, room)
    factor, wanted = a.copy(), a.copy()
    assert factor_upper(factor, n)
    factor_one_by_one(wanted, n)
    assert np.array_equal(factor, wanted)

    x = np.random.default_rng(n + 100).standard_normal((room, 10)) * (np.arange(10) % 3 != 0)
    solved, right = x.copy(), x.copy()
    solve_upper_transposed_many(factor, n, solved, columns)
    solve_one_by_one(wanted, n, right, columns)
    assert np.array_equal(solved, right)

    out = np.full((10, 10), np.nan)
    gram(solved, n, columns, out)
    for p in range(columns):
        for q in range(columns):
            total = 0.0
            for i in range(n):
                total += right[i, min(p, q)] * right[i, max(p, q)]
            assert out[p, q] == total
    assert np.isnan(out[columns:]).all()


@pytest.mark.parametrize("at", [0, 2, 4, 9])
@pytest.mark.parametrize("value", [-1.0, 0.0, np.nan, np.inf])
def test_a_pivot_that_is_none_is_refused_wherever_it_lies(at: int, value: float) -> None:
    a = block(10, 12)
    a[at, at] = value
    assert not factor_upper(a, 10)
