"""GCRF and ITRF from the flight table against pyerfa's own chain fed with finals2000A read anew."""

from __future__ import annotations

import erfa
import numpy as np
import pytest
from flight_bench import (
    DAY_NS,
    NS,
    T0_GPS_NS,
    circular_orbit,
    itrf_from_gcrf_oracle,
    loaded_memory,
    record,
    to_itrf,
    two_body,
)

from flightsw.kernels import frames


def rotation(t_gps_ns):
    memory = loaded_memory("j2")
    m, dm = np.full((3, 3), np.nan), np.full((3, 3), np.nan)
    assert frames.itrf_from_gcrf(record(memory.orientation), int(t_gps_ns), record(memory.work), m, dm)
    return m, dm


TIMES = T0_GPS_NS + np.random.default_rng(3).integers(-DAY_NS, 3 * DAY_NS, 150)


def test_positions_agree_with_erfa_below_a_millimetre_and_velocities_below_a_hundredth_of_a_millimetre_per_second():
    r, v = two_body(circular_orbit(500e3), TIMES)
    r_itrf, v_itrf = to_itrf(TIMES, r, v)
    worst_r = worst_v = 0.0
    for k, t in enumerate(TIMES):
        m, dm = rotation(t)
        worst_r = max(worst_r, np.linalg.norm(m @ r[k] - r_itrf[k]))
        worst_v = max(worst_v, np.linalg.norm(m @ v[k] + dm @ r[k] - v_itrf[k]))
    assert worst_r < 1e-3
    assert worst_v < 1e-5


def test_polar_motion_belongs_in_the_velocity():
    """What it is worth: without it a velocity is wrong by about a millimetre per second."""
    t = TIMES[:1]
    r, v = two_body(circular_orbit(500e3), t)
    full = rotation(t[0])[0] @ v[0]
    memory = loaded_memory("j2")
    memory.orientation.flags.writeable = True
    memory.orientation["nodes"][0, :, 3:5] = 0.0
    m, dm = np.zeros((3, 3)), np.zeros((3, 3))
    assert frames.itrf_from_gcrf(record(memory.orientation), int(t[0]), record(memory.work), m, dm)
    assert 1e-3 < np.linalg.norm(m @ v[0] - full) < 0.05  # 7.6 km/s times some 0.3"
    assert r.shape == (1, 3)


def test_matrix_is_a_rotation():
    for t in TIMES[:30]:
        m, _ = rotation(t)
        assert np.abs(m @ m.T - np.eye(3)).max() < 1e-14
        assert np.linalg.det(m) == pytest.approx(1.0, abs=1e-14)


def test_derivative_is_the_numerical_derivative_of_the_matrix():
    """Five-point difference over +-20 s. What is left out is the rate of polar motion: 1e-13 rad/s, 1e-6 m/s."""
    for t in TIMES[:30]:
        h = 10 * NS
        near, far = (rotation(t + k * h)[0] - rotation(t - k * h)[0] for k in (1, 2))
        assert np.abs(rotation(t)[1] - (8 * near - far) / 120.0).max() < 3e-13
        oracle = (itrf_from_gcrf_oracle(t + NS) - itrf_from_gcrf_oracle(t - NS))[0] / 2.0
        assert np.abs(rotation(t)[1] - oracle).max() * 6.9e6 < 1e-5


def test_pole_of_date_is_that_of_erfa():
    memory = loaded_memory("j2")
    for t in TIMES[:30]:
        pole = np.zeros(3)
        assert frames.pole_gcrf(record(memory.orientation), int(t), record(memory.work), pole)
        days, rest = divmod(int(t), DAY_NS)
        x, y, _ = erfa.xys06a(2400000.5 + 44244 + days, (rest / NS + 51.184) / 86400.0)
        assert np.abs(pole[:2] - (x, y)).max() < 3e-9  # the observed offsets dX, dY: below 0.5 mas
        assert np.linalg.norm(pole) == pytest.approx(1.0, abs=1e-15)


def test_interpolation_reproduces_cubics_and_their_rates():
    """Four-point Lagrange is exact for any cubic."""
    memory = loaded_memory("j2")
    memory.orientation.flags.writeable = True
    t0, step, count = (int(memory.orientation[n][0]) for n in ("t0_gps_ns", "step_ns", "count"))
    rng = np.random.default_rng(11)
    c = rng.standard_normal((4, 6))
    u = np.arange(count)[:, None] - 5.0
    memory.orientation["nodes"][0, :count] = c[0] + c[1] * u + c[2] * u**2 + c[3] * u**3
    value, rate = np.zeros(6), np.zeros(6)
    for place in (1.0, 1.25, 4.999, 7.5, count - 2.000001):
        t = t0 + round(place * step)
        frames.interpolate(record(memory.orientation), t, value, rate)
        w = (t - t0) / step - 5.0
        scale = np.abs(c).sum(0) * max(1.0, abs(w)) ** 3
        assert (np.abs(value - (c[0] + c[1] * w + c[2] * w**2 + c[3] * w**3)) <= 1e-14 * scale).all()
        assert (np.abs(rate - (c[1] + 2 * c[2] * w + 3 * c[3] * w**2) / (step * 1e-9)) <= 1e-17 * scale).all()


def test_outside_the_table_nothing_is_answered():
    """Covered is where a node lies on each outer side: [node 1, node count - 2)."""
    memory = loaded_memory("j2")
    eop, work = record(memory.orientation), record(memory.work)
    t0, step, count = (int(memory.orientation[n][0]) for n in ("t0_gps_ns", "step_ns", "count"))
    first, end = t0 + step, t0 + (count - 2) * step
    inside, outside = (first, end - 1), (first - 1, end, -(2**63), 2**63 - 1)
    for t in inside:
        assert frames.covers(eop, t)
        assert frames.pole_gcrf(eop, t, work, np.zeros(3))
    for t in outside:
        pole, m, dm = np.full(3, 7.0), np.full((3, 3), 7.0), np.full((3, 3), 7.0)
        assert not frames.covers(eop, t)
        assert not frames.pole_gcrf(eop, t, work, pole)
        assert not frames.itrf_from_gcrf(eop, t, work, m, dm)
        assert (pole == 7.0).all()
        assert (m == 7.0).all()
        assert (dm == 7.0).all()
