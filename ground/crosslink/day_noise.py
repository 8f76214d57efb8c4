"""What is normal on a real day: its noise table, what lies beyond any such table, and how often normal errors alarm.

Errors of messages are not Gaussian. A table made of their robust spread describes the many and not the tails, where
false alarms come from. A Gaussian that no tail of the day exceeds overbounds them (DeCleene, ION GPS 2000): with it the
rate that the thresholds are computed for holds for errors as they are, as far as a day shows them.

What is further out than any noise is a fault, by the precise orbits, whatever the message says of itself.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from flightsw.crosslink.records import PARAMETERS
from flightsw.crosslink.setup import MonitorMemory
from ground.crosslink.judge import linear_functions
from hil_sim.truth.constellation.glonass_day import GlonassDay

ANOMALY = 4.5  # robust sigma: 48 uploads of 18 satellites in 8 directions reach it by chance once in 20 days
LEFT_OUT = 5.0  # robust sigma: who is once so far out in a direction is no example of what is normal in it
_BEGUN = 3.0  # robust sigma: from here on such an anomaly is under way
_RATES = 2.0  # rates of clocks that walk at random have longer tails: of theirs it takes twice as many
HELD_S = 1200.0  # that the monitor's history remembers


class Spread(NamedTuple):
    """1-sigma (4,) [m] of errors and (4,) [m/s] of their rates within an ephemeris."""

    sigma_m: np.ndarray
    rate_mps: np.ndarray


def rates_mps(day: GlonassDay) -> np.ndarray:
    """Rates (n,k,4) [m/s] of the day's errors; NaN where an ephemeris ends."""
    same = day.issue[:, 1:] == day.issue[:, :-1]
    step = day.grid_s[1] - day.grid_s[0]
    found = np.where(same[:, :, None], np.diff(day.errors_m, axis=1) / step, np.nan)
    return np.concatenate((found, np.full_like(found[:, :1], np.nan)), axis=1)


def robust(day: GlonassDay) -> Spread:
    """1.4826 times the median absolute error, which a few bad satellites do not move."""
    return Spread(
        1.4826 * np.nanmedian(np.abs(day.errors_m), axis=(0, 1)),
        1.4826 * np.nanmedian(np.abs(rates_mps(day)), axis=(0, 1)),
    )


def overbound(day: GlonassDay) -> Spread:
    """The least sigma whose Gaussian tails are not below the day's anywhere beyond the median.

    Left out of a direction are satellites that are once beyond LEFT_OUT robust sigma in it.
    """
    spread = robust(day)
    found = []
    for values, sigma in ((day.errors_m, spread.sigma_m), (rates_mps(day), _RATES * spread.rate_mps)):
        worst = np.nanmax(np.abs(values), axis=1) / sigma
        found.append(np.array([folded_overbound(values[worst[:, k] < LEFT_OUT, :, k]) for k in range(4)]))
    return Spread(found[0], found[1])


def folded_overbound(values: np.ndarray) -> float:
    """Least sigma with P(|N(0, sigma)| > x) not below the share of |values| beyond x, for all x beyond their median."""
    size = np.sort(np.abs(values[np.isfinite(values)]))
    beyond = 1.0 - (np.arange(len(size)) + 0.5) / len(size)
    outer = beyond < 0.5
    z = np.array([NormalDist().inv_cdf(1.0 - 0.5 * p) for p in beyond[outer]])
    return float((size[outer] / z).max())


