"""Measurements of the flight filter against a whole Kalman filter in numpy: innovation, NIS, posterior, editing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flight_bench import record
from flight_filter_bench import bare_table, rtn

from flightsw.icd.enums import EditMode, MeasurementType, RejectCause
from flightsw.kernels import udu
from flightsw.nav import measurement
from flightsw.records import NAV, OUTPUT, STATES, WORK

POSITION, VELOCITY = int(MeasurementType.POSITION), int(MeasurementType.VELOCITY)
KINDS = [POSITION, VELOCITY]
USED, ABSENT = measurement.USED, measurement.ABSENT
GATE, OPERATOR = int(RejectCause.GATE), int(RejectCause.OPERATOR)
ERRORS = {  # states -> which GNSS errors the table has
    11: {"gnss_bias_sigma_m": 0.0, "gnss_periodic_sigma_m": 0.0},
    14: {"gnss_bias_sigma_m": 3.0, "gnss_periodic_sigma_m": 0.0},
    20: {"gnss_bias_sigma_m": 3.0, "gnss_periodic_sigma_m": 2.0},
}


class Case:
    """A state of n states with a full covariance, a measurement with another sigma on each ITRF axis."""

    def __init__(self, n: int, kind: int, seed: int = 1, spread: float = 1.0, **settings: Any) -> None:
        rng = np.random.default_rng(seed)
        self.n, self.kind = n, kind
        arrays = bare_table(**ERRORS[n], **settings), np.zeros(1, NAV), np.zeros(1, WORK), np.zeros(1, OUTPUT)
        for array in arrays[2:]:
            array.view(np.float64)[:] = np.nan
        self.table, self.nav, self.work, self.out = (record(array) for array in arrays)
        self.x = np.concatenate([[4.1e6, -3.9e6, 3.7e6, 5.1e3, 5.2e3, -0.9e3], rng.standard_normal(14)])
        self.m, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        self.work.itrf_from_gcrf[:, :] = self.m
        sigma = np.repeat([8.0, 0.05, 5e-8, 0.3, 3.0], [3, 3, 3, 2, 9])[:n]
        root = spread * rng.standard_normal((n, n + 4)) * sigma[:, None]
        self.p = root @ root.T / n
        self.ud = np.zeros((STATES, STATES))
        assert udu.factorise(self.p, n, self.ud)
        self.sigma = np.array([[4.0, 9.0, 15.0], [0.03, 0.1, 0.2]][kind])
        self.work.sigma[:] = self.sigma
        # rows of H in GCRF: a position is r, with the lasting and the in-phase periodic error of GNSS on top, in RTN
        self.h = np.zeros((3, n))
        self.h[:, 3 * kind : 3 * kind + 3] = np.eye(3)
        basis = rtn(self.x[:3], self.x[3:6])
        if kind == POSITION and n >= 14:
            self.h[:, 11:14] = basis
        if kind == POSITION and n >= 20:
            self.h[:, 14:20:2] = basis
        self.r = self.m.T @ np.diag(self.sigma**2) @ self.m
        self.s = self.h @ self.p @ self.h.T + self.r
        self.innovation = np.linalg.cholesky(self.s) @ rng.standard_normal(3)
        self.work.z[3 * kind : 3 * kind + 3] = self.h @ self.x[:n] + self.innovation

    def evaluate(self) -> float:
        return measurement.evaluate(self.table, self.kind, self.x, self.ud, self.work, self.out)

    def covariance(self) -> np.ndarray:
        p = np.zeros((self.n, self.n))
        udu.covariance(self.ud, self.n, self.n, p)
        return p


def relative(got: np.ndarray, expected: np.ndarray, prior: np.ndarray) -> float:
    """Largest difference in units of the prior's sigmas."""
    sigma = np.sqrt(np.diag(prior))
    return float(np.abs((got - expected) / np.outer(sigma, sigma)).max())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", ERRORS)
