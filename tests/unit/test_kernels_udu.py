"""The factorised covariance against arithmetic in 60 decimal digits, exact where the numbers are dyadic."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from mpmath import mp

from flightsw.kernels import udu

EPS = np.finfo(float).eps
SIZES = [1, 2, 3, 6, 11, 20]


@pytest.fixture(autouse=True)
def sixty_digits() -> Iterator[None]:
    with mp.workdps(60):
        yield


def exact(a: np.ndarray) -> mp.matrix:
    return mp.matrix(a.tolist())


def product(ud: np.ndarray) -> mp.matrix:
    """U D U' of the factors, without rounding that matters."""
    u = exact(np.triu(ud, 1) + np.eye(len(ud)))
    return u * mp.diag([mp.mpf(d) for d in np.diag(ud)]) * u.T


def floats(a: mp.matrix) -> np.ndarray:
    return np.array([[float(a[i, j]) for j in range(a.cols)] for i in range(a.rows)])


def assert_same(got: mp.matrix, expected: mp.matrix, tolerance: float) -> None:
    """Every element to `tolerance` of the product of the sigmas it belongs to."""
    for i in range(expected.rows):
        for j in range(expected.cols):
            assert abs(got[i, j] - expected[i, j]) <= tolerance * mp.sqrt(expected[i, i] * expected[j, j]), (i, j)


def factors(rng: np.random.Generator, n: int, decades: float = 12.0, coupling: float = 1.0) -> np.ndarray:
    """Factors of a covariance: D over so many decades each side of one, U with elements about `coupling`."""
    ud = np.triu(coupling * rng.standard_normal((n, n)), 1)
    np.fill_diagonal(ud, 10.0 ** rng.uniform(-decades, decades, n))
    return ud


def covariance_of(rng: np.random.Generator, n: int, decades: float = 3.0) -> np.ndarray:
    """A full covariance: correlated without order, variances over so many decades each side of one."""
    root = rng.standard_normal((n, n + 2)) * 10.0 ** rng.uniform(-decades, decades, n)[:, None]
    p = root @ root.T
    return (p + p.T) / 2.0


# -- factorise


@pytest.mark.parametrize("n", SIZES)
def test_factors_multiply_to_the_matrix(n: int) -> None:
    """Backward error of the factorisation: a few roundings of each element; U unit upper, zeros below."""
    rng = np.random.default_rng(n)
    for _ in range(5):
        p = covariance_of(rng, n)
        ud = np.full((n, n), np.nan)
        assert udu.factorise(p, n, ud)
        assert (np.diag(ud) > 0.0).all()
        assert (np.tril(ud, -1) == 0.0).all()
        assert_same(product(ud), exact(p), 2.0 * n * EPS)


def test_factors_are_the_ones_they_were_made_from() -> None:
    """GIVEN U and D of small dyadic numbers, so that P = U D U' is exact WHEN factorised THEN U and D come back."""
    rng = np.random.default_rng(5)
    for n in SIZES:
        ud = np.triu(rng.integers(-3, 4, (n, n)).astype(float) / 4.0, 1)
        np.fill_diagonal(ud, 2.0 ** rng.integers(-3, 4, n))
        p = floats(product(ud))
        got = np.full((n, n), np.nan)
        assert udu.factorise(p, n, got)
        np.testing.assert_array_equal(got, ud)
        assert udu.factorise(p, n, p)  # in place
        np.testing.assert_array_equal(p, ud)


@pytest.mark.parametrize("zeros", [1, 3, 6])
def test_a_semidefinite_matrix_has_zeros_in_d(zeros: int) -> None:
    """GIVEN an exact P of rank 6 - zeros THEN D has its zeros where they were, and the product is P."""
    rng = np.random.default_rng(zeros)
    for _ in range(20):
        ud = np.triu(rng.integers(-3, 4, (6, 6)).astype(float), 1)
        d = 2.0 ** rng.integers(-2, 3, 6)
        d[rng.permutation(6)[:zeros]] = 0.0
        np.fill_diagonal(ud, d)
        p = floats(product(ud))
        got = np.full((6, 6), np.nan)
        assert udu.factorise(p, 6, got)
        assert sorted(np.diag(got)) == sorted(d)
        assert (product(got) - exact(p)).apply(abs) == mp.zeros(6, 6)


