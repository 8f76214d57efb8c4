"""The whole force model: its sum, its switches, the frame of what the filter adds, its limits; nothing allocated."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import DAY_NS, T0_GPS_NS, circular_orbit, itrf_from_gcrf_oracle, record
from force_bench import NO_FORCES, ZERO, flight_model, satkit_moved, work

from flightsw.kernels import force_model, spherical_harmonics
from flightsw.kernels.force_model import acceleration_at
from flightsw.kernels.orbit_integrators import propagate
from ground.errors import OperatorError

NS = 1_000_000_000
START = circular_orbit(600e3)
HUGE = {"area_to_mass_m2pkg": 0.02}


def test_gravity_is_taken_in_the_earth_fixed_frame():
    """The rotation by pyerfa, the field by itself: the sum without other forces."""
    model = flight_model(degree=40, **NO_FORCES)
    m = itrf_from_gcrf_oracle(T0_GPS_NS)[0]
    fixed = np.zeros(3)
    spherical_harmonics.acceleration(record(model.field), m @ START[:3], work(), fixed)
    got = model.acceleration(T0_GPS_NS, START)
    assert np.linalg.norm(got - m.T @ fixed) < 2e-11  # 1e-4 m of frame


@pytest.mark.compiled
def test_the_whole_sum_moves_a_satellite_as_satkit_does():
    """2000 s at 50x50 with Sun, Moon, tides, relativity: a centimetre; the Moon's series is the largest part of it."""
    model = flight_model(degree=50, area_to_mass_m2pkg=0.0)
    moved = model.propagate(T0_GPS_NS, START, 2000 * NS)
    expected = satkit_moved(START, 2000.0, 50, sun=True, moon=True, tides=True, relativity=True)
    assert np.abs(moved[:3] - expected[:3]).max() < 0.015
    assert np.abs(moved[3:] - expected[3:]).max() < 2e-5


@pytest.mark.parametrize(
    ("switch", "low", "high"),
    [
        ({"sun": "no"}, 1e-7, 1e-6),
        ({"moon": "no"}, 3e-7, 2e-6),
        ({"solid_tides": "no"}, 1e-8, 5e-7),
        ({"relativity": "no"}, 1e-8, 2e-8),
        ({"drag_coefficient": 0.0}, 1e-9, 1e-6),
        ({"radiation_coefficient": 0.0}, 1e-7, 1.4e-7),
    ],
    ids=lambda x: "-".join(x) if isinstance(x, dict) else None,
)
def test_every_force_can_be_left_out_and_has_the_size_it_should(switch, low, high):
    """Sizes: Montenbruck and Gill, Satellite Orbits, figure 3.1, at 600 km."""
    whole = flight_model(degree=10, **HUGE).acceleration(T0_GPS_NS, START)
    without = flight_model(degree=10, **HUGE, **switch).acceleration(T0_GPS_NS, START)
    assert low < np.linalg.norm(whole - without) < high


def test_relativity_of_a_circular_orbit():
    """3 GM^2 / (c^2 r^3) outward: 1.66e-8 m/s2 at 600 km."""
    r = np.array([0.0, 6.978137e6, 0.0])
    v, out = np.array([0.0, 0.0, np.sqrt(3.986004415e14 / r[1])]), np.zeros(3)
    force_model.add_relativity(3.986004415e14, r, v, out)
    np.testing.assert_allclose(out, [0.0, 3 * (3.986004415e14 / 299792458.0) ** 2 / r[1] ** 3, 0.0], rtol=1e-12)


def test_what_the_filter_adds_lies_along_radius_track_and_normal():
    model = flight_model(degree=4)
    r, v = START[:3], START[3:] + 300.0 * START[:3] / np.linalg.norm(START[:3])  # not circular: track is not v
    radial = r / np.linalg.norm(r)
    normal = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    axes = (radial, np.cross(normal, radial), normal)
    x = np.concatenate((r, v))
    bare = model.acceleration(T0_GPS_NS, x)
    for axis, unit in zip(axes, np.eye(3), strict=True):
        got = model.acceleration(T0_GPS_NS, x, 1.0, 1e-3 * unit) - bare
        assert np.abs(got - 1e-3 * axis).max() < 1e-14


def test_drag_scale_multiplies_drag_alone():
    model, calm = flight_model(degree=4, **HUGE), flight_model(degree=4, **HUGE, drag_coefficient=0.0)
    none = model.acceleration(T0_GPS_NS, START, 0.0)
    assert np.array_equal(none, calm.acceleration(T0_GPS_NS, START))
    one, three = (model.acceleration(T0_GPS_NS, START, k) - none for k in (1.0, 3.0))
    assert np.abs(three - 3 * one).max() < 1e-14
    assert one @ START[3:] < 0.0


def test_gradient_in_gcrf_is_the_derivative_of_gravity_there():
    model = flight_model(degree=8, gradient_degree=8, **NO_FORCES)
    scratch, got, h = work(), np.full((3, 3), np.nan), 1000.0
    assert force_model.turn(record(model.orientation), T0_GPS_NS, scratch)
    force_model.gradient(record(model.field), START[:3], scratch, got)
    expected = np.zeros((3, 3))
    for i in range(3):
        step = np.zeros(6)
        step[i] = h
        one, two = (
            model.acceleration(T0_GPS_NS, START + k * step) - model.acceleration(T0_GPS_NS, START - k * step)
            for k in (1, 2)
        )
        expected[:, i] = (8 * one - two) / (12 * h)
    assert np.abs(got - expected).max() < 1e-10 * np.abs(expected).max()


def test_outside_the_earth_orientation_table_nothing_is_answered():
    for settings in ({}, NO_FORCES):
        model = flight_model(degree=4, **settings)
        for t in (T0_GPS_NS - 5 * DAY_NS, T0_GPS_NS + 9 * DAY_NS):
            with pytest.raises(OperatorError, match="Earth-orientation"):
                model.acceleration(t, START)


def test_nothing_is_left_over_from_one_call_to_the_next():
    """GIVEN scratch full of NaN or of another evaluation WHEN called THEN the same bits."""
    model = flight_model(degree=12)
    results = []
    for before in (np.nan, 1e300):
        model.work.view(np.float64)[:] = before
        results.append(model.acceleration(T0_GPS_NS, START))
    model.acceleration(T0_GPS_NS + 3600 * NS, -START)
    results.append(model.acceleration(T0_GPS_NS, START))
    assert np.isfinite(results[0]).all()
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(results[0], results[2])


@pytest.mark.compiled
def test_kernels_allocate_nothing():
    """numba's own count over a hundred evaluations and steps: one small object per array that Python hands over."""
    from numba.core.runtime import _nrt_python, rtsys

    model = flight_model(degree=20)
    x, out = START.copy(), np.zeros(3)

    def fly():
        for _ in range(100):
            tables = model.forces, model.field, model.orientation
            assert acceleration_at(*tables, T0_GPS_NS, x[:3], x[3:], 1.0, ZERO, model.work, out)
            assert propagate(*tables, T0_GPS_NS, x, 10 * NS, 1.0, ZERO, model.work)

    fly()
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        fly()
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    handed_over = 8 + 6  # arrays among the arguments of the two calls
    assert after.alloc - before.alloc == 100 * handed_over
