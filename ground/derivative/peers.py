"""What others would do with the same positions: a local polynomial, and pynumdiff where it is installed.

Both look ahead and know the noise; their parameters are the best of a grid on a track of the tuning branch, which is
more than a user could do.
"""

from __future__ import annotations

import importlib
import importlib.util
from functools import lru_cache
from typing import Any

import numpy as np

from ground.derivative import scenario
from ground.derivative.tuning import LAG_S, SMOOTHED_LIMITS

ABSENT = "pynumdiff is not installed: it is left out (pip install pynumdiff, and run again in another folder)"
_GRID_S = (4.0, 6.0, 8.0, 10.0, 14.0, 18.0, 22.0, 26.0, 30.0)  # half windows
_RATIOS = tuple(range(-16, 3))  # log10 q / r of pynumdiff


def has_pynumdiff() -> bool:
    """Whether it can be imported."""
    return importlib.util.find_spec("pynumdiff") is not None


def savitzky_golay(z: np.ndarray, step_s: float, half: int, degree: int = 4) -> np.ndarray:
    """Estimates (m, 3) from a polynomial fitted to 2 half + 1 positions around each; NaN at the ends.

    A. Savitzky, M. J. E. Golay, Analytical Chemistry 36 (1964) 1627.
    """
    rows = np.linalg.pinv((np.arange(-half, half + 1) / half)[:, None] ** np.arange(degree + 1))[:3]
    answer = np.full((len(z), 3), np.nan)
    for k, factor in enumerate((1.0, 1.0, 2.0)):
        fitted = np.convolve(z, rows[k][::-1], mode="valid") * factor / (half * step_s) ** k
        answer[half : len(z) - half, k] = fitted
    return answer


def pynumdiff_velocity(z: np.ndarray, step_s: float, log_ratio: int) -> np.ndarray:
    """Estimates (m, 3) of pynumdiff's constant-jerk smoother over the whole record; it gives no acceleration."""
    smooth: Any = importlib.import_module("pynumdiff.kalman_smooth")
    position, velocity = smooth.rtsdiff(z, step_s, 3, log_ratio, True)
    return np.column_stack([position, velocity, np.full(len(z), np.nan)])


def _worst(estimate: np.ndarray, columns: int) -> float:
    found = scenario.judge(estimate, LAG_S)
    return float(max(np.divide(found[:columns], SMOOTHED_LIMITS[:columns])))


@lru_cache(maxsize=2)
def best_half(seed: int) -> int:
    """Half window [epochs] that does best on a tuning track."""
    true = scenario.truth()
    z = true.y_m + scenario.errors(scenario.tuning_stream(seed, 0), len(true.t_s))
    halves = [round(half_s / scenario.STEP_S) for half_s in _GRID_S]
    return min(halves, key=lambda half: _worst(savitzky_golay(z, scenario.STEP_S, half), 4))


@lru_cache(maxsize=2)
def best_ratio(seed: int) -> int:
    """log10 q / r with which pynumdiff does best on a tuning track."""
    true = scenario.truth()
    z = true.y_m + scenario.errors(scenario.tuning_stream(seed, 0), len(true.t_s))
    return min(_RATIOS, key=lambda ratio: _worst(pynumdiff_velocity(z, scenario.STEP_S, ratio), 2))
