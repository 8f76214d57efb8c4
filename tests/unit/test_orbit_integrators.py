"""Integrators of the force model: order conditions, Kepler by 40 digits, whole and split steps, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import DAY_NS, T0_GPS_NS, circular_orbit, record, two_body
from force_bench import NO_FORCES, ZERO, bare_field, flight_model, work

from flightsw.kernels import orbit_integrators
from flightsw.kernels.orbit_integrators import RK8_MATRIX, RK8_NODES, RK8_WEIGHTS, rk4, rk8, rkn5

NS = 1_000_000_000
GM = 3.986004415e14
ORBIT = circular_orbit(500e3) * np.array([1.0, 1.0, 1.0, 1.03, 0.98, 1.0])


def test_coefficients_satisfy_the_order_conditions_that_are_easy_to_write():
    """Rows add up to nodes; quadrature to order 8; b A c^k = b c^(k+1) / (k + 1) contracted: (Butcher, trees)."""
    assert np.abs(RK8_MATRIX.sum(axis=1) - RK8_NODES).max() < 1e-14
    for k in range(8):
        assert RK8_WEIGHTS @ RK8_NODES**k == pytest.approx(1 / (k + 1), abs=1e-15)
    for k in range(7):
        assert RK8_WEIGHTS @ RK8_MATRIX @ RK8_NODES**k == pytest.approx(1 / ((k + 1) * (k + 2)), abs=1e-14)
        for p in range(7 - k):
            left = (RK8_WEIGHTS * RK8_NODES**p) @ RK8_MATRIX @ RK8_NODES**k
            assert left == pytest.approx(1 / ((k + 1) * (k + p + 2)), abs=1e-14)


def flown(kind, duration_s, step_s):
    """ORBIT around a point mass."""
    model = flight_model(degree=2, **NO_FORCES)
    field, x, scratch = record(bare_field()), ORBIT.copy(), work()
    for k in range(round(duration_s / step_s)):
        t = T0_GPS_NS + round(k * step_s * NS)
        assert kind(
            record(model.forces), field, record(model.orientation), t, x, round(step_s * NS), 1.0, ZERO, scratch
        )
    return x


def error_m(kind, duration_s, step_s):
    r, _ = two_body(ORBIT, np.array([T0_GPS_NS + round(duration_s * NS)]), mu=GM)
    return np.linalg.norm(flown(kind, duration_s, step_s)[:3] - r[0])


@pytest.mark.parametrize(("kind", "order", "coarse"), [(rk4, 4, 60.0), (rkn5, 5, 60.0), (rk8, 8, 300.0)])
def test_order_of_convergence_on_keplers_orbit(kind, order, coarse):
    ratio = error_m(kind, 3600.0, coarse) / error_m(kind, 3600.0, coarse / 2)
    assert np.log2(ratio) == pytest.approx(order, abs=0.5)


@pytest.mark.compiled
def test_steps_of_1_s_with_fixes_and_long_steps_without_are_exact_for_all_purposes():
    assert error_m(rk4, 900.0, 1.0) < 1e-6
    assert error_m(rkn5, 900.0, 1.0) < 1e-6
    assert error_m(rkn5, 3600.0, 15.0) < 1e-3
    assert error_m(rk8, 3600.0, 30.0) < 1e-5


@pytest.mark.parametrize("integrator", ["RK4", "RK8", "RKN5"])
def test_long_intervals_are_split_evenly_and_end_on_time(integrator):
    """GIVEN a step of at most 10 s WHEN 95 s and a nanosecond are asked for THEN as ten steps; backwards undoes it."""
    model = flight_model(degree=20, integrator=integrator, step_max_ns=10 * NS)
    span = 95 * NS + 1
    there = model.propagate(T0_GPS_NS, ORBIT, span)
    x = ORBIT.copy()
    for k in range(10):
        x = model.propagate(T0_GPS_NS + span * k // 10, x, span * (k + 1) // 10 - span * k // 10)
    assert np.array_equal(x, there)
    back = model.propagate(T0_GPS_NS + span, there, -span)
    assert np.abs(back[:3] - ORBIT[:3]).max() < 2e-5
    assert np.array_equal(model.propagate(T0_GPS_NS, ORBIT, 0), ORBIT)


def test_table_names_the_integrator():
    for name, kind in (("RK4", rk4), ("RK8", rk8), ("RKN5", rkn5)):
        model, x = flight_model(degree=6, integrator=name), ORBIT.copy()
        tables = record(model.forces), record(model.field), record(model.orientation)
        assert kind(*tables, T0_GPS_NS, x, 10 * NS, 1.0, ZERO, work())
        assert np.array_equal(x, model.propagate(T0_GPS_NS, ORBIT, 10 * NS))


@pytest.mark.compiled
@pytest.mark.parametrize(("integrator", "step_s"), [("RKN5", 15), ("RK8", 60)])
def test_long_steps_of_the_full_model_stay_within_a_millimetre_of_steps_of_1_s(integrator, step_s):
    """50x50, all forces, 0.02 m2/kg, 2000 s; the edge of the shadow, which no integrator likes, is most of it."""
    settings = {"degree": 50, "area_to_mass_m2pkg": 0.02}
    fine = flight_model(**settings, integrator="RK4", step_max_ns=NS).propagate(T0_GPS_NS, ORBIT, 2000 * NS)
    long = flight_model(**settings, integrator=integrator, step_max_ns=step_s * NS)
    assert np.abs(long.propagate(T0_GPS_NS, ORBIT, 2000 * NS)[:3] - fine[:3]).max() < 1e-3


def test_outside_the_earth_orientation_table_a_step_is_refused_and_the_state_untouched():
    model, x = flight_model(degree=2), ORBIT.copy()
    tables = record(model.forces), record(model.field), record(model.orientation)
    for kind in (rk4, rk8, rkn5, orbit_integrators.advance):
        assert not kind(*tables, T0_GPS_NS + 9 * DAY_NS, x, NS, 1.0, ZERO, work())
        assert np.array_equal(x, ORBIT)
