"""Gravity of high degree against sums in spherical coordinates by mpmath, closed forms at the poles, and satkit."""

from __future__ import annotations

import os
from functools import cache

import numpy as np
import pytest
from flight_bench import record
from force_bench import bare_field, flight_model, work
from mpmath import mp, mpf

from flightsw.kernels import gravity, spherical_harmonics
from flightsw.kernels.spherical_harmonics import load_field
from flightsw.records import FIELD, FORCE_TABLE, GRAVITY_TABLE
from ground.tables.gravity_field import packaged_model, read_gfc

DEGREE = 120
PLACES = {
    "middle latitude": (-3.1e6, 4.2e6, 4.6e6),
    "southern": (4.4e6, 1.1e6, -5.3e6),
    "equator": (6.9e6, 100.0, 0.0),
    "7 m from the north pole": (5.0, -5.0, 6.878e6),
    "micrometres from the south pole": (1e-6, 2e-6, -6.878e6),
    "at 20 000 km": (1.9e7, -1.1e7, 1.4e7),
}


@cache
def coefficients():
    """C, S of EGM96 as numbers of mpmath, unnormalised by exact factorials."""
    model = read_gfc(packaged_model("EGM96"), DEGREE)
    with mp.workdps(50):
        c = [[mpf(0)] * (DEGREE + 1) for _ in range(DEGREE + 1)]
        s = [[mpf(0)] * (DEGREE + 1) for _ in range(DEGREE + 1)]
        for n in range(DEGREE + 1):
            ratio = mpf(2 * n + 1)  # (2 - d) (2 n + 1) (n - m)! / (n + m)!
            for m in range(n + 1):
                factor = mp.sqrt(ratio * (1 if m == 0 else 2))
                c[n][m], s[n][m] = factor * mpf(float(model.c[n, m])), factor * mpf(float(model.s[n, m]))
                if m < n:
                    ratio /= (n - m) * (n + m + 1)
    return model, c, s


def sum_in_spherical_coordinates(place, degree, order):
    """Gradient of the potential from its partial derivatives by r, latitude, longitude: classical P_nm, 50 digits.

    Source: D. A. Vallado, Fundamentals of Astrodynamics, 4th edition, equations 8-25 to 8-27.
    """
    model, c, s = coefficients()
    with mp.workdps(50):
        x, y, z = (mpf(float(v)) for v in place)
        r = mp.sqrt(x * x + y * y + z * z)
        flat = mp.sqrt(x * x + y * y)
        u, cosine = z / r, flat / r
        by_r = by_latitude = by_longitude = mpf(0)
        cos, sin = mpf(1), mpf(0)
        sectoral = mpf(1)
        rho = mpf(model.radius_m) / r
        columns = []
        for m in range(order + 2):
            column = [mpf(0)] * (degree + 2)
            if m <= degree:
                column[m] = sectoral
                column[m + 1] = (2 * m + 1) * u * sectoral
                for n in range(m + 2, degree + 1):
                    column[n] = ((2 * n - 1) * u * column[n - 1] - (n + m - 1) * column[n - 2]) / (n - m)
            columns.append(column)
            sectoral *= (2 * m + 1) * cosine
        for m in range(order + 1):
            for n in range(m, degree + 1):
                turned = c[n][m] * cos + s[n][m] * sin
                p = columns[m][n]
                slope = columns[m + 1][n] - m * u / cosine * p
                by_r -= rho**n * (n + 1) * p * turned
                by_latitude += rho**n * slope * turned
                by_longitude += rho**n * m * p * (s[n][m] * cos - c[n][m] * sin)
            cos, sin = cos * x / flat - sin * y / flat, sin * x / flat + cos * y / flat
        mu = mpf(model.gm_m3ps2)
        by_r, by_latitude, by_longitude = by_r * mu / r**2, by_latitude * mu / r, by_longitude * mu / r
        common = by_r / r - z / (r * r * flat) * by_latitude
        return np.array(
            [
                float(common * x - by_longitude * y / flat**2),
                float(common * y + by_longitude * x / flat**2),
                float(by_r * z / r + flat / r**2 * by_latitude),
            ]
        )


def field_of(degree, order=None, gradient_degree=4):
    settings = {"degree": degree, "order": degree if order is None else order, "gradient_degree": gradient_degree}
    return record(flight_model(**settings).field)


def gravity_at(field, place):
    out = np.full(3, np.nan)
    spherical_harmonics.acceleration(field, np.array(place, dtype=float), work(), out)
    return out


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_acceleration_to_degree_120_agrees_with_fifty_digits(place):
    """ISSUE: 1e-12 relative, poles included."""
    expected = sum_in_spherical_coordinates(place, DEGREE, DEGREE)
    assert np.linalg.norm(gravity_at(field_of(DEGREE), place) - expected) <= 1e-14 * np.linalg.norm(expected)


