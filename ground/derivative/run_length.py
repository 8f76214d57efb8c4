"""Mean time between false alarms of a multivariate CUSUM of three axes, exactly, and the threshold for a wanted one.

Under no fault the length of Crosier's sum is a Markov chain by itself: |S + u| depends on S through its length alone,
u being white with unit covariance (G. C. Runger, S. S. Prabhu, JASA 91 (1996) 1701). In three dimensions its density
given |S| = s is (r / s) (phi(r - s) - phi(r + s)); the mean run length solves a Fredholm equation, by Gauss-Legendre.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

_NODES = 400  # a fifth of the unit width of a step at a threshold of 80
_NEAR = 1e-6


def _phi(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi))


def _below(x: np.ndarray) -> np.ndarray:
    return np.array([0.5 * math.erfc(-value / math.sqrt(2.0)) for value in x.ravel()]).reshape(x.shape)


@lru_cache(maxsize=1)
def _rule() -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    return nodes, weights


def mean_run_length(reference: float, threshold: float) -> float:
    """Mean number of epochs until a false alarm, from a sum of zero."""
    nodes, weights = _rule()
    x, w = 0.5 * threshold * (nodes + 1.0), 0.5 * threshold * weights
    s = np.concatenate(([0.0], x))
    far = np.maximum(s, _NEAR)[:, None]
    r = x[None, :] + reference
    density = np.where(s[:, None] > _NEAR, r / far * (_phi(r - far) - _phi(r + far)), 2.0 * r * r * _phi(r))
    k = np.full_like(s, reference)
    zero = _below(k - s) + _below(k + s) - 1.0 - (_phi(k - s) - _phi(k + s)) / far[:, 0]
    zero[0] = 2.0 * _below(k[:1])[0] - 1.0 - 2.0 * reference * _phi(k[:1])[0]
    kernel = np.column_stack([zero, density * w])
    return float(np.linalg.solve(np.eye(len(s)) - kernel, np.ones(len(s)))[0])


def threshold_for(reference: float, epochs: float) -> float:
    """Threshold whose mean run length is so many epochs, to 1e-4; ValueError for a rate that none has."""
    low, high = 1.0, 1.0
    while mean_run_length(reference, high) < epochs:
        high *= 1.5
        if high > 400.0:
            raise ValueError(f"no threshold gives {epochs:g} epochs between alarms at a reference of {reference:g}")
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if mean_run_length(reference, middle) < epochs else (low, middle)
    return high
