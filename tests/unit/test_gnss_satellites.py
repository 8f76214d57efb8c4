"""Satellites where they were at emission: against an integration of another kind, in inertial axes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flightsw.gnss.records import EPHEMERIDES, EPOCH, RAW
from flightsw.gnss.satellites import place_satellites
from flightsw.gnss.setup import EARTH_RATE_RADPS, Settings, build_table
from flightsw.gnss.solution import LIGHT_MPS
from flightsw.kernels.registry import warm_up

MU, J2, RADIUS = 3.986004418e14, 1.0826359e-3, 6_378_136.6
T_REF_NS = 1_300_000_000 * 10**9


def inertial(r: np.ndarray, v: np.ndarray, dt_s: float, steps: int = 400) -> np.ndarray:
    """Position after dt under central gravity and J2 by leapfrog in inertial axes: no line of it is flight's."""
    h = dt_s / steps

    def pull(x: np.ndarray) -> np.ndarray:
        d = math.sqrt(float(x @ x))
        z2 = (x[2] / d) ** 2
        flat = 1.5 * J2 * (RADIUS / d) ** 2
        return -MU * x / d**3 * (1.0 + flat * np.array([1.0 - 5.0 * z2, 1.0 - 5.0 * z2, 3.0 - 5.0 * z2]))

    x, u = r.copy(), v.copy()
    for _ in range(steps):
        u = u + 0.5 * h * pull(x)
        x = x + h * u
        u = u + 0.5 * h * pull(x)
    return x


def turned(x: np.ndarray, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]])


def one(t_ns: int, range_m: float, **known: object) -> tuple[np.ndarray, np.ndarray]:
    """The epoch of one row of satellite 5 of Galileo, and the ephemerides."""
    warm_up()
    raw, ephemerides, epoch = np.zeros(1, RAW), np.zeros(1, EPHEMERIDES), np.zeros(1, EPOCH)
    raw["t_gps_ns"], raw["count"] = t_ns, 1
    raw["satellite"][0, 0], raw["constellation"][0, 0] = 5, 2
    raw["range_m"][0, 0], raw["sigma_m"][0, 0] = range_m, 3.0
    for name, value in known.items():
        ephemerides[name][0, 2, 4] = value
    place_satellites(build_table(Settings(signal_sigma_m=(0.0, 0.0, 4.0, 0.0))), raw, ephemerides, epoch)
    return epoch, ephemerides


R = np.array([1.9e7, -1.2e7, 1.85e7])
V = np.array([1800.0, 2300.0, -900.0])  # inertial, where the axes of the Earth are the inertial ones at the reference


@pytest.mark.parametrize("age_s", [0.0, 7.5, 59.0, -30.0])
def test_a_place_is_carried_to_the_emission(age_s: float) -> None:
    """GIVEN place and motion at a reference time WHEN a signal came age seconds after THEN it left where an inertial
    integration puts the satellite, to 2 mm, and the range has the clock of that moment in it.
    """
    range_m, clock_m, drift = 2.4e7, 3000.0, 0.02
    omega = np.array([0.0, 0.0, EARTH_RATE_RADPS])
    epoch, _ = one(
        T_REF_NS + round(age_s * 1e9),
        range_m,
        known=1,
        t_ref_gps_ns=T_REF_NS,
        r_m=R,
        v_mps=V - np.cross(omega, R),
        clock_m=clock_m,
        clock_drift_mps=drift,
    )
    dt_s = age_s - (range_m + clock_m) / LIGHT_MPS
    expected = turned(inertial(R, V, dt_s), EARTH_RATE_RADPS * dt_s)
    np.testing.assert_allclose(epoch["r_m"][0, 0], expected, atol=2e-3)
    assert epoch["range_m"][0, 0] == pytest.approx(range_m + clock_m + drift * dt_s, abs=1e-6)
    assert epoch["sigma_m"][0, 0] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("t_ns", "range_m", "known"),
    [
        (T_REF_NS + 61 * 10**9, 2.4e7, {}),
        (2**63 - 1, 2.4e7, {"t_ref_gps_ns": -(2**63)}),
        (T_REF_NS, float("nan"), {}),
        (T_REF_NS, 1e300, {}),
        (T_REF_NS, 2.4e7, {"known": 0}),
        (T_REF_NS, 2.4e7, {"clock_m": float("inf")}),
    ],
    ids=["too old", "times that overflow", "no number", "absurd range", "unknown", "clock"],
)
def test_a_satellite_without_a_usable_place_is_nowhere(t_ns: int, range_m: float, known: dict[str, float]) -> None:
    """GIVEN any of these THEN the row has no place, and the range is left as it came."""
    given = {"known": 1, "t_ref_gps_ns": T_REF_NS, "r_m": R, "v_mps": V, "clock_m": 0.0} | known
    epoch, _ = one(t_ns, range_m, **given)
    assert not epoch["r_m"][0, 0].any()
    np.testing.assert_equal(epoch["range_m"][0, 0], range_m)


def test_no_number_of_a_satellite_reaches_outside() -> None:
    """GIVEN numbers and constellations beyond all bounds THEN these rows have no place, the others theirs."""
    warm_up()
    raw, ephemerides, epoch = np.zeros(1, RAW), np.zeros(1, EPHEMERIDES), np.zeros(1, EPOCH)
    ephemerides["known"] = 1
    ephemerides["t_ref_gps_ns"] = T_REF_NS
    ephemerides["r_m"], ephemerides["v_mps"] = R, V
    raw["t_gps_ns"], raw["count"] = T_REF_NS, 2**40
    raw["range_m"], raw["sigma_m"] = 2.4e7, 1.0
    raw["satellite"][0, :6] = (0, 65, -1, 2**62, 1, 64)
    raw["constellation"][0, :8] = (0, 0, 0, 0, 0, 3, -1, 4)
    raw["satellite"][0, 6:] = 7
    place_satellites(build_table(Settings()), raw, ephemerides, epoch)
    placed = epoch["r_m"][0].any(axis=1)
    assert placed[:8].tolist() == [False] * 4 + [True, True, False, False]
    assert epoch["count"][0] == 2**40
