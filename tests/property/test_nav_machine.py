"""State machines: the flag against a model of its rules, and whole flights under any sequence of what may happen."""

from __future__ import annotations

import math

import numpy as np
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
    two_body,
)
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from flightsw.icd.enums import FlagState, Mode, Validity, Verdict
from flightsw.integrity import failure_flag

ORBIT = circular_orbit(500e3)


def truth(t_gps_ns):
    return two_body(ORBIT, t_gps_ns)


class FlagMachine(RuleBasedStateMachine):
    """Independent account of REFERENCE (14): persist, latch, clear, STALE."""

    @initialize(persist=st.integers(1, 4))
    def begin(self, persist):
        memory = loaded_memory("paper", flag_persist=persist, limit_m=100.0, clear_limit_m=50.0, clear_fixes=3)
        self.memory, self.nav, self.table = memory, record(memory.nav), record(memory.table)
        self.persist = persist
        self.bounds = []  # finite ones since the last clearing
        self.raised_age = None
        self.stale = False
        self.age = 0.0

    @rule(bound=st.one_of(st.floats(0.0, 200.0), st.sampled_from([100.0, 100.1, 150.0, 150.0, math.nan, math.inf])))
    def epoch(self, bound):
        self.age += 1.0
        failure_flag.evaluate(self.nav, self.table, bound, self.age)
        if math.isfinite(bound):
            self.stale = False
            self.bounds.append(bound)
            last = self.bounds[-self.persist :]
            if self.raised_age is None and len(last) == self.persist and min(last) > 100.0:
                self.raised_age = self.age
        elif self.raised_age is None:
            self.stale = True

    @rule(bound=st.floats(0.0, 120.0), streak=st.integers(0, 5), nis=st.one_of(st.floats(0.0, 5.0), st.just(math.nan)))
    def accepted_fix(self, bound, streak, nis):
        self.nav.streak, self.nav.mean_nis = streak, nis
        cleared = failure_flag.clear_if_recovered(self.nav, self.table, bound)
        expected = self.raised_age is not None and bound <= 50.0 and streak >= 3 and 0.0 <= nis <= 3.0
        assert cleared == expected
        if expected:
            self.raised_age, self.bounds = None, []
        self.age = 0.0

    @invariant()
    def agrees(self):
        if not hasattr(self, "nav"):
            return
        expected = (
            FlagState.RAISED if self.raised_age is not None else FlagState.STALE if self.stale else FlagState.CLEAR
        )
        assert self.nav.flag == expected
        if self.raised_age is None:
            assert math.isnan(self.nav.flag_age_s)
        else:
            assert self.nav.flag_age_s == self.raised_age


class FlightMachine(RuleBasedStateMachine):
    """Fixes, wrong fixes, outages, jumps of time in any order. No noise: the truth is what fixes say."""

    @initialize(init_fixes=st.sampled_from([1, 3]), driver=st.sampled_from([0, 1]))
    def begin(self, init_fixes, driver):
        self.memory = loaded_memory(
            "paper",
            init_fixes=init_fixes,
            flag_driver=driver,
            limit_m=120.0,
            clear_fixes=5,
            clock_restart_pulses=15,
            integrated_after_fixes=2,
        )
        self.t = T0_GPS_NS
        self.before = None
        self.seen = []

    def seconds(self, count, fix=False, pulse=True, offset=0.0, jump_ns=0):
        t = self.t + np.arange(1, count + 1) * NS
        inputs = calls(t)
        if pulse:
            put_pulses(inputs, slice(None), t)
            inputs["pulse_gps_ns"] += jump_ns
        if fix:
            put_fixes(inputs, slice(None), t, truth)
            inputs["fix_r_itrf_m"] *= 1.0 + offset
            inputs["fix_gps_ns"] += jump_ns
        self.t = int(t[-1])
        for out in run(self.memory, inputs):
            self.check(out)

    @rule(count=st.integers(1, 12))
    def fixes(self, count):
        self.seconds(count, fix=True)

    @rule(count=st.integers(1, 12), offset=st.sampled_from([1e-3, -5e-4]))
    def wrong_fixes(self, count, offset):
        self.seconds(count, fix=True, offset=offset)

    @rule(count=st.sampled_from([1, 2, 4, 30, 150]))
    def outage(self, count):
        self.seconds(count, pulse=False)

    @rule(count=st.integers(1, 20), jump_ns=st.sampled_from([10**6, -NS, NS]))
    def jump_of_time(self, count, jump_ns):
        self.seconds(count, fix=True, jump_ns=jump_ns)

    def check(self, out):
        flag, mode, verdict, validity = int(out.flag), int(out.mode), int(out.verdict), int(out.validity)
        if flag == FlagState.RAISED:
            assert mode in (Mode.FAILED, Mode.INIT)
        if flag != FlagState.CLEAR:
            assert verdict == Verdict.DO_NOT_USE
        assert bool(validity & Validity.STATE_VALID) == (verdict in (Verdict.TRUSTED, Verdict.TRUSTED_COASTING))
        assert bool(validity & Validity.INITIALISED) == bool(np.isfinite(out.r_gcrf_m).all())
        assert (mode == Mode.INIT) == (not validity & Validity.INITIALISED)
        if validity & Validity.STATE_VALID:
            bound = out.bound_3d_m if out.driver else out.bound_m
            assert bound <= out.limit_m
            assert (mode == Mode.AUTONOMOUS) == (verdict == Verdict.TRUSTED_COASTING)
        if self.before is not None:
            flag_before, used_before = self.before
            if flag_before == FlagState.RAISED and flag != FlagState.RAISED:
                assert out.fix_used  # nothing but an accepted fix clears
            assert used_before in (0, 1)
        if mode == Mode.INTEGRATED:
            assert out.fix_age_s <= 3.0
        self.before = flag, int(out.fix_used)


TestFlag = FlagMachine.TestCase
TestFlag.settings = settings(max_examples=60, stateful_step_count=60)
TestFlight = FlightMachine.TestCase
TestFlight.settings = settings(max_examples=40, stateful_step_count=25)
