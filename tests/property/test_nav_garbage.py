"""Whatever arrives in a pulse or a fix: the step never raises, and what is wrong never moves the state."""

from __future__ import annotations

from functools import cache

import numpy as np
from flight_bench import (
    NS,
    T0_GPS_NS,
    calls,
    changed_fields,
    circular_orbit,
    finish,
    loaded_memory,
    put_fixes,
    record,
    run,
    steady_calls,
    two_body,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from flightsw.icd.enums import RejectCause
from flightsw.nav import fix_checks
from flightsw.records import INPUT

ORBIT = circular_orbit(500e3)
INT64 = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.sampled_from([-(2**63), -(2**63) + 1, 2**63 - 1, 2**62, -(2**62), 0, 1, -1, T0_GPS_NS, 77 * NS]),
)
REAL = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True), st.sampled_from([np.nan, np.inf, -np.inf, 1e308, 5e-324])
)
VECTOR = st.tuples(REAL, REAL, REAL)
NEAR = st.integers(-5 * NS, 5 * NS)


def truth(t_gps_ns):
    return two_body(ORBIT, t_gps_ns)


@cache
def converged():
    memory = loaded_memory("two_body")
    finish(run(memory, steady_calls(40, truth)))
    return memory


def flown(inputs):
    """NAV after the inputs, and after the same calls with nothing on the bus; the last output."""
    states = []
    for quiet in (True, False):
        memory = loaded_memory("two_body")
        memory.nav[:] = converged().nav
        given_inputs = inputs.copy()
        if quiet:
            given_inputs["pulse_present"] = given_inputs["fix_present"] = 0
        out = finish(run(memory, given_inputs))
        states.append(memory.nav)
    return states[0], states[1], out


