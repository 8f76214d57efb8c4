"""Thresholds from the wanted false-alarm rate: tails of chi-square and binomial distributions, and their inverses.

Computed when a monitor is set up, never in a tick. Closed forms: Abramowitz and Stegun 26.4.4, 26.4.5 (chi-square),
26.5.24 (binomial).
"""

from __future__ import annotations

import math

_DIGITS = 1e-13


def chi2_tail(x: float, dof: int) -> float:
    """P(chi-square with `dof` degrees of freedom > x)."""
    if x <= 0.0:
        return 1.0
    half = 0.5 * x
    if dof % 2 == 0:
        term = total = 1.0
        for k in range(1, dof // 2):
            term *= half / k
            total += term
        return math.exp(-half) * total
    tail = math.erfc(math.sqrt(half))
    term = math.sqrt(2.0 * x / math.pi) * math.exp(-half)
    for k in range(1, (dof - 1) // 2 + 1):
        tail += term
        term *= x / (2 * k + 1)
    return tail


def chi2_quantile(p_tail: float, dof: int) -> float:
    """The x that a chi-square with `dof` degrees of freedom exceeds with probability p_tail; 0 < p_tail < 1."""
    if not 0.0 < p_tail < 1.0:
        raise ValueError(f"probability {p_tail}: give one between 0 and 1")
    low, high = 0.0, 1.0
    while chi2_tail(high, dof) > p_tail:
        high *= 2.0
    while high - low > _DIGITS * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chi2_tail(middle, dof) > p_tail else (low, middle)
    return high


def normal_quantile(p_tail: float) -> float:
    """The z that a standard normal exceeds in absolute value with probability p_tail."""
    return math.sqrt(chi2_quantile(p_tail, 1))


def binomial_tail(least: int, trials: int, p: float) -> float:
    """P(at least `least` of `trials` independent events of probability p)."""
    return sum(math.comb(trials, k) * p**k * (1.0 - p) ** (trials - k) for k in range(max(least, 0), trials + 1))


def paper_threshold_m(sigma_along_m: float, sigma_cross_m: float, sigma_radial_m: float, factor: float = 12.0) -> float:
    """The paper's threshold of a range difference: 12 sigma of one satellite's position error, 59.7 m with Table 2."""
    return factor * math.sqrt(sigma_along_m**2 + sigma_cross_m**2 + sigma_radial_m**2)


def majority_threshold_m(p_false_alarm: float, neighbours: int, sigma_link_m: float) -> float:
    """Threshold of |dR| for which a strict majority of independent links is a false alarm so often, and no oftener.

    sigma_link_m: 1-sigma of a link's measured minus computed range. Links share the own satellite's error; as
    independent ones they need the larger threshold only if that share is small, so use `sigma_link_m` of the whole.
    """
    least = neighbours // 2 + 1
    low, high = 0.0, 1.0
    while high - low > _DIGITS:
        p = 0.5 * (low + high)
        low, high = (p, high) if binomial_tail(least, neighbours, p) < p_false_alarm else (low, p)
    return normal_quantile(max(low, 1e-300)) * sigma_link_m


def noncentral_chi2_tail(x: float, dof: int, noncentrality: float) -> float:
    """P(noncentral chi-square > x): a Poisson mixture of central ones (Abramowitz and Stegun 26.4.25)."""
    half = 0.5 * noncentrality
    if half <= 0.0:
        return chi2_tail(x, dof)
    reach = 12.0 * math.sqrt(half) + 30.0
    total = 0.0
    for k in range(max(0, int(half - reach)), int(half + reach) + 1):
        total += math.exp(k * math.log(half) - half - math.lgamma(k + 1)) * chi2_tail(x, dof + 2 * k)
    return min(total, 1.0)


def certain_noncentrality(threshold: float, dof: int, detection: float) -> float:
    """Noncentrality at which a chi-square exceeds the threshold with probability `detection`."""
    low, high = 0.0, 1.0
    while noncentral_chi2_tail(threshold, dof, high) < detection:
        high *= 2.0
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if noncentral_chi2_tail(threshold, dof, middle) < detection else (low, middle)
    return high
