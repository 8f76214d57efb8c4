"""What no test of a receiver's velocity can do: how many biases can be found in time at a rate of false alarms.

A test with at most one alarm in D alarms on average in no more than W / D of all stretches of W. Within one stretch the
best of all tests of a shift of known size is Neyman and Pearson's on all that is seen; its power is concave in the
share of alarms, so that no choice of when to alarm does better on average. Where the direction is not known, the same
for every direction is at best the chi-square test (G. A. Hunt, C. Stein: the most powerful one that no rotation
changes). The orbit counts as known exactly here: what is seen of it can only take away.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from flightsw.crosslink.thresholds import chi2_quantile, noncentral_chi2_tail

_AXES = 3


def deflection(bias_mps: float, white_mps: float, coloured_mps: float, coloured_s: float, window: int) -> float:
    """Sigmas of a bias in the best sum of so many fixes a second apart, errors white and first-order Gauss-Markov."""
    apart_s = np.abs(np.subtract.outer(np.arange(window), np.arange(window)))
    covariance = white_mps**2 * np.eye(window) + coloured_mps**2 * np.exp(-apart_s / coloured_s)
    ones = np.ones(window)
    return bias_mps * math.sqrt(float(ones @ np.linalg.solve(covariance, ones)))


def most_found(sigmas: float, window_s: float, alarm_s: float) -> tuple[float, float]:
    """Largest share of biases of so many sigmas found within window_s at one alarm in alarm_s: direction known, not."""
    share = window_s / alarm_s
    known = NormalDist().cdf(sigmas - NormalDist().inv_cdf(1.0 - share))
    return known, noncentral_chi2_tail(chi2_quantile(share, _AXES), _AXES, sigmas**2)
