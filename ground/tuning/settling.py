"""Where the bound of (17) settles: the fixed point of its Riccati recursion, by doubling.

A search that may not end below twice the limit has to know how far from there it is; the saturation linter only says
yes or no. On a circular orbit, in axes that turn with it, the recursion has constant coefficients.

Source: Chu, Fan, Lin, Wang, International Journal of Control 77 (2004): structure-preserving doubling.
"""

from __future__ import annotations

import math

import numpy as np

_RADIUS_M, _MU_M3PS2 = 6.878e6, 3.986004415e14
_RATE_RADPS = math.sqrt(_MU_M3PS2 / _RADIUS_M**3)
_SCALE = np.repeat((1e3, 1.0, 1e-3), 3)  # of positions, velocities, accelerations, so that numbers are near one
_DOUBLINGS = 40


def settled_m(row: np.ndarray, dt_s: float, runge_kutta: bool, k_axis: float) -> float:
    """The bound [m] over the worst direction at which (17) with this row (5,) settles; NaN where it is not found."""
    a = _transition(dt_s, runge_kutta).T * _SCALE[:, None] / _SCALE
    x = np.diag(np.repeat(row[:3], 3) / _SCALE**2)
    information = np.diag([row[3] ** -2] * 3 + [row[4] ** -2] * 3 + [0.0] * 3) * _SCALE[:, None] * _SCALE
    g, one = information, np.eye(9)
    for _ in range(_DOUBLINGS):
        try:
            w = np.linalg.solve(one + g @ x, np.hstack((a, g)))
        except np.linalg.LinAlgError:
            return math.nan
        more = a.T @ x @ w[:, :9]
        g = g + a @ w[:, 9:] @ a.T
        x, a = x + 0.5 * (more + more.T), a @ w[:, :9]
        if not np.isfinite(x).all():
            return math.nan
        if np.abs(more).max() < 1e-9 * np.abs(x).max():
            break
    p = np.linalg.solve(one + x @ information, x)[:3, :3] * _SCALE[:3, None] * _SCALE[:3]
    return k_axis * math.sqrt(max(float(np.linalg.eigvalsh(0.5 * (p + p.T))[-1]), 0.0))


def _transition(dt_s: float, runge_kutta: bool) -> np.ndarray:
    """The filter's Phi (9, 9) over a step, its result in the axes of the orbit at the end of the step."""
    pull = _RATE_RADPS**2 * np.diag([2.0, -1.0, -1.0])
    second = 0.5 * dt_s**2 if runge_kutta else 0.0
    phi = np.eye(9)
    phi[0:3, 0:3] += second * pull
    phi[3:6, 3:6] += second * pull
    phi[0:3, 3:6] = phi[3:6, 6:9] = dt_s * np.eye(3)
    phi[0:3, 6:9] = second * np.eye(3)
    phi[3:6, 0:3] = dt_s * pull
    c, s = math.cos(_RATE_RADPS * dt_s), math.sin(_RATE_RADPS * dt_s)
    return np.kron(np.eye(3), np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])) @ phi
