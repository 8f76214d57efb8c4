"""Statistics of a certification: against published numbers, and mpmath's incomplete beta function."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from ground.campaign.statistics import lower_limit, quantile, tightness, trials_needed, upper_limit


@pytest.mark.parametrize(("failures", "trials"), [(0, 998), (1, 1580), (3, 2583), (10, 5651)])
def test_how_many_outages_prove_0_997(failures: int, trials: int) -> None:
    """GIVEN the published numbers of outages for 0.997 at 95 % WHEN asked how many are needed THEN it is those; one
    fewer does not do."""
    assert trials_needed(failures) == trials
    assert upper_limit(failures, trials) <= 0.003 < upper_limit(failures, trials - 1)


@pytest.mark.parametrize(("failures", "trials"), [(0, 1), (0, 60), (1, 60), (7, 480), (59, 60), (36, 12_000)])
@pytest.mark.parametrize("confidence", [0.95, 0.995])
def test_limits_are_quantiles_of_the_beta_distribution(failures: int, trials: int, confidence: float) -> None:
    """GIVEN counts WHEN limits are computed THEN Clopper and Pearson's beta distribution has its quantile there."""
    high = upper_limit(failures, trials, confidence)
    assert float(mpmath.betainc(failures + 1, trials - failures, 0, high, True)) == pytest.approx(confidence, abs=1e-9)
    low = lower_limit(failures, trials, confidence)
    if failures:
        below = float(mpmath.betainc(failures, trials - failures + 1, 0, low, True))
        assert below == pytest.approx(1.0 - confidence, abs=1e-9)
    else:
        assert low == 0.0
    assert low <= failures / trials <= high


def test_all_failed_and_nonsense() -> None:
    """GIVEN only failures THEN the limit is one; GIVEN impossible counts THEN they are refused."""
    assert upper_limit(5, 5) == 1.0
    for failures, trials in ((6, 5), (-1, 5), (0, 0)):
        with pytest.raises(ValueError, match="trials"):
            upper_limit(failures, trials)


def test_quantile_takes_a_value_that_occurred() -> None:
    """GIVEN 1000 ratios 0.001 to 1 and gaps WHEN the 0.997 quantile is taken THEN 997 do not exceed it; by its inverse
    all bounds could be divided."""
    ratio = np.r_[np.arange(1, 1001) / 1000.0, np.nan, np.nan]
    assert quantile(ratio) == 0.997
    assert tightness(ratio) == pytest.approx(1.0 / 0.997)
    assert math.isnan(tightness(np.array([np.nan])))
    assert quantile(np.array([3.0]), 0.5) == 3.0
    assert tightness(np.array([0.5, np.inf])) == 0.0
