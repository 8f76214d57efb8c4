"""What tightness is possible at all: errors drawn from a covariance that is known perfectly.

Even then k = 3 is broken in more than 0.3 % of outages, since an outage has many epochs and three axes. The factor that
breaks no more than that, and what it leaves at a single age, is the floor beside which a measured tightness is judged.
Motion about a circular orbit (Clohessy and Wiltshire, J. Aerospace Sciences 27, 1960), Gauss-Markov accelerations.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ground.campaign.statistics import CONTENT, quantile

MU_M3PS2 = 3.986004415e14
_STEP_S = 10.0
_SIGMA_MPS2, _TAU_S = 5e-8, 600.0
_FIX_M, _FIX_MPS = 10.0, 0.1
_SAMPLES = 6000
_SEED = 20_260_101  # the floor is a number, not an experiment


class Floor(NamedTuple):
    """k: sigmas that hold over whole outages; ages_s (m,), tightness (m,) that this k leaves at each age."""

    k: float
    ages_s: np.ndarray
    tightness: np.ndarray

    def over(self, low_s: float, high_s: float) -> float:
        """Mean tightness of the ages in [low, high)."""
        inside = (self.ages_s >= low_s) & (self.ages_s < high_s)
        return float(self.tightness[inside].mean()) if inside.any() else math.nan


@lru_cache(maxsize=8)
def floor(altitude_km: float, outage_s: float, acquisition_s: float = 5400.0) -> Floor:
    """The floor for a circular orbit of that altitude, after fixes of 10 m and 0.1 m/s every ten seconds."""
    rate = math.sqrt(MU_M3PS2 / (6_378_137.0 + 1e3 * altitude_km) ** 3)
    transition, noise = _model(rate)
    p = np.diag([1e4] * 3 + [1.0] * 3 + [_SIGMA_MPS2**2] * 3)
    r = np.diag([_FIX_M**2] * 3 + [_FIX_MPS**2] * 3)
    for _ in range(round(acquisition_s / _STEP_S)):
        p = transition @ p @ transition.T + noise
        gain = np.linalg.solve(p[:6, :6] + r, p[:6]).T
        p = p - gain @ p[:6]
        p = 0.5 * (p + p.T)
    rng = np.random.default_rng(_SEED)
    x = _drawn(rng, p)
    pushes = np.linalg.cholesky(noise + 1e-30 * np.eye(9))
    # a random attitude of the orbit for each sample: axes of GCRF are not those of the orbit
    axes, _ = np.linalg.qr(rng.standard_normal((_SAMPLES, 3, 3)))
    ages = np.arange(1, round(outage_s / _STEP_S) + 1) * _STEP_S
    ratio = np.empty((len(ages), _SAMPLES))
    for k, age in enumerate(ages):
        x = x @ transition.T + rng.standard_normal((_SAMPLES, 9)) @ pushes.T
        p = transition @ p @ transition.T + noise
        c, s = math.cos(rate * age), math.sin(rate * age)
        to_inertial = axes @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        error = np.abs(to_inertial @ x[:, :3, None])[..., 0].max(axis=1)
        variance = np.sum((to_inertial @ p[:3, :3]) * to_inertial, axis=2)
        ratio[k] = error / np.sqrt(variance.max(axis=1))
    needed = quantile(ratio.max(axis=0))
    return Floor(needed, ages, np.array([needed / quantile(row, CONTENT) for row in ratio]))


def _drawn(rng: np.random.Generator, p: np.ndarray) -> np.ndarray:
    sigma = np.sqrt(np.diag(p))
    lower = np.linalg.cholesky(p / np.outer(sigma, sigma) + 1e-12 * np.eye(9))
    return rng.standard_normal((_SAMPLES, 9)) @ lower.T * sigma


def _model(rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and process noise (9,9) over a step: radial, along-track, cross-track; r, v, accelerations.

    Both from the matrix exponential of Van Loan (IEEE Trans. Automatic Control 23, 1978), summed as a series.
    """
    a = np.zeros((9, 9))
    a[:3, 3:6] = np.eye(3)
    a[3, 0], a[3, 4], a[4, 3], a[5, 2] = 3.0 * rate**2, 2.0 * rate, -2.0 * rate, -(rate**2)
    a[3:6, 6:9] = np.eye(3)
    a[6:9, 6:9] = -np.eye(3) / _TAU_S
    q = np.zeros((9, 9))
    q[6:9, 6:9] = np.eye(3) * 2.0 * _SIGMA_MPS2**2 / _TAU_S
    block = np.zeros((18, 18))
    block[:9, :9], block[:9, 9:], block[9:, 9:] = -a, q, a.T
    term, total = np.eye(18), np.eye(18)
    for k in range(1, 30):
        term = term @ block * (_STEP_S / k)
        total += term
    transition = total[9:, 9:].T
    noise = transition @ total[:9, 9:]
    return transition, 0.5 * (noise + noise.T)
