"""What any gravity field obeys: turned with the Earth, mirrored, free of sources and of singular places."""

from __future__ import annotations

import numpy as np
from flight_bench import record
from force_bench import work
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flightsw.kernels import spherical_harmonics
from flightsw.kernels.spherical_harmonics import load_field
from flightsw.records import FIELD, FORCE_TABLE, GRAVITY_TABLE

DEGREE = 12
angles = st.floats(-np.pi, np.pi)
sizes = st.floats(6.4e6, 5e7)
tiny = st.floats(-1e-300, 1e-300) | st.floats(-1.0, 1.0)


def random_coefficients(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """C, S [n, m] of the size of the Earth's (Kaula's rule, a hundred times)."""
    rng = np.random.default_rng(seed)
    n = np.maximum(np.arange(DEGREE + 1), 1)[:, None]
    c, s = rng.standard_normal((2, DEGREE + 1, DEGREE + 1)) * 1e-3 / n**2
    c[0, 0], s[:, 0] = 1.0, 0.0
    return c, s


def field_of(c: np.ndarray, s: np.ndarray) -> np.recarray:
    table, forces, field = np.zeros(1, GRAVITY_TABLE), np.zeros(1, FORCE_TABLE), np.zeros(1, FIELD)
    table["gm_m3ps2"], table["radius_m"], table["degree"] = 3.986004415e14, 6378136.3, DEGREE
    for n in range(DEGREE + 1):
        for m in range(n + 1):
            table["coefficients"][0, n * (n + 1) + 2 * m : n * (n + 1) + 2 * m + 2] = c[n, m], s[n, m]
    forces["degree"] = forces["order"] = forces["gradient_degree"] = DEGREE
    table.flags.writeable = forces.flags.writeable = False
    assert load_field(table, forces, field)
    return record(field)


def acceleration(field: np.recarray, place: np.ndarray) -> np.ndarray:
    out = np.full(3, np.nan)
    spherical_harmonics.acceleration(field, place, work(), out)
    return out


def place_of(size: float, latitude: float, longitude: float) -> np.ndarray:
    c = np.cos(latitude)
    return size * np.array([c * np.cos(longitude), c * np.sin(longitude), np.sin(latitude)])


@settings(max_examples=25)
@given(st.integers(0, 9), angles, sizes, angles, angles)
def test_field_and_place_turned_together_turn_the_acceleration(seed, turn, size, latitude, longitude):
    """C + i S of order m turns by m times the angle."""
    c, s = random_coefficients(seed)
    m = np.arange(DEGREE + 1)
    turned = (c - 1j * s) * np.exp(-1j * m * turn)
    place = place_of(size, latitude, longitude)
    z = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    a = acceleration(field_of(c, s), place)
    b = acceleration(field_of(turned.real.copy(), -turned.imag), z @ place)
    assert np.linalg.norm(z @ a - b) <= 1e-14 * np.linalg.norm(a)


@settings(max_examples=25)
@given(st.integers(0, 9), sizes, angles, angles)
def test_field_and_place_mirrored_at_the_equator_mirror_the_acceleration(seed, size, latitude, longitude):
    """P_nm(-u) = (-1)^(n + m) P_nm(u)."""
    c, s = random_coefficients(seed)
    n, m = np.indices(c.shape)
    sign = 1.0 - 2.0 * ((n + m) % 2)
    mirror = np.array([1.0, 1.0, -1.0])
    place = place_of(size, latitude, longitude)
    a = acceleration(field_of(c, s), place)
    b = acceleration(field_of(sign * c, sign * s), mirror * place)
    assert np.linalg.norm(mirror * a - b) <= 1e-14 * np.linalg.norm(a)


@settings(max_examples=40)
@given(st.integers(0, 9), sizes, tiny, tiny, st.sampled_from([-1.0, 1.0]))
@example(0, 7e6, 0.0, 0.0, 1.0)
@example(0, 7e6, 0.0, 5e-324, -1.0)
def test_nothing_happens_at_the_poles(seed, size, x, y, side):
    """However near, the acceleration there is that at the pole itself, to what a metre of distance can change."""
    field = field_of(*random_coefficients(seed))
    at_pole = acceleration(field, np.array([0.0, 0.0, side * size]))
    near = acceleration(field, np.array([x, y, side * size]))
    assert np.isfinite(near).all()
    assert np.linalg.norm(near - at_pole) <= 2e-6 * np.linalg.norm(at_pole)


@settings(max_examples=25)
@given(st.integers(0, 9), sizes, angles, angles)
def test_work_around_a_small_loop_is_nothing_and_space_holds_no_mass(seed, size, latitude, longitude):
    """Curl and divergence from central differences: gravity is a gradient, and harmonic; so says `gradient`."""
    field = field_of(*random_coefficients(seed))
    place, h = place_of(size, latitude, longitude), 1e-4 * size
    jacobian = np.zeros((3, 3))
    for i in range(3):
        step = np.zeros(3)
        step[i] = h
        one = acceleration(field, place + step) - acceleration(field, place - step)
        two = acceleration(field, place + 2 * step) - acceleration(field, place - 2 * step)
        jacobian[:, i] = (8 * one - two) / (12 * h)
    scale = np.abs(jacobian).max()
    gradient = np.full((3, 3), np.nan)
    spherical_harmonics.gradient(field, place, work(), gradient)
    assert np.abs(jacobian - jacobian.T).max() <= 1e-9 * scale
    assert abs(np.trace(jacobian)) <= 1e-9 * scale
    assert np.abs(jacobian - gradient).max() <= 1e-9 * scale