def test_record_of_an_innovation(n: int, kind: int) -> None:
    """GIVEN sigmas that differ by axis of ITRF THEN innovation and its sigma, in GCRF, and NIS are those of the whole
    matrices; the other type's record is left alone, state and covariance are not touched."""
    case = Case(n, kind)
    x, ud = case.x.copy(), case.ud.copy()
    nis = case.evaluate()
    own, other = slice(3 * kind, 3 * kind + 3), slice(3 - 3 * kind, 6 - 3 * kind)
    assert nis == pytest.approx(case.innovation @ np.linalg.solve(case.s, case.innovation), rel=1e-6)
    np.testing.assert_allclose(case.out.innovation[own], case.innovation, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(case.out.innovation_sigma[own], np.sqrt(np.diag(case.s)), rtol=1e-10)
    assert np.isnan(case.out.innovation[other]).all()
    assert np.isnan(case.out.innovation_sigma[other]).all()
    np.testing.assert_array_equal(case.x, x)
    np.testing.assert_array_equal(case.ud, ud)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", ERRORS)
def test_what_the_monitor_is_told(n: int, kind: int) -> None:
    """Innovation and S^-1 in GCRF, of each type in a place of its own."""
    case = Case(n, kind)
    case.evaluate()
    measurement.keep_weight(kind, case.work)
    np.testing.assert_allclose(case.work.innovation_type[kind], case.innovation, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(case.work.weight_type[kind] @ case.s, np.eye(3), atol=1e-10)
    assert np.isnan(case.work.weight_type[1 - kind]).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", ERRORS)
@pytest.mark.parametrize("seed", range(4))
def test_posterior_is_that_of_a_whole_kalman_filter(n: int, kind: int, seed: int) -> None:
    """GIVEN three scalar updates along ITRF axes THEN state and covariance are those of one update with the whole S,
    and the mean gains are the traces of its gain."""
    case = Case(n, kind, seed)
    x = case.x.copy()
    case.evaluate()
    measurement.correct(case.table, kind, case.x, case.ud, case.work)
    gain = np.linalg.solve(case.s, case.h @ case.p).T
    expected = case.p - gain @ case.h @ case.p
    assert relative(case.covariance(), expected, case.p) <= 1e-12
    change = gain @ case.innovation
    np.testing.assert_allclose((case.x - x)[:n], change, atol=1e-9 * np.sqrt(np.diag(case.p)).max(), rtol=1e-6)
    np.testing.assert_array_equal(case.x[n:], x[n:])
    # scalar by scalar: the gain of an axis is that of the covariance the axes before it have left
    p, trace = case.p.copy(), np.zeros(2)
    for axis in range(3):
        row = case.m[axis] @ case.h
        one = p @ row / (row @ p @ row + case.sigma[axis] ** 2)
        p = p - np.outer(one, row @ p)
        trace += [case.m[axis] @ one[:3], case.m[axis] @ one[3:6]]
    np.testing.assert_allclose(case.work.mean_gain[kind], trace / 3.0, rtol=1e-8)


def test_lasting_errors_take_their_share_of_a_position() -> None:
    """GIVEN r known to 1 m and a lasting error of 5 m, nothing correlated WHEN a position comes 10 m off along-track
    THEN the error of GNSS takes 25 parts of it, r one: its residual is not put into the orbit."""
    case = Case(20, POSITION)
    case.ud[:, :] = 0.0
    variance = np.repeat([1.0, 1e-6, 1e-16, 1e-2, 25.0, 0.0], [3, 3, 3, 2, 3, 6])
    np.fill_diagonal(case.ud, variance)
    case.x[6:] = 0.0
    before, basis = case.x.copy(), rtn(case.x[:3], case.x[3:6])
    case.work.sigma[:] = 2.0
    case.work.z[:3] = case.x[:3] + 10.0 * basis[:, 1]
    case.evaluate()
    measurement.correct(case.table, POSITION, case.x, case.ud, case.work)
    np.testing.assert_allclose(basis.T @ (case.x - before)[:3], [0.0, 10.0 / 30.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(case.x[11:14], [0.0, 250.0 / 30.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(case.x[14:], 0.0, atol=1e-9)


# -- underweighting


@pytest.mark.parametrize(("limit", "share"), [(0.99, 0.2), (1.01, 0.0)])
def test_underweighting_begins_at_its_limit(limit: float, share: float) -> None:
    """GIVEN a share of 0.2 WHEN the 3-D sigma of the state is above the limit THEN each scalar is taken with R and a
    fifth of the state's variance; below the limit as it is. S and NIS are not changed by it."""
    case = Case(20, POSITION, spread=5.0, underweight=0.2)
    case.table.underweight_above_m = limit * np.sqrt(np.trace(case.h @ case.p @ case.h.T))
    nis = case.evaluate()
    assert nis == pytest.approx(case.innovation @ np.linalg.solve(case.s, case.innovation), rel=1e-6)
    measurement.correct(case.table, POSITION, case.x, case.ud, case.work)
    p = case.p.copy()
    for axis in range(3):
        row = case.m[axis] @ case.h
        column = p @ row
        p = p - np.outer(column, column) / ((1.0 + share) * (row @ column) + case.sigma[axis] ** 2)
    assert relative(case.covariance(), p, case.p) <= 1e-12


def test_an_underweighted_posterior_is_never_below_the_other() -> None:
    for seed in range(20):
        cases = [Case(14, POSITION, seed, spread=3.0, underweight=u, underweight_above_m=0.0) for u in (0.0, 0.3)]
        for case in cases:
            case.evaluate()
            measurement.correct(case.table, POSITION, case.x, case.ud, case.work)
        sigma = np.sqrt(np.diag(cases[0].p))
        more = (cases[1].covariance() - cases[0].covariance()) / np.outer(sigma, sigma)
        assert np.linalg.eigvalsh(more).min() >= -1e-12


# -- editing

# mode, excluded by the monitor, NIS -> cause
RULES = [
    (EditMode.AUTO, 0, 3.0, USED),
    (EditMode.AUTO, 0, 30.0, USED),  # at the gate
    (EditMode.AUTO, 0, 30.1, GATE),
    (EditMode.AUTO, 1, 3.0, int(RejectCause.SLOW_FAULT)),
    (EditMode.AUTO, 1, 300.0, int(RejectCause.SLOW_FAULT)),
    (EditMode.ACCEPT, 0, 1e6, USED),
    (EditMode.ACCEPT, 1, 3.0, USED),
    (EditMode.REJECT, 0, 3.0, OPERATOR),
    (EditMode.REJECT, 1, 300.0, OPERATOR),
    (EditMode.INHIBIT, 0, 3.0, OPERATOR),
]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("by_command", [False, True])
@pytest.mark.parametrize(("mode", "excluded", "nis", "cause"), RULES)
def test_editing(kind: int, by_command: bool, mode: EditMode, excluded: int, nis: float, cause: int) -> None:
    """By the table or by a command, for this type and not for the other; the operator is asked before the monitor, the
    monitor before the gate."""
    name = ["edit_position", "edit_velocity"][kind]
    other_name = ["edit_velocity", "edit_position"][kind]
    table = record(bare_table(**{name: 2 if by_command else int(mode), other_name: int(EditMode.AUTO)}))
    nav = record(np.zeros(1, NAV))
    if by_command:
        nav.edit_ordered[kind] = 1 + int(mode)
    nav.excluded[kind] = excluded
    assert measurement.editing(nav, table, kind) == mode
    assert measurement.editing(nav, table, 1 - kind) == EditMode.AUTO
    assert measurement.judge(nav, table, kind, nis, 30.0) == cause
    assert measurement.is_inhibited(nav, table, kind) == (mode == EditMode.INHIBIT)
    assert measurement.judge(nav, table, 1 - kind, 3.0, 30.0) == USED


@pytest.mark.parametrize("mode", list(EditMode))
def test_what_has_no_nis_is_used_by_nobody(mode: EditMode) -> None:
    """Not even where the operator accepts all."""
    nav, table = record(np.zeros(1, NAV)), record(bare_table(edit_position=int(mode)))
    for nis in (np.nan, np.inf):
        assert measurement.judge(nav, table, POSITION, nis, 30.0) == int(RejectCause.SINGULAR)


@pytest.mark.compiled
@pytest.mark.parametrize("broken", [np.nan, -1e9, np.inf])
def test_an_impossible_covariance_has_no_nis(broken: float) -> None:
    case = Case(11, POSITION)
    case.ud[0, 0] = case.ud[1, 1] = case.ud[2, 2] = broken
    assert not np.isfinite(case.evaluate())