@pytest.mark.parametrize(("degree", "order"), [(2, 0), (2, 2), (3, 1), (36, 36), (70, 20), (17, 16), (50, 0)])
def test_degree_and_order_are_those_of_the_table(degree, order):
    place = PLACES["middle latitude"]
    expected = sum_in_spherical_coordinates(place, degree, order)
    got = gravity_at(field_of(degree, order), place)
    assert np.linalg.norm(got - expected) <= 1e-14 * np.linalg.norm(expected)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_acceleration_at_the_very_poles(side):
    """Closed form: only orders 0 and 1 reach the pole, with P_n(1) = 1 and P_n1 / cos phi = n (n + 1) / 2."""
    model, c, s = coefficients()
    r = 6.878e6
    with mp.workdps(50):
        rho, sums = mpf(model.radius_m) / mpf(r), [mpf(0)] * 3
        for n in range(DEGREE + 1):
            parity = mpf(side) ** (n + 1)
            sums[0] += rho**n * c[n][1] * n * (n + 1) / 2 * parity
            sums[1] += rho**n * s[n][1] * n * (n + 1) / 2 * parity
            sums[2] -= rho**n * c[n][0] * (n + 1) * parity
        expected = np.array([float(mpf(model.gm_m3ps2) / mpf(r) ** 2 * total) for total in sums])
    got = gravity_at(field_of(DEGREE), (0.0, 0.0, side * r))
    assert np.linalg.norm(got - expected) <= 1e-14 * np.linalg.norm(expected)


def test_acceleration_agrees_with_satkit():
    os.environ["SATKIT_OFFLINE"] = "1"
    satkit = pytest.importorskip("satkit")
    rng = np.random.default_rng(7)
    for degree in (10, 36, 50):
        field = field_of(degree)
        for _ in range(20):
            place = rng.standard_normal(3)
            place *= rng.uniform(6.6e6, 9e6) / np.linalg.norm(place)
            expected = np.array(satkit.gravity(place, degree=degree, model=satkit.gravmodel.egm96))
            assert np.linalg.norm(gravity_at(field, place) - expected) <= 1e-12 * np.linalg.norm(expected)


def test_a_recursion_that_overflows_or_loses_digits_would_show_far_out_and_close_in():
    for size in (6.4e6, 4.2e7, 4e8):
        for place in ((size, 0, 0), (0, 0, size), (0.6 * size, 0.0, 0.8 * size)):
            a = gravity_at(field_of(DEGREE), place)
            central = 3.986004415e14 / size**2
            assert np.linalg.norm(a) == pytest.approx(central, rel=4e-3 * (6.378e6 / size) ** 2)


@pytest.mark.parametrize("degree", [2, 4, 20])
@pytest.mark.parametrize("place", list(PLACES.values())[:4], ids=list(PLACES)[:4])
def test_gradient_is_the_derivative_of_the_acceleration(degree, place):
    """Eighth-order central differences of a field of the same degree, whose values are right to 1e-15."""
    field = field_of(degree, gradient_degree=degree)
    got, h = np.full((3, 3), np.nan), 3000.0
    spherical_harmonics.gradient(field, np.array(place), work(), got)
    expected = np.zeros((3, 3))
    for i in range(3):
        step = np.zeros(3)
        for k, weight in ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280)):
            step[i] = k * h
            expected[:, i] += weight / h * (gravity_at(field, place + step) - gravity_at(field, place - step))
    assert np.abs(got - expected).max() <= 3e-12 * np.abs(expected).max()
    assert np.array_equal(got, got.T)


def test_gradient_of_j2_is_that_of_the_smaller_model():
    """gravity.py has J2 in closed form, written for another pole and by another route."""
    from flight_bench import loaded_memory

    table = loaded_memory("j2", mu_m3ps2=3.986004415e14).table
    field = record(bare_field(-float(table["j2"][0]) / np.sqrt(5.0)))
    place, pole = np.array(PLACES["southern"]), np.array([0.0, 0.0, 1.0])
    got, expected, a = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    spherical_harmonics.gradient(field, place, work(), got)
    gravity.gradient(record(table), place, pole, expected)
    gravity.acceleration(record(table), place, pole, a)
    assert np.abs(got - expected).max() <= 1e-14 * np.abs(expected).max()
    assert np.linalg.norm(gravity_at(field, place) - a) <= 1e-15 * np.linalg.norm(a)


def test_a_force_table_that_asks_for_more_than_the_coefficients_hold_changes_nothing():
    source, forces, field = np.zeros(1, GRAVITY_TABLE), np.zeros(1, FORCE_TABLE), np.zeros(1, FIELD)
    source["degree"] = 10
    field.view(np.uint8)[:] = 7
    for degree, order in ((11, 0), (10, 11)):
        forces["degree"], forces["order"], forces["gradient_degree"] = degree, order, 2
        assert not load_field(*(readonly(a) for a in (source, forces)), field)
        assert (field.view(np.uint8) == 7).all()


def readonly(array):
    copy = array.copy()
    copy.flags.writeable = False
    return copy
