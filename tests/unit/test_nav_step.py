"""The navigation step as a whole: time set anew, convergence, no memory taken, nothing kept by a reset."""

from __future__ import annotations

import gc
import sys

import numpy as np
import pytest
from flight_bench import (
    NS,
    T0_GPS_NS,
    calls,
    changed_fields,
    circular_orbit,
    counter_at,
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
from flightsw.icd.enums import FlagState, Mode, RejectCause, Verdict
from flightsw.memory import Memory
from flightsw.nav.step import step

ORBIT = circular_orbit(500e3)
TIME_JUMP_REJECTED = 1 << int(AlertId.TIME_JUMP_REJECTED)
CLOCK_REINITIALISED = 1 << int(AlertId.CLOCK_REINITIALISED)


def truth(t_gps_ns):
    return two_body(ORBIT, t_gps_ns)


def jumped(first_s, stop_s, jump_ns, fixes_too=True):
    """One step a second; the receiver's GPS time is off by the jump, in pulses and in fixes, the counter is not."""
    t = seconds(first_s, stop_s)
    inputs = calls(t)
    put_pulses(inputs, slice(None), t)
    put_fixes(inputs, slice(None), t, truth)
    inputs["pulse_gps_ns"] += jump_ns
    inputs["fix_gps_ns"] += jump_ns if fixes_too else 0
    return inputs


CLOCK = ("clock_valid", "clock_gps_ns", "clock_counter_ns", "clock_phase_ns", "clock_drift", "clock_p")


@pytest.mark.parametrize(
    "jump_ns",
    [1_000_000, -1_000_000, NS, -NS, -1024 * 604_800 * NS, -100 * NS],
    ids=["1 ms", "-1 ms", "1 s", "leap second", "week rollover", "backwards"],
)
def test_time_jumps_change_no_state_and_true_time_is_taken_at_once(jump_ns):
    """GIVEN a converged filter WHEN receiver time jumps for ten seconds THEN state and clock coast as with no receiver
    at all, to the bit, and the first true second is used."""
    memory, alone = (loaded_memory("two_body") for _ in range(2))
    for each in (memory, alone):
        finish(run(each, steady_calls(60, truth)))
    for out in run(memory, jumped(60, 70, jump_ns)):
        assert not out.fix_used
        assert int(out.events) & TIME_JUMP_REJECTED
    finish(run(alone, calls(seconds(60, 70))))
    expected = {
        "rejected",
        "pulse_gps_ns",
        "pulse_counter_ns",
        "pulse_first_gps_ns",
        "pulse_first_counter_ns",
        "pulse_chain",
    }
    assert changed_fields(memory.nav, alone.nav) <= expected
    nav = record(memory.nav)
    assert nav.rejected[RejectCause.SYNC_JUMP] == 10
    out = finish(run(memory, jumped(70, 71, 0)))
    assert out.fix_used
    assert np.abs(out.r_gcrf_m - truth(seconds(70, 71))[0][0]).max() < 0.05


def test_time_that_stays_wrong_is_set_anew_with_alert_flag_and_a_new_start():
    """GIVEN receiver time off by 1 s for good WHEN 20 pulses have agreed THEN the clock restarts, the flag is raised at
    once, what is stored against the old time is forgotten, and navigation starts from fixes."""
    memory = loaded_memory("two_body", clock_restart_pulses=20, stored_da_after_fixes=10)
    finish(run(memory, steady_calls(60, truth)))
    assert finish(run(memory, calls(seconds(59, 60)))).da_coverage_pct >= 0
    assert record(memory.nav).da_samples.sum() > 0
    outs = []
    for out in run(memory, jumped(60, 120, NS)):
        outs.append((int(out.events), int(out.flag), int(out.verdict), int(out.mode), float(out.flag_age_s)))
    restarted = [index for index, row in enumerate(outs) if row[0] & CLOCK_REINITIALISED]
    assert restarted == [19]
    _, flag, verdict, mode, flag_age = outs[19]
    assert (flag, verdict, mode) == (FlagState.RAISED, Verdict.DO_NOT_USE, Mode.INIT)
    assert flag_age == pytest.approx(19.0, abs=1.01)
    nav = record(memory.nav)
    assert nav.clock_gps_ns == T0_GPS_NS + 120 * NS
    assert nav.da_samples[nav.da_t_gps_ns < T0_GPS_NS + 80 * NS].sum() == 0
    assert outs[-1][1:4] == (FlagState.CLEAR, Verdict.TRUSTED, Mode.INTEGRATED)


def test_the_passage_of_a_bin_of_stored_da_ends_with_the_fixes():
    """Coarse bins, a short outage within one of them: what was stored before it is not mixed with what comes after."""
    memory = loaded_memory("two_body", stored_da_after_fixes=10, stored_da_bins=8)
    inputs = steady_calls(160, truth)
    inputs["fix_present"][60:90] = 0
    finish(run(memory, inputs))
    assert record(memory.nav).da_samples.max() == 70 - 9


@pytest.mark.compiled
def test_white_noise_is_averaged_to_what_the_covariance_says():
    """Integrated mode on a two-body truth, 1 m and 1 m/s: errors within five sigmas, 6 to 12 times below the fixes."""
    memory = loaded_memory("two_body")
    errors, sigmas = [], []
    noise = np.random.default_rng(42)
    r, _ = truth(seconds(0, 1200))
    for k, out in enumerate(run(memory, steady_calls(1200, truth, noise=noise))):
        if k > 600:
            errors.append(out.r_gcrf_m - r[k])
            sigmas.append(np.sqrt(np.diag(record(memory.nav).P)[:3]))
    ratio = np.abs(errors) / np.array(sigmas)
    assert ratio.max() < 5.0
    assert np.sqrt(np.mean(np.square(errors))) < 0.25


@pytest.mark.compiled
def test_a_step_takes_no_memory():
    """Blocks of Python after 20,000 steps with pulses, fixes, rejected fixes and an outage: none more."""
    memory = loaded_memory("two_body")
    inputs = np.concatenate((steady_calls(200, truth), calls(seconds(200, 400))))
    inputs["fix_type"][50:60] = 0
    inputs["fix_gps_ns"][70:80] += 10**9
    singles = [inputs[k : k + 1] for k in range(len(inputs))]
    arguments = (memory.table, memory.orientation, memory.forces, memory.field, memory.work, memory.scratch)

    def fly():
        for single in singles:
            step(memory.nav, single, *arguments, memory.output)

    fly()
    gc.collect()
    gc.disable()
    try:
        before = sys.getallocatedblocks()
        for _ in range(50):
            fly()
        after = sys.getallocatedblocks()
    finally:
        gc.enable()
    assert after - before <= 20


def test_reset_leaves_nothing_behind():
    """A flight after a reset is that of a new memory, to the bit; a new memory shares nothing with an old one."""
    used = loaded_memory("two_body", stored_da_after_fixes=10)
    inputs = steady_calls(60, truth, noise=np.random.default_rng(3))
    finish(run(used, inputs))
    first = used.nav.copy(), used.output.copy()
    used.reset()
    fresh = loaded_memory("two_body", stored_da_after_fixes=10)
    for name in ("nav", "input", "output", "work"):
        assert changed_fields(getattr(used, name), getattr(fresh, name)) == set(), name
    finish(run(used, inputs))
    assert changed_fields(first[0], used.nav) == set()
    assert changed_fields(first[1], used.output) == set()
    assert record(Memory().nav).fixes_accepted == 0
    assert np.isnan(record(fresh.nav).flag_age_s)
    assert record(fresh.nav).da_bin == -1


def test_tables_cannot_be_written():
    memory = loaded_memory("two_body")
    for image in (memory.table, memory.orientation):
        name = image.dtype.names[0]
        with pytest.raises(ValueError, match="read-only"):
            image[name] = 0


def test_counter_origin_is_arbitrary():
    """The same flight on a counter that starts near the end of its range of a century."""
    results = []
    for origin in (0, 3_000_000_000_000_000_000, -3_000_000_000_000_000_000):
        memory = loaded_memory("two_body")
        inputs = steady_calls(30, truth)
        for field in ("counter_now_ns", "pulse_counter_ns", "fix_counter_ns"):
            inputs[field] += origin
        finish(run(memory, inputs))
        results.append((memory.nav["x"].copy(), memory.nav["P"].copy(), memory.output["bound_m"].copy()))
    assert counter_at(T0_GPS_NS) == 77 * NS
    for other in results[1:]:
        for a, b in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(a, b)
