"""What the step says: the state at its stamp, NaN for what is not known, verdict, validity, alerts."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import (
    NS,
    T0_GPS_NS,
    calls,
    changed_fields,
    circular_orbit,
    finish,
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
from flightsw.icd.enums import DaSource, FlagState, Mode, Validity, Verdict
from flightsw.nav import publish  # noqa: F401  (names the room under test for the lanes)

ORBIT = circular_orbit(500e3) * np.array([1.0, 1.0, 1.0, 1.003, 0.998, 1.001])


def truth(t_gps_ns):
    return two_body(ORBIT, t_gps_ns)


def alert(name):
    return 1 << int(AlertId[name])


@pytest.mark.parametrize("drift", [0.0, 1e-6])
def test_the_state_is_that_of_its_stamp_to_a_millimetre(drift):
    """Two-body truth, fixes without noise; stamps anywhere between fixes and up to 30 s after the last. Held between
    fixes the position would be wrong by kilometres."""
    memory = loaded_memory("two_body")
    fix_times = seconds(5, 60)
    t = np.unique(np.concatenate((seconds(0, 61), T0_GPS_NS + np.random.default_rng(1).integers(0, 90 * NS, 700))))
    inputs = calls(t, drift)
    pulses = np.flatnonzero(((t - T0_GPS_NS) % NS == 0) & (t < T0_GPS_NS + 60 * NS))
    put_pulses(inputs, pulses, t[pulses], drift)
    put_fixes(inputs, np.searchsorted(t, fix_times), fix_times, truth, drift=drift)
    r, v = truth(t)
    checked = 0
    for index, out in enumerate(run(memory, inputs)):
        if t[index] < T0_GPS_NS + 12 * NS:
            continue
        assert abs(int(out.t_gps_ns) - t[index]) <= 3  # the counter itself is whole nanoseconds
        assert np.abs(out.r_gcrf_m - r[index]).max() < 1e-3
        assert np.abs(out.v_gcrf_mps - v[index]).max() < 1e-4
        checked += 1
    assert checked > 500


def test_before_the_clock_nothing_is_said():
    memory = loaded_memory("two_body")
    out = finish(run(memory, calls(seconds(0, 3))))
    assert out.t_gps_ns == 0
    assert out.validity == 0
    assert out.mode == Mode.INIT
    assert out.verdict == Verdict.NOT_READY
    assert out.flag == FlagState.CLEAR
    assert out.outage_age_s == 0.0
    for name in ("r_gcrf_m", "v_gcrf_mps", "da_gcrf_mps2", "bound_m", "bound_3d_m", "fix_age_s", "flag_age_s"):
        assert np.isnan(getattr(out, name)).all(), name


def test_with_a_clock_and_no_fix_only_time_is_valid():
    memory = loaded_memory("two_body")
    out = finish(run(memory, steady_calls(10, truth, fix_from_s=10)))
    assert out.validity == Validity.TIME_VALID
    assert out.t_gps_ns == T0_GPS_NS + 9 * NS
    assert np.isnan(out.r_gcrf_m).all()
    assert np.isnan(out.bound_m)


def test_a_start_is_not_offered_until_a_fix_has_confirmed_it():
    memory = loaded_memory("two_body", init_fixes=1)
    verdicts = [(int(out.verdict), int(out.validity)) for out in run(memory, steady_calls(8, truth, fix_from_s=4))]
    timed = int(Validity.TIME_VALID)
    assert verdicts[3] == (Verdict.NOT_READY, timed)
    assert verdicts[4] == (Verdict.NOT_READY, timed | Validity.INITIALISED)
    assert verdicts[5] == (Verdict.TRUSTED, timed | Validity.INITIALISED | Validity.STATE_VALID)


def test_the_story_of_an_outage():
    """Ages count from the last accepted fix; trusted coasting, then the flag, then never offered."""
    memory = loaded_memory("paper", limit_m=500.0, stored_da_after_fixes=10)
    finish(run(memory, steady_calls(60, truth)))
    raised_at = None
    for k, out in enumerate(run(memory, calls(seconds(60, 700))), start=1):
        assert out.fix_age_s == pytest.approx(k)
        assert out.outage_age_s == pytest.approx(k if k > 3 else 0.0)
        assert bool(int(out.alerts) & alert("OUTAGE_START")) == (k > 3)
        if out.flag == FlagState.RAISED:
            raised_at = k if raised_at is None else raised_at
            assert out.mode == Mode.FAILED
            assert out.verdict == Verdict.DO_NOT_USE
            assert int(out.alerts) & alert("FLAG_RAISED")
            assert not int(out.validity) & Validity.STATE_VALID
            assert out.flag_age_s == pytest.approx(raised_at, abs=1.01)  # the epoch whose interval crosses
            assert np.isfinite(out.bound_m)
        else:
            assert out.mode == (Mode.AUTONOMOUS if k > 3 else Mode.INTEGRATED)
            assert out.verdict == (Verdict.TRUSTED_COASTING if k > 3 else Verdict.TRUSTED)
            assert out.bound_m <= 500.0
            assert np.isnan(out.flag_age_s)
        assert out.limit_m == 500.0
    assert raised_at is not None
    assert out.bound_m > 500.0


def test_stored_da_that_is_missing_is_told():
    """60 s of fixes store about 1 % of the orbit: flown at the start of the outage, then held with an alert."""
    memory = loaded_memory("two_body", stored_da_after_fixes=10)
    finish(run(memory, steady_calls(60, truth)))
    sources = []
    for out in run(memory, calls(seconds(60, 100))):
        sources.append(int(out.da_source))
        held = out.da_source == DaSource.HELD and out.outage_age_s > 0.0
        assert bool(int(out.alerts) & alert("STORED_DA_MISSING")) == held
    assert sources[0] == DaSource.FILTER
    assert sources[-1] == DaSource.HELD
    assert 0 <= out.da_coverage_pct <= 2


def test_a_bound_that_cannot_be_computed_is_nan_and_stale():
    memory = loaded_memory("two_body")
    finish(run(memory, steady_calls(60, truth)))
    nav = record(memory.nav)
    nav.P_bound[:, :] = -1e12 * np.eye(9)  # what no update can make good
    nav.P_bound_ahead[:, :] = nav.P_bound
    out = finish(run(memory, calls(seconds(60, 64))))
    assert np.isnan(out.bound_m)
    assert out.flag == FlagState.STALE
    assert out.verdict == Verdict.DO_NOT_USE
    assert int(out.alerts) & alert("BOUND_STALE")
    inputs = calls(seconds(64, 65))
    put_fixes(inputs, 0, T0_GPS_NS + 64 * NS, truth)
    out = finish(run(memory, inputs))
    assert out.fix_used
    assert np.isfinite(out.bound_m)
    out = finish(run(memory, calls(seconds(65, 66))))
    assert out.flag == FlagState.CLEAR


def test_earth_orientation_that_has_ended_is_told():
    memory = loaded_memory("two_body")
    finish(run(memory, steady_calls(60, truth)))
    memory.orientation.flags.writeable = True
    memory.orientation["t0_gps_ns"] -= 30 * 86_400 * NS
    out = finish(run(memory, calls(seconds(60, 62))))
    assert int(out.alerts) & alert("EARTH_ORIENTATION_EXPIRED")
    assert np.isfinite(out.r_gcrf_m).all()


def test_asking_twice_changes_nothing():
    """A step at the same reading with nothing on the bus: the same record, to the bit."""
    memory = loaded_memory("two_body")
    finish(run(memory, steady_calls(20, truth)))
    again = calls(seconds(19, 20))
    finish(run(memory, again))
    nav, out = memory.nav.copy(), memory.output.copy()
    finish(run(memory, again))
    assert changed_fields(nav, memory.nav) == set()
    assert changed_fields(out, memory.output) == set()
