"""Thresholds of the inter-satellite monitor against mpmath and the paper."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp

from flightsw.crosslink import thresholds
from flightsw.crosslink.setup import Settings, build_table


def exact_tail(x: float, dof: int) -> float:
    return float(mp.gammainc(mp.mpf(dof) / 2, mp.mpf(x) / 2, mp.inf, regularized=True))


@given(st.floats(1e-3, 400.0), st.integers(1, 12))
def test_the_chi_square_tail_is_exact(x: float, dof: int) -> None:
    assert thresholds.chi2_tail(x, dof) == pytest.approx(exact_tail(x, dof), rel=1e-11)


@given(st.floats(-12.0, -0.01), st.integers(1, 6))
def test_a_quantile_is_exceeded_as_often_as_asked(exponent: float, dof: int) -> None:
    p = 10.0**exponent
    assert exact_tail(thresholds.chi2_quantile(p, dof), dof) == pytest.approx(p, rel=1e-9)


def test_reference_threshold_of_24_satellites() -> None:
    """GIVEN P_fa 2e-7 shared by 24 satellites of four parameters THEN the threshold is 43.45 (the reference's)."""
    assert thresholds.chi2_quantile(2e-7 / 24, 4) == pytest.approx(43.45, abs=0.005)
    table = build_table(Settings(slow_share=0.0))
    assert table["network_threshold"][0][4] == pytest.approx(43.45, abs=0.005)


def test_the_papers_threshold_follows_from_table_2() -> None:
    """GIVEN Table 2 (3.5, 3.5, 0.5 m) THEN 12 sigma of the position are the paper's 59.7 m."""
    assert thresholds.paper_threshold_m(3.5, 3.5, 0.5) == pytest.approx(59.7, abs=0.05)
    assert build_table(Settings())["majority_threshold_m"][0] == pytest.approx(59.7, abs=0.05)


@pytest.mark.parametrize(("n", "p"), [(9, 1e-7), (7, 1e-3), (4, 0.05)])
def test_the_majority_threshold_gives_its_rate(n: int, p: float) -> None:
    """GIVEN a rate THEN a strict majority of independent links beyond the threshold is that frequent (mpmath)."""
    limit = thresholds.majority_threshold_m(p, n, 2.0)
    one = mp.erfc(mp.mpf(limit) / 2 / mp.sqrt(2))
    rate = sum(mp.binomial(n, k) * one**k * (1 - one) ** (n - k) for k in range(n // 2 + 1, n + 1))
    assert float(rate) == pytest.approx(p, rel=1e-6)


@pytest.mark.parametrize("noncentrality", [0.0, 3.0, 40.0, 90.0])
def test_noncentral_tail_against_integration(noncentrality: float) -> None:
    """GIVEN a noncentral chi-square of four degrees THEN its tail is the integral of its density (Bessel form)."""
    mp.dps = 30
    x, lam = mp.mpf(43.45), mp.mpf(noncentrality)
    if noncentrality == 0.0:
        exact = exact_tail(43.45, 4)
    else:
        density = lambda t: mp.exp(-(t + lam) / 2) / 2 * mp.sqrt(t / lam) * mp.besseli(1, mp.sqrt(lam * t))  # noqa: E731
        exact = float(mp.quad(density, [x, x + 50, x + 200, x + 1000]))
    assert thresholds.noncentral_chi2_tail(43.45, 4, noncentrality) == pytest.approx(exact, rel=1e-8)


def test_the_certain_noncentrality_is_certain() -> None:
    found = thresholds.certain_noncentrality(43.45, 4, 0.999)
    assert thresholds.noncentral_chi2_tail(43.45, 4, found) == pytest.approx(0.999, abs=1e-7)


@pytest.mark.parametrize(
    "bad",
    [
        {"satellites": 33},
        {"own": 24},
        {"sigma_range_m": 0.0},
        {"sigma_m": (1.0, 1.0, 1.0)},
        {"sigma_rate_mps": (-1.0, 0.0, 0.0, 0.0)},
        {"p_false_alarm": 0.0},
        {"slow_share": 1.0},
        {"clear_epochs": 0},
        {"faulty_max": 0},
        {"onset_blocks": (0,)},
        {"onset_blocks": (200,)},
        {"block_epochs": 3},
        {"sigma_range_m": math.nan},
    ],
)
def test_a_setting_out_of_range_is_named(bad: dict) -> None:
    (name,) = bad if "block_epochs" not in bad else ("onset_blocks",)
    with pytest.raises(ValueError, match=name):
        Settings(**bad)


@pytest.mark.parametrize("p", [0.0, 1.0, -0.1, math.nan])
def test_a_probability_that_is_none_is_refused(p: float) -> None:
    with pytest.raises(ValueError, match="probability"):
        thresholds.chi2_quantile(p, 4)
