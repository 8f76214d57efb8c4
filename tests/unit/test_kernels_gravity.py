"""Gravity: acceleration and gradient against derivatives of the potential taken by mpmath with 40 digits."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import loaded_memory, record
from mpmath import mp, mpf

from flightsw.kernels import gravity

POLES = {
    "z axis": (0.0, 0.0, 1.0),
    "pole of 2021": (2.0e-3, -3.0e-5, 0.9999979999977499),
    "far off": (0.48, -0.6, 0.64),
}
PLACES = [(7.0e6, 0.0, 0.0), (-3.1e6, 5.2e6, 3.4e6), (1.0, -2.0, 6.8e6), (4.4e6, 4.1e6, -3.3e6)]


def potential(table, pole, r):
    """U = mu/r [1 - J2 (a/r)^2 (3 sin^2(phi) - 1) / 2], sin(phi) = r.pole / r."""
    size = mp.sqrt(sum(c * c for c in r))
    value = mpf(float(table.mu_m3ps2)) / size
    if table.gravity_model:
        sine = sum(c * mpf(p) for c, p in zip(r, pole, strict=True)) / size
        flat = mpf(float(table.j2)) * (mpf(float(table.equatorial_radius_m)) / size) ** 2
        value *= 1 - flat * (3 * sine**2 - 1) / 2
    return value


def derivative(table, pole, r, *axes):
    """Partial derivative of the potential by nested central differences; steps and digits leave 1e-15."""
    if not axes:
        return potential(table, pole, r)
    step = mpf(10)
    up, down = list(r), list(r)
    up[axes[0]] += step
    down[axes[0]] -= step
    up2, down2 = list(r), list(r)
    up2[axes[0]] += 2 * step
    down2[axes[0]] -= 2 * step
    rest = axes[1:]
    near = derivative(table, pole, up, *rest) - derivative(table, pole, down, *rest)
    far = derivative(table, pole, up2, *rest) - derivative(table, pole, down2, *rest)
    return (8 * near - far) / (12 * step)


@pytest.fixture(scope="module", autouse=True)
def _forty_digits():
    with mp.workdps(40):
        yield


@pytest.mark.parametrize("name", ["paper", "j2"])
@pytest.mark.parametrize("pole", POLES.values(), ids=POLES)
def test_acceleration_and_gradient_are_derivatives_of_the_potential(name, pole):
    table = record(loaded_memory(name).table)
    for place in PLACES:
        r = [mpf(c) for c in place]
        first = np.array([float(derivative(table, pole, r, i)) for i in range(3)])
        second = np.array([[float(derivative(table, pole, r, i, j)) for j in range(3)] for i in range(3)])
        got, gradient = np.full(3, np.nan), np.full((3, 3), np.nan)
        gravity.acceleration(table, np.array(place), np.array(pole), got)
        gravity.gradient(table, np.array(place), np.array(pole), gradient)
        assert np.abs(got - first).max() <= 1e-12 * np.linalg.norm(first)
        assert np.abs(gradient - second).max() <= 1e-12 * np.abs(second).max()
        assert np.abs(gradient - gradient.T).max() <= 1e-15 * np.abs(gradient).max()
        assert abs(np.trace(gradient)) <= 1e-11 * np.abs(gradient).max()  # Laplace, for a pole of unit length to 1e-12


def test_pole_of_date_against_the_z_axis_is_worth_tens_of_metres():
    """What the note in gravity.py claims: 2.5e-5 m/s2 for 2.5 mrad."""
    table = record(loaded_memory("j2").table)
    worst = 0.0
    rng = np.random.default_rng(5)
    for _ in range(300):
        r = rng.standard_normal(3)
        r *= 6.878e6 / np.linalg.norm(r)
        a, b = np.zeros(3), np.zeros(3)
        gravity.acceleration(table, r, np.array([0.0, 0.0, 1.0]), a)
        gravity.acceleration(table, r, np.array([2.5e-3, 0.0, np.sqrt(1.0 - 2.5e-3**2)]), b)
        worst = max(worst, np.linalg.norm(a - b))
    assert 2.0e-5 < worst < 9e-5
