"""What of the paper is so and what is not: the figures of issue and ledger, flown from twenty seeds and start phases.

One measurement serves all tests of this file. Thresholds are the requirement's, or those of an independent prototype.
"""

from __future__ import annotations

import math
from statistics import median

import pytest

from ground.studies.flights import usual_jobs
from ground.studies.ledger import ROWS, Row
from ground.studies.measurement import Effort, Measured, measure
from ground.studies.outage import OutageRun

RUNS = 20
EFFORT = Effort(runs=RUNS, fresh_runs=2, side_runs=3, sigmas_m=(33.0, 100.0), thin=True)


@pytest.fixture(scope="module")
def measured() -> Measured:
    """The ledger's measurement with the paper's outage in full and everything else thinned out."""
    return measure(EFFORT, usual_jobs(), lambda: None)


def figures(runs: list[OutageRun], key: str) -> list[float]:
    """A figure of each run; every run must have reached it."""
    values = [getattr(run, key) for run in runs]
    assert None not in values, f"{key} was not reached in {values.count(None)} of {len(runs)} runs"
    return values


@pytest.mark.parametrize("noise", ["paper_1m", "paper_33m"])
def test_error_passes_the_limit_after_some_900_s(measured: Measured, noise: str) -> None:
    """GIVEN fixes of 1 m or 33 m WHEN GNSS is lost at twenty start phases THEN the error passes 2000 m at a median
    age between 450 s and 1300 s (paper: about 900 s)."""
    runs = getattr(measured, noise)
    assert len({run.phase_deg for run in runs}) == len({run.seed for run in runs}) == RUNS
    assert 450.0 <= median(figures(runs, "crossed_age_s")) <= 1300.0


@pytest.mark.parametrize("noise", ["paper_1m", "paper_33m"])
def test_the_shipped_row_holds_on_every_start_phase(measured: Measured, noise: str) -> None:
    """GIVEN the shipped row for (17) WHEN GNSS is lost at twenty start phases THEN the bound is never below the error
    until the flag, and the flag comes before the error passes the limit; with 1 m fixes not before 0.6 of that."""
    runs = getattr(measured, noise)
    assert [run.violations for run in runs] == [0] * RUNS
    for run in runs:
        assert run.epochs > 0
        assert run.flag_age_s is not None
        assert run.crossed_age_s is not None
        assert run.flag_age_s < run.crossed_age_s, f"seed {run.seed}, phase {run.phase_deg}"
    if noise == "paper_1m":
        assert median(figures(runs, "flag_to_crossing")) >= 0.6


@pytest.mark.parametrize("noise", ["paper_1m", "paper_33m"])
def test_back_in_service_after_the_outage(measured: Measured, noise: str) -> None:
    """GIVEN a raised flag WHEN GNSS returns THEN it clears after its 30 accepted fixes, within a minute."""
    assert all(29.0 <= age_s <= 60.0 for age_s in figures(getattr(measured, noise), "back_in_service_s"))


def test_table_1_saturates_and_is_a_fault_of_the_table(measured: Measured) -> None:
    """GIVEN Table 1's autonomous row WHEN GNSS is lost THEN the bound settles at 494 m, the flag never comes although
    the error passes 2000 m, and the evaluation calls it a fault of the table."""
    for run in measured.table_1:
        assert run.bound_max_m == pytest.approx(494.0, abs=2.0)
        assert run.flag_age_s is None
        assert run.crossed_age_s is not None
        assert run.violations > run.epochs / 2
        assert run.fault_of_table is not None
        assert "can never be raised" in run.fault_of_table


def test_the_descent_of_the_paper_finds_an_exact_solution(measured: Measured) -> None:
    """GIVEN one outage of the paper's model WHEN (18) to (23) are solved THEN the bound is 2000 m at T to 1 %, (22) is
    broken at no epoch before, and the row is none that settles; one row for 64 phases holds on all of them, and on 64
    that it was not made from, with other noise."""
    exact, common = measured.tuning.exact, measured.tuning.common
    assert exact.found.trial.at_t_m == pytest.approx(2000.0, rel=0.01)
    assert exact.broken == 0
    assert 450.0 <= exact.t_s <= 1300.0
    assert (common.worst <= 1.0).all()
    assert (common.worst_unseen <= 1.0).all()
    assert median(common.share.tolist()) > 0.5


def test_plain_propagation_reaches_the_limit_in_300_s(measured: Measured) -> None:
    """GIVEN (11) with the Q of integrated mode WHEN GNSS is lost THEN three sigmas reach 2000 m in 300 s."""
    assert figures(measured.plain, "flag_age_s") == pytest.approx([300.0] * len(measured.plain), abs=10.0)


def test_integrated_mode_stays_within_three_sigmas(measured: Measured) -> None:
    """GIVEN 1 m fixes and Table 1's integrated row WHEN integrated THEN the bound holds in 99 % of ticks and the
    published error is metres."""
    assert min(figures(measured.table_1, "covered")) > 0.99
    assert max(figures(measured.table_1, "integrated_rms_m")) < 3.0