def beyond_noise(day: GlonassDay, satellite: int, t_s: float) -> float:
    """How many robust sigma, of errors or twice that of rates, a satellite was off at most in the HELD_S before t."""
    spread = robust(day)
    step = day.grid_s[1] - day.grid_s[0]
    first, last = int(max(t_s - HELD_S, 0.0) // step), int(t_s // step) + 1
    parts = (
        day.errors_m[satellite, first : last + 1] / spread.sigma_m,
        rates_mps(day)[satellite, first:last] / (_RATES * spread.rate_mps),
    )
    return max((float(np.nanmax(np.abs(part))) for part in parts if np.isfinite(part).any()), default=0.0)


def anomalous(day: GlonassDay) -> np.ndarray:
    """(n,k): whether a satellite's anomaly is under way, or still in the history of who watches it.

    An anomaly is a direction in which a satellite goes beyond LEFT_OUT robust sigma, while it is beyond _BEGUN.
    """
    spread = robust(day)
    found = np.zeros(day.issue.shape, bool)
    for values, sigma in ((day.errors_m, spread.sigma_m), (rates_mps(day), _RATES * spread.rate_mps)):
        size = np.nan_to_num(np.abs(values) / sigma)
        found |= ((size > _BEGUN) & (size.max(axis=1, keepdims=True) >= LEFT_OUT)).any(axis=2)
    held = int(HELD_S // (day.grid_s[1] - day.grid_s[0]))
    reach = np.cumsum(np.pad(found, ((0, 0), (held + 1, held))), axis=1)
    return reach[:, 2 * held + 1 :] > reach[:, : -2 * held - 1]


class Expected:
    """Rate of false alarms of the network monitor, given the errors that satellites really broadcast.

    Fed with epochs without noise. What a statistic is the squared length of is then the mean of its four Gaussians
    under noise, and their covariance follows from the noise of the links alone; the tail of such a quadratic form is
    computed, at rates that no counting reaches.
    """

    def __init__(self, memory: MonitorMemory, slow: bool) -> None:
        name = "network_slow_threshold" if slow else "network_threshold"
        self._thresholds = np.array(memory.table[name][0])
        self._memory = memory
        self._sum, self._largest, self._epochs = 0.0, 0.0, 0

    def add(self, apart: np.ndarray) -> None:
        """Count the epoch that the monitor's network test was made ready with last; apart (n,): who is not charged."""
        test = self._memory.network[0]
        links, n = int(test["links"]), int(test["columns"]) // PARAMETERS
        self._epochs += 1
        if not test["ready"]:
            return
        mean = np.einsum("nik,nk->ni", np.array(test["root"])[:n], np.array(test["g"])[: PARAMETERS * n].reshape(n, -1))
        noise = np.array(test["noise_m2"])[:links]
        # last of all: what the test holds of the epoch is lost with it
        gain = linear_functions(self._memory.network, links, PARAMETERS * n).reshape(links, n, PARAMETERS)
        covariance = np.einsum("lni,l,lnj->nij", gain, noise, gain)
        dof = np.array(test["dof"])[:n]
        for satellite in np.flatnonzero((dof > 0) & ~apart):
            threshold = float(self._thresholds[dof[satellite]])
            self._sum += quadratic_tail(threshold, mean[satellite], covariance[satellite])
            self._largest = max(self._largest, float(mean[satellite] @ mean[satellite]))

    def document(self) -> dict[str, float]:
        """Rate an epoch, over all satellites; the largest statistic that errors alone gave."""
        return {"epochs": self._epochs, "rate": self._sum / max(self._epochs, 1), "largest": self._largest}


def quadratic_tail(threshold: float, mean: np.ndarray, covariance: np.ndarray) -> float:
    """P(|x|^2 > threshold) of a Gaussian x, by the saddle point of Lugannani and Rice (1980); 1 below its mean."""
    variance, axes = np.linalg.eigh(covariance)
    variance = np.maximum(variance, 1e-12)
    offset = (axes.T @ mean) ** 2
    if threshold <= float(variance.sum() + offset.sum()):
        return 1.0

    def slope(theta: float) -> float:
        left = 1.0 - 2.0 * theta * variance
        return float((variance / left + offset / left**2).sum())

    low, high = 0.0, 0.5 / float(variance.max())
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slope(middle) < threshold else (low, middle)
    theta = 0.5 * (low + high)
    left = 1.0 - 2.0 * theta * variance
    cumulant = float((-0.5 * np.log(left) + theta * offset / left).sum())
    curvature = float((2.0 * variance**2 / left**2 + 4.0 * offset * variance / left**3).sum())
    w, u = math.sqrt(2.0 * (theta * threshold - cumulant)), theta * math.sqrt(curvature)
    density = math.exp(-0.5 * w * w) / math.sqrt(2.0 * math.pi)
    return min(1.0, 0.5 * math.erfc(w / math.sqrt(2.0)) + density * (1.0 / u - 1.0 / w))
