"""The weighted test against dense algebra by numpy: statistics, exclusion, rank, own satellite, slow contrasts."""

from __future__ import annotations

import numpy as np
import pytest
from crosslink_bench import WALKER, Bench, jump

from flightsw.crosslink.declare import entry, kernel
from flightsw.crosslink.matrices import factor_upper, pivoted_rank
from flightsw.crosslink.records import MONITOR_TABLE, TEST
from flightsw.crosslink.weighted_test import exclude, restore, statistic_left
from flightsw.kernels.registry import frozen_records, records, warm_up

RNG = np.random.default_rng(3)
N = WALKER.total


@entry(records(TEST), frozen_records(MONITOR_TABLE), records(TEST))
def left_after(tests, tables, copies):
    """Exclude the satellites marked in the copy's dof; statistics of all into the copy's."""
    test, copy = tests[0], copies[0]
    restore(test)
    for satellite in range(tables[0]["satellites"]):
        if copy["dof"][satellite] == 1:
            exclude(test, satellite)
    for satellite in range(tables[0]["satellites"]):
        copy["statistic"][satellite], _ = statistic_left(test, satellite)


def dense(bench: Bench) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sensitivities A (m, 4n), covariance S (m, m) and residuals (m,) by their definitions."""
    test, table = bench.memory.network[0], bench.memory.table[0]
    m = int(test["links"])
    a = np.zeros((m, 4 * N))
    for link in range(m):
        i, j = int(test["receiver"][link]), int(test["sender"][link])
        a[link, 4 * i : 4 * i + 4] = test["h"][link, 0]
        a[link, 4 * j : 4 * j + 4] = test["h"][link, 1]
    sigma = np.tile(table["sigma_m"], N)
    s = a @ np.diag(sigma**2) @ a.T + table["sigma_range_m"] ** 2 * np.eye(m)
    return a, s, np.array(bench.memory.work["residual_m"][0, :m])


def glr(a: np.ndarray, s: np.ndarray, r: np.ndarray, wanted: list[int], nuisance: list[int]) -> float:
    """Drop of the weighted sum of squares when the wanted columns join the nuisance ones: a likelihood ratio."""
    lower = np.linalg.cholesky(s)
    white, z = np.linalg.solve(lower, a), np.linalg.solve(lower, r)

    def rest(columns: list[int]) -> float:
        if not columns:
            return float(z @ z)
        x, *_ = np.linalg.lstsq(white[:, columns], z, rcond=1e-9)
        return float(np.sum((z - white[:, columns] @ x) ** 2))

    return rest(nuisance) - rest(nuisance + wanted)


def columns(*satellites: int) -> list[int]:
    return [4 * satellite + k for satellite in satellites for k in range(4)]


@pytest.mark.parametrize(("directions", "dropout"), [(True, 0.0), (False, 0.0), (True, 0.3)])
def test_statistics_are_likelihood_ratios(directions: bool, dropout: float) -> None:
    """GIVEN an epoch with a fault, of links once, both ways, or here and there one way only, WHEN judged THEN each
    statistic is the fall of the weighted sum of squares."""
    bench = Bench(directions=directions, faulty_max=1)
    object.__setattr__(bench.ranging, "dropout", dropout)
    bench.faults = [jump(6, 1, 35.0)]
    bench.step()
    a, s, r = dense(bench)
    for satellite in (0, 6, 7, 15, 23):
        expected = glr(a, s, r, columns(satellite), [])
        assert bench.memory.network["statistic"][0, satellite] == pytest.approx(expected, rel=1e-8)


def test_an_excluded_satellite_is_estimated() -> None:
    """GIVEN two exclusions WHEN others are tested THEN the ratio is that with the two as free parameters."""
    warm_up()
    bench = Bench()
    bench.step()
    a, s, r = dense(bench)
    copy = np.zeros(1, TEST)
    copy["dof"][0, [6, 7]] = 1
    left_after(bench.memory.network, bench.memory.table, copy)
    for satellite in (5, 8, 14):
        expected = glr(a, s, r, columns(satellite), columns(6, 7))
        assert copy["statistic"][0, satellite] == pytest.approx(expected, rel=1e-7)
    assert copy["statistic"][0, 6] == 0.0


def test_own_statistic_is_that_of_the_own_links() -> None:
    """GIVEN an epoch WHEN judged THEN the own statistic is the likelihood ratio over the own links alone."""
    bench = Bench(own=3)
    bench.step()
    a, s, r = dense(bench)
    test = bench.memory.network[0]
    m = int(test["links"])
    mine = np.flatnonzero((test["receiver"][:m] == 3) | (test["sender"][:m] == 3))
    expected = glr(a[mine], s[np.ix_(mine, mine)], r[mine], columns(3), [])
    assert bench.verdict["own_statistic"] == pytest.approx(expected, rel=1e-8)
    assert bench.verdict["own_dof"] == 4


@pytest.mark.parametrize(("two_way", "rank", "parameters"), [(False, 89, 96), (True, 66, 72)])
def test_rank_and_undetectable_subspace(two_way: bool, rank: int, parameters: int) -> None:
    """GIVEN the constellation THEN the rank is 89 of 96 one way, 66 of 72 two ways, and numpy's."""
    bench = Bench(directions=not two_way, two_way=two_way)
    bench.step()
    a, _, _ = dense(bench)
    assert (bench.verdict["rank"], bench.verdict["parameters"]) == (rank, parameters)
    # the flight time turns a ray by 1e-5: what shows by that alone is nothing beside metres of noise
    assert np.linalg.matrix_rank(a, tol=1e-3) == rank
    assert bench.verdict["undetectable"] == parameters - rank


def test_common_errors_are_in_the_null_space() -> None:
    """GIVEN sensitivities WHEN all satellites share a translation, a rotation or a clock THEN no residual shows it."""
    bench = Bench()
    bench.step()
    a, _, _ = dense(bench)
    r, _ = WALKER.states(0.0)
    axes = np.array(bench.memory.work["axes"][0, :N])
    for shift in (np.tile([3.0, -5.0, 7.0], (N, 1)), np.cross([1e-6, 2e-6, -1e-6], r)):
        f = np.zeros((N, 4))
        f[:, :3] = np.einsum("nij,nj->ni", axes, shift)
        assert np.abs(a @ f.ravel()).max() < 1e-3 * np.abs(f).max()  # flight time turns the ray by 1e-5
    f = np.zeros((N, 4))
    f[:, 3] = 100.0
    assert np.abs(a @ f.ravel()).max() == 0.0


@kernel
def _rank(a, n):
    return pivoted_rank(a, n, 1e-10)


@pytest.mark.parametrize("rank", [0, 1, 5, 12])
def test_pivoted_rank(rank: int) -> None:
    """GIVEN a semidefinite matrix of known rank THEN it is found."""
    b = RNG.standard_normal((12, rank))
    assert _rank(np.ascontiguousarray(b @ b.T), 12) == rank


def test_factor_refuses_what_is_not_positive_definite() -> None:
    """GIVEN an indefinite matrix, or one with NaN THEN the factor is refused; a good one is U'U."""
    b = RNG.standard_normal((7, 7))
    good = b @ b.T + np.eye(7)
    u = good.copy()
    reach = np.zeros(7, np.int64)
    assert factor_upper(u, 7, reach)
    np.testing.assert_allclose(np.triu(u).T @ np.triu(u), good, rtol=1e-12, atol=1e-12)
    assert not factor_upper(good - 100.0 * np.eye(7), 7, reach)
    good[2, 2] = np.nan
    assert not factor_upper(good, 7, reach)
