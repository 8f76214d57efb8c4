"""Integrators against Kepler's solution by mpmath, and against motion without gravity, which both know exactly."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import circular_orbit, loaded_memory, record, two_body
from mpmath import mp, mpf

from flightsw.kernels import integrators

POLE = np.array([0.0, 0.0, 1.0])


def kepler(state, dt_s, mu):
    """Position and velocity after dt_s by f and g, 40 digits."""
    with mp.workdps(40):
        r0, v0 = [mpf(c) for c in state[:3]], [mpf(c) for c in state[3:6]]
        mu, dt = mpf(mu), mpf(dt_s)
        r = mp.sqrt(sum(c * c for c in r0))
        a = 1 / (2 / r - sum(c * c for c in v0) / mu)
        n = mp.sqrt(mu / a**3)
        c0 = 1 - r / a
        s0 = sum(x * y for x, y in zip(r0, v0, strict=True)) / mp.sqrt(mu * a)
        e = mp.findroot(lambda e: e - c0 * mp.sin(e) + s0 * (1 - mp.cos(e)) - n * dt, n * dt, tol=mpf(10) ** -70)
        now = a * (1 - c0 * mp.cos(e) + s0 * mp.sin(e))
        f, g = 1 - a / r * (1 - mp.cos(e)), dt - (e - mp.sin(e)) / n
        df, dg = -mp.sqrt(mu * a) / (now * r) * mp.sin(e), 1 - a / now * (1 - mp.cos(e))
        position = [float(f * x + g * y) for x, y in zip(r0, v0, strict=True)]
        velocity = [float(df * x + dg * y) for x, y in zip(r0, v0, strict=True)]
    return np.array(position), np.array(velocity)


def flown(kind, start, duration_s, dt_s):
    table = record(loaded_memory("paper").table)
    x, work = np.zeros(9), np.zeros((6, 3))
    x[:6] = start
    for _ in range(round(duration_s / dt_s)):
        kind(table, x, dt_s, POLE, work)
    return x


def error_m(kind, start, duration_s, dt_s):
    mu = float(loaded_memory("paper").table["mu_m3ps2"][0])
    return np.abs(flown(kind, start, duration_s, dt_s)[:3] - kepler(start, duration_s, mu)[0]).max()


ORBIT = circular_orbit(500e3)


def test_bench_truth_agrees_with_forty_digits():
    start = ORBIT * np.array([1.0, 1.0, 1.0, 1.01, 0.99, 1.02])
    for dt in (0.0, 1.0, 900.0, 5580.0, -300.0):
        r, v = two_body(start, np.array([round(dt * 1e9)]), t0_gps_ns=0)
        r_mp, v_mp = kepler(start, dt, 3.9860044e14)
        assert np.abs(r[0] - r_mp).max() < 1e-6
        assert np.abs(v[0] - v_mp).max() < 1e-9


def test_euler_alone_errs_by_kilometres_after_900_s():
    """REFERENCE S0, finding 1: 3.9 km at 900 s, 500 km, step 1 s.

    The error is 5.65 km in space whatever the plane and phase; its largest axis depends on them: 3.74 to 5.65 km.
    """
    errors = [
        error_m(integrators.euler, circular_orbit(500e3, i, node, u), 900.0, 1.0)
        for i in (0.0, 51.6, 97.4)
        for node in (0.0, 40.0, 90.0)
        for u in (0.0, 30.0, 90.0)
    ]
    assert min(errors) == pytest.approx(3.8e3, rel=0.03)
    assert max(errors) < 5.65e3
    assert min(errors) < 3.9e3 < max(errors)


def test_rk4_of_one_second_errs_by_a_tenth_of_a_micrometre():
    """REFERENCE S0, finding 1: 7e-8 m at 900 s."""
    assert error_m(integrators.rk4, ORBIT, 900.0, 1.0) < 2.5e-7


def test_rk4_of_ten_seconds_errs_by_less_than_a_millimetre():
    """REFERENCE S0, finding 1: 0.7 mm at 900 s."""
    assert 0.2e-3 < error_m(integrators.rk4, ORBIT, 900.0, 10.0) < 1.0e-3


@pytest.mark.parametrize(("kind", "order", "coarse"), [(integrators.euler, 1, 2.0), (integrators.rk4, 4, 30.0)])
def test_order_of_convergence(kind, order, coarse):
    start = ORBIT * np.array([1.0, 1.0, 1.0, 1.03, 0.98, 1.0])
    ratio = error_m(kind, start, 600.0, coarse) / error_m(kind, start, 600.0, coarse / 2.0)
    assert np.log2(ratio) == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize("kind", [integrators.euler, integrators.rk4])
def test_correction_acts_as_a_constant_acceleration(kind):
    """Without gravity r = r0 + v0 t + dA t^2/2: exact for RK4; Euler lags by dA t tau/2; dA itself never moves."""
    memory = loaded_memory("paper")
    memory.table.flags.writeable = True
    memory.table["mu_m3ps2"] = 0.0
    table, work = record(memory.table), np.zeros((6, 3))
    x = np.array([7e6, -1e6, 2e5, 100.0, -7500.0, 30.0, 1e-3, -2e-3, 5e-4])
    start = x.copy()
    for _ in range(100):
        kind(table, x, 0.5, POLE, work)
    t = 50.0
    lag = start[6:9] * t * 0.25 if kind is integrators.euler else 0.0
    np.testing.assert_allclose(x[:3], start[:3] + start[3:6] * t + start[6:9] * t * t / 2 - lag, rtol=1e-14)
    np.testing.assert_allclose(x[3:6], start[3:6] + start[6:9] * t, rtol=1e-14)
    assert (x[6:9] == start[6:9]).all()


def test_table_names_the_integrator():
    for name, kind in (("paper", integrators.euler), ("j2", integrators.rk4)):
        table = record(loaded_memory(name).table)
        a, b, work = np.zeros(9), np.zeros(9), np.zeros((6, 3))
        a[:6] = b[:6] = ORBIT
        integrators.advance(table, a, 1.0, POLE, work)
        kind(table, b, 1.0, POLE, work)
        assert (a == b).all()


def test_rk4_backwards_undoes_a_step():
    """A fix may be a little later than the stamp: the state is carried back."""
    table = record(loaded_memory("j2").table)
    x, work = np.zeros(9), np.zeros((6, 3))
    x[:6] = ORBIT
    integrators.rk4(table, x, 0.7, POLE, work)
    integrators.rk4(table, x, -0.7, POLE, work)
    assert np.abs(x[:3] - ORBIT[:3]).max() < 1e-7
