"""What others would do with the same positions: a local polynomial, and pynumdiff where an interpreter has it.

All look ahead; their parameters are the best of a grid on a track of the tuning branch whose truth is known, which is
more than a user could do. pynumdiff's acceleration is the difference quotient of its velocity.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ground.derivative import scenario
from ground.derivative.tuning import LAG_S, SMOOTHED_LIMITS
from ground.peers import interpreter

ABSENT = f"pynumdiff was not asked: name an interpreter that has it with --peer-python ({interpreter.HOW})"
SCRIPT = "pynumdiff_tracks.py"
METHODS = {"pynumdiff_rts": "rts", "pynumdiff_savgol": "savgol"}
_GRID_S = (4.0, 6.0, 8.0, 10.0, 14.0, 18.0, 22.0, 26.0, 30.0)  # half windows


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


class Pynumdiff(NamedTuple):
    """Figures (runs, 6) by name, the parameters chosen, the version."""

    figures: dict[str, np.ndarray]
    words: dict[str, str]
    version: str


def pynumdiff(python: Path, seed: int, z_m: np.ndarray) -> Pynumdiff:
    """pynumdiff's smoothers over positions (runs, m) of the scenario. Raises OperatorError where it cannot be asked."""
    true = scenario.truth(LAG_S)
    tune = true.y_m + scenario.errors(scenario.tuning_stream(seed, 0), len(true.t_s))
    answer = interpreter.ask(
        python,
        SCRIPT,
        tune_m=tune,
        truth_mps=true.v_mps,
        counted=np.array([true.straight, true.yawing]),
        z_m=z_m,
        step_s=np.array(scenario.STEP_S),
    )
    figures = {
        name: np.array(
            [scenario.judge(np.column_stack((z, track)), LAG_S) for z, track in zip(z_m, answer[of], strict=True)]
        )
        for name, of in METHODS.items()
    }
    return Pynumdiff(
        figures, {name: str(answer[of + "_words"]) for name, of in METHODS.items()}, str(answer["version"])
    )
