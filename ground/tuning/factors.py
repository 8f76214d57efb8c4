"""The factor k from flown outages: no fewer sigmas than a per-outage rate wants, with confidence, and no more.

A bound is k times a sigma that does not depend on k. The worst error / bound of an outage therefore says which k it
would have needed: nothing has to be flown again. The k that proves a rate is an order statistic of those (the count
beyond it is binomial: Clopper and Pearson). Too few outages prove nothing; then the largest is carried on to the rate
as errors of a perfectly known covariance would go on (floor.py), and that is said.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ground.campaign.statistics import CONFIDENCE, upper_limit

ROUND = 0.01  # k is rounded up to this


class Factor(NamedTuple):
    """k for a group of outages: how many there were, how many needed more, the limit that this proves at 95 %.

    proven: whether that limit is the wanted rate; else k was carried on from the largest needed.
    """

    group: str
    k: float
    outages: int
    beyond: int
    upper_limit_95: float
    rate: float
    proven: bool


def allowed(trials: int, rate: float) -> int:
    """How many of the trials may fail so that the rate is proven at 95 %; -1 where none may and it still is not."""
    failures = -1
    while failures + 1 < trials and upper_limit(failures + 1, trials) <= rate:
        failures += 1
    return failures


def factor(group: str, needed: np.ndarray, rate: float, floor_k: float, trials: int | None = None) -> Factor:
    """k for outages that needed so much (n,). trials: what the rate is of, if not outages (revolutions).

    floor_k: that breaks 0.003 of outages under a perfectly known covariance; carries k on where n is too small.
    Infinite where outages beyond any k are more than may be.
    """
    n = len(needed) if trials is None else trials
    if not len(needed) or n < 1:
        return Factor(group, 1.0, 0, 0, 1.0, rate, False)
    falling = np.sort(np.where(np.isnan(needed), np.inf, needed))[::-1]
    may_fail = allowed(n, rate)
    if may_fail >= 0:
        k = float(falling[may_fail]) if may_fail < len(falling) else 1.0
        k = max(_up(k), 1.0)
        beyond = int(np.sum(falling > k))
        return Factor(group, k, n, beyond, upper_limit(beyond, n), rate, True)
    # the tail of the largest of an outage: rate = m exp(-k^2 / 2), with m from the floor
    m = max(1.0, 0.003 * math.exp(0.5 * floor_k**2))
    shown = min(0.5, 1.0 - (1.0 - CONFIDENCE) ** (1.0 / n))
    stretch = math.sqrt(math.log(m / rate) / math.log(m / shown))
    k = max(_up(float(falling[0]) * stretch), 1.0)
    return Factor(group, k, n, int(np.sum(falling > k)), upper_limit(0, n), rate, False)


def _up(k: float) -> float:
    return math.ceil(k / ROUND - 1e-9) * ROUND if math.isfinite(k) else k
