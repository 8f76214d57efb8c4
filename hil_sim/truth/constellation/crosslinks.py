"""Who can range to whom, and what the receivers measure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hil_sim.truth.constellation.orbits import Constellation

LIGHT_MPS = 299_792_458.0
EARTH_RADIUS_M = 6_378_137.0


@dataclass(frozen=True)
class View:
    """Limits of a link: central angle of the two satellites, height of the ray over the Earth, field of both antennas.

    The field is the angle between the ray and the direction to the Earth's centre, from `off_nadir_min_deg` to
    `off_nadir_max_deg`. On one circular shell it is 90 degrees less half the central angle.
    """

    central_angle_max_deg: float = 86.0
    ray_height_min_m: float = 100_000.0
    off_nadir_min_deg: float = 0.0
    off_nadir_max_deg: float = 90.0

    def pairs(self, r_m: np.ndarray) -> np.ndarray:
        """Visibility (n,n) bool of satellites at r (n,3) [m]: symmetric, nobody sees itself or an unknown position."""
        radius = np.linalg.norm(r_m, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            cosine = np.clip((r_m @ r_m.T) / (radius[:, None] * radius[None, :]), -1.0, 1.0)
            central = np.arccos(cosine)
            between = r_m[None, :, :] - r_m[:, None, :]
            length = np.linalg.norm(between, axis=2)
            down = -np.einsum("ijk,ik->ij", between, r_m) / (length * radius[:, None])
            off_nadir = np.degrees(np.arccos(np.clip(down, -1.0, 1.0)))
            # the ray is lowest at an end, or between them if both ends look below their local horizon
            lowest = np.where((down > 0.0) & (down.T > 0.0), radius[:, None] * np.sin(np.radians(off_nadir)), np.inf)
            seen = (
                (central < math.radians(self.central_angle_max_deg))
                & (np.minimum(lowest, lowest.T) > EARTH_RADIUS_M + self.ray_height_min_m)
                & (off_nadir >= self.off_nadir_min_deg)
                & (off_nadir <= self.off_nadir_max_deg)
            )
        seen &= seen.T
        np.fill_diagonal(seen, False)
        return seen


def one_way_m(constellation: Constellation, t_s: float, receiver: int, sender: int) -> float:
    """Distance [m] that a signal received at t has come: from where the sender was when it sent."""
    return float(flight_m(constellation, t_s)[receiver, sender])


def flight_m(constellation: Constellation, t_s: float) -> np.ndarray:
    """Distances (n,n) [m] of signals received at t by the row's satellite, sent by the column's.

    The sender's motion within the flight time is expanded to the third order: 0.1 s at 0.6 m/s2 and its rate, exact to
    a micrometre. tests/unit/test_constellation.py iterates the flight time on the orbit itself instead.
    """
    n = len(constellation.names)
    receiver, sender = np.divmod(np.arange(n * n), n)
    return _flight_of_pairs(constellation, t_s, receiver, sender).reshape(n, n)


def _flight_of_pairs(constellation: Constellation, t_s: float, receiver: np.ndarray, sender: np.ndarray) -> np.ndarray:
    """The same (m,) [m] of these pairs alone."""
    r, v = constellation.states(t_s)
    radius = np.linalg.norm(r, axis=1, keepdims=True)
    a = -3.986004418e14 * r / radius**3
    jerk = -3.986004418e14 * (v / radius**3 - 3.0 * r * np.einsum("ij,ij->i", r, v)[:, None] / radius**5)
    here, there, speed = r[receiver], r[sender], v[sender]
    half, sixth = 0.5 * a[sender], jerk[sender] / 6.0
    tau = np.zeros((len(here), 1))
    for _ in range(4):
        gap = here - (there - tau * (speed - tau * (half - tau * sixth)))
        distance = np.sqrt(np.einsum("ij,ij->i", gap, gap))
        tau = (distance / LIGHT_MPS)[:, None]
    return distance


@dataclass(frozen=True)
class Ranging:
    """What ranging adds: noise and bias of every link, links that drop out, one or two ways."""

    sigma_m: float = 11.8
    bias_m: float = 0.0
    dropout: float = 0.0
    two_way: bool = False

    def measure(
        self,
        constellation: Constellation,
        t_s: float,
        pairs: np.ndarray,
        clock_m: np.ndarray,
        rng: np.random.Generator,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pairs (m,2) that were measured, of (receiver, sender), and their ranges (m,) [m].

        pairs (k,2): those in view. clock_m (n,): true clocks minus system time, as range; they drop out of two ways.
        The same number of random numbers is drawn whatever drops out.
        """
        i, j = pairs[:, 0], pairs[:, 1]
        true = _flight_of_pairs(constellation, t_s, i, j)
        if self.two_way:
            true = 0.5 * (true + _flight_of_pairs(constellation, t_s, j, i))
        else:
            true += clock_m[i] - clock_m[j]
        noise = rng.standard_normal(len(pairs))
        lost = rng.random(len(pairs)) < self.dropout
        return pairs[~lost], (true + self.bias_m + self.sigma_m * noise)[~lost]


def once(seen: np.ndarray) -> np.ndarray:
    """Pairs (m,2) of a visibility, each once; the satellite with the lower number receives."""
    return np.argwhere(np.triu(seen, 1))


def both(seen: np.ndarray) -> np.ndarray:
    """Pairs (m,2) of a visibility, each in both directions."""
    return np.argwhere(seen)
