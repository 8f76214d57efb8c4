"""What a fix must be: every cause of rejection, each by one thing wrong with an otherwise good fix."""

from __future__ import annotations

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
    record,
    run,
    seconds,
    steady_calls,
    two_body,
)

from flightsw.icd.enums import RejectCause
from flightsw.nav import fix_checks

ORBIT = circular_orbit(500e3)
WEEK_NS = 604_800 * NS
NOW_S = 20


def truth(t_gps_ns):
    return two_body(ORBIT, t_gps_ns)


@pytest.fixture(scope="module")
def flying():
    """A flight at T0 + 20 s, fixed once a second until 19.0 s; tests work on copies."""
    memory = loaded_memory("two_body", satellites_min=5, future_max_s=1e-3, latency_max_s=0.8)
    out = finish(run(memory, steady_calls(NOW_S, truth)))
    assert out.fix_used
    return memory


def good_fix(at_s=NOW_S - 0.4, now_s=NOW_S):
    inputs = calls(np.array([T0_GPS_NS + round(now_s * NS)]))
    put_fixes(inputs, 0, T0_GPS_NS + round(at_s * NS), truth)
    return inputs


def offer(flying, inputs):
    """Cause of the fix by the whole step, and the fields of NAV that it changed against a step without it."""
    states = []
    for present in (0, 1):
        memory = loaded_memory("two_body", satellites_min=5, future_max_s=1e-3, latency_max_s=0.8)
        memory.nav[:] = flying.nav
        given = inputs.copy()
        given["fix_present"] = present
        out = finish(run(memory, given))
        states.append(memory.nav)
    return int(out.fix_cause), bool(out.fix_used), changed_fields(*states)


def test_the_good_fix_is_used(flying):
    cause, used, _ = offer(flying, good_fix())
    assert used
    assert cause == fix_checks.PASSED


WRONG = {
    "position NaN": ("fix_r_itrf_m", 1, np.nan, RejectCause.NOT_FINITE),
    "position inf": ("fix_r_itrf_m", 2, -np.inf, RejectCause.NOT_FINITE),
    "velocity NaN": ("fix_v_itrf_mps", 0, np.nan, RejectCause.NOT_FINITE),
    "velocity inf": ("fix_v_itrf_mps", 2, np.inf, RejectCause.NOT_FINITE),
    "sigma NaN": ("fix_sigma_r_m", 0, np.nan, RejectCause.NOT_FINITE),
    "velocity sigma inf": ("fix_sigma_v_mps", 2, np.inf, RejectCause.NOT_FINITE),
    "absurd": ("fix_r_itrf_m", 0, 1e300, RejectCause.OUT_OF_RANGE),
    "too far": ("fix_r_itrf_m", 0, 9.1e6, RejectCause.OUT_OF_RANGE),
    "underground": ("fix_r_itrf_m", slice(None), 3e6, RejectCause.OUT_OF_RANGE),
    "null": ("fix_r_itrf_m", slice(None), 0.0, RejectCause.OUT_OF_RANGE),
    "too fast": ("fix_v_itrf_mps", slice(None), 5.3e3, RejectCause.OUT_OF_RANGE),
    "no fix": ("fix_type", None, 0, RejectCause.FIX_TYPE),
    "2-D": ("fix_type", None, 2, RejectCause.FIX_TYPE),
    "unknown type": ("fix_type", None, 200, RejectCause.FIX_TYPE),
    "four satellites": ("fix_satellites", None, 4, RejectCause.SATELLITES),
    "sigma zero": ("fix_sigma_r_m", 1, 0.0, RejectCause.SIGMA),
    "sigma negative": ("fix_sigma_v_mps", 1, -1.0, RejectCause.SIGMA),
    "sigma large": ("fix_sigma_r_m", 2, 1000.1, RejectCause.SIGMA),
    "velocity sigma large": ("fix_sigma_v_mps", 2, 100.1, RejectCause.SIGMA),
    "5 km off": ("fix_r_itrf_m", 0, 5e3, RejectCause.GATE),
    "100 m/s off": ("fix_v_itrf_mps", 0, 100.0, RejectCause.GATE),
}
COUNTED = {"rejected"}
# a time tag is kept for the clock, which restarts from tags that agree for long
TAG = {"pulse_chain", "pulse_gps_ns", "pulse_counter_ns", "pulse_first_gps_ns", "pulse_first_counter_ns"}
GATED = COUNTED | {
    "t_seen_gps_ns",
    "streak",
    "candidate_count",
    "candidate_t_gps_ns",
    "candidate_x",
    "candidate_sigma_r_m",
    "candidate_sigma_v_mps",
}


