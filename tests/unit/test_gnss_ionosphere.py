"""One frequency: flight's delay against the interface document's formulas in numpy, the world's bulge, refusals."""

from __future__ import annotations

import math

import erfa
import numpy as np
import pytest

from flightsw.gnss.ionosphere import correct_ionosphere
from flightsw.gnss.records import EPOCH, SATELLITES
from flightsw.gnss.setup import Settings, build_table
from flightsw.kernels.registry import warm_up
from hil_sim.pseudoranges import ionosphere

LIGHT_MPS = 299_792_458.0
ALPHA, BETA = (4.6566e-9, 1.4901e-8, -5.9605e-8, -1.1921e-7), (81_920.0, 98_304.0, -65_536.0, -524_290.0)
SETTINGS = Settings(iono_share=0.6, iono_error=0.4, iono_floor_m=0.2, iono_alpha=ALPHA, iono_beta=BETA)
RADIUS_M, SHELL_M = 6_878_000.0, 300_000.0
T0_NS = 1_277_078_400 * 10**9  # 2020-06-25 00:00 GPS time


def klobuchar_m(t_s: float, there: np.ndarray) -> float:
    """Vertical delay [m] at L1 by IS-GPS-200, 20.3.3.5.2.5, where a direction points; written without flight's."""
    latitude, longitude = np.arcsin(there[2]) / np.pi, np.arctan2(there[1], there[0]) / np.pi
    magnetic = latitude + 0.064 * np.cos(np.pi * (longitude - 1.617))
    local = (43_200.0 * longitude + t_s) % 86_400.0
    amplitude, period = np.polyval(ALPHA[::-1], magnetic), np.polyval(BETA[::-1], magnetic)
    x = 2.0 * np.pi * (local - 50_400.0) / max(period, 72_000.0)
    day = max(amplitude, 0.0) * (1.0 - x**2 / 2.0 + x**4 / 24.0) if abs(x) < 1.57 else 0.0
    return float(LIGHT_MPS * (5e-9 + day))


def epoch(system: int, satellite_m: np.ndarray, start_m: np.ndarray, hour: float = 0.0) -> np.ndarray:
    made = np.zeros(1, EPOCH)
    made["t_gps_ns"], made["count"] = T0_NS + round(hour * 3.6e12), 1
    made["constellation"][0, 0], made["satellite"][0, 0] = system, 3
    made["range_m"][0, 0], made["sigma_m"][0, 0], made["r_m"][0, 0] = 2.2e7, 1.5, satellite_m
    made["start_known"], made["start_m"] = 1, start_m
    return made


def corrected(made: np.ndarray, settings: Settings = SETTINGS) -> np.ndarray:
    warm_up()
    correct_ionosphere(build_table(settings), made)
    return made


@pytest.mark.parametrize("system", [0, 1, 2, 3])
@pytest.mark.parametrize("hour", [2.0, 13.0, 19.5])
def test_the_delay_is_that_of_the_documents(system: int, hour: float) -> None:
    """GIVEN rays at random WHEN corrected THEN range and sigma change by Klobuchar's delay where the ray meets the
    layer (found by bisection), the share, the slant there, and the frequency of the constellation."""
    rng = np.random.default_rng([system, round(hour)])
    frequency_mhz = (1575.42, 1602.0, 1575.42, 1561.098)[system]
    tried = 0
    while tried < 12:
        up = rng.standard_normal(3)
        up /= np.linalg.norm(up)
        start = RADIUS_M * up
        satellite = rng.standard_normal(3)
        satellite *= 2.66e7 / np.linalg.norm(satellite)
        ray = (satellite - start) / np.linalg.norm(satellite - start)
        sine = float(ray @ up)
        if sine < 0.05:
            continue
        tried += 1
        low, high = 0.0, 1e7
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.linalg.norm(start + middle * ray) < RADIUS_M + SHELL_M else (low, middle)
        there = (start + low * ray) / np.linalg.norm(start + low * ray)
        slant = (1575.42 / frequency_mhz) ** 2 / float(there @ ray)  # by the cosine of the angle to the layer's normal
        vertical = 0.6 * klobuchar_m(T0_NS / 1e9 % 86_400.0 + hour * 3_600.0, there)
        made = corrected(epoch(system, satellite, start, hour))
        assert 2.2e7 - made["range_m"][0, 0] == pytest.approx(slant * vertical, abs=1e-5)
        wrong = slant * (0.4 * vertical + 0.2)
        assert made["sigma_m"][0, 0] == pytest.approx(math.hypot(1.5, wrong), rel=1e-9)


