"""Position and clock from ranges to satellites at known places, for many epochs at once: weighted least squares.

Gauss-Newton from anywhere near the Earth (Misra and Enge 2011, section 6.1); the Earth turns under the signal in flight
(section 4.5.3, Sagnac). The same lines solve differences of ranges over time for a displacement.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hil_sim.gnss.precise_ephemeris import LIGHT_MPS
from hil_sim.truth.earth_rotation import OMEGA_RADPS

UNKNOWNS = 4  # position and clock
_ITERATIONS = 10
_SETTLED_M = 1e-4


class Fit(NamedTuple):
    """Solutions of m epochs over k places for satellites. NaN where there are fewer than UNKNOWNS satellites.

    x (m,4): position [m] or displacement in ITRF, and clock as range [m]. covariance (m,4,4) [m2]: of the given sigmas.
    residual (m,k) [m]. design (m,k,4). statistic (m,): sum of squared residuals over sigma. freedom (m,): satellites
    minus UNKNOWNS.
    """

    x: np.ndarray
    covariance_m2: np.ndarray
    residual_m: np.ndarray
    design: np.ndarray
    statistic: np.ndarray
    freedom: np.ndarray


def turned_in_flight(satellite_m: np.ndarray, distance_m: np.ndarray) -> np.ndarray:
    """Satellites (..., 3), ITRF at transmission, in ITRF at reception: the Earth has turned by omega distance / c."""
    angle = OMEGA_RADPS / LIGHT_MPS * distance_m
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = satellite_m[..., 0], satellite_m[..., 1], satellite_m[..., 2]
    return np.stack((c * x + s * y, c * y - s * x, z), axis=-1)


def geometry(satellite_m: np.ndarray, r_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (m,k) [m] and unit vectors from satellites to receivers (m,k,3); r_m (m,3) at reception."""
    here = r_m[:, None, :]
    distance = np.linalg.norm(satellite_m - here, axis=2)
    turned = turned_in_flight(satellite_m, distance)
    line = here - turned
    distance = np.linalg.norm(line, axis=2)
    return distance, line / distance[..., None]


def solve_positions(satellite_m: np.ndarray, range_m: np.ndarray, sigma_m: np.ndarray) -> Fit:
    """Position and clock of each epoch.

    satellite_m (m,k,3): ITRF at transmission. range_m (m,k): pseudorange plus satellite clock. sigma_m (m,k): 1-sigma
    of a range, inf for a place that is empty or left out; what stands there is not looked at.
    """
    used = np.isfinite(sigma_m)
    satellite = np.where(used[..., None], satellite_m, np.array([4.2e7, 0.0, 0.0]))
    measured = np.where(used, range_m, 0.0)
    x = np.zeros((len(range_m), UNKNOWNS))
    x[:, 0] = 1.0
    for _ in range(_ITERATIONS):
        distance, line = geometry(satellite, x[:, :3])
        fit = _normal(line, np.where(used, measured - distance - x[:, 3:], 0.0), sigma_m)
        x += np.nan_to_num(fit.x)
        if np.nanmax(np.abs(fit.x), initial=0.0) < _SETTLED_M:
            break
    distance, line = geometry(satellite, x[:, :3])
    fit = _normal(line, np.where(used, measured - distance - x[:, 3:], 0.0), sigma_m)
    return fit._replace(x=x + fit.x)


def solve_displacements(line: np.ndarray, difference_m: np.ndarray, sigma_m: np.ndarray) -> Fit:
    """Small displacement and change of clock (m,4) from what ranges have changed by beyond the expected, (m,k) [m]."""
    used = np.isfinite(sigma_m)
    return _normal(np.where(used[..., None], line, 0.0), np.where(used, difference_m, 0.0), sigma_m)


def _normal(line: np.ndarray, difference_m: np.ndarray, sigma_m: np.ndarray) -> Fit:
    """One linear weighted least-squares solution of every epoch."""
    weight = 1.0 / sigma_m**2  # zero for inf
    design = np.concatenate((line, np.ones((*line.shape[:2], 1))), axis=2)
    scaled = design / sigma_m[..., None]
    count = np.isfinite(sigma_m).sum(axis=1)
    enough = count >= UNKNOWNS
    matrix = np.where(enough[:, None, None], np.einsum("mki,mkj->mij", scaled, scaled), np.eye(UNKNOWNS))
    # satellites in one plane: no solution either
    singular = np.linalg.cond(matrix) > 1e13
    matrix = np.where(singular[:, None, None], np.eye(UNKNOWNS), matrix)
    covariance = np.linalg.solve(matrix, np.broadcast_to(np.eye(UNKNOWNS), matrix.shape))
    x = np.einsum("mij,mkj,mk,mk->mi", covariance, design, weight, difference_m)
    residual = difference_m - np.einsum("mkj,mj->mk", design, x)
    bad = ~enough | singular
    x[bad], covariance[bad] = np.nan, np.nan
    statistic = np.where(bad, np.nan, np.sum(residual**2 * weight, axis=1))
    return Fit(x, covariance, residual, design, statistic, count - UNKNOWNS)
