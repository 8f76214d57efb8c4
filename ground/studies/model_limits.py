"""Limits of the paper's model that need no flight: its integrator, and what three sigmas cover."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.kernels import integrators
from flightsw.kernels.registry import VECTOR, entry, frozen_records, records
from flightsw.memory import Memory
from flightsw.records import TABLE, WORK
from ground.tables.build import build_navigation

PERIOD_S = 5580.0  # the paper's
ECCENTRICITY = 0.001
INCLINATION_RAD = math.radians(65.0)
PERCENT_997 = 0.997


@entry(frozen_records(TABLE), VECTOR, VECTOR, records(WORK))
def _integrate(table, x, steps_s, work):
    for index in range(steps_s.shape[0]):
        integrators.advance(table[0], x, steps_s[index], work[0].node, work[0].stages)


def two_body_error_m(integrator: str, step_s: float, age_s: float) -> float:
    """Error of flight's own integrator on a two-body orbit with the paper's period, largest axis [m].

    Nothing is left out of its gravity, so what remains is the integrator alone. Reference: Kepler's equation.
    """
    memory = Memory()
    image = decode(build_navigation("paper", {"integrator": integrator}))
    memory.table.flags.writeable = True
    for name in image.values.dtype.names or ():
        memory.table[name] = image.values[name]
    memory.table.flags.writeable = False
    mu_m3ps2 = float(image.values["mu_m3ps2"][0])
    x = np.concatenate((*kepler_state(mu_m3ps2, 0.0), np.zeros(3)))
    _integrate(memory.table, x, np.full(round(age_s / step_s), step_s), memory.work)
    r_m, _ = kepler_state(mu_m3ps2, age_s)
    return float(np.abs(x[:3] - r_m).max())


def kepler_state(mu_m3ps2: float, age_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) [m] and velocity (3,) [m/s] on the paper's orbit, age_s after perigee at the ascending node."""
    motion = 2.0 * math.pi / PERIOD_S
    a = (mu_m3ps2 / motion**2) ** (1.0 / 3.0)
    mean = motion * age_s
    anomaly = mean
    for _ in range(20):
        anomaly -= (anomaly - ECCENTRICITY * math.sin(anomaly) - mean) / (1.0 - ECCENTRICITY * math.cos(anomaly))
    flat = math.sqrt(1.0 - ECCENTRICITY**2)
    rate = motion / (1.0 - ECCENTRICITY * math.cos(anomaly))
    along, across = a * (math.cos(anomaly) - ECCENTRICITY), a * flat * math.sin(anomaly)
    v_along, v_across = -a * math.sin(anomaly) * rate, a * flat * math.cos(anomaly) * rate
    tilt = np.array([0.0, math.cos(INCLINATION_RAD), math.sin(INCLINATION_RAD)])
    node = np.array([1.0, 0.0, 0.0])
    return along * node + across * tilt, v_along * node + v_across * tilt


def coverage_of_worst_axis(k: float) -> float:
    """Probability that k sigma cover the largest of three independent, equally uncertain axes."""
    return math.erf(k / math.sqrt(2.0)) ** 3


def factor_for_worst_axis(probability: float = PERCENT_997) -> float:
    """The k of `coverage_of_worst_axis` for a probability."""
    return NormalDist().inv_cdf((1.0 + probability ** (1.0 / 3.0)) / 2.0)


def factor_for_radius(probability: float = PERCENT_997) -> float:
    """Radius in sigmas that covers an isotropic error in space with a probability (Maxwell's distribution)."""
    low, high = 0.0, 20.0
    for _ in range(80):
        k = 0.5 * (low + high)
        inside = math.erf(k / math.sqrt(2.0)) - math.sqrt(2.0 / math.pi) * k * math.exp(-0.5 * k * k)
        low, high = (k, high) if inside < probability else (low, k)
    return 0.5 * (low + high)
