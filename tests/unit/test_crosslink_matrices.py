"""The dense kernels of the crosslink monitor, four rows at a time, against dense algebra."""

import numpy as np
import pytest

from flightsw.crosslink.matrices import factor_upper, gram, invert_transposed, solve_upper_transposed_many

SIZES = (1, 3, 4, 5, 8, 11, 17)


def block(n: int, room: int) -> np.ndarray:
    """Positive definite, with zeros in it as links that share no satellite leave; what lies around it is noise."""
    rng = np.random.default_rng(n)
    root = rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.4)
    a = rng.standard_normal((room, room))
    a[:n, :n] = root @ root.T + np.eye(n)
    return a


@pytest.mark.parametrize("n", SIZES)
def test_blocks_of_four_rows_are_plain_algebra(n: int) -> None:
    """GIVEN a system of any size WHEN factored, solved and squared THEN it is what dense algebra says, and what lies
    outside is left alone."""
    room, columns = 20, 7
    a = block(n, room)
    factor, reach = a.copy(), np.zeros(room, np.int64)
    assert factor_upper(factor, n, reach)
    wanted = np.linalg.cholesky(a[:n, :n]).T
    upper = np.triu_indices(n)
    np.testing.assert_allclose(factor[:n, :n][upper], wanted[upper], rtol=0.0, atol=1e-13)
    outside = np.ones((room, room), bool)
    outside[:n, :n] = np.tri(n, k=-1, dtype=bool)
    assert np.array_equal(factor[outside], a[outside])
    for j in range(n):
        assert not factor[j, reach[j] : n].any() or reach[j] >= n

    x = np.random.default_rng(n + 100).standard_normal((room, 10)) * (np.arange(10) % 3 != 0)
    solved = x.copy()
    solve_upper_transposed_many(factor, n, solved, columns, reach, False)
    right = np.linalg.solve(wanted.T, x[:n, :columns])
    np.testing.assert_allclose(solved[:n, :columns], right, rtol=0.0, atol=1e-12)
    assert np.array_equal(solved[n:], x[n:])
    assert np.array_equal(solved[:, columns:], x[:, columns:])

    inverse = np.full((room, room), np.nan)
    invert_transposed(factor, n, inverse, reach)
    np.testing.assert_allclose(inverse[:n, :n], np.linalg.solve(wanted.T, np.eye(n)), rtol=0.0, atol=1e-12)
    assert not np.triu(inverse[:n, :n], 1).any()
    assert np.isnan(inverse[n:]).all()

    out = np.full((10, 10), np.nan)
    gram(solved, n, columns, out)
    np.testing.assert_allclose(np.triu(out[:columns, :columns]), np.triu(right.T @ right), rtol=0.0, atol=1e-11)
    assert np.isnan(out[columns:]).all()


@pytest.mark.parametrize("at", [0, 2, 4, 9])
@pytest.mark.parametrize("value", [-1.0, 0.0, np.nan, np.inf])
def test_a_pivot_that_is_none_is_refused_wherever_it_lies(at: int, value: float) -> None:
    a = block(10, 12)
    a[at, at] = value
    assert not factor_upper(a, 10, np.zeros(12, np.int64))
