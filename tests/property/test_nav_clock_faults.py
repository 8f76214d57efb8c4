"""Property: whatever wrong pulses and tags come, time moves no further than the covariance allowed, or says so."""

from __future__ import annotations

import numpy as np
from flight_bench import COUNTER_AT_T0_NS, NS, T0_GPS_NS, loaded_memory, record
from hypothesis import given
from hypothesis import strategies as st

from flightsw.nav import clock

WARM_S = 90
GATE, PULSE_SIGMA_S, Q_PHASE, Q_DRIFT = 6.0, 1e-7, 1e-20, 4e-19  # of the schema
RESTART = 40

size_s = st.floats(-8.0, 1.0).map(lambda exponent: 10.0**exponent)
sign = st.sampled_from([-1.0, 1.0])


@st.composite
def wrong_sequences(draw):
    """Errors [s] of up to so many pulses in a row that no restart can come of them: steps, ramps, noise, toggling.

    A ramp below some 1e-7 s/s looks to any clock as an oscillator that drifts, and is left out.
    """
    n = draw(st.integers(1, RESTART - 1))
    k = np.arange(n)
    amplitude = draw(size_s) * draw(sign)
    kind = draw(st.sampled_from(["step", "ramp", "noise", "toggle"]))
    if kind == "step":
        return np.full(n, amplitude)
    if kind == "ramp":
        return amplitude + draw(sign) * draw(st.floats(3e-7, 1e-3)) * (k + 1)
    if kind == "toggle":
        return np.where(k % draw(st.integers(2, 5)) == 0, amplitude, draw(size_s) * draw(sign))
    return amplitude * np.random.default_rng(draw(st.integers(0, 2**31))).standard_normal(n)


def allowed_s(p, elapsed_s):
    """Six sigmas of a clock without corrections and a pulse: covariance by matrices."""
    phi = np.array([[1.0, elapsed_s], [0.0, 1.0]])
    variance = (phi @ p @ phi.T)[0, 0] + Q_PHASE * elapsed_s + Q_DRIFT * elapsed_s**3 / 3.0
    return GATE * np.sqrt(variance + PULSE_SIGMA_S**2)


@given(
    wrong_sequences(),
    st.integers(0, 3000),
    st.floats(-4e-6, 4e-6),
    st.booleans(),
    st.integers(0, 2**31),
)
def test_wrong_pulses_in_a_row_move_time_within_the_covariance(errors_s, outage_s, drift, tags_too, seed):
    """GIVEN a clock on true pulses, then perhaps an outage WHEN fewer wrong pulses come than restart time THEN the time
    never leaves what the covariance of the last true pulse allows, and true pulses are believed again.

    Half of it more is granted: each of several pulses in a row may use up a gate of its own.
    """
    memory = loaded_memory("paper", clock_restart_pulses=RESTART)
    nav, table = record(memory.nav), record(memory.table)
    rng = np.random.default_rng(seed)

    def counter_at(t):
        return COUNTER_AT_T0_NS + t * NS + round(drift * t * NS)

    def take(t, error_s=0.0, with_tag=False):
        counter = counter_at(t) + round(50.0 * rng.standard_normal())
        gps = T0_GPS_NS + t * NS + round(error_s * 1e9)
        outcome = clock.take_pulse(nav, table, 1, gps, counter, 100.0, counter + 1000)
        if with_tag:
            assert clock.take_tag(nav, table, gps, counter, counter + 1000) != clock.RESTARTED
        return outcome

    for t in range(WARM_S):
        assert take(t) == clock.ACCEPTED
    last, p = WARM_S - 1, np.array(nav.clock_p)
    free = (nav.clock_gps_ns, nav.clock_counter_ns, nav.clock_drift)
    first = last + 1 + outage_s
    for k, error_s in enumerate(errors_s):
        t = first + k
        assert take(t, error_s, tags_too) != clock.RESTARTED
        counter = counter_at(t)
        free_ns = (counter - free[1]) + round(free[2] * (counter - free[1]))
        moved_s = 1e-9 * (clock.gps_at(nav, counter) - free[0] - free_ns)
        assert abs(moved_s) <= 1.5 * allowed_s(p, t - last) + 2e-9
    after = [take(t) for t in range(first + len(errors_s), first + len(errors_s) + RESTART + 10)]
    assert after[-1] == clock.ACCEPTED
    end = counter_at(first + len(errors_s) + RESTART + 9)
    true_ns = T0_GPS_NS + (first + len(errors_s) + RESTART + 9) * NS
    assert abs(clock.gps_at(nav, end) - true_ns) < 1000
