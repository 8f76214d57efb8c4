"""Covariances stay symmetric, positive and finite for any noise a table may hold: 100,000 steps of each filter rule."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import circular_orbit, loaded_memory, record
from hypothesis import given, settings
from hypothesis import strategies as st

from flightsw.integrity.autonomous import predict_bound_covariance
from flightsw.kernels import gravity
from flightsw.kernels.registry import I8, MATRIX, VECTOR, entry, records
from flightsw.nav import filter as ekf
from flightsw.records import TABLE, WORK

EXAMPLES, STEPS = 100, 1000
POLE = np.array([0.0, 0.0, 1.0])


def decades(low, high):
    return st.floats(low, high).map(lambda e: 10.0**e)


NOISE = st.tuples(
    st.one_of(st.just(0.0), decades(-6, 6)),  # q_R, q_V, q_A per step
    st.one_of(st.just(0.0), decades(-12, 2)),
    st.one_of(st.just(0.0), decades(-18, -4)),
    decades(-3, 6),  # s_R, s_V
    decades(-5, 4),
)


@entry(records(TABLE), MATRIX, VECTOR, MATRIX, I8, records(WORK), MATRIX)
def _fly(table, orbit, pole, noise, every, work, p):
    """STEPS of prediction, each `every` of them with an update; how many before a covariance was refused."""
    x = np.zeros(9)
    for k in range(STEPS):
        x[:6] = orbit[k // 10]
        gravity.gradient(table[0], x[0:3], pole, work[0].gradient)
        ekf.transition(table[0], 1.0, work[0].gradient, work[0])
        ekf.predict_covariance(table[0], 0, 1.0, p, work[0], p)
        if k % every == 0:
            if not ekf.gain(p, noise, work[0]):
                return k
            ekf.condition(p, noise, work[0], p)
            if not ekf.is_sound(table[0], x, p):
                return k
    return STEPS


@entry(records(TABLE), MATRIX, VECTOR, records(WORK), MATRIX)
def _coast(table, orbit, pole, work, p):
    """The same by the rule of the bound: (17) at every step."""
    for k in range(STEPS):
        r = orbit[k // 10][0:3]
        gravity.gradient(table[0], r, pole, work[0].gradient)
        ekf.transition(table[0], 1.0, work[0].gradient, work[0])
        if not predict_bound_covariance(table[0], 0, p, work[0], p):
            return k
    return STEPS


def bench(row, integrator):
    memory = loaded_memory("paper")
    memory.table.flags.writeable = True
    memory.table["integrator"] = integrator
    memory.table["gravity_model"] = integrator
    names = ("q_r_m2", "q_v_m2ps2", "q_a_m2ps4", "s_r_m", "s_v_mps")
    for name, value in zip(names, row, strict=True):
        memory.table["tuning_bound_" + name][0, 0] = value
        if name.startswith("q"):
            memory.table["tuning_" + name][0, 0] = value
    return memory.table, memory.work


def orbit_from(u_deg):
    """Once around in 100 places (100, 6), ten steps each."""
    return np.array([circular_orbit(500e3, 60.0, 10.0, u_deg + 3.6 * k) for k in range(100)])


def assert_sound(p):
    assert np.isfinite(p).all()
    assert (p == p.T).all()
    assert (np.diag(p) > 0.0).all()
    scale = np.sqrt(np.diag(p))
    # as correlations, so that metres and m/s2 weigh the same
    assert np.linalg.eigvalsh(p / np.outer(scale, scale)).min() > -1e-9


def start(row):
    return np.diag(np.repeat([row[3] ** 2, row[4] ** 2, (0.02 / 3) ** 2], 3))


@pytest.mark.compiled
@settings(max_examples=EXAMPLES)
@given(NOISE, st.integers(0, 1), st.floats(0.0, 360.0), st.integers(1, 30))
def test_the_filters_own_covariance(row, integrator, u_deg, every):
    """Predict each second, update each second or less often; with Euler and with RK4 and J2."""
    table, work = bench(row, integrator)
    p, noise = start(row), np.diag(np.repeat([row[3] ** 2, row[4] ** 2], 3))
    assert _fly(table, orbit_from(u_deg), POLE, noise, every, work, p) == STEPS
    assert_sound(p)


@pytest.mark.compiled
@settings(max_examples=EXAMPLES)
@given(NOISE, st.integers(0, 1), st.floats(0.0, 360.0))
def test_the_covariance_of_the_bound(row, integrator, u_deg):
    table, work = bench(row, integrator)
    p = start(row)
    assert _coast(table, orbit_from(u_deg), POLE, work, p) == STEPS
    assert_sound(p)


@settings(max_examples=30)
@given(NOISE, st.integers(0, 2**32 - 1))
def test_more_information_never_gives_a_larger_covariance(row, seed):
    """P after an update, by any fix, is not above P before it: eigenvalues of the difference are not negative."""
    work = record(bench(row, 0)[1])
    root = np.random.default_rng(seed).standard_normal((9, 9)) * np.repeat([1e3, 1.0, 1e-3], 3)[:, None]
    p = root @ root.T
    before = p.copy()
    noise = np.diag(np.repeat([row[3] ** 2, row[4] ** 2], 3))
    assert ekf.gain(p, noise, work)
    ekf.condition(p, noise, work, p)
    scale = np.sqrt(np.diag(before))
    assert np.linalg.eigvalsh((before - p) / np.outer(scale, scale)).min() > -1e-9
