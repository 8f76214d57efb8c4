"""Limits of the paper's model in numbers, each against an oracle of its own."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from flightsw.kernels.registry import warm_up
from ground.studies import model_limits
from ground.studies.fix_ratio import Ratio, Tuning, noise_for_ratio
from ground.studies.outage import OutageRun, Spread, largest_dip, summarise, variants

MU_M3PS2 = 3.9860044e14


@pytest.fixture(scope="module", autouse=True)
def _kernels() -> None:
    warm_up()


def test_kepler_reference_against_series_of_many_digits() -> None:
    """GIVEN the analytic orbit WHEN mpmath integrates the same start by Taylor series THEN positions agree to 1 um."""
    r0_m, v0_mps = model_limits.kepler_state(MU_M3PS2, 0.0)
    mpmath.mp.dps = 25

    def motion(_: mpmath.mpf, y: list[mpmath.mpf]) -> list[mpmath.mpf]:
        cube = mpmath.sqrt(y[0] ** 2 + y[1] ** 2 + y[2] ** 2) ** 3
        return [y[3], y[4], y[5], *(-MU_M3PS2 * y[i] / cube for i in range(3))]

    y = mpmath.odefun(motion, 0, [mpmath.mpf(float(c)) for c in (*r0_m, *v0_mps)], tol=mpmath.mpf("1e-12"))(10)
    r_m, v_mps = model_limits.kepler_state(MU_M3PS2, 10.0)
    assert np.allclose([float(c) for c in y[:3]], r_m, rtol=0, atol=1e-6)
    assert np.allclose([float(c) for c in y[3:]], v_mps, rtol=0, atol=1e-9)


def test_euler_is_the_error() -> None:
    """GIVEN a pure two-body orbit WHEN flown for 900 s THEN Euler errs by 3.9 km (REFERENCE: an independent prototype),
    RK4 by nothing at 1 s and by less than a millimetre at 10 s."""
    assert model_limits.two_body_error_m("Euler", 1.0, 900.0) == pytest.approx(3900.0, rel=0.05)
    assert model_limits.two_body_error_m("RK4", 1.0, 900.0) < 1e-6
    assert model_limits.two_body_error_m("RK4", 10.0, 900.0) == pytest.approx(7e-4, rel=0.3)


def test_euler_is_of_first_order_and_rk4_of_fourth() -> None:
    """GIVEN half the step WHEN flown for 900 s THEN Euler errs half as much and RK4 a sixteenth."""
    euler = [model_limits.two_body_error_m("Euler", step_s, 900.0) for step_s in (1.0, 0.5)]
    rk4 = [model_limits.two_body_error_m("RK4", step_s, 900.0) for step_s in (20.0, 10.0)]
    assert euler[0] / euler[1] == pytest.approx(2.0, rel=0.05)
    assert rk4[0] / rk4[1] == pytest.approx(16.0, rel=0.1)


def test_three_sigmas_on_the_worst_axis() -> None:
    """GIVEN three equal axes WHEN three sigmas bound the worst THEN they cover 0.9919, not 0.997; 3.29 would."""
    draws = np.abs(np.random.default_rng(5).standard_normal((400_000, 3))).max(axis=1)
    assert model_limits.coverage_of_worst_axis(3.0) == pytest.approx(0.9919, abs=5e-5)
    assert np.mean(draws <= 3.0) == pytest.approx(model_limits.coverage_of_worst_axis(3.0), abs=6e-4)
    assert model_limits.factor_for_worst_axis(0.997) == pytest.approx(3.29, abs=5e-3)


def test_radius_that_covers_a_sphere() -> None:
    """GIVEN the regularised gamma function WHEN it is asked THEN the radius for 0.997 is 3.73 sigmas."""
    k = model_limits.factor_for_radius(0.997)
    assert float(mpmath.gammainc(1.5, 0, k * k / 2, regularized=True)) == pytest.approx(0.997, abs=1e-12)
    assert k == pytest.approx(3.73, abs=5e-3)


def _ratio(sigma_m: float, best: float) -> Ratio:
    return Ratio(sigma_m, sigma_m, 1.0, best, Tuning(0.0, 0.0, 0.0, 1.0))


def test_noise_at_which_a_ratio_holds() -> None:
    """GIVEN best ratios 5 at 10 m and 20 at 1000 m WHEN 10 is wanted THEN it holds from 100 m on; 30 nowhere."""
    ratios = [_ratio(1000.0, 20.0), _ratio(10.0, 5.0)]
    assert noise_for_ratio(ratios, 10.0) == pytest.approx(100.0)
    assert noise_for_ratio(ratios, 30.0) is None


def test_largest_dip() -> None:
    """GIVEN series WHEN they fall back THEN the share of what had been reached counts; growth is no dip."""
    assert largest_dip(np.array([1.0, 4.0, 3.0, 5.0, 4.5])) == pytest.approx(0.25)
    assert largest_dip(np.array([1.0, 2.0, 3.0])) == 0.0


def test_spread_counts_what_never_happened() -> None:
    """GIVEN figures of which one was never reached WHEN spread THEN it is counted and not averaged."""
    assert Spread.of([3.0, None, 1.0, 2.0]) == Spread(1.0, 2.0, 3.0, 1)
    assert Spread.of([None, None]) == Spread(None, None, None, 2)


def _run(crossed_s: float | None, flag_s: float | None, violations: int = 0) -> OutageRun:
    numbers = {"epochs": 9, "worst_error_to_bound": 0.5, "back_in_service_s": 29.0, "fix_rms_m": 1.4}
    more = {"integrated_rms_m": 0.7, "fix_to_integrated": 2.0, "covered": 1.0, "error_at_900_s_m": 1.0}
    rest = {"error_at_2000_s_m": 1.0, "error_max_m": 1.0, "error_dip": 0.0, "bound_max_m": 1.0, "fault_of_table": None}
    return OutageRun(1, 0.0, crossed_s, flag_s, None, violations, **numbers, **more, **rest)  # type: ignore[arg-type]


def test_a_flag_is_in_time_before_the_crossing_only() -> None:
    """GIVEN runs WHEN flags come before, after, without and never THEN only the first and third are in time."""
    runs = [_run(600.0, 500.0), _run(600.0, 601.0, 3), _run(None, 500.0), _run(600.0, None, 5)]
    assert [run.flag_in_time for run in runs] == [True, False, True, False]
    summary = summarise(runs)
    assert (summary["outages_violated"], summary["violated_epochs"], summary["flag_in_time"]) == (2, 8, 2)


def test_variants_cover_the_orbit_with_seeds_of_their_own() -> None:
    """GIVEN four runs WHEN laid out THEN seeds differ and phases are a quarter of an orbit apart."""
    chosen = variants("paper_outage", 4, ["gnss.sigma_position_m=33.0"])
    assert [(v.seed, v.phase_deg) for v in chosen] == [(1, 0.0), (2, 90.0), (3, 180.0), (4, 270.0)]