@pytest.mark.parametrize(
    "p",
    [
        [[1.0, 0.0], [0.0, -1e-300]],
        [[1.0, 2.0], [2.0, 1.0]],
        [[1.0, 1.0], [1.0, 0.0]],  # a variance of zero that correlates
        [[0.0, 1e-9], [1e-9, 1.0]],
        [[1.0, 0.0], [0.0, np.nan]],
        [[np.nan, 0.0], [0.0, 1.0]],
        [[1.0, np.nan], [np.nan, 1.0]],
        [[1.0, np.nan], [np.nan, 0.0]],
        [[1.0, 0.0], [0.0, np.inf]],
        [[np.inf, 0.0], [0.0, 1.0]],
        [[1.0, np.inf], [np.inf, 1.0]],
        [[1.0, np.inf], [np.inf, 0.0]],
    ],
)
def test_what_is_not_a_covariance_is_refused(p: list[list[float]]) -> None:
    assert not udu.factorise(np.array(p), 2, np.zeros((2, 2)))


def test_an_indefinite_matrix_of_any_size_is_refused() -> None:
    """GIVEN one negative eigenvalue, well above rounding, in any direction THEN False."""
    rng = np.random.default_rng(8)
    for n in SIZES[1:]:
        for _ in range(10):
            q, _ = np.linalg.qr(rng.standard_normal((n, n)))
            values = rng.uniform(0.5, 2.0, n)
            values[rng.integers(n)] = -1e-3
            p = q @ np.diag(values) @ q.T
            assert not udu.factorise((p + p.T) / 2.0, n, np.zeros((n, n)))


def test_only_the_leading_rows_are_touched() -> None:
    rng = np.random.default_rng(3)
    p, ud = np.full((20, 20), np.nan), np.full((20, 20), 7.0)
    p[:11, :11] = covariance_of(rng, 11)
    assert udu.factorise(p, 11, ud)
    assert (ud[11:, :] == 7.0).all()
    assert (ud[:, 11:] == 7.0).all()


# -- covariance