@pytest.mark.parametrize(("field", "axis", "value", "cause"), WRONG.values(), ids=WRONG)
def test_content(flying, field, axis, value, cause):
    """A rejected fix leaves state, covariances, bound and flag as they were, to the bit."""
    inputs = good_fix()
    if cause == RejectCause.GATE:
        inputs[field][0, axis] += value
    elif axis is None:
        inputs[field] = value
    else:
        inputs[field][0, axis] = value
    got, used, changed = offer(flying, inputs)
    assert got == cause
    assert not used
    assert changed <= (GATED if cause == RejectCause.GATE else COUNTED)


TIMES = {
    "0.9 s old": (-0.5, -0.5, RejectCause.TIME_STALE),
    "2 ms ahead": (0.402, 0.4, RejectCause.TIME_FUTURE),
    "the last one again": (-0.6, -0.6, RejectCause.TIME_STALE),
    "1 ms": (1e-3, 0.0, RejectCause.TIME_JUMP),
    "-1 ms": (-1e-3, 0.0, RejectCause.TIME_JUMP),
    "counter 1 ms": (0.0, 1e-3, RejectCause.TIME_JUMP),
    "counter of the future": (0.0, 0.5, RejectCause.TIME_JUMP),
    "counter long ago": (0.0, -1000.0, RejectCause.TIME_JUMP),
    "1 s": (1.0, 0.0, RejectCause.TIME_FUTURE),
    "leap second": (-1.0, 0.0, RejectCause.TIME_STALE),
    "week rollover": (-1024 * 604_800.0, 0.0, RejectCause.TIME_STALE),
    "week ahead": (604_800.0, 0.0, RejectCause.TIME_FUTURE),
}


@pytest.mark.parametrize(("by_s", "counter_by_s", "cause"), TIMES.values(), ids=TIMES)
def test_time(flying, by_s, counter_by_s, cause):
    inputs = good_fix()
    inputs["fix_gps_ns"] += round(by_s * NS)
    inputs["fix_counter_ns"] += round(counter_by_s * NS)
    got, used, changed = offer(flying, inputs)
    assert got == cause
    assert not used
    assert changed <= COUNTED | TAG


def test_a_fix_whose_time_was_seen_is_repeated(flying):
    memory = loaded_memory("two_body", satellites_min=5, future_max_s=1e-3, latency_max_s=0.8)
    memory.nav[:] = flying.nav
    assert finish(run(memory, good_fix())).fix_used
    before = memory.nav.copy()
    assert finish(run(memory, good_fix(NOW_S - 0.4))).fix_cause == RejectCause.TIME_REPEATED
    assert finish(run(memory, good_fix(NOW_S - 0.5))).fix_cause == RejectCause.TIME_REPEATED  # runs backwards
    assert changed_fields(before, memory.nav) == COUNTED


def test_latency_up_to_the_limit_passes(flying):
    for late_s, cause in ((0.799, fix_checks.PASSED), (0.801, RejectCause.TIME_STALE)):
        assert offer(flying, good_fix(NOW_S + 0.1 - late_s, NOW_S + 0.1))[0] == cause


def test_before_the_clock_is_set_nothing_passes():
    memory = loaded_memory("two_body")
    inputs = good_fix()
    inputs["counter_now_ns"] = counter_at(seconds(NOW_S, NOW_S + 1))
    before = memory.nav.copy()
    out = finish(run(memory, inputs))
    assert out.fix_cause == RejectCause.CLOCK_UNSET
    assert changed_fields(before, memory.nav) - TAG == COUNTED
    assert record(memory.nav).rejected[RejectCause.CLOCK_UNSET] == 1


def test_outside_the_earth_orientation_table_nothing_passes(flying):
    memory = loaded_memory("two_body", satellites_min=5, future_max_s=1e-3, latency_max_s=0.8)
    memory.nav[:] = flying.nav
    memory.orientation.flags.writeable = True
    memory.orientation["t0_gps_ns"] += WEEK_NS
    without = good_fix()
    without["fix_present"] = 0
    finish(run(memory, without))
    before = memory.nav.copy()
    out = finish(run(memory, good_fix()))
    assert out.fix_cause == RejectCause.EARTH_ORIENTATION
    assert changed_fields(before, memory.nav) == COUNTED


def test_a_fix_outside_the_gate_has_an_innovation_record_and_one_refused_before_has_none(flying):
    memory = loaded_memory("two_body", satellites_min=5, future_max_s=1e-3, latency_max_s=0.8)
    memory.nav[:] = flying.nav
    inputs = good_fix()
    inputs["fix_r_itrf_m"][0] *= 1.0 + 5e3 / 6.9e6
    out = finish(run(memory, inputs))
    assert out.fix_cause == RejectCause.GATE
    assert out.nis > out.gate == record(memory.table).gate_nis
    assert np.linalg.norm(out.innovation[:3]) == pytest.approx(5e3, rel=1e-2)
    inputs = good_fix(NOW_S + 0.1, NOW_S + 0.3)
    inputs["fix_type"] = 0
    out = finish(run(memory, inputs))
    assert out.fix_cause == RejectCause.FIX_TYPE
    assert np.isnan(out.nis)
    assert np.isnan(out.innovation).all()
