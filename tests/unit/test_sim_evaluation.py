"""Figures of a run, on runs made up so that every expected number can be read off."""

from typing import Any

import numpy as np
import pytest

from flightsw.icd.can_frames import INTEGRITY, NAV_STATE
from flightsw.icd.enums import Verdict
from hil_sim import evaluation

T0_NS = 1_230_336_000 * 10**9
TICK_S = 0.1
INTEGRATED, AUTONOMOUS = 1, 2
START_S, END_S = 1000.0, 3200.0
RUN_S = 3600.0


def made_up_run(
    error_rate_mps: float = 1.0, bound_rate_mps: float = 2.0, flag_at_m: float = 2000.0, settle_m: float = np.inf
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Fixes every second (the last at 999 s), outage 1000 to 3200 s; error and bound grow linearly from the last fix.

    While integrated the error is 5 m on y and the bound 20 m. Fixes are accepted again from 3200 s; the flag
    clears, and the mode is INTEGRATED, from 3230 s.
    """
    n = round(RUN_S / TICK_S)
    t = np.arange(n) * TICK_S
    age = np.where(t < START_S, t % 1.0, np.where(t < END_S, t - (START_S - 1.0), t % 1.0))
    outage = (t >= START_S) & (t < END_S)
    error = np.where(outage, 5.0 + error_rate_mps * age, 5.0)
    bound = np.where(outage, np.minimum(20.0 + bound_rate_mps * age, settle_m), 20.0)
    flagged = (np.maximum.accumulate(np.where(outage, bound, 0.0)) > flag_at_m) & (t < 3230.0)
    r = np.zeros((n, 3))
    r[:, 0] = 7e6
    nav = np.zeros(n, dtype=NAV_STATE.dtype)
    nav["x_gcrf_m"] = 7e6 + 0.5 * error
    nav["y_gcrf_m"] = -error
    nav["vy_gcrf_mps"] = 7500.25
    nav["validity"] = 7
    integrity = np.zeros(n, dtype=INTEGRITY.dtype)
    integrity["bound_m"] = bound
    integrity["bound_3d_m"] = 1.2 * bound
    integrity["limit_m"] = 2000.0
    integrity["fix_age_s"] = age
    integrity["mode"] = np.where((t >= START_S + 2.0) & (t < 3230.0), AUTONOMOUS, INTEGRATED)
    integrity["flag_state"] = flagged
    truth = {
        "tick": np.arange(n),
        "t_true_gps_ns": T0_NS + np.arange(n) * 100_000_000,
        "r_gcrf_m": r,
        "v_gcrf_mps": np.tile([0.0, 7500.0, 0.0], (n, 1)),
        "fix_error_m": np.tile([1.0, -12.0, 3.0], (500, 1)),
        "outages": np.array([[T0_NS + 10**12, T0_NS + 3_200 * 10**9]]),
    }
    return truth, {"tick": np.arange(n), "nav": nav, "integrity": integrity}


def test_an_outage_that_holds() -> None:
    """Error 5 + a, bound 20 + 2a: flag at a = 990 s, crossing at a = 1995 s, no violation."""
    result = evaluation.evaluate(*made_up_run())
    (outage,) = result["outages"]
    assert (outage["start_s"], outage["end_s"], outage["last_accepted_fix_s"]) == (1000.0, 3200.0, 999.0)
    assert outage["eps_m"] == 2000.0
    assert outage["flag_raised_age_s"] == pytest.approx(990.0, abs=0.11)
    assert outage["error_crossed_eps_age_s"] == pytest.approx(1995.0, abs=0.11)
    assert outage["bound_at_flag_m"] == pytest.approx(2000.0, abs=0.3)
    assert (outage["violations"], outage["violated"], outage["first_violation_age_s"]) == (0, False, None)
    assert outage["epochs"] == pytest.approx(9900, abs=3)
    assert outage["error_at_900_s_m"] == pytest.approx(905.0, abs=0.11)
    assert outage["bound_at_900_s_m"] == pytest.approx(1820.0, abs=0.21)
    assert outage["error_at_2000_s_m"] == pytest.approx(2005.0, abs=0.11)
    assert outage["error_max_m"] == pytest.approx(2205.9, abs=0.2)
    assert outage["back_in_service_s"] == 30.0
    assert outage["worst_error_to_bound"] < 0.5
    assert result["fault_of_table"] is None


def test_integrated_figures_leave_out_settling_and_outage() -> None:
    """Largest axis: 5 m, 0.25 m/s, fixes 12 m; from 600 s to the last fix at 999 s and from 3230 s on."""
    integrated = evaluation.evaluate(*made_up_run())["integrated"]
    assert integrated["position_rms_m"] == integrated["position_max_m"] == 5.0
    assert integrated["velocity_rms_mps"] == 0.25
    assert integrated["fix_rms_m"] == 12.0
    assert integrated["epochs"] == pytest.approx((999 - 600 + 3600 - 3230) * 10, abs=3)


def test_violations_are_counted_up_to_the_flag() -> None:
    """Error 5 + 2a against bound 20 + a: below from a = 15 s; the flag at a = 1980 s comes after the crossing."""
    (outage,) = evaluation.evaluate(*made_up_run(error_rate_mps=2.0, bound_rate_mps=1.0))["outages"]
    assert outage["first_violation_age_s"] == pytest.approx(15.0, abs=0.2)
    assert outage["violations"] == pytest.approx(19650, abs=5)
    assert outage["violations_3d"] > 19000
    assert outage["error_crossed_eps_age_s"] < outage["flag_raised_age_s"]
    assert outage["violated"]


def test_a_bound_that_settles_is_a_fault_of_the_table() -> None:
    """The paper's Table 1: the bound stays at 494 m, the flag never comes."""
    result = evaluation.evaluate(*made_up_run(settle_m=494.0))
    (outage,) = result["outages"]
    assert outage["flag_raised_age_s"] is None
    assert outage["violations"] > 0
    assert "settles at 494 m" in result["fault_of_table"]
    assert result["fault_of_table"] == outage["fault_of_table"]


def test_a_slow_bound_is_no_settled_bound() -> None:
    result = evaluation.evaluate(*made_up_run(bound_rate_mps=0.5))
    assert result["fault_of_table"] is None
    assert result["outages"][0]["flag_raised_age_s"] is None


def test_a_bound_that_is_no_number_covers_nothing() -> None:
    truth, monitor = made_up_run()
    monitor["integrity"]["bound_m"][11_000:11_100] = np.nan
    assert evaluation.evaluate(truth, monitor)["outages"][0]["violations"] == 100


def test_what_flight_said_is_counted_tick_by_tick() -> None:
    """GIVEN TRUSTED for three quarters and DO_NOT_USE for the rest WHEN evaluated THEN these shares and no other."""
    truth, monitor = made_up_run()
    monitor["integrity"]["verdict"] = Verdict.TRUSTED
    monitor["integrity"]["verdict"][27_000:] = Verdict.DO_NOT_USE
    assert evaluation.evaluate(truth, monitor)["said"] == {"TRUSTED": 0.75, "DO_NOT_USE": 0.25}


def test_silence_is_counted_apart() -> None:
    """Ticks without a state are neither covered nor violated."""
    truth, monitor = made_up_run(error_rate_mps=2.0, bound_rate_mps=1.0)
    before = evaluation.evaluate(truth, monitor)["outages"][0]
    monitor["has_nav"] = np.ones(len(monitor["tick"]), dtype=bool)
    monitor["has_nav"][15_000:15_050] = False
    result = evaluation.evaluate(truth, monitor)
    assert result["ticks_without_output"] == 50
    assert before["epochs"] - result["outages"][0]["epochs"] == 50
    assert before["violations"] - result["outages"][0]["violations"] == 50


def test_no_return_to_service() -> None:
    truth, monitor = made_up_run()
    monitor["integrity"]["mode"][32_000:] = AUTONOMOUS
    (outage,) = evaluation.evaluate(truth, monitor)["outages"]
    assert outage["back_in_service_s"] is None


def test_fixes_rejected_after_the_outage_prolong_it() -> None:
    """GIVEN GNSS back at 3200 s but no fix accepted until 3300 s THEN epochs run on, and service counts from 3200 s."""
    truth, monitor = made_up_run(flag_at_m=1e9, bound_rate_mps=2.0)
    t = np.arange(len(monitor["tick"])) * TICK_S
    rejected = (t >= END_S) & (t < 3300.0)
    monitor["integrity"]["fix_age_s"][rejected] = t[rejected] - 999.0
    (outage,) = evaluation.evaluate(truth, monitor)["outages"]
    assert outage["epochs"] == pytest.approx((3300 - 999) * 10, abs=3)
    assert outage["back_in_service_s"] == pytest.approx(100.0, abs=0.2)


def test_ages_by_a_drifted_onboard_clock() -> None:
    """GIVEN an onboard clock 20 ms off after the outage THEN the first new fix still ends it."""
    truth, monitor = made_up_run()
    plain = evaluation.evaluate(truth, monitor)["outages"][0]
    monitor["integrity"]["fix_age_s"][32_000:] += 0.02
    assert evaluation.evaluate(truth, monitor)["outages"][0]["epochs"] == plain["epochs"]


def test_a_run_without_outage_or_data() -> None:
    truth, monitor = made_up_run()
    truth["outages"] = np.zeros((0, 2), dtype=np.int64)
    assert evaluation.evaluate(truth, monitor)["outages"] == []
    empty = {key: value[:0] for key, value in monitor.items()}
    result = evaluation.evaluate(truth | {"outages": np.array([[T0_NS, T0_NS + 10**12]])}, empty)
    assert result["integrated"]["position_rms_m"] is None
    assert result["outages"][0]["epochs"] == 0


def test_from_the_files_of_a_run(tmp_path) -> None:
    truth, monitor = made_up_run()
    np.savez(tmp_path / "truth.npz", **truth)
    np.savez(tmp_path / "monitor.npz", **monitor)
    assert evaluation.evaluate_run(tmp_path) == evaluation.evaluate(truth, monitor)
