"""The monitor of slow faults: its statistic under no fault, what it calls a fault, how large, and when it lets go.

On innovations drawn by themselves; on flights it is in test_nav_monitor_flights.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from flight_bench import NS, T0_GPS_NS, record
from flight_filter_bench import bare_table

from flightsw.icd.enums import FaultKind, MeasurementType, RejectCause
from flightsw.kernels import registry
from flightsw.kernels.registry import MATRIX, TIMES, VECTOR, entry, records
from flightsw.nav import monitor
from flightsw.records import NAV, TABLE, WORK

KINDS = list(FaultKind)
POSITION, VELOCITY = int(MeasurementType.POSITION), int(MeasurementType.VELOCITY)
SLOW_FAULT = int(RejectCause.SLOW_FAULT)


@entry(records(NAV), records(TABLE), MATRIX, MATRIX, registry.I8, MATRIX, records(WORK), MATRIX, VECTOR)
def _observe(nav, table, weights, innovations, period, gains, work, statistics, found):
    """Innovations (n, 6) a second apart, all onsets closed every `period`; weights (6, 3) of position, velocity.

    Before they are closed, the statistics of the first onset go into a row of `statistics`. found: fix, kind and onset
    of what is found first, the largest statistic.
    """
    for i in range(len(innovations)):
        for kind in range(2):
            for a in range(3):
                work[0].innovation_type[kind, a] = innovations[i, 3 * kind + a]
                for b in range(3):
                    work[0].weight_type[kind, a, b] = weights[3 * kind + a, b]
            for k in range(2):
                work[0].mean_gain[kind, k] = gains[kind, k]
        if i % period == 0:
            monitor.forget(nav[0])
            nav[0].monitor_next[:] = 0
            nav[0].monitor_watched = 0
        nis = np.zeros(2)
        for kind in range(2):
            for a in range(3):
                for b in range(3):
                    w = weights[3 * kind + a, b]
                    nis[kind] += innovations[i, 3 * kind + a] * w * innovations[i, 3 * kind + b]
        t_gps_ns = T0_GPS_NS + i * NS
        slot = monitor.observe(nav[0], table[0], t_gps_ns, nis[0], nis[1], work[0])
        found[3] = max(found[3], nav[0].monitor_statistic)
        if slot >= 0 and found[0] < 0.0:
            found[0] = i
            found[1] = nav[0].monitor_kind
            found[2] = (nav[0].monitor_t_gps_ns[slot] - T0_GPS_NS) // NS
        if (i + 1) % period == 0:
            for hypothesis in range(4):
                statistics[i // period, hypothesis] = monitor._solve(nav[0], 0, hypothesis, work[0])


class Stream:
    """A monitor fed with innovations; S of position and velocity as given, or drawn: no axis like another."""

    def __init__(self, seed: int, s: np.ndarray | None = None, gains: Any = 0.0, **table: Any) -> None:
        registry.warm_up()
        self.rng = np.random.default_rng(seed)
        if s is None:
            roots = self.rng.standard_normal((2, 3, 3)) * np.array([10.0, 0.1])[:, None, None]
            s = roots @ roots.transpose(0, 2, 1) + np.array([1.0, 1e-4])[:, None, None] * np.eye(3)
        self.s = s
        self.gains = np.zeros((2, 2)) + gains
        self.nav, self.work = np.zeros(1, NAV), np.zeros(1, WORK)
        self.table = bare_table(monitor_use=1, monitor_step_fixes=10, **table)
        self.found = np.array([-1.0, -1.0, -1.0, 0.0])

    def white(self, n: int) -> np.ndarray:
        """Innovations (n, 6) of a healthy filter."""
        lower = np.linalg.cholesky(self.s)
        return np.einsum("kij,nkj->nki", lower, self.rng.standard_normal((n, 2, 3))).reshape(n, 6)

    def feed(self, innovations: np.ndarray, period: int) -> np.ndarray:
        """Statistics (n // period, 4) of the onset at the beginning of each period."""
        statistics = np.zeros((len(innovations) // period, 4))
        weights = inverse(self.s).reshape(6, 3)
        _observe(self.nav, self.table, weights, innovations, period, self.gains, self.work, statistics, self.found)
        return statistics


def inverse(a: np.ndarray) -> np.ndarray:
    return np.linalg.solve(a, np.broadcast_to(np.eye(3), a.shape))


def chi_square_below(x: np.ndarray) -> np.ndarray:
    """Distribution function of chi-square with three degrees of freedom, closed form."""
    erf = np.array([math.erf(v) for v in np.sqrt(x / 2.0)])
    return erf - np.sqrt(2.0 * x / np.pi) * np.exp(-x / 2.0)


def signature(kind: FaultKind, age_s: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Shift (n, 6) of the measurements by a fault of that size, a filter that absorbs nothing of it."""
    shape = {
        FaultKind.MANOEUVRE: (age_s, np.ones_like(age_s)),
        FaultKind.POSITION_RAMP: (age_s, np.zeros_like(age_s)),
        FaultKind.POSITION_STEP: (np.ones_like(age_s), np.zeros_like(age_s)),
        FaultKind.VELOCITY_BIAS: (np.zeros_like(age_s), np.ones_like(age_s)),
    }[kind]
    return np.where(age_s < 0.0, 0.0, np.array(shape)).T.repeat(3, axis=1) * np.tile(size, 2)


@pytest.mark.compiled
@pytest.mark.parametrize(("period", "gains"), [(2, 0.0), (7, [[0.02, 1e-4], [0.5, 0.01]]), (30, 0.0)])
def test_statistic_of_a_healthy_filter_is_chi_square(period: int, gains: Any) -> None:
    """GIVEN 20,000 onsets with white innovations of any S after each THEN every hypothesis's statistic is chi-square
    with three degrees of freedom (Kolmogorov and Smirnov's distance below its 0.1 % point), whatever the filter is
    thought to absorb."""
    stream, n = Stream(period, gains=gains, monitor_threshold=1e6), 20_000
    statistics = stream.feed(stream.white(n * period), period)
    for hypothesis in KINDS:
        ordered = np.sort(statistics[:, hypothesis])
        below = chi_square_below(ordered)
        distance = max(np.abs(below - np.arange(1, n + 1) / n).max(), np.abs(below - np.arange(n) / n).max())
        assert distance < 1.95 / math.sqrt(n), hypothesis


@pytest.mark.compiled
@pytest.mark.parametrize("kind", KINDS)
def test_size_of_a_fault_is_found_within_its_sigma(kind: FaultKind) -> None:
    """GIVEN 500 faults of known onset, S of any axes WHEN sized after a minute THEN the error of the estimate has no
    mean, and no axis a larger sigma than the one given, which the worst axis has."""
    stream, n, period = Stream(3, monitor_threshold=1e6), 500, 60
    size = np.array([0.03, -0.02, 0.05]) * (1.0 if kind != FaultKind.POSITION_STEP else 100.0)
    error = np.zeros((n, 3))
    age = np.arange(period, dtype=float)
    for k in range(n):
        stream.feed(stream.white(period) + signature(kind, age, size), period)
        nav, work = record(stream.nav), record(stream.work)
        nav.monitor_kind = int(kind)
        sigma = monitor.fault_size(nav, 0, work)
        error[k] = work.residual - size
    weights = inverse(stream.s)
    shape = signature(kind, age, np.ones(3))
    information = weights[0] * (shape[:, 0] ** 2).sum() + weights[1] * (shape[:, 3] ** 2).sum()
    assert sigma == pytest.approx(math.sqrt(np.diag(inverse(information)).max()), rel=1e-9)
    assert (np.abs(error.mean(axis=0)) <= 4.0 * sigma / math.sqrt(n)).all()
    assert 0.88 <= error.std(axis=0).max() / sigma <= 1.12


ISOTROPIC = np.array([100.5 * np.eye(3), 0.01 * np.eye(3)])
SIZES = {
    FaultKind.MANOEUVRE: [0.05, 0.3],
    FaultKind.POSITION_RAMP: [0.1, 1.0],
    FaultKind.POSITION_STEP: [10.0, 20.0],
    FaultKind.VELOCITY_BIAS: [0.05, 0.3],
}


@pytest.mark.compiled
@pytest.mark.parametrize(("kind", "size"), [(kind, size) for kind in KINDS for size in SIZES[kind]])
def test_each_fault_is_called_by_its_name(kind: FaultKind, size: float) -> None:
    """GIVEN fixes of 10 m and 0.1 m/s, a fault in any direction, its onset between those held open WHEN found THEN it
    has its name, in 60 of 60 draws. Step and ramp of positions may be taken for each other: either excludes positions.
    """
    names = []
    for seed in range(60):
        stream = Stream(seed, ISOTROPIC)
        direction = stream.rng.standard_normal(3)
        innovations = stream.white(600)
        age = np.arange(600.0) - stream.rng.integers(200, 210)
        innovations += signature(kind, age, size * direction / np.linalg.norm(direction))
        stream.feed(innovations, 600)
        assert stream.found[0] >= 200
        names.append(FaultKind(int(stream.found[1])))
    of_positions = names.count(FaultKind.POSITION_STEP) + names.count(FaultKind.POSITION_RAMP)
    if kind in (FaultKind.POSITION_STEP, FaultKind.POSITION_RAMP):
        assert of_positions >= 59
    else:
        assert names.count(kind) == 60


@pytest.mark.compiled
def test_measurements_that_the_gate_refuses_count_from_the_third_on() -> None:
    nav = record(np.zeros(1, NAV))
    gate, used = int(RejectCause.GATE), -1
    seen = [monitor.counts(nav, VELOCITY, cause) for cause in (used, gate, gate, gate, gate, used, gate, gate, gate)]
    assert seen == [True, False, False, True, True, True, False, False, True]
    for cause in (int(RejectCause.OPERATOR), SLOW_FAULT, int(RejectCause.STARTING), -2):
        assert not monitor.counts(nav, POSITION, cause)


@entry(records(NAV), records(TABLE), MATRIX, VECTOR, VECTOR, records(WORK), TIMES)
def _watch_excluded(nav, table, residuals, sigma, variance, work, answers):
    for i in range(len(residuals)):
        work[0].S[:, :] = 0.0
        for axis in range(3):
            work[0].residual[axis] = residuals[i, axis]
            work[0].sigma[axis] = sigma[axis]
            work[0].S[axis, axis] = variance[axis]
        answers[i] = 1 if monitor.watch_excluded(nav[0], table[0], POSITION, work[0]) else 0


@pytest.mark.compiled
@pytest.mark.parametrize("state_sigma_m", [0.1, 3.0, 10.0, 100.0])
def test_an_excluded_type_returns_once_it_fits_the_state(state_sigma_m: float) -> None:
    """GIVEN noise of another sigma on each axis, and an error of the state of its own sigma, the same in all fixes of a
    window WHEN the 60 fixes have gone by THEN the type returns in 999 of 1000 cases; with a bias of eight sigmas of
    their mean never, however large the error that the state may have."""
    registry.warm_up()
    rng, table, n = np.random.default_rng(9), bare_table(monitor_clear_fixes=60), 2000
    sigma = np.array([5.0, 10.0, 20.0])
    for bias in (0.0, 8.0):
        offset = state_sigma_m * rng.standard_normal((n, 1, 3))
        offset[:, :, 2] += bias * math.hypot(state_sigma_m, sigma[2] / math.sqrt(60.0))
        residuals = (offset + sigma * rng.standard_normal((n, 60, 3))).reshape(-1, 3)
        answers = np.zeros(60 * n, np.int64)
        variance = sigma**2 + state_sigma_m**2
        _watch_excluded(np.zeros(1, NAV), table, residuals, sigma, variance, np.zeros(1, WORK), answers)
        windows = answers.reshape(n, 60)
        assert not windows[:, :-1].any()
        assert n - 9 <= windows[:, -1].sum() <= n if bias == 0.0 else not windows.any()
