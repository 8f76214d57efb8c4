"""What satellites broadcast of themselves: the truth with healthy errors, and faults on top.

Errors are radial, along-track, cross-track [m] and clock [m], broadcast minus true, in each satellite's own axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hil_sim.truth.local_frames import rtn_axes

RADIAL, ALONG, CROSS, CLOCK = range(4)
DIRECTIONS = ("radial", "along", "cross", "clock")


@dataclass(frozen=True)
class HealthyErrors:
    """1-sigma of an upload's errors and of their rates: the paper's Table 2 (GLONASS-K), which names no clock."""

    sigma_m: tuple[float, float, float, float] = (0.5, 3.5, 3.5, 0.0)
    sigma_rate_mps: tuple[float, float, float, float] = (0.0017, 0.0002, 0.0002, 0.0)
    upload_s: float = 1800.0

    def draw(self, satellites: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Errors (n,4) [m] at the upload and their rates (n,4) [m/s]."""
        drawn = rng.standard_normal((2, satellites, 4))
        return drawn[0] * np.array(self.sigma_m), drawn[1] * np.array(self.sigma_rate_mps)

    def at_age(self, error_m: np.ndarray, rate_mps: np.ndarray, age_s: np.ndarray | float) -> np.ndarray:
        """What errors (n,4) at the upload and their rates (n,4) have become at an age [s], a number or (n,1).

        An error swings about zero as fast as its rate allows, so that at every age both it and its rate have the sigma
        of the table. Growing on at that rate it would be no healthy one after half an hour: 3 m, six sigma, radially.
        """
        sigma_m, rate = np.array(self.sigma_m), np.array(self.sigma_rate_mps)
        swing_radps = np.where(sigma_m > 0.0, rate / np.where(sigma_m > 0.0, sigma_m, 1.0), 0.0)
        angle = swing_radps * age_s
        # sin(angle) / swing, also where the swing is zero
        return error_m * np.cos(angle) + rate_mps * age_s * np.sinc(angle / np.pi)


@dataclass(frozen=True)
class Fault:
    """A wrong message of some satellites, from onset_s for duration_s: a jump [m] and a growth [m/s] in any mix."""

    satellites: tuple[int, ...]
    jump_m: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    ramp_mps: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    onset_s: float = 0.0
    duration_s: float = math.inf

    def error_m(self, t_s: float) -> np.ndarray:
        """Its error (4,) [m] at t; zero outside its time."""
        age = t_s - self.onset_s
        if not 0.0 <= age < self.duration_s:
            return np.zeros(4)
        return np.array(self.jump_m) + age * np.array(self.ramp_mps)


@dataclass(frozen=True)
class CommonRotation:
    """All broadcast positions turned together about an axis, as by a wrong Earth orientation."""

    angle_rad: float
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    onset_s: float = 0.0

    def displacement_m(self, t_s: float, r_m: np.ndarray) -> np.ndarray:
        """Displacement (n,3) [m] of positions (n,3), to the first order."""
        if t_s < self.onset_s:
            return np.zeros_like(r_m)
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        return self.angle_rad * np.cross(axis, r_m)


def broadcast(r_m: np.ndarray, v_mps: np.ndarray, error_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n,3) [m] and clocks (n,) [m] as broadcast, for errors (n,4); velocities are broadcast as they are.

    A healthy velocity error, millimetres a second, is nothing within a flight time.
    """
    axes = rtn_axes(r_m, v_mps)
    return r_m + np.einsum("nk,nki->ni", error_m[:, :3], axes), error_m[:, CLOCK].copy()


class FailureClass(NamedTuple):
    """A row of the standard's failure statistics. per_satellite_hour: rate; size: jump [m] or ramp [m/s], in range."""

    name: str
    ramp: bool
    size_min: float
    size_max: float
    per_satellite_hour: float
    mean_duration_h: float


# The paper's Tables 3 and 4, after the standard of GLONASS open service (2.2, 2019): GLONASS-M, 2009 to 2015.
FAILURES = (
    FailureClass("jump 70-300 m", False, 70.0, 300.0, 2.04e-6, 5.0 / 3.0),
    FailureClass("jump 300-700 m", False, 300.0, 700.0, 4.08e-6, 32.34 / 6.0),
    FailureClass("jump > 700 m", False, 700.0, 2000.0, 16.31e-6, 26.99 / 24.0),
    FailureClass("ramp < 0.01 m/s", True, 0.001, 0.01, 180.75e-6, 1573.02 / 266.0),
    FailureClass("ramp 0.01-0.05 m/s", True, 0.01, 0.05, 7.47e-6, 72.84 / 11.0),
)


def draw_failures(satellites: int, span_s: float, rng: np.random.Generator, scale: float = 1.0) -> list[Fault]:
    """Service failures of a span, of the rates of Tables 3 and 4 times `scale`.

    Each failure is of one satellite (the tables know no others), its direction any of the four, its size uniform in the
    class, its duration exponential with the class's mean.
    """
    faults = []
    for kind in FAILURES:
        count = int(rng.poisson(kind.per_satellite_hour * scale * satellites * span_s / 3600.0))
        for _ in range(count):
            satellite = int(rng.integers(satellites))
            size = float(rng.uniform(kind.size_min, kind.size_max)) * (1.0 if rng.random() < 0.5 else -1.0)
            vector = [0.0] * 4
            vector[int(rng.integers(4))] = size
            faults.append(
                Fault(
                    (satellite,),
                    jump_m=(0.0,) * 4 if kind.ramp else (vector[0], vector[1], vector[2], vector[3]),
                    ramp_mps=(vector[0], vector[1], vector[2], vector[3]) if kind.ramp else (0.0,) * 4,
                    onset_s=float(rng.uniform(0.0, span_s)),
                    duration_s=float(rng.exponential(kind.mean_duration_h * 3600.0)),
                )
            )
    return sorted(faults, key=lambda fault: fault.onset_s)
