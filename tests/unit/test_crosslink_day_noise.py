"""What is normal on a real day: overbounds and tails of quadratic forms against counting and known distributions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightsw.crosslink.thresholds import chi2_quantile, chi2_tail, noncentral_chi2_tail
from ground.crosslink.day_noise import folded_overbound, quadratic_tail


@pytest.mark.parametrize("p", [1e-2, 1e-5, 4e-9])
def test_a_quadratic_form_of_unit_gaussians_is_chi_square(p: float) -> None:
    """GIVEN four unit Gaussians, with and without a mean THEN the tail is that of (noncentral) chi-square, to 3 %."""
    threshold = chi2_quantile(p, 4)
    assert quadratic_tail(threshold, np.zeros(4), np.eye(4)) == pytest.approx(chi2_tail(threshold, 4), rel=0.03)
    mean = np.array([1.0, -0.5, 0.0, 2.0])
    expected = noncentral_chi2_tail(threshold, 4, float(mean @ mean))
    assert quadratic_tail(threshold, mean, np.eye(4)) == pytest.approx(expected, rel=0.03)


def test_a_quadratic_form_of_unequal_gaussians_is_as_counted() -> None:
    """GIVEN correlated Gaussians with a mean WHEN counted in two million draws THEN the tail is that, to 5 %."""
    rng = np.random.default_rng(2)
    root = np.array([[0.9, 0.0, 0.0, 0.0], [0.3, 0.5, 0.0, 0.0], [0.1, 0.0, 0.2, 0.0], [0.0, 0.0, 0.0, 0.0]])
    mean = np.array([0.5, 1.0, -1.0, 0.2])
    drawn = rng.standard_normal((2_000_000, 4)) @ root.T + mean
    size = (drawn**2).sum(axis=1)
    for threshold in (8.0, 12.0, 16.0):
        assert quadratic_tail(threshold, mean, root @ root.T) == pytest.approx((size > threshold).mean(), rel=0.05)
    assert quadratic_tail(1.0, mean, root @ root.T) == 1.0  # below the mean it is not a tail


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 5.0))
def test_no_tail_of_the_samples_is_beyond_its_overbound(seed: int, shape: float) -> None:
    """GIVEN samples of heavy or light tails THEN no quantile beyond the median exceeds the Gaussian's, and with a
    sigma that is 1 % less one does."""
    rng = np.random.default_rng(seed)
    values = rng.standard_normal(400) * np.abs(rng.standard_normal(400)) ** (1.0 / shape)
    sigma = folded_overbound(np.concatenate((values, [np.nan])))
    size = np.sort(np.abs(values))[200:]
    share = 1.0 - (np.arange(200, 400) + 0.5) / 400
    tail = np.array([chi2_tail((x / sigma) ** 2, 1) for x in size])
    assert (tail >= share - 1e-9).all()
    assert any(chi2_tail((x / (0.99 * sigma)) ** 2, 1) < p for x, p in zip(size, share, strict=True))
