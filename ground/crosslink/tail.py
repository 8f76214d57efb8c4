"""False-alarm rates that counting cannot reach, by importance sampling whose error does not grow as the rate falls.

Each satellite's statistic is chi-square, so that the sum of their tails bounds the rate of any of them. What they share
is taken off by the estimator of Adler, Blanchet and Liu (Ann. Appl. Prob. 22, 2012): draw a satellite, draw an epoch
given that its statistic is beyond the threshold, count how many are; the sum of the tails times the mean of 1 / count
is the rate, with a relative error that stays bounded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flightsw.crosslink.records import PARAMETERS
from flightsw.crosslink.setup import MonitorMemory
from flightsw.crosslink.thresholds import chi2_quantile, chi2_tail
from ground.crosslink.judge import linear_functions


class Tail(NamedTuple):
    """rate, its standard error, and the Bonferroni bound it lies below."""

    rate: float
    error: float
    bound: float


def family_rate(memory: MonitorMemory, rng: np.random.Generator, samples: int = 20_000) -> Tail:
    """Rate per healthy epoch at which any satellite's statistic is beyond its threshold, in a monitor made ready."""
    test, table = memory.network[0], memory.table[0]
    links, n = int(test["links"]), int(table["satellites"])
    dof = np.array(test["dof"])[:n]
    threshold = np.array(table["network_threshold"])
    p = np.array([chi2_tail(threshold[d], int(d)) if d > 0 else 0.0 for d in dof])
    functions = linear_functions(memory.network, links, PARAMETERS * n)
    spread = np.linalg.cholesky(_covariance(memory))
    bases = [spread.T @ functions[:, PARAMETERS * i : PARAMETERS * (i + 1)] for i in range(n)]  # orthonormal columns
    terms = np.empty(samples)
    for sample in range(samples):
        i = int(rng.choice(n, p=p / p.sum()))
        d = int(dof[i])
        z = rng.standard_normal(links)
        basis = bases[i][:, :d]
        direction = rng.standard_normal(d)
        beyond = chi2_quantile(p[i] * rng.uniform(1e-300, 1.0), d)
        z += basis @ (math.sqrt(beyond) * direction / np.linalg.norm(direction) - basis.T @ z)
        count = sum(float(np.sum((bases[j].T @ z) ** 2)) > threshold[dof[j]] or j == i for j in range(n) if dof[j] > 0)
        terms[sample] = 1.0 / count
    total = float(p.sum())
    return Tail(total * float(terms.mean()), total * float(terms.std(ddof=1)) / math.sqrt(samples), total)


def _covariance(memory: MonitorMemory) -> np.ndarray:
    """Covariance (links, links) [m2] of an epoch's residuals, by its definition."""
    test, table = memory.network[0], memory.table[0]
    links, n = int(test["links"]), int(table["satellites"])
    sensitivity = np.zeros((links, n, PARAMETERS))
    for end, name in enumerate(("receiver", "sender")):
        sensitivity[np.arange(links), np.array(test[name])[:links]] += np.array(test["h"])[:links, end]
    shared = (sensitivity * np.array(table["sigma_m"])).reshape(links, -1)
    return np.asarray(shared @ shared.T + np.diag(np.array(test["noise_m2"])[:links]))