@pytest.mark.parametrize("n", SIZES)
def test_covariance_is_the_product(n: int) -> None:
    """All of it, and any leading block, though later columns add to it."""
    rng = np.random.default_rng(n + 100)
    for _ in range(3):
        ud = factors(rng, n)
        expected = product(ud)
        for size in {1, (n + 1) // 2, n}:
            out = np.full((n, n), np.nan)
            udu.covariance(ud, n, size, out)
            block = out[:size, :size]
            assert (block == block.T).all()
            assert_same(exact(block), expected[:size, :size], 2.0 * n * EPS)
            assert np.isnan(out[size:, :]).all()


# -- orthogonalise


@pytest.mark.parametrize("columns", [4, 20, 64])
@pytest.mark.parametrize("n", SIZES)
def test_orthogonalised_factors_are_those_of_the_weighted_product(n: int, columns: int) -> None:
    """Any W, weights over 24 decades with zeros among them, fewer columns than rows: U D U' = W diag(q) W', D >= 0."""
    rng = np.random.default_rng(100 * n + columns)
    for trial in range(4):
        w = rng.standard_normal((n, columns))
        q = 10.0 ** rng.uniform(-12.0, 12.0, columns)
        q[rng.random(columns) < 0.25 * trial] = 0.0
        expected = exact(w) * mp.diag([mp.mpf(v) for v in q]) * exact(w).T
        ud = np.full((n, n), np.nan)
        udu.orthogonalise(w.copy(), q, n, columns, np.full(columns, np.nan), ud)
        assert (np.diag(ud) >= 0.0).all()
        assert (np.tril(ud, -1) == 0.0).all()
        assert np.isfinite(ud).all()
        assert_same(product(ud), expected, 2.0 * (n + columns) * EPS)


def test_nothing_but_zeros_gives_factors_of_zero() -> None:
    ud = np.full((4, 4), np.nan)
    udu.orthogonalise(np.ones((4, 8)), np.zeros(8), 4, 8, np.zeros(8), ud)
    np.testing.assert_array_equal(ud, np.zeros((4, 4)))


def test_rows_beyond_n_are_left_alone_and_columns_beyond_the_count_are_not_read() -> None:
    rng = np.random.default_rng(1)
    w, q, ud = rng.standard_normal((20, 64)), np.full(64, 2.0), np.full((20, 20), 7.0)
    kept = w[11:].copy()
    w[:, 12:] = np.nan
    kept[:, 12:] = np.nan
    q[12:] = np.nan
    expected = exact(w[:11, :12]) * exact(w[:11, :12]).T * 2.0
    udu.orthogonalise(w, q, 11, 12, np.zeros(64), ud)
    np.testing.assert_array_equal(w[11:], kept)
    assert (ud[11:, :] == 7.0).all()
    assert_same(product(ud[:11, :11].copy()), expected, 50 * EPS)


def test_factors_keep_what_a_whole_matrix_would_lose() -> None:
    """GIVEN two states that differ by 1e-10 of their sigma, known to ten digits only as a difference WHEN made from
    columns THEN the variance of the difference is right to eight digits; from P in float64 it is noise."""
    w = np.array([[1.0, 1e-10, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    ud = np.zeros((2, 2))
    udu.orthogonalise(w.copy(), np.ones(4), 2, 4, np.zeros(4), ud)
    assert ud[0, 0] == pytest.approx(1e-20, rel=1e-8)
    p = w @ w.T
    assert p[0, 0] - 2.0 * p[0, 1] + p[1, 1] == 0.0


def test_not_a_number_is_not_hidden() -> None:
    """GIVEN a NaN in any row or weight THEN a variance on D's diagonal is NaN: that is what flight looks at."""
    for place in range(3):
        w, q, ud = np.eye(3, 4), np.ones(4), np.zeros((3, 3))
        w[place, 3] = np.nan
        udu.orthogonalise(w, q, 3, 4, np.zeros(4), ud)
        assert np.isnan(np.diag(ud)).any()


# -- project and correct


@pytest.mark.parametrize("n", SIZES)
def test_projection(n: int) -> None:
    """f = U' h, and h' P h = f' D f."""
    rng = np.random.default_rng(n + 7)
    for _ in range(5):
        ud, h, f = factors(rng, n, decades=6.0), rng.standard_normal(n), np.full(n, np.nan)
        udu.project(ud, n, h, f)
        u = exact(np.triu(ud, 1) + np.eye(n))
        expected = u.T * exact(h[:, None])
        size = u.apply(abs).T * exact(np.abs(h)[:, None])
        for j in range(n):
            assert abs(f[j] - expected[j]) <= n * EPS * size[j]
        variance = (exact(h[:, None]).T * product(ud) * exact(h[:, None]))[0]
        total = sum(mp.mpf(f[j]) ** 2 * mp.mpf(ud[j, j]) for j in range(n))
        spread = sum(size[j] ** 2 * mp.mpf(ud[j, j]) for j in range(n))
        assert abs(total - variance) <= 4 * n * EPS * spread


def bayes(ud: np.ndarray, h: np.ndarray, variance: float) -> tuple[mp.matrix, mp.matrix, mp.mpf]:
    """Posterior, gain and variance of the innovation by the textbook, in exact arithmetic."""
    p, column = product(ud), exact(h[:, None])
    s = (column.T * p * column)[0] + mp.mpf(variance)
    gain = p * column / s
    return p - gain * column.T * p, gain, s


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("sigma", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_correction_is_the_exact_posterior(n: int, sigma: float) -> None:
    """Posterior and gain against exact arithmetic, in units of the prior's sigmas; innovation variance relative.

    The measurement may be a million times better or worse than the state.
    """
    rng = np.random.default_rng(n)
    for _ in range(4):
        ud, h = factors(rng, n, decades=1.0), rng.standard_normal(n)
        prior = product(ud)
        expected, expected_gain, expected_s = bayes(ud, h, sigma**2)
        f, gain = np.full(n, np.nan), np.full(n, np.nan)
        s = udu.correct(ud, n, h, sigma**2, f, gain)
        assert abs(s - expected_s) <= 100 * n * EPS * expected_s
        posterior = product(ud)
        for i in range(n):
            scale = mp.sqrt(prior[i, i])
            assert abs(gain[i] - expected_gain[i]) * mp.sqrt(expected_s) <= 100 * n * EPS * scale
            for j in range(n):
                assert abs(posterior[i, j] - expected[i, j]) <= 100 * n * EPS * scale * mp.sqrt(prior[j, j])


def test_a_correction_keeps_twice_the_digits() -> None:
    """GIVEN a state known to 1 m WHEN measured to a nanometre THEN its variance is right to six digits, where
    P - K h' P in float64 has none left: 1e-18 is below the rounding of 1."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        ud, h = factors(rng, 9, decades=0.0), rng.standard_normal(9)
        column = exact(h[:, None])
        expected = column.T * bayes(ud, h, 1e-18)[0] * column
        udu.correct(ud, 9, h, 1e-18, np.zeros(9), np.zeros(9))
        after = (column.T * product(ud) * column)[0]
        assert abs(after / expected[0] - 1) <= 1e-6


def test_a_row_of_zeros_changes_nothing() -> None:
    rng = np.random.default_rng(2)
    ud = factors(rng, 11)
    before, f, gain = ud.copy(), np.zeros(11), np.full(11, np.nan)
    assert udu.correct(ud, 11, np.zeros(11), 4.0, f, gain) == 4.0
    np.testing.assert_array_equal(ud, before)
    np.testing.assert_array_equal(gain, np.zeros(11))


def test_states_that_are_known_stay_known() -> None:
    """GIVEN a singular P (a variance of zero) WHEN measured THEN its gain is zero and the rest is the exact update."""
    ud = np.array([[4.0, 0.5, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, 1.0]])
    h = np.array([1.0, 1.0, 0.0])
    expected, expected_gain, expected_s = bayes(ud, h, 0.25)
    gain = np.zeros(3)
    assert udu.correct(ud, 3, h, 0.25, np.zeros(3), gain) == float(expected_s)
    np.testing.assert_allclose(gain, [float(v) for v in expected_gain], rtol=1e-15)
    np.testing.assert_allclose(floats(product(ud)), floats(expected), rtol=1e-15, atol=1e-15)
    assert np.diag(ud)[1] == 0.0


def test_small_numbers_by_hand() -> None:
    """P = [[3, 1], [1, 1]], h = (1, 0), R = 1: S = 4, K = (3/4, 1/4), P+ = [[3/4, 1/4], [1/4, 3/4]]."""
    ud = np.zeros((2, 2))
    assert udu.factorise(np.array([[3.0, 1.0], [1.0, 1.0]]), 2, ud)
    np.testing.assert_array_equal(ud, [[2.0, 1.0], [0.0, 1.0]])
    gain, out = np.zeros(2), np.zeros((2, 2))
    assert udu.correct(ud, 2, np.array([1.0, 0.0]), 1.0, np.zeros(2), gain) == 4.0
    udu.covariance(ud, 2, 2, out)
    np.testing.assert_allclose(out, [[0.75, 0.25], [0.25, 0.75]], rtol=1e-15)
    np.testing.assert_allclose(gain, [0.75, 0.25], rtol=1e-15)
