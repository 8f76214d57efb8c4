"""The accuracy bench without flying: its plan, and its statistics on figures made here."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.accuracy.bench_cases import (
    AGES_S,
    CONVERGENCE_S,
    LONG_FLIGHT,
    MARGIN_S,
    ORBITS,
    PROFILES,
    RETURN_S,
    RETURNS_S,
    Case,
    Plan,
    seed,
)
from ground.accuracy.bench_flight import best_scale, nees
from ground.accuracy.bench_summary import (
    age_figures,
    chance_of_a_late_return,
    converged_s,
    near_s,
    pooled_validation,
    return_figures,
    start_list,
    steady_again_s,
    steady_figures,
    validation_figures,
)
from ground.errors import OperatorError

PLAN = Plan.of(86_400)


def case(**changes: Any) -> Case:
    """The simulated orbit with white fixes, three arcs."""
    plan = replace(PLAN, begins_s=PLAN.begins_s[:3])
    return replace(Case(ORBITS["simulated"], "white", plan, "flight"), **changes)


# -- plan --------------------------------------------------------------------------------------------------------------


def test_a_day_has_two_revolutions_of_convergence_and_every_start_that_fits() -> None:
    """GIVEN a day WHEN planned THEN starts are 1000 s apart from 12000 s on, to the last with the least age behind."""
    assert PLAN.convergence_s == CONVERGENCE_S == 12_000
    assert not PLAN.shortened
    starts = [begin + PLAN.convergence_s for begin in PLAN.begins_s]
    assert starts == list(range(12_000, 86_400 - MARGIN_S - AGES_S[0] + 1, 1000))
    assert PLAN.arc_s(0) >= CONVERGENCE_S + AGES_S[-1] + RETURN_S
    assert PLAN.begins_s[-1] + PLAN.arc_s(PLAN.begins_s[-1]) == PLAN.span_s


@given(st.integers(4500, 400_000))
def test_every_plan_stays_within_its_orbit_and_drops_no_start(span_s: int) -> None:
    """GIVEN an orbit of any length WHEN planned THEN no arc leaves it, and one start more would not fit."""
    plan = Plan.of(span_s)
    known = min(span_s, 86_400) - MARGIN_S
    assert plan.flight_s <= known
    assert all(b - a == 1000 for a, b in itertools.pairwise(plan.begins_s))
    assert all(begin + plan.arc_s(begin) <= known for begin in plan.begins_s)
    assert all(plan.arc_s(begin) >= plan.convergence_s + AGES_S[0] for begin in plan.begins_s)
    assert plan.begins_s[-1] + 1000 + plan.convergence_s + AGES_S[0] > known
    assert set(plan.ages_s) <= set(plan.curve_s)
    assert plan.shortened == (plan.convergence_s < 12_000)


def test_a_short_orbit_converges_for_a_third_of_it_and_a_shorter_one_is_refused() -> None:
    assert Plan.of(ORBITS["sentinel1a"].span_s).convergence_s == 3900
    with pytest.raises(OperatorError, match=r"4499 s is too short: 4500 s are the least"):
        Plan.of(4499)


def test_noise_is_drawn_anew_for_every_part_and_is_the_same_for_every_profile() -> None:
    """GIVEN all parts of all orbits WHEN seeds are listed THEN no two are equal, whatever the profile."""
    parts = [(orbit, part) for orbit in ORBITS for part in (LONG_FLIGHT, *range(len(PLAN.begins_s)))]
    assert len({seed(*part) for part in parts}) == len(parts)
    for part in (LONG_FLIGHT, 2):
        seeds = {next(s for s in case(profile=p).scenario_settings(part) if "seed=" in s) for p in PROFILES}
        assert seeds == {f"seed={seed('simulated', part)}"}


def test_arcs_of_a_simulated_orbit_begin_further_along_it() -> None:
    """GIVEN the second arc WHEN its scenario is set THEN it begins 1000 s later, 360/T degrees a second further on."""
    settings = dict(text.split("=", 1) for text in case().scenario_settings(1))
    assert settings["time.start"] == '"2019-01-01T00:16:40"'
    period_s = 5676.98  # of 6878136.3 m by Kepler's third law
    assert float(settings["orbit.argument_of_latitude_deg"]) == pytest.approx(360.0 * 1000.0 / period_s, abs=1e-3)


def test_settings_of_the_operator_come_last() -> None:
    assert case(settings=("gnss.sigma_position_m=1.0",)).scenario_settings(0)[-1] == "gnss.sigma_position_m=1.0"


# -- statistics --------------------------------------------------------------------------------------------------------


def test_nees_of_independent_errors_is_their_sum_of_squares_in_sigmas() -> None:
    """GIVEN diagonal covariances WHEN the NEES is taken THEN it is the sum of (error / sigma)^2, in any axes."""
    rng = np.random.default_rng(1)
    sigma = np.array([1.0, 2.0, 5.0, 1e-3, 2e-3, 7e-3])
    error = rng.standard_normal((50, 6)) * sigma * 1.7
    wanted = np.sum((error / sigma) ** 2, axis=1)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = turn
    covariance = np.repeat((both @ np.diag(sigma**2) @ both.T)[None], 50, axis=0)
    np.testing.assert_allclose(nees(error @ both.T, covariance), wanted, rtol=1e-9)


def test_nees_of_errors_drawn_from_the_covariance_is_their_number_in_the_mean() -> None:
    """GIVEN 20000 errors drawn from full covariances WHEN averaged THEN 6 to within four sigmas of the mean."""
    rng = np.random.default_rng(2)
    factor = np.diag([3.0, 3.0, 3.0, 3e-3, 3e-3, 3e-3]) @ np.tril(rng.standard_normal((6, 6)) + 2.0 * np.eye(6))
    error = rng.standard_normal((20_000, 6)) @ factor.T
    found = nees(error, np.repeat((factor @ factor.T)[None], len(error), axis=0))
    assert abs(found.mean() - 6.0) < 4.0 * np.sqrt(12.0 / len(error))


def test_a_covariance_that_says_nothing_gives_no_nees() -> None:
    """GIVEN covariances that are indefinite, empty, not finite WHEN the NEES is taken THEN it is NaN, others stand."""
    covariance = np.repeat(np.eye(6)[None], 5, axis=0)
    covariance[0, 0, 1] = covariance[0, 1, 0] = 1.5
    covariance[1] = 0.0
    covariance[2, 3, 3] = np.nan
    error = np.ones((5, 6))
    error[3, 0] = np.nan
    found = nees(error, covariance)
    assert np.isnan(found[:4]).all()
    assert found[4] == 6.0


def test_the_drag_scale_that_fits_is_found() -> None:
    """GIVEN an error that a scale of 1.6 removes WHEN sought THEN 1.6; no drag: 1; beyond the range: its end."""
    by_scale = np.outer(np.arange(1.0, 30.0) ** 2, [0.1, -0.3, 0.2])
    assert best_scale(-0.6 * by_scale, by_scale) == pytest.approx(1.6)
    assert best_scale(-0.6 * by_scale, 0.0 * by_scale) == 1.0
    assert best_scale(2.5 * by_scale, by_scale) == 0.0
    assert best_scale(-9.0 * by_scale, by_scale) == 4.0


@pytest.mark.parametrize(
    ("blocks", "wanted"),
    [
        ([9.0] * 7 + [1.0] * 60, 70.0),
        ([9.0] * 7 + [1.0] * 30 + [9.0] + [1.0] * 60, 380.0),
        ([9.0] * 7 + [1.0] * 59, np.inf),
        ([1.0] * 60, 0.0),
    ],
)
def test_converged_is_ten_minutes_below_three_times_the_steady_rms(blocks: list[float], wanted: float) -> None:
    """GIVEN largest errors of every 10 s and a steady rms of 0.5 m THEN converged when 1.5 m holds for 600 s."""
    assert converged_s(np.array(blocks), 0.5) == wanted


def test_near_again_counts_to_the_last_second_beyond_5_m() -> None:
    error = np.full(900, 1.0)
    assert near_s(error) == 0.0
    error[[3, 42]] = 5.1
    assert near_s(error) == 43.0
    error[899] = np.inf
    assert near_s(error) == np.inf


def test_steady_again_when_the_rms_of_a_minute_is_within_twice_the_steady_one() -> None:
    """GIVEN 10 m for 100 s, then 1 m WHEN the steady rms is 0.6 m THEN steady as soon as all of a minute is 1 m."""
    error = np.where(np.arange(900) < 100, 10.0, 1.0)
    assert steady_again_s(error, 0.6) == 100.0
    assert steady_again_s(error, 0.4) == np.inf
    # one second of 10 m in a minute is an rms of 1.63 m
    assert steady_again_s(error, 0.8) == 100.0
    assert steady_again_s(error, 0.9) == 99.0


def test_late_by_chance_is_what_steady_flight_itself_would_say() -> None:
    """GIVEN 1 m but for 700 s of 9 m WHEN every instant is judged as a return THEN late where all windows have 9 m.

    A window of 60 s with k seconds of 9 m is within 2 m for k <= 2; a return is late if none of 601 windows is.
    """
    error = np.ones(5000)
    error[2000:2700] = 9.0
    late = [t for t in range(5000 - 660 + 1) if steady_again_s(error[t : t + 660], 1.0) > 600.0]
    assert late[0] == 2000 - 57
    assert chance_of_a_late_return(error, 1.0) == pytest.approx(len(late) / (5000 - 660 + 1), rel=1e-5)
    assert chance_of_a_late_return(np.ones(659), 1.0) is None


def figures(starts: int = 4) -> dict[str, np.ndarray]:
    """Figures of a case: start n has an error of n + 1 m along x at all ages, bounds of 4 m, floors of half of it."""
    ages, seconds = len(PLAN.curve_s), np.arange(20_000.0)
    error = np.zeros((starts, ages, 3))
    error[:, :, 0] = np.arange(1.0, starts + 1)[:, None]
    error[0, 200:] = np.nan  # the orbit ends there for the first
    return {
        "flight_t_s": seconds,
        "flight_3d_m": np.where(seconds < 12_000, 50.0, np.where(seconds % 2 == 0, 0.3, 0.4)),
        "flight_3d_mps": np.full(len(seconds), 1e-3),
        "flight_axis_m": np.where(seconds == 15_000, 2.0, 0.3),
        "flight_bound_m": np.full(len(seconds), 1.5),
        "flight_nees": np.full(len(seconds), 3.0),
        "start_phase_deg": np.arange(starts) * 60.0,
        "converging_3d_m": np.full((starts, 1200), 0.5),
        "outage_error_m": error,
        "outage_bound_m": np.where(np.isnan(error[:, :, 0]), np.nan, 4.0),
        "outage_nees": np.full((starts, ages), 9.0),
        "outage_ticks": np.full(starts, 7200),
        "outage_beyond": np.full(starts, 36),
        "floor_m": 0.5 * error,
        "floor_drag_m": 0.1 * error,
        "drag_scale": np.full(starts, 1.2),
        "return_3d_m": np.full((starts, len(RETURNS_S), RETURN_S), 0.5),
        "return_mode_s": np.full((starts, len(RETURNS_S)), 4.0),
        "return_ticks": np.full((starts, len(RETURNS_S)), RETURN_S),
        "return_beyond": np.zeros((starts, len(RETURNS_S)), int),
    }


def test_figures_of_an_age_are_those_of_the_starts_that_reach_it() -> None:
    """GIVEN errors of 1 to 4 m, the first of which ends early WHEN summed up THEN by hand the same."""
    early, late = (age_figures(PLAN, figures(), age) for age in (300, 7200))
    assert (early["starts"], late["starts"]) == (4, 3)
    assert (early["median_m"], late["median_m"], late["max_m"]) == (2.5, 3.0, 4.0)
    assert late["q997_m"] == pytest.approx(3.0 + 0.994)
    assert late["rms_3d_m"] == pytest.approx(np.sqrt((4 + 9 + 16) / 3), rel=1e-5)
    assert late["worst_error_to_bound"] == 1.0
    assert (late["nees_per_state"], late["nees_per_state_standard_error"]) == (1.5, 0.0)
    assert (late["floor_median_m"], late["floor_max_m"]) == (1.5, 2.0)
    assert late["floor_share"] == pytest.approx(0.25)
    assert late["floor_drag_share"] == pytest.approx(0.01)


def test_a_bound_that_is_no_number_is_beyond_all_ratios_and_a_lost_state_all_errors() -> None:
    """GIVEN a start without bound, and one without state WHEN summed up THEN neither passes for a good one."""
    broken = figures()
    broken["outage_bound_m"][2, 10] = np.nan
    broken["outage_error_m"][3, 10] = np.inf
    found = age_figures(PLAN, broken, 220)
    assert found["starts"] == 4
    assert found["worst_error_to_bound"] is None
    assert found["max_m"] is None


def test_steady_figures_are_those_after_convergence() -> None:
    """GIVEN 50 m before 12000 s, 0.3 and 0.4 m after WHEN summed up THEN the rms of these two, and one bound broken."""
    found = steady_figures(PLAN, figures())
    assert found["rms_3d_m"] == pytest.approx(np.sqrt(0.125), rel=1e-5)
    assert (found["max_3d_m"], found["rms_3d_mps"], found["nees_per_state"]) == (0.4, 1e-3, 0.5)
    assert found["beyond_bound_share"] == pytest.approx(1 / 8000)


def test_the_error_of_a_mean_nees_is_that_of_revolutions_not_of_seconds() -> None:
    """GIVEN two revolutions of NEES 3 and 9 by 6 states WHEN averaged THEN 1, and an error of 0.5."""
    slow = figures()
    slow["flight_t_s"] = np.arange(24_000.0)
    for name in ("flight_3d_m", "flight_3d_mps", "flight_axis_m", "flight_bound_m"):
        slow[name] = np.full(24_000, 0.1)
    slow["flight_nees"] = np.where(slow["flight_t_s"] < 18_000, 3.0, 9.0)
    found = steady_figures(PLAN, slow)
    assert (found["nees_per_state"], found["nees_per_state_standard_error"]) == (1.0, 0.5)
    # one revolution has no scatter
    assert steady_figures(PLAN, figures())["nees_per_state_standard_error"] is None


def test_a_state_lost_in_steady_flight_is_no_steady_flight() -> None:
    lost = figures()
    lost["flight_3d_m"][13_000] = np.nan
    assert steady_figures(PLAN, lost)["rms_3d_m"] is None


def test_returns_count_those_flown_to_the_end_and_judge_each() -> None:
    """GIVEN a return not flown, one late at 5 m, one never steady, a good one WHEN counted THEN 3 runs, 2 in time."""
    some = figures()
    some["return_3d_m"][0, 1] = np.nan
    some["return_3d_m"][1, 1, 70] = 6.0
    some["return_3d_m"][2, 1] = 3.0
    found = return_figures(PLAN, some, 1, 0.3)
    assert (found["runs"], found["near_in_time"], found["near_max_s"]) == (3, 2, 71.0)
    assert (found["steady_in_time"], found["steady_max_s"]) == (2, None)
    assert found["integrated_max_s"] == 4.0
    assert found["rms_then_by_steady"] == pytest.approx(np.sqrt((0.25 + 0.25 + 9.0) / 3) / 0.3, rel=1e-5)


def test_every_start_is_listed() -> None:
    listed = start_list(replace(PLAN, begins_s=(0, 1000, 2000, 3000)), figures())
    assert [one["start_s"] for one in listed] == [12_000, 13_000, 14_000, 15_000]
    assert [one["error_m"]["7200"] for one in listed] == [None, 2.0, 3.0, 4.0]
    assert listed[2]["argument_of_latitude_deg"] == 120.0


def test_validation_counts_outages_and_the_arcs_that_do_not_overlap() -> None:
    """GIVEN three outages, 1000 s apart, of errors of 0.2, 0.4 and 0.5 of their bound, and one beyond it between the
    ages kept WHEN validated THEN worst and quantile are those of the outages, and one arc of them is independent."""
    plan = case().plan
    bound = np.full((3, len(plan.curve_s)), 10.0)
    error = np.zeros((3, len(plan.curve_s), 3))
    error[:, 5, 1] = [2.0, -4.0, 5.0]
    error[2, 50:] = np.nan
    figures = {"outage_error_m": error, "outage_bound_m": bound, "outage_beyond": np.array([0, 1, 0])}
    found = validation_figures(plan, figures)
    assert (found["outages"], found["independent_arcs"], found["violated"]) == (3, 1, 1)
    assert found["worst_error_to_bound"] == 0.5
    assert found["q95_error_to_bound"] == pytest.approx(0.49)
    bound[0, 7] = np.nan  # a state without a bound
    assert validation_figures(plan, figures)["worst_error_to_bound"] is None


def test_measured_orbits_are_pooled_by_their_outages() -> None:
    """GIVEN two measured orbits and a simulated one with white fixes, one measured one with coloured ones WHEN pooled
    THEN white ones are the outages of the two measured orbits together, and nobody is pooled alone."""

    def told(profile: str, measured: bool, ratios: list[float | None], violated: int) -> dict[str, Any]:
        validation = {"error_to_bound": ratios, "independent_arcs": 2, "violated": violated}
        return {"profile": profile, "measured": measured, "validation": validation}

    first, second = told("white", True, [0.1, 0.2, 0.3], 0), told("white", True, [0.5], 1)
    simulated, alone = told("white", False, [0.9], 1), told("coloured", True, [0.7], 1)
    (pooled,) = pooled_validation([first, simulated, second, alone])
    assert pooled["profile"] == "white"
    found = pooled["validation"]
    assert (found["outages"], found["independent_arcs"], found["violated"]) == (4, 4, 1)
    assert found["worst_error_to_bound"] == 0.5
    assert found["tightness_q95"] == pytest.approx(1.0 / 0.47)
    (pooled,) = pooled_validation([first, told("white", True, [None], 1)])
    assert pooled["validation"]["worst_error_to_bound"] is None