def test_what_is_left_alone() -> None:
    """GIVEN no share, no start, a start that is none, an unknown constellation, no numbers THEN nothing is changed and
    nothing raised; a sigma that is not positive stays as it came, to be refused by its name."""
    good = epoch(0, np.array([2.66e7, 0.0, 0.0]), np.array([RADIUS_M, 0.0, 0.0]))
    for change, settings in (
        ({}, Settings()),
        ({"start_known": 0}, SETTINGS),
        ({"start_m": np.zeros(3)}, SETTINGS),
        ({"start_m": np.full(3, math.nan)}, SETTINGS),
        ({"constellation": -1}, SETTINGS),
        ({"constellation": 9}, SETTINGS),
        ({"r_m": math.nan}, SETTINGS),
        ({"r_m": math.inf}, SETTINGS),
    ):
        made = good.copy()
        for name, value in change.items():
            made[name] = value
        assert corrected(made.copy(), settings).tobytes() == made.tobytes(), change
    for value in (0.0, -1.0, math.nan):
        made = good.copy()
        made["sigma_m"] = value
        found = corrected(made)["sigma_m"][0, 0]
        assert found == value or (math.isnan(value) and math.isnan(found))
    for count in (-5, SATELLITES + 9):
        made = good.copy()
        made["count"], made["t_gps_ns"] = count, -(2**62)
        corrected(made)


def test_the_worlds_bulge_is_where_it_is_two_in_the_afternoon() -> None:
    """GIVEN the world's ionosphere THEN its middle has the local solar time 14 h, on the Sun's declination."""
    t_ns = T0_NS + np.arange(0, 86_400, 7_200) * 10**9
    tt_1, tt_2 = 2_444_244.5, t_ns / 8.64e13 + 51.184 / 86_400.0
    sun = -erfa.epv00(tt_1, tt_2)[0]["p"]
    at = ionosphere.bulge(t_ns)
    east = np.degrees(np.arctan2(at[:, 1], at[:, 0]) - np.arctan2(sun[:, 1], sun[:, 0])) % 360.0
    np.testing.assert_allclose(east, 30.0, atol=1e-6)
    np.testing.assert_allclose(at[:, 2], sun[:, 2] / np.linalg.norm(sun, axis=1), atol=1e-9)


def test_the_worlds_delay_by_hand() -> None:
    """GIVEN a receiver under the bulge and one on the far side THEN upwards 1 + 4 m and 1 m at L1, less for GLONASS,
    and the slant of a shell 350 km above at the horizon."""
    t_ns = np.array([T0_NS, T0_NS])
    up = ionosphere.bulge(t_ns) * np.array([[1.0], [-1.0]])
    ray = np.repeat(up[:, None, :], 2, axis=1)
    overhead = np.full((2, 2), math.pi / 2.0)
    found = ionosphere.delay_m(1.0, 4.0, np.array([0, 1]), t_ns, RADIUS_M * up, ray, overhead)
    np.testing.assert_allclose(found[:, 0], [5.0, 1.0], rtol=1e-9)
    np.testing.assert_allclose(found[:, 1] / found[:, 0], (1575.42 / 1602.0) ** 2, rtol=1e-12)
    level = ionosphere.slant(np.array([0.0]), np.array([RADIUS_M]))[0]
    assert level == pytest.approx(1.0 / math.sqrt(1.0 - (RADIUS_M / (RADIUS_M + 350_000.0)) ** 2), rel=1e-12)