def test_ten_times_better_than_the_fix_does_not_hold(measured: Measured) -> None:
    """GIVEN fixes of 33 m and 100 m WHEN the paper's model is tuned at will THEN it is 4 to 7 times better than the
    fix, never 10 (an independent prototype: 6 at 33 m); with Table 1's Q it is no better at all."""
    assert [ratio.sigma_m for ratio in measured.ratios] == [33.0, 100.0]
    for ratio in measured.ratios:
        assert 4.0 < ratio.best < 7.0
        assert ratio.table_1 < 1.0
    assert measured.ratios[0].best < measured.ratio_rk4.best < 10.0


def test_with_j2_and_rk4_the_limit_is_not_reached(measured: Measured) -> None:
    """GIVEN J2 and RK4 onboard, 33 m fixes WHEN GNSS is lost for 2000 s THEN the error stays far below the limit on
    the paper's orbit and on the scenario's, without violation."""
    for run in measured.j2_paper_orbit + measured.j2_outage:
        assert run.crossed_age_s is None
        assert run.error_at_2000_s_m is not None
        assert run.error_at_2000_s_m < 1000.0
        assert run.violations == 0


def test_j2_outage_as_it_ships(measured: Measured) -> None:
    """GIVEN scenario j2_outage as it ships, 33 m and 1 m/s fixes WHEN flown THEN the error at 2000 s is below 400 m and
    the integrated error at least 10 times smaller than the fix's."""
    run = measured.j2_outage[0]
    assert (run.seed, run.phase_deg) == (1, 0.0)
    assert run.error_at_2000_s_m is not None
    assert run.error_at_2000_s_m < 400.0
    assert run.fix_rms_m >= 10.0 * run.integrated_rms_m
    assert measured.ratio_j2_1336_km.best >= 10.0


def test_coordinates_repeat_with_the_period(measured: Measured) -> None:
    """GIVEN a Keplerian period of 5580 s, osculating at the node WHEN two revolutions are flown THEN ascending nodes
    are as far apart as J2 wants it: mean semi-major axis and nodal period to first order (Brouwer 1959; Vallado)."""
    j2, radius_m, mu_m3ps2, tilt = 1.0826e-3, 6378137.0, 3.986004415e14, math.radians(65.0)
    a_m = (mu_m3ps2 * (5580.0 / (2.0 * math.pi)) ** 2) ** (1.0 / 3.0)
    mean_a_m = a_m - 1.5 * j2 * radius_m**2 / a_m * math.sin(tilt) ** 2
    period_s = 2.0 * math.pi * math.sqrt(mean_a_m**3 / mu_m3ps2)
    nodal_s = period_s * (1.0 - 1.5 * j2 * (radius_m / a_m) ** 2 * (4.0 * math.cos(tilt) ** 2 - 1.0))
    assert measured.coordinates.nodal_period_s == pytest.approx(nodal_s, abs=2.0)
    assert measured.coordinates.largest_km == pytest.approx(a_m / 1e3, rel=0.01)


def test_da_repeats_on_the_next_revolution(measured: Measured) -> None:
    """GIVEN the true dA WHEN compared with itself a revolution later THEN it is the same but for a thousandth."""
    assert measured.correction_euler.neighbours > 0.999


def test_estimated_da_carries_the_error_of_euler(measured: Measured) -> None:
    """GIVEN two revolutions of fixes WHEN estimated and true dA are compared THEN with Euler they differ by more than
    half of dA, with RK4 merely by a lag of a minute or two."""
    euler, rk4 = measured.correction_euler, measured.correction_rk4
    assert euler.error_rms_mps2 > 0.5 * euler.true_rms_mps2
    assert euler.estimate_later < 0.9
    assert rk4.estimate_later > 0.99
    assert 60 <= rk4.lag_s <= 150


def test_the_error_of_an_outage_all_but_grows(measured: Measured) -> None:
    """GIVEN outages of 2000 s WHEN the error is followed THEN it falls back by a few per cent at most with 1 m fixes,
    and with 33 m by less than half."""
    assert max(figures(measured.paper_1m, "error_dip")) < 0.05
    assert max(figures(measured.paper_33m, "error_dip")) < 0.5


def test_the_bound_falls_back_within_an_orbit(measured: Measured) -> None:
    """GIVEN a bound by plain propagation WHEN an outage lasts an orbit THEN the bound per axis falls back by up to a
    quarter (prototype: 26 %), the one in space hardly."""
    assert max(dip.axis for dip in measured.dips) == pytest.approx(0.26, abs=0.06)
    assert max(dip.radius for dip in measured.dips) < 0.02


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.test.partition("::")[2])
def test_the_verdict_of_each_row_holds(measured: Measured, row: Row) -> None:
    """GIVEN the measurements WHEN a row of the ledger judges itself THEN they bear its verdict."""
    assert row.holds(measured), row.ours(measured)
