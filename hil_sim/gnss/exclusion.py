"""Receiver autonomous integrity: does an epoch contradict itself, and without which satellites does it not?

The weighted sum of squared residuals is chi-square with n - 4 degrees of freedom when all is well (Parkinson and
Axelrad 1988). Where it is too large, the fewest satellites are left out whose absence makes the rest consistent, and of
those choices the one that fits best; to leave out the largest residual again and again would hide faults behind each
other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from hil_sim.gnss.least_squares import UNKNOWNS, Fit

FALSE_ALARM = 1e-3
MOST_EXCLUDED = 2

Solve = Callable[[np.ndarray, np.ndarray], Fit]  # rows (m,) of the epochs, sigma (m,k) with inf for what is left out


class Verdict(IntEnum):
    """What became of an epoch."""

    GOOD = 0
    TOO_FEW = 1  # satellites for a solution
    UNCHECKED = 2  # as many satellites as unknowns: nothing can contradict
    INCONSISTENT = 3  # and no exclusion helps, or too few satellites are left to tell


class Checked(NamedTuple):
    """Solutions after exclusion: the fit of m epochs, verdict (m,), used (m,k) bool, excluded (m,k) bool."""

    fit: Fit
    verdict: np.ndarray
    used: np.ndarray
    excluded: np.ndarray


def check(solve: Solve, sigma_m: np.ndarray) -> Checked:
    """Solve all epochs, test them, leave satellites out where they fail. sigma_m (m,k): inf for an empty place."""
    fit = solve(np.arange(len(sigma_m)), sigma_m)
    excluded = np.zeros(sigma_m.shape, dtype=bool)
    verdict = np.where(fit.freedom < 0, Verdict.TOO_FEW, np.where(fit.freedom == 0, Verdict.UNCHECKED, Verdict.GOOD))
    verdict = np.where((fit.freedom >= 0) & np.isnan(fit.statistic), Verdict.TOO_FEW, verdict)
    suspect = np.flatnonzero((verdict == Verdict.GOOD) & (fit.statistic > thresholds(fit.freedom)))
    verdict[suspect] = Verdict.INCONSISTENT
    for row in suspect.tolist():
        found = _exclude(solve, row, sigma_m[row])
        if found is not None:
            excluded[row, list(found[0])] = True
            verdict[row] = Verdict.GOOD
            for whole, part in zip(fit, found[1], strict=True):
                whole[row] = part[found[2]]
    return Checked(fit, verdict, np.isfinite(sigma_m) & ~excluded, excluded)


def _exclude(solve: Solve, row: int, sigma_m: np.ndarray) -> tuple[tuple[int, ...], Fit, int] | None:
    """The fewest satellites without which the epoch is consistent, and the fit in which row it is then; or None."""
    there = np.flatnonzero(np.isfinite(sigma_m)).tolist()
    for count in range(1, MOST_EXCLUDED + 1):
        if len(there) - count <= UNKNOWNS:  # nothing would be left to test the rest with
            return None
        choices = list(combinations(there, count))
        trials = np.repeat(sigma_m[None, :], len(choices), axis=0)
        for trial, choice in zip(trials, choices, strict=True):
            trial[list(choice)] = np.inf
        fit = solve(np.full(len(choices), row), trials)
        best = int(np.argmin(np.nan_to_num(fit.statistic, nan=np.inf)))
        if fit.statistic[best] <= chi_square_threshold(int(fit.freedom[best])):
            return choices[best], fit, best
    return None


def thresholds(freedom: np.ndarray) -> np.ndarray:
    """Largest statistic (m,) that is still believed; inf where nothing can be tested."""
    return np.array([chi_square_threshold(int(n)) if n > 0 else math.inf for n in freedom])


@lru_cache(maxsize=64)
def chi_square_threshold(freedom: int, probability: float = FALSE_ALARM) -> float:
    """The value that chi-square with so many degrees of freedom exceeds with this probability."""
    low, high = 0.0, 10.0 * (freedom + 20)
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _upper_tail(middle, freedom) > probability else (low, middle)
    return 0.5 * (low + high)


def _upper_tail(x: float, freedom: int) -> float:
    """P(chi-square > x), Abramowitz and Stegun 26.4.4 and 26.4.5."""
    odd = freedom % 2 == 1
    tail = math.erfc(math.sqrt(x / 2.0)) if odd else 0.0
    term = math.exp(-x / 2.0) * (math.sqrt(2.0 * x / math.pi) if odd else 1.0)
    for r in range(freedom // 2):
        tail += term
        term *= x / (2 * r + (3 if odd else 2))
    return tail
