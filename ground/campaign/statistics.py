"""Statistics of rare events: what a count of failures proves, and quantiles of what was flown.

Clopper and Pearson, Biometrika 26 (1934): exact for the binomial distribution, whatever the rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

CONFIDENCE = 0.95
CONTENT = 0.997  # of 3 sigma, the paper's frequency
_TOLERANCE = 1e-15


def _tail(failures: int, trials: int, rate: float) -> float:
    """Probability of at most so many failures."""
    if rate <= 0.0:
        return 1.0
    if rate >= 1.0:
        return 1.0 if failures >= trials else 0.0
    k = np.arange(failures + 1)
    log_choose = math.lgamma(trials + 1) - np.array(
        [math.lgamma(i + 1) + math.lgamma(trials - i + 1) for i in k.tolist()]
    )
    terms = log_choose + k * math.log(rate) + (trials - k) * math.log1p(-rate)
    return float(min(np.exp(terms).sum(), 1.0))


def upper_limit(failures: int, trials: int, confidence: float = CONFIDENCE) -> float:
    """One-sided Clopper-Pearson upper limit of the rate; 1 where nothing was tried."""
    _check(failures, trials)
    if failures == trials:
        return 1.0
    return _solve(lambda rate: _tail(failures, trials, rate) > 1.0 - confidence)


def lower_limit(failures: int, trials: int, confidence: float = CONFIDENCE) -> float:
    """One-sided Clopper-Pearson lower limit of the rate; 0 where nothing failed."""
    _check(failures, trials)
    if failures == 0:
        return 0.0
    return _solve(lambda rate: 1.0 - _tail(failures - 1, trials, rate) < 1.0 - confidence)


def trials_needed(failures: int, rate: float = 1.0 - CONTENT, confidence: float = CONFIDENCE) -> int:
    """The fewest trials with so many failures whose upper limit does not exceed the rate."""
    low, high = failures, failures + 1
    while _tail(failures, high, rate) > 1.0 - confidence:
        high *= 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _tail(failures, middle, rate) > 1.0 - confidence else (low, middle)
    return high


def quantile(values: np.ndarray, content: float = CONTENT) -> float:
    """The smallest value that at least this share does not exceed: no interpolation, NaN left out; NaN for nothing."""
    known = np.sort(values[~np.isnan(values)], axis=None)
    if not len(known):
        return math.nan
    return float(known[min(math.ceil(content * len(known) - 1e-9), len(known)) - 1])


def tightness(ratio: np.ndarray, content: float = CONTENT) -> float:
    """By what factor all bounds could be divided and still hold with this frequency; ratio: error / bound."""
    worst = quantile(ratio, content)
    return 1.0 / worst if worst > 0.0 else math.inf if worst == 0.0 else math.nan


def _check(failures: int, trials: int) -> None:
    if not 0 <= failures <= trials or trials < 1:
        raise ValueError(f"{failures} failures of {trials} trials")


def _solve(below: Callable[[float], bool]) -> float:
    """The rate at which `below` turns from true to false, by bisection."""
    low, high = 0.0, 1.0
    while high - low > _TOLERANCE * max(high, 1e-3):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        low, high = (middle, high) if below(middle) else (low, middle)
    return high
