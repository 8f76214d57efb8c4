"""The factorised covariance, one operation at a time and in the flight filter: no noise makes it anything else.

Variances from 24 decades; the random walk of a million steps is in test_udu_random_walk.py.
"""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import circular_orbit
from hypothesis import given, settings
from hypothesis import strategies as st

from flightsw.icd.table_schema import NAVIGATION
from flightsw.kernels import registry, udu
from flightsw.kernels.registry import MATRIX, VECTOR, entry, records
from flightsw.nav import flight_model, flight_start
from flightsw.records import NAV, STATES, TABLE, WORK

MU_M3PS2 = 3.986004415e14
TURNS = 64


# -- one operation at a time


@st.composite
def factors(draw: st.DrawFn) -> np.ndarray:
    """U D U' of 1 to 20 states: variances over 24 decades, a few of them zero, any coupling between them."""
    n = draw(st.integers(1, 20))
    variance = st.one_of(st.just(0.0), st.floats(-12.0, 12.0).map(lambda e: 10.0**e))
    ud = np.diag(draw(st.lists(variance, min_size=n, max_size=n)))
    coupling = draw(st.sampled_from([0.0, 1e-6, 1.0, 1e6]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return ud + np.triu(coupling * rng.standard_normal((n, n)), 1)


def whole(ud: np.ndarray) -> np.ndarray:
    p = np.full(ud.shape, np.nan)
    udu.covariance(ud, len(ud), len(ud), p)
    return p


def unit(p: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """p in units of these sigmas; where a sigma is zero, so is p."""
    scale = np.where(sigma > 0.0, sigma, 1.0)
    return p / np.outer(scale, scale)


@settings(max_examples=200)
@given(factors(), st.floats(-12.0, 12.0), st.integers(0, 2**32 - 1))
def test_a_measurement_never_makes_a_covariance_larger(ud: np.ndarray, decade: float, seed: int) -> None:
    """Any state, any row, a noise variance from 24 decades: D >= 0, P+ <= P as matrices, no variance above its own."""
    n = len(ud)
    h, f, gain = np.random.default_rng(seed).standard_normal(n), np.zeros(n), np.zeros(n)
    prior = whole(ud)
    s = udu.correct(ud, n, h, 10.0**decade, f, gain)
    posterior, sigma = whole(ud), np.sqrt(np.diag(prior))
    assert s >= 10.0**decade
    assert np.isfinite(ud).all()
    assert np.isfinite(gain).all()
    assert (np.diag(ud) >= 0.0).all()
    assert (np.diag(posterior) <= np.diag(prior) * (1.0 + 1e-14)).all()
    assert np.linalg.eigvalsh(unit(posterior, sigma)).min() >= -1e-14 * n
    assert np.linalg.eigvalsh(unit(prior - posterior, sigma)).min() >= -1e-14 * n


@settings(max_examples=200)
@given(factors(), st.integers(0, 6), st.integers(0, 2**32 - 1))
def test_a_prediction_is_the_sum_of_what_goes_in(ud: np.ndarray, columns: int, seed: int) -> None:
    """Any transition, noise over 24 decades or none: D >= 0, and U D U' is Phi P Phi' + G q G'."""
    n, rng = len(ud), np.random.default_rng(seed)
    phi, g = rng.standard_normal((n, n)), rng.standard_normal((n, columns))
    width = (n + columns + 3) // 4 * 4
    w, q = np.zeros((n, width)), np.zeros(width)
    w[:, :n], w[:, n : n + columns] = phi @ (np.triu(ud, 1) + np.eye(n)), g
    q[:n], q[n : n + columns] = np.diag(ud), 10.0 ** rng.uniform(-12.0, 12.0, columns)
    expected = (w * q) @ w.T
    out = np.full((n, n), np.nan)
    udu.orthogonalise(w.copy(), q, n, width, np.zeros(width), out)
    sigma = np.sqrt(np.diag(expected))
    assert (np.diag(out) >= 0.0).all()
    assert np.isfinite(out).all()
    assert np.abs(unit(whole(out) - expected, sigma)).max() <= 1e-14 * n


# -- the flight filter's own prediction


@entry(records(NAV), records(TABLE), MATRIX, MATRIX, MATRIX, VECTOR, MATRIX, MATRIX, registry.F8, records(WORK))
def _predict_and_correct(nav, table, ud, orbit, gradients, drag, rows, variance, dt_s, work):
    """As `_walk`, by flight_model; orbit (k, 20) and gradients (3 k, 3) are gone through in turn."""
    n = flight_model.states(table[0])
    f, gain = np.zeros(STATES), np.zeros(STATES)
    for step in range(len(variance)):
        at = step % len(orbit)
        flight_model.set_transition(table[0], orbit[at], dt_s, drag, gradients[3 * at : 3 * at + 3], work[0])
        flight_model.predict(nav[0], table[0], 0, ud, dt_s, drag, work[0], ud)
        for r in range(len(rows)):
            if variance[step, r] > 0.0:
                udu.correct(ud, n, rows[r], variance[step, r], f, gain)
        for i in range(n):
            if not (ud[i, i] > 0.0 and ud[i, i] < np.inf):
                return step
    return len(variance)


@entry(records(TABLE), VECTOR, registry.F8, registry.F8, registry.F8, records(WORK), MATRIX)
def _start(table, x, sigma_r_m, sigma_v_mps, arc_s, work, ud):
    return flight_start.start(table[0], x, sigma_r_m, sigma_v_mps, arc_s, work[0], ud)


# the table's sigmas, each about the middle of its 12 decades
NOISE = {
    "empirical_sigma_mps2": -7.0,
    "white_radial_m2ps3": -12.0,
    "white_along_m2ps3": -12.0,
    "white_cross_m2ps3": -12.0,
    "drag_sigma": -1.0,
    "drag_slow_sigma": -1.0,
    "gnss_bias_sigma_m": 0.0,
    "gnss_periodic_sigma_m": 0.0,
}
TIMES = ("empirical_tau_s", "drag_tau_s", "drag_slow_tau_s", "gnss_bias_tau_s", "gnss_periodic_tau_s")


@pytest.mark.compiled
@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from([11, 14, 20]), st.sampled_from([0.1, 1.0, 60.0]))
def test_any_table_leaves_a_covariance(seed: int, n: int, dt_s: float) -> None:
    """GIVEN any of 12 decades of each noise setting of the flight filter and of the receiver's sigmas, correlation
    times from seconds to months WHEN flown for 1000 steps THEN D > 0 and P is a covariance; 11, 14 and 20 states."""
    registry.warm_up()
    rng = np.random.default_rng(seed)
    table, work, nav = np.zeros(1, TABLE), np.zeros(1, WORK), np.zeros(1, NAV)
    for field in NAVIGATION.fields:
        if field.default is not None:
            table[field.name] = field.default
    for name, middle in NOISE.items():
        table[name] = 10.0 ** rng.uniform(middle - 6.0, middle + 6.0)
    for name in TIMES:
        table[name] = 10.0 ** rng.uniform(0.0, 7.0)
    if n < 20:
        table["gnss_periodic_sigma_m"] = 0.0
    if n < 14:
        table["gnss_bias_sigma_m"] = 0.0
    orbit, gradients = np.zeros((TURNS, STATES)), []
    for turn in range(TURNS):
        orbit[turn, :6] = circular_orbit(500e3, 60.0, 10.0, 360.0 * turn / TURNS)
        r = orbit[turn, :3]
        gradients.append(MU_M3PS2 / np.linalg.norm(r) ** 5 * (3.0 * np.outer(r, r) - r @ r * np.eye(3)))
    turned, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    rows = np.zeros((6, STATES))
    rows[:, :6] = np.kron(np.eye(2), turned)
    if n >= 14:
        rows[:3, 11:14] = np.eye(3)
    if n >= 20:
        rows[:3, 14:20:2] = np.eye(3)
    sigma = 10.0 ** np.hstack([rng.uniform(-6.0, 6.0, (1, 3)), rng.uniform(-9.0, 3.0, (1, 3))])
    variance = np.where(rng.random((1000, 6)) < 0.6, sigma**2, 0.0)
    drag = orbit[0, 3:6] * -(10.0 ** rng.uniform(-16.0, -8.0))
    ud = np.zeros((STATES, STATES))
    arc_s = rng.choice([0.0, 10.0, 60.0, 600.0])
    assert _start(table, orbit[0], 10.0 ** rng.uniform(-3, 3), 10.0 ** rng.uniform(-6, 0), arc_s, work, ud)
    args = (nav, table, ud, orbit, np.vstack(gradients), drag, rows, variance, dt_s, work)
    assert _predict_and_correct(*args) == 1000
    p = whole(np.ascontiguousarray(ud[:n, :n]))
    assert np.isfinite(p).all()
    assert (p == p.T).all()
    assert np.linalg.eigvalsh(unit(p, np.sqrt(np.diag(p)))).min() >= -1e-14
