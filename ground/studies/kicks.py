"""What a burn adds to a known motion: Encke's method along the true orbit, real or simulated.

The difference d to the orbit obeys d'' = g(r + d) - g(r) + thrust; of g the central field and J2 (Vallado, Fundamentals
of Astrodynamics and Applications, 4th ed., 8.3). What is left out, higher harmonics and drag, acts on the difference
alone: against satkit 2e-5 of it after 1000 s, 1e-4 after 2000 s; of a burn of 1 m/s, 2 cm and 10 cm. No line of it is
shared with flight.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ground.studies.arcs import Track

MU_M3PS2 = 3.986004415e14
J2 = 1.0826261738522e-3
RADIUS_M = 6378136.3


class Burn(NamedTuple):
    """Constant acceleration dv / duration along RTN from a second of the track on; whole seconds."""

    start_s: int
    duration_s: int
    dv_rtn_mps: np.ndarray


def kicked(track: Track, burns: list[Burn]) -> list[Track]:
    """The track as it would have been with each of these burns."""
    n, k = len(track.r_m), len(burns)
    dr, dv = np.zeros((n, k, 3)), np.zeros((n, k, 3))
    first = min(burn.start_s for burn in burns)
    for second in range(first, n - 1):
        r, v = _between(track, second)
        acting = np.array([burn.start_s <= second < burn.start_s + burn.duration_s for burn in burns], dtype=float)
        thrust = np.array([burn.dv_rtn_mps for burn in burns]) * acting[:, None]
        thrust /= np.array([burn.duration_s for burn in burns], dtype=float)[:, None]
        dr[second + 1], dv[second + 1] = _step(r, v, dr[second], dv[second], thrust)
    return [track.moved(dr[:, at], dv[:, at]) for at in range(k)]


def _between(track: Track, second: int) -> tuple[np.ndarray, np.ndarray]:
    """Reference r, v (3, 3) at the start, the middle and the end of a second; cubic Hermite, to 1e-7 m."""
    r0, r1 = track.r_m[second : second + 2]
    v0, v1 = track.v_mps[second : second + 2]
    middle_r = 0.5 * (r0 + r1) + 0.125 * (v0 - v1)
    middle_v = 1.5 * (r1 - r0) - 0.25 * (v0 + v1)
    return np.stack((r0, middle_r, r1)), np.stack((v0, middle_v, v1))


def _step(
    r: np.ndarray, v: np.ndarray, dr: np.ndarray, dv: np.ndarray, thrust: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Classical Runge-Kutta over a second of differences (k, 3)."""

    def rate(at: int, d: np.ndarray, w: np.ndarray) -> np.ndarray:
        there = r[at] + d
        out = gravity_mps2(there) - gravity_mps2(r[at][None])
        if thrust.any():
            out = out + np.einsum("ki,kij->kj", thrust, _axes(there, v[at] + w))
        return out

    a1 = rate(0, dr, dv)
    a2 = rate(1, dr + 0.5 * dv, dv + 0.5 * a1)
    a3 = rate(1, dr + 0.5 * dv + 0.25 * a1, dv + 0.5 * a2)
    a4 = rate(2, dr + dv + 0.5 * a2, dv + a3)
    return dr + dv + (a1 + a2 + a3) / 6.0, dv + (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0


def gravity_mps2(r_m: np.ndarray) -> np.ndarray:
    """Central field and J2 (k, 3); the pole of GCRF stands for the Earth's (Vallado, 8.6)."""
    radius2 = np.sum(r_m * r_m, axis=1, keepdims=True)
    z2 = r_m[:, 2:] ** 2 / radius2
    factor = 1.5 * J2 * RADIUS_M**2 / radius2
    scale = np.concatenate((1.0 + factor * (1.0 - 5.0 * z2),) * 2 + (1.0 + factor * (3.0 - 5.0 * z2),), axis=1)
    out: np.ndarray = -MU_M3PS2 * r_m / radius2**1.5 * scale
    return out


def _axes(r_m: np.ndarray, v_mps: np.ndarray) -> np.ndarray:
    """Rows radial, along-track, cross-track (k, 3, 3)."""
    radial = r_m / np.linalg.norm(r_m, axis=1, keepdims=True)
    normal = np.cross(r_m, v_mps)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack((radial, np.cross(normal, radial), normal), axis=1)
