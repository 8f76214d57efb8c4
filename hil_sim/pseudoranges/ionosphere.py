"""The ionosphere above a receiver in low orbit, on one frequency: a thin shell, thicker where it is afternoon.

The vertical delay is a constant and a bulge by day that stands 30 degrees east of the Sun (two in the afternoon) and
goes with the cosine of the angle from there to where a ray meets the shell. Nothing is shared with flight's model.
"""

from __future__ import annotations

import math

import erfa
import numpy as np

from hil_sim.gps_time import tt_two_part

SHELL_M = 350_000.0  # above the receiver: half of the electrons are below, for the slant of a ray
_LATE_RAD = math.radians(30.0)
# delay at the first civil frequency over that at 1575.42 MHz: GPS, GLONASS, Galileo, BeiDou
_DISPERSION = (1575.42 / np.array([1575.42, 1602.0, 1575.42, 1561.098])) ** 2


def delay_m(
    constant_m: float,
    day_m: float,
    system: np.ndarray,
    t_gps_ns: np.ndarray,
    antenna_m: np.ndarray,
    ray: np.ndarray,
    elevation: np.ndarray,
) -> np.ndarray:
    """Delays (n,s) [m] of rays (n,s,3), unit vectors in GCRF, at elevations (n,s) from antennas (n,3) at t_gps_ns (n,).

    constant_m, day_m: vertical delays above the receiver at 1575.42 MHz, always and at the bulge's middle.
    """
    radius = np.linalg.norm(antenna_m, axis=1)[:, None]
    vertical_m = np.full(elevation.shape, constant_m)
    if day_m:
        up = np.sin(elevation)
        way_m = -radius * up + np.sqrt(np.maximum((radius + SHELL_M) ** 2 - radius**2 * (1.0 - up * up), 0.0))
        there = antenna_m[:, None, :] + way_m[..., None] * ray
        there /= np.linalg.norm(there, axis=2)[..., None]
        vertical_m = vertical_m + day_m * np.maximum(np.einsum("nsk,nk->ns", there, bulge(t_gps_ns)), 0.0)
    return _DISPERSION[system] * vertical_m * slant(elevation, radius)


def bulge(t_gps_ns: np.ndarray) -> np.ndarray:
    """Directions (n,3) in GCRF of the middle of the bulge."""
    earth = erfa.epv00(*tt_two_part(t_gps_ns))[0]["p"]
    sun = -earth / np.linalg.norm(earth, axis=1)[:, None]
    c, s = math.cos(_LATE_RAD), math.sin(_LATE_RAD)
    return np.stack((c * sun[:, 0] - s * sun[:, 1], s * sun[:, 0] + c * sun[:, 1], sun[:, 2]), axis=1)


def slant(elevation: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Way through the shell, by that upwards (obliquity of Klobuchar's model)."""
    sine = radius / (radius + SHELL_M) * np.cos(np.maximum(elevation, 0.0))
    return np.asarray(1.0 / np.sqrt(1.0 - sine * sine))
