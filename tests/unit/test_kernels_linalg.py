"""Small linear algebra against numpy.linalg and mpmath, on good, bad and broken matrices."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp

from flightsw.kernels import linalg

RNG = np.random.default_rng(9)


def positive(n, spread=1.0):
    """Random symmetric positive definite matrix with a condition number of 10**(2 spread)."""
    q, _ = np.linalg.qr(RNG.standard_normal((n, n)))
    a = q @ np.diag(10.0 ** RNG.uniform(-spread, spread, n)) @ q.T
    return np.ascontiguousarray((a + a.T) / 2)


@pytest.mark.parametrize("shape", [(3, 3, 3), (9, 9, 9), (9, 6, 6), (6, 9, 3)])
def test_products(shape):
    n, m, k = shape
    a, b = RNG.standard_normal((n, m)), RNG.standard_normal((m, k))
    out = np.full((n, k), np.nan)
    linalg.multiply(a, b, out)
    np.testing.assert_allclose(out, a @ b, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("n", [1, 3, 6])
@pytest.mark.parametrize("spread", [0.0, 2.0, 5.0])
def test_cholesky_factor_and_solution(n, spread):
    for _ in range(20):
        a, b = positive(n, spread), RNG.standard_normal(n)
        lower = np.full((n, n), np.nan)
        assert linalg.cholesky(a, lower)
        np.testing.assert_allclose(lower, np.linalg.cholesky(a), rtol=1e-9, atol=1e-9 * np.abs(a).max() ** 0.5)
        assert np.abs(lower @ lower.T - a).max() <= 1e-14 * np.abs(a).max()
        x = b.copy()
        linalg.solve_lower(lower, x, x)  # in place, as the gain does it
        linalg.solve_lower_transposed(lower, x, x)
        with mp.workdps(40):
            exact = np.array([float(v) for v in mp.lu_solve(mp.matrix(a.tolist()), mp.matrix(b.tolist()))])
        assert np.abs(x - exact).max() <= 1e-15 * np.linalg.cond(a) * 20 * np.abs(exact).max()


def test_cholesky_refuses_what_is_not_positive_definite():
    lower = np.zeros((6, 6))
    good = positive(6)
    assert linalg.cholesky(good, lower)
    broken = {
        "zero": np.zeros((6, 6)),
        "negative": -good,
        "semidefinite": np.diag([1.0, 1.0, 0.0, 1.0, 1.0, 1.0]),
        "correlation beyond one": np.eye(6) + 1.5 * (np.eye(6, k=1) + np.eye(6, k=-1)),
    }
    for name, a in broken.items():
        assert not linalg.cholesky(a, lower), name
        with pytest.raises(np.linalg.LinAlgError):
            np.linalg.cholesky(a)
    for value in (np.nan, np.inf, -np.inf):
        for i in range(6):
            for j in range(i + 1):
                a = good.copy()
                a[i, j] = a[j, i] = value
                assert not linalg.cholesky(a, lower), (i, j, value)


def test_largest_eigenvalue_against_numpy():
    for _ in range(300):
        a = RNG.standard_normal((3, 3)) * 10.0 ** RNG.uniform(-8, 8)
        a = a + a.T
        assert linalg.largest_eigenvalue_3x3(a) == pytest.approx(np.linalg.eigvalsh(a)[-1], abs=4e-15 * np.abs(a).max())


@pytest.mark.parametrize(
    "a",
    [
        np.zeros((3, 3)),
        np.eye(3) * 7.0,
        np.diag([4.0, 4.0, 1.0]),
        np.diag([1.0, 4.0, 4.0]),
        np.diag([1e12, 1e-3, 1e-3]),
        np.ones((3, 3)),
        np.diag([1.0, 1.0 + 1e-15, 1.0 - 1e-15]),
        np.array([[1.0, 1e-9, 0.0], [1e-9, 1.0, 1e-9], [0.0, 1e-9, 1.0]]),
        -np.diag([3.0, 2.0, 1.0]),
        np.diag([1e-320, 2e-320, 0.0]),
    ],
    ids=["zero", "identity", "two top", "two bottom", "needle", "rank 1", "near 1", "weak", "negative", "denormal"],
)
def test_largest_eigenvalue_of_degenerate_matrices(a):
    expected = np.linalg.eigvalsh(a)[-1]
    assert linalg.largest_eigenvalue_3x3(a) == pytest.approx(expected, rel=2e-15, abs=4e-15 * np.abs(a).max() + 1e-320)


def test_largest_eigenvalue_of_a_long_thin_ellipsoid_at_any_orientation():
    """An outage covariance: kilometres along track, metres across."""
    for _ in range(200):
        q, _ = np.linalg.qr(RNG.standard_normal((3, 3)))
        a = q @ np.diag([2.0, 9.0, 4e6]) @ q.T
        assert linalg.largest_eigenvalue_3x3((a + a.T) / 2) == pytest.approx(4e6, rel=1e-14)


def test_largest_eigenvalue_reads_the_corner_of_a_larger_matrix():
    a = positive(9)
    assert linalg.largest_eigenvalue_3x3(a) == pytest.approx(np.linalg.eigvalsh(a[:3, :3])[-1], rel=1e-13)


@pytest.mark.parametrize("place", [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_largest_eigenvalue_of_a_broken_matrix_is_not_finite(place, value):
    a = np.eye(3)
    a[place] = a[place[::-1]] = value
    assert not np.isfinite(linalg.largest_eigenvalue_3x3(a))


def test_copies_are_whole_and_leave_the_source() -> None:
    """GIVEN a vector and a matrix WHEN copied THEN the copy is the source to the last bit, NaN and signed zero too."""
    vector, matrix = np.array([1.0, -0.0, np.nan, np.inf]), np.arange(6.0).reshape(2, 3)
    to_vector, to_matrix = np.full(4, 7.0), np.full((2, 3), 7.0)
    linalg.copy_vector(vector, to_vector)
    linalg.copy_matrix(matrix, to_matrix)
    assert to_vector.tobytes() == vector.tobytes()
    np.testing.assert_array_equal(to_matrix, matrix)
