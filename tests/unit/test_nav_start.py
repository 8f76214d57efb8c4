"""How navigation starts, and starts anew when it is the state that is wrong (nav/candidate.py within the step)."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import (
    NS,
    T0_GPS_NS,
    calls,
    circular_orbit,
    loaded_memory,
    put_fixes,
    put_pulses,
    record,
    run,
    seconds,
    steady_calls,
    two_body,
)

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import FlagState, Mode, RejectCause, Verdict
from flightsw.nav import candidate

ORBIT = circular_orbit(500e3)
REINITIALISED, INITIALISED = 1 << int(AlertId.REINITIALISED), 1 << int(AlertId.INITIALISED)
WRONG = {"5 km": [5e3, 0, 0, 0, 0, 0], "100 m/s": [0, 0, 0, 0, 100.0, 0], "5 km across": [0, 3e3, 4e3, 0, 0, 0]}


def truth(t_gps_ns):
    return two_body(ORBIT, t_gps_ns)


def wrong_between(first_s, stop_s, offset):
    """Truth with an offset on the fixes of [first_s, stop_s)."""

    def fixes(t_gps_ns):
        r, v = truth(t_gps_ns)
        age_s = (np.asarray(t_gps_ns) - T0_GPS_NS) / NS
        bad = ((age_s >= first_s) & (age_s < stop_s))[:, None]
        offset_at = np.asarray(offset(t_gps_ns) if callable(offset) else [offset] * len(r), dtype=float)
        return r + bad * offset_at[:, :3], v + bad * offset_at[:, 3:]

    return fixes


def history(memory, inputs):
    """(error [m], bound, verdict, flag, mode, events, cause) of each step; the error is NaN without a state."""
    rows = []
    for step, out in enumerate(run(memory, inputs)):
        true = truth(np.array([T0_GPS_NS + step * NS]))[0][0]
        rows.append(
            (
                np.abs(out.r_gcrf_m - true).max(),
                float(out.bound_m),
                int(out.verdict),
                int(out.flag),
                int(out.mode),
                int(out.events),
                int(out.fix_cause),
            )
        )
    return np.array(rows)


ERROR, BOUND, VERDICT, FLAG, MODE, EVENTS, CAUSE = range(7)


def assert_honest(rows):
    """Whoever is told to trust the state gets one within its bound."""
    trusted = np.isin(rows[:, VERDICT], (Verdict.TRUSTED, Verdict.TRUSTED_COASTING))
    assert (rows[trusted, ERROR] <= rows[trusted, BOUND]).all()
    assert trusted.any()


def test_three_consistent_fixes():
    """GIVEN fixes from 3 s on WHEN the third has come THEN there is a state, at its time."""
    memory = loaded_memory("two_body")
    rows = history(memory, steady_calls(10, truth))
    assert (rows[:5, MODE] == Mode.INIT).all()
    assert np.isnan(rows[:5, ERROR]).all()
    assert (rows[:5, VERDICT] == Verdict.NOT_READY).all()
    assert rows[5, MODE] == Mode.INTEGRATED
    assert int(rows[5, EVENTS]) & INITIALISED
    assert rows[5, ERROR] < 1e-3
    assert rows[6, VERDICT] == Verdict.TRUSTED
    assert not (rows[6:, EVENTS].astype(int) & INITIALISED).any()


def test_fixes_too_far_apart_do_not_agree():
    memory = loaded_memory("two_body", agreement_gap_max_s=2.0)
    inputs = steady_calls(40, truth)
    inputs["fix_present"][np.arange(40) % 3 != 0] = 0
    rows = history(memory, inputs)
    assert (rows[:, MODE] == Mode.INIT).all()


@pytest.mark.parametrize("offset", WRONG.values(), ids=WRONG)
@pytest.mark.parametrize("init_fixes", [1, 3])
@pytest.mark.parametrize("sigmas", [(1.0, 1.0), (33.0, 1.0)])
def test_a_wrong_first_fix_is_overcome_within_sixty_seconds(init_fixes, offset, sigmas):
    memory = loaded_memory("two_body", init_fixes=init_fixes)
    noise = np.random.default_rng(31)
    inputs = steady_calls(70, wrong_between(0, 3.5, offset), noise=noise, sigma_r_m=sigmas[0], sigma_v_mps=sigmas[1])
    rows = history(memory, inputs)
    assert (rows[63:, VERDICT] == Verdict.TRUSTED).all()
    assert rows[63:, ERROR].max() < 5.0 * sigmas[0]
    assert_honest(rows)
    assert any(rows[:, EVENTS].astype(int) & REINITIALISED) == (init_fixes == 1)


def test_ten_agreeing_rejected_fixes_start_anew_with_alert_and_raised_flag():
    """GIVEN a converged filter WHEN all fixes from 100 s on are 5 km off THEN the tenth starts anew; the flag is up
    until 30 fixes have proven the new state."""
    memory = loaded_memory("two_body", gate_nis=60.0)
    noise = np.random.default_rng(5)
    rows = history(memory, steady_calls(160, wrong_between(100, 1e9, WRONG["5 km"]), noise=noise))
    assert (rows[100:110, CAUSE] == RejectCause.GATE).all()
    assert rows[110, CAUSE] == -1
    reinitialised = np.flatnonzero(rows[:, EVENTS].astype(int) & REINITIALISED)
    assert list(reinitialised) == [109]
    assert (rows[:109, FLAG] == FlagState.CLEAR).all()
    assert (rows[109:139, FLAG] == FlagState.RAISED).all()
    assert (rows[109:139, MODE] == Mode.FAILED).all()
    assert (rows[109:139, VERDICT] == Verdict.DO_NOT_USE).all()
    assert (rows[139:, FLAG] == FlagState.CLEAR).all()
    assert int(rows[139, EVENTS]) & (1 << int(AlertId.FLAG_CLEARED))


def test_nine_agreeing_rejected_fixes_and_a_true_one_change_nothing():
    memory = loaded_memory("two_body")
    rows = history(memory, steady_calls(140, wrong_between(100, 109, WRONG["5 km"])))
    assert (rows[100:109, CAUSE] == RejectCause.GATE).all()
    assert (rows[109:, CAUSE] == -1).all()
    assert not (rows[:, EVENTS].astype(int) & REINITIALISED).any()
    assert rows[:, FLAG].max() == FlagState.CLEAR
    assert rows[110:, ERROR].max() < 0.1
    assert_honest(rows)


def test_an_accepted_fix_ends_the_row_of_rejected_ones():
    """Five wrong, a true one, five wrong that agree with the first five: that is not ten in a row."""
    memory = loaded_memory("two_body")
    inputs = steady_calls(130, wrong_between(100, 111, WRONG["5 km"]))
    put_fixes(inputs, 105, seconds(105, 106), truth)
    rows = history(memory, inputs)
    assert (rows[100:105, CAUSE] == RejectCause.GATE).all()
    assert rows[105, CAUSE] == -1
    assert (rows[106:111, CAUSE] == RejectCause.GATE).all()
    assert not (rows[:, EVENTS].astype(int) & REINITIALISED).any()


def test_a_rejected_fix_starts_the_count_for_clearing_anew():
    """GIVEN a new start at 109 s WHEN one fix at 125 s is wrong THEN the flag clears 30 fixes after that one."""
    memory = loaded_memory("two_body", clear_fixes=30)
    inputs = steady_calls(170, wrong_between(100, 1e9, WRONG["5 km"]))
    put_fixes(inputs, 125, seconds(125, 126), wrong_between(0, 1e9, WRONG["5 km across"]))
    rows = history(memory, inputs)
    assert rows[125, CAUSE] == RejectCause.GATE
    assert (rows[109:155, FLAG] == FlagState.RAISED).all()
    assert rows[155, FLAG] == FlagState.CLEAR


def test_mean_nis_is_over_the_last_fixes_of_the_streak():
    """A plain mean until clear_fixes, then each new fix weighs one in clear_fixes; a rejection starts it anew."""
    memory = loaded_memory("two_body", clear_fixes=8)
    inputs = steady_calls(60, wrong_between(30, 31, WRONG["5 km"]), noise=np.random.default_rng(9))
    expected, count = 0.0, 0
    for out in run(memory, inputs):
        if out.fix_cause == RejectCause.GATE:
            count = 0
        elif out.fix_used and np.isfinite(out.nis):
            count += 1
            per_dof = out.nis / 6.0
            expected = per_dof if count == 1 else expected + (per_dof - expected) / min(count, 8)
            assert out.streak == count
            assert out.mean_nis == pytest.approx(expected, rel=1e-12)
    assert count == 29


def test_rejected_fixes_that_disagree_never_start_anew():
    """Scattered by kilometres: AUTONOMOUS after 3 s, the state coasts on, true fixes are taken again."""
    rng = np.random.default_rng(77)
    memory = loaded_memory("two_body")
    scatter = wrong_between(
        100, 150, lambda t: np.hstack((5e3 * rng.standard_normal((len(t), 3)), np.zeros((len(t), 3))))
    )
    rows = history(memory, steady_calls(160, scatter))
    assert (rows[100:150, CAUSE] == RejectCause.GATE).all()
    assert not (rows[:, EVENTS].astype(int) & REINITIALISED).any()
    assert (rows[103:150, MODE] == Mode.AUTONOMOUS).all()
    assert rows[5:, ERROR].max() < 1.0
    assert (rows[150:, CAUSE] == -1).all()
    assert rows[-1, MODE] == Mode.INTEGRATED
    assert_honest(rows)


def test_integrated_again_after_three_accepted_fixes():
    memory = loaded_memory("two_body", integrated_after_fixes=3)
    inputs = steady_calls(80, truth)
    inputs["fix_present"][40:60] = 0
    rows = history(memory, inputs)
    assert (rows[43:62, MODE] == Mode.AUTONOMOUS).all()  # fix ages 4 s and more, then two fixes
    assert (rows[62:, MODE] == Mode.INTEGRATED).all()
    assert rows[42, MODE] == Mode.INTEGRATED  # 3 s exactly


@pytest.mark.parametrize(
    ("dr_m", "dv_mps", "dt_s", "agrees"),
    [
        (0.0, 0.0, 1.0, True),
        (6.0 * np.sqrt(10.0**2 + 10.0**2 + 0.5**2) - 0.01, 0.0, 1.0, True),
        (6.0 * np.sqrt(10.0**2 + 10.0**2 + 0.5**2) + 0.01, 0.0, 1.0, False),
        (6.0 * np.sqrt(10.0**2 + 10.0**2 + 2.0**2) - 0.01, 0.0, 4.0, True),
        (0.0, 6.0 * np.sqrt(0.5**2 + 0.5**2) - 1e-4, 1.0, True),
        (0.0, 6.0 * np.sqrt(0.5**2 + 0.5**2) + 1e-4, 1.0, False),
        (np.nan, 0.0, 1.0, False),
        (0.0, 0.0, 5.001, False),
        (0.0, 0.0, 0.0, False),
        (0.0, 0.0, -1.0, False),
    ],
)
def test_agreement_is_within_six_sigmas_of_the_difference(dr_m, dv_mps, dt_s, agrees):
    memory = loaded_memory("two_body")
    nav, table, work = (record(getattr(memory, name)) for name in ("nav", "table", "work"))
    for age_s, dr, dv, expected in ((0.0, 0.0, 0.0, 1), (dt_s, dr_m, dv_mps, 2 if agrees else 1)):
        t = T0_GPS_NS + round(age_s * NS)
        r, v = truth(np.array([t]))
        work.z[:3], work.z[3:] = r[0] + [0.0, dr, 0.0], v[0] + [0.0, 0.0, dv]
        assert candidate.offer(nav, table, t, 10.0, 0.5, work) == expected


def test_start_writes_the_papers_covariance():
    """P0 = diag(sigma_R^2, sigma_V^2, (dA_max/3)^2), dA = 0; a fix is never taken as better than the floor."""
    memory = loaded_memory("paper", init_fixes=1, da_max_mps2=0.03)
    t = seconds(0, 4)
    inputs = calls(t)
    put_pulses(inputs, slice(None), t)
    put_fixes(inputs, 3, t[3], truth, sigma_r_m=0.2, sigma_v_mps=2.0)
    for _ in run(memory, inputs):
        pass
    nav = record(memory.nav)
    np.testing.assert_allclose(nav.P, np.diag(np.repeat([1.0, 4.0, 1e-4], 3)), rtol=1e-14)
    np.testing.assert_array_equal(nav.P_bound, nav.P)
    np.testing.assert_array_equal(nav.x[6:], 0.0)
    r, v = truth(t[3:])
    assert np.abs(nav.x[:3] - r[0]).max() < 1e-3
    assert np.abs(nav.x[3:6] - v[0]).max() < 1e-5