def good_fix():
    inputs = calls(np.array([T0_GPS_NS + 40 * NS]))
    put_fixes(inputs, 0, T0_GPS_NS + 40 * NS - NS // 5, truth)
    return inputs


CHAIN = {"pulse_gps_ns", "pulse_counter_ns", "pulse_first_gps_ns", "pulse_first_counter_ns", "pulse_chain"}
CANDIDATE = {f"candidate_{name}" for name in ("count", "t_gps_ns", "x", "sigma_r_m", "sigma_v_mps")}
MAY_CHANGE = {"rejected", "t_seen_gps_ns", "streak"} | CHAIN | CANDIDATE


@settings(max_examples=300)
@given(
    INT64,
    INT64,
    REAL,
    st.integers(0, 255),
    INT64,
    INT64,
    VECTOR,
    VECTOR,
    VECTOR,
    VECTOR,
    st.integers(0, 255),
    st.integers(0, 255),
)
def test_pure_garbage(gps, counter, sigma, status, fix_gps, fix_counter, r, v, sigma_r, sigma_v, satellites, fix_type):
    inputs = calls(np.array([T0_GPS_NS + 40 * NS]))
    values = (1, status, gps, counter, sigma, 1, fix_gps, fix_counter, r, v, sigma_r, sigma_v, satellites, fix_type)
    for name, value in zip((INPUT.names or ())[1:], values, strict=False):
        inputs[name][0] = value
    quiet, after, out = flown(inputs)
    assert not out.fix_used
    assert changed_fields(quiet, after) <= MAY_CHANGE
    assert np.isfinite(out.r_gcrf_m).all()


@settings(max_examples=200)
@given(st.sampled_from(["fix_r_itrf_m", "fix_v_itrf_mps", "fix_sigma_r_m", "fix_sigma_v_mps"]), st.integers(0, 2), REAL)
def test_a_good_fix_with_one_real_of_garbage(field, axis, value):
    inputs = good_fix()
    inputs[field][0, axis] = value
    quiet, after, out = flown(inputs)
    if out.fix_used:  # then it must have been harmless: a plausible sigma, or a value within the gate
        table = record(converged().table)
        assert np.isfinite(value)
        assert out.nis <= table.gate_nis
        if "sigma" in field:
            assert 0.0 < value <= (table.sigma_r_max_m if field == "fix_sigma_r_m" else table.sigma_v_max_mps)
    else:
        assert changed_fields(quiet, after) <= MAY_CHANGE


@settings(max_examples=200)
@given(
    st.one_of(INT64, NEAR.map(lambda d: T0_GPS_NS + 40 * NS + d)), st.one_of(INT64, NEAR.map(lambda d: 117 * NS + d))
)
def test_a_good_fix_at_any_time(gps, counter):
    """It passes only where the two stamps agree within the tolerance of the clock, and neither is late or ahead."""
    inputs = good_fix()
    inputs["fix_gps_ns"], inputs["fix_counter_ns"] = gps, counter
    quiet, after, out = flown(inputs)
    now = T0_GPS_NS + 40 * NS
    agrees = abs((gps - T0_GPS_NS) - (counter - 77 * NS)) <= 30_000
    if not (agrees and now - NS - 30_000 <= gps <= now + 10**6 + 30_000):
        assert not out.fix_used
        assert changed_fields(quiet, after) <= MAY_CHANGE
        assert out.fix_cause in set(RejectCause)


@settings(max_examples=200)
@given(INT64, INT64, REAL, st.integers(0, 255), st.booleans())
def test_a_pulse_of_garbage_leaves_the_clock_alone(gps, counter, sigma, status, near):
    inputs = calls(np.array([T0_GPS_NS + 40 * NS]))
    inputs["pulse_present"], inputs["pulse_status"], inputs["pulse_sigma_ns"] = 1, status, sigma
    inputs["pulse_gps_ns"], inputs["pulse_counter_ns"] = gps, 116 * NS if near else counter
    quiet, after, _ = flown(inputs)
    clock = {"clock_valid", "clock_gps_ns", "clock_counter_ns", "clock_phase_ns", "clock_drift", "clock_p"}
    true_pulse = abs((gps - T0_GPS_NS) - (int(inputs["pulse_counter_ns"][0]) - 77 * NS)) <= 20_000
    if not true_pulse:
        assert not changed_fields(quiet, after) & clock


@settings(max_examples=100)
@given(st.binary(min_size=INPUT.itemsize, max_size=INPUT.itemsize))
def test_any_bits_as_a_whole_input_but_the_counter(raw):
    inputs = np.frombuffer(raw, INPUT).copy()
    inputs["counter_now_ns"] = 117 * NS
    quiet, after, out = flown(inputs)
    assert not out.fix_used
    assert changed_fields(quiet, after) <= MAY_CHANGE


@settings(max_examples=200)
@given(VECTOR, VECTOR, VECTOR, VECTOR, st.integers(0, 255), st.integers(0, 255))
def test_content_checks_pass_only_what_the_table_permits(r, v, sigma_r, sigma_v, satellites, fix_type):
    table = record(converged().table)
    inputs = np.zeros(1, INPUT)
    inp = record(inputs)
    inp.fix_r_itrf_m, inp.fix_v_itrf_mps, inp.fix_sigma_r_m, inp.fix_sigma_v_mps = r, v, sigma_r, sigma_v
    inp.fix_satellites, inp.fix_type = satellites, fix_type
    with np.errstate(all="ignore"):
        numbers = np.array([r, v, sigma_r, sigma_v])
        good = (
            np.isfinite(numbers).all()
            and table.radius_min_m <= np.linalg.norm(numbers[0]) <= table.radius_max_m
            and np.linalg.norm(numbers[1]) <= table.speed_max_mps
            and fix_type == 3
            and satellites >= table.satellites_min
            and ((numbers[2] > 0.0) & (numbers[2] <= table.sigma_r_max_m)).all()
            and ((numbers[3] > 0.0) & (numbers[3] <= table.sigma_v_max_mps)).all()
        )
        assert (fix_checks.check_content(table, inp) == fix_checks.PASSED) == good
