"""Axes that go with the satellite: radial, along-track, cross-track (RTN), and the angle along its orbit."""

from __future__ import annotations

import numpy as np

_NODE_MINIMUM = 1e-9  # sine of the inclination below which the ascending node is undefined


def rtn_axes(r_gcrf_m: np.ndarray, v_gcrf_mps: np.ndarray) -> np.ndarray:
    """Matrices (n,3,3) GCRF -> RTN of positions and velocities (n,3); rows: radial, along-track, cross-track.

    Cross-track is along r x v, along-track completes (CCSDS 500.0-G-4, RTN).
    """
    radial = r_gcrf_m / np.linalg.norm(r_gcrf_m, axis=1, keepdims=True)
    normal = np.cross(r_gcrf_m, v_gcrf_mps)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack((radial, np.cross(normal, radial), normal), axis=1)


def argument_of_latitude(r_gcrf_m: np.ndarray, v_gcrf_mps: np.ndarray) -> np.ndarray:
    """Angle (n,) [rad], -pi to pi, from the ascending node to the satellite in its osculating plane.

    Over the equator, where there is no node, from the GCRF x axis.
    """
    normal = np.cross(r_gcrf_m, v_gcrf_mps)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    node = np.stack((-normal[:, 1], normal[:, 0], np.zeros(len(normal))), axis=1)  # z x normal
    length = np.linalg.norm(node, axis=1)
    equatorial = length < _NODE_MINIMUM
    node[equatorial] = (1.0, 0.0, 0.0)
    node /= np.where(equatorial, 1.0, length)[:, None]
    ahead = np.cross(normal, node)
    return np.arctan2(np.einsum("ni,ni->n", r_gcrf_m, ahead), np.einsum("ni,ni->n", r_gcrf_m, node))
