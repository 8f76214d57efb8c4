"""The grid of epochs: late fixes, the history ring, two covariances, bounds of intervals, catching up."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import (
    COMMON_AUTONOMOUS,
    MU_M3PS2,
    NS,
    T0_GPS_NS,
    TABLE_1_INTEGRATED,
    calls,
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

from flightsw.icd.enums import FlagState, RejectCause, Verdict
from flightsw.nav.chain import HELD
from flightsw.records import HISTORY

ORBIT = circular_orbit(500e3)
STATE = ("t_gps_ns", "x", "P", "P_bound", "P_ahead", "P_bound_ahead", "mean_nis", "streak", "fixes_accepted")


def truth(t_gps_ns):
    return two_body(ORBIT, t_gps_ns)


def ticks(first_s, stop_s, period_ns=NS // 10):
    return np.arange(T0_GPS_NS + round(first_s * NS), T0_GPS_NS + round(stop_s * NS), period_ns)


def fly(memory, fix_times, latency_ns, stop_s, tick_ns=NS // 10):
    """Steps on a raster of ticks and, to deliver fixes in time, at each fix time plus latency."""
    arrivals = fix_times + latency_ns
    t = np.unique(np.concatenate((ticks(0.0, stop_s, tick_ns), arrivals)))
    inputs = calls(t)
    pulses = np.flatnonzero((t - T0_GPS_NS) % NS == 0)
    put_pulses(inputs, pulses, t[pulses])
    put_fixes(inputs, np.searchsorted(t, arrivals), fix_times, truth, noise=np.random.default_rng(2))
    return [int(out.fix_cause) for out in run(memory, inputs) if out.fix_seen]


def state_of(memory):
    nav = record(memory.nav)
    return {name: np.array(getattr(nav, name)) for name in STATE}


@pytest.mark.parametrize("latency_s", [0.0, 0.05, 0.1, 0.35, 0.75, 0.999])
def test_late_fixes_on_the_grid_give_the_same_bits(latency_s):
    states = []
    for delay_s in (0.0, latency_s):
        memory = loaded_memory("two_body")
        causes = fly(memory, seconds(5, 40), round(delay_s * NS), 39.99 + latency_s)
        assert set(causes) == {-1}
        states.append(state_of(memory))
    for name in STATE:
        np.testing.assert_array_equal(states[0][name], states[1][name], err_msg=name)


@pytest.mark.parametrize("name", ["two_body", "j2", "paper"])
def test_late_fixes_off_the_grid_give_the_same_state(name):
    """Jitter of up to 0.4 s, latencies of 0.9 s: the same bits, or 1e-9 where the pole is a second younger."""
    jitter = np.random.default_rng(6).integers(-NS * 2 // 5, NS * 2 // 5, 35)
    states = []
    for latency_ns in (0, 9 * NS // 10):
        memory = loaded_memory(name)
        causes = fly(memory, seconds(5, 40) + jitter, latency_ns, 41.0)
        assert set(causes) == {-1}
        states.append(state_of(memory))
    for field in STATE:
        if name == "j2":
            np.testing.assert_allclose(states[0][field], states[1][field], rtol=1e-9, atol=1e-12, err_msg=field)
        else:
            np.testing.assert_array_equal(states[0][field], states[1][field], err_msg=field)


def test_too_late_is_stale_and_out_of_order_is_repeated():
    memory = loaded_memory("two_body", latency_max_s=0.5)
    assert set(fly(memory, seconds(5, 10), round(0.501 * NS), 11.0)) == {int(RejectCause.TIME_STALE)}
    memory = loaded_memory("two_body")
    t = np.sort(np.concatenate((ticks(0, 12), [])))
    inputs = calls(t)
    put_pulses(inputs, slice(0, None, 10), t[::10])
    put_fixes(inputs, slice(50, 120, 10), t[50::10], truth)
    put_fixes(inputs, 105, t[104], truth)
    put_fixes(inputs, 106, t[102], truth)
    causes = {index: int(out.fix_cause) for index, out in enumerate(run(memory, inputs)) if out.fix_seen}
    assert causes[105] == -1
    assert causes[106] == RejectCause.TIME_REPEATED


def of_short_steps():
    """Steps of 0.1 s, and fixes taken later than the history reaches back, which no table that is built allows."""
    memory = loaded_memory("two_body", nav_step_ns=NS // 10, stored_da_use=0)
    memory.table.flags.writeable = True
    memory.table["latency_max_s"] = 2.0
    memory.table.flags.writeable = False
    return memory


@pytest.mark.parametrize("late_steps", [1, 5, HISTORY])
def test_the_history_ring_wraps_around(late_steps):
    """GIVEN a grid of 0.1 s and 5 s without a fix, the ring overwritten four times WHEN a fix comes late
    THEN the state is that of the same fix in time."""
    states = []
    late_ns = (late_steps * NS) // 10 - NS // 100
    for delay_ns in (0, late_ns):
        memory = of_short_steps()
        fix_times = np.concatenate((seconds(5, 15), [T0_GPS_NS + 20 * NS]))
        arrivals = fix_times.copy()
        arrivals[-1] += delay_ns
        t = np.unique(np.concatenate((ticks(0.0, 19.95), arrivals)))
        inputs = calls(t)
        pulses = np.flatnonzero((t - T0_GPS_NS) % NS == 0)
        put_pulses(inputs, pulses, t[pulses])
        put_fixes(inputs, np.searchsorted(t, arrivals), fix_times, truth, noise=np.random.default_rng(2))
        causes = [int(out.fix_cause) for out in run(memory, inputs) if out.fix_seen]
        assert causes[-1] == -1
        finish(run(memory, calls(ticks(21.5, 22.0))))
        states.append(state_of(memory))
    for field in STATE:
        np.testing.assert_array_equal(states[0][field], states[1][field], err_msg=field)


def test_a_fix_from_before_the_history_is_stale_and_moves_nothing():
    memory = of_short_steps()
    finish(run(memory, steady_calls(20, truth, fix_stop_s=15)))
    before = state_of(memory)
    inputs = calls(seconds(19, 20))
    put_fixes(inputs, 0, T0_GPS_NS + 19 * NS - (HISTORY + 1) * NS // 10, truth)
    assert finish(run(memory, inputs)).fix_cause == RejectCause.TIME_STALE
    for name, value in state_of(memory).items():
        np.testing.assert_array_equal(value, before[name])


def plain_covariances(positions, p, q, row):
    """(7) and (17) side by side from the same start, as printed."""
    own, bound = p.copy(), p.copy()
    h = np.eye(6, 9)
    noise = np.diag(np.repeat([row[3] ** 2, row[4] ** 2], 3))
    for r in positions:
        size = np.linalg.norm(r)
        phi = np.eye(9) + np.eye(9, k=3)
        phi[3:6, 0:3] = MU_M3PS2 / size**5 * (3.0 * np.outer(r, r) - size**2 * np.eye(3))
        own = phi @ own @ phi.T + np.diag(np.repeat(q, 3))
        bound = phi @ bound @ phi.T + np.diag(np.repeat(row[:3], 3))
        gain = np.linalg.solve(h @ bound @ h.T + noise, h @ bound).T
        bound = (np.eye(9) - gain @ h) @ bound
    return own, bound


def test_two_covariances_run_in_an_outage_and_neither_overwrites_the_other():
    """The filter's own by (11), the bound's by (17), from one start; the flown positions are given to both."""
    memory = loaded_memory("paper", stored_da_use=0)
    finish(run(memory, steady_calls(60, truth)))
    nav = record(memory.nav)
    start = np.array(nav.P)
    np.testing.assert_array_equal(nav.P_bound, start)
    positions = [np.array(nav.x[:3])]
    positions += [np.array(nav.x[:3]) for _ in run(memory, calls(seconds(60, 260)))]
    out = record(memory.output)
    assert out.outage_age_s == 200.0
    assert out.da_source != HELD  # this table flies no stored dA
    own, bound = plain_covariances(positions[:-1], start, TABLE_1_INTEGRATED[:3], COMMON_AUTONOMOUS)
    for got, expected in ((nav.P, own), (nav.P_bound, bound)):
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        assert (np.abs(got - expected) <= 1e-9 * scale).all()
    assert np.diag(nav.P)[:3].max() > 1.5 * np.diag(nav.P_bound)[:3].max()


@pytest.mark.compiled
def test_the_returning_fix_meets_the_filters_own_covariance():
    """REFERENCE S0, finding 9: with (17) a saturated sigma would close the gate against kilometres of error."""
    memory = loaded_memory("paper_table1", stored_da_use=0)
    finish(run(memory, steady_calls(60, truth)))
    finish(run(memory, calls(seconds(60, 1259))))
    nav = record(memory.nav)
    own = np.sqrt(np.diag(nav.P_ahead)[:3])
    inputs = calls(seconds(1259, 1260))
    put_fixes(inputs, 0, inputs["counter_now_ns"] - 77 * NS + T0_GPS_NS, truth)
    out = finish(run(memory, inputs))
    assert np.abs(out.innovation[:3]).max() > 1500.0  # Euler alone
    np.testing.assert_allclose(out.innovation_sigma[:3], own, rtol=1e-3)
    assert out.fix_used
    np.testing.assert_array_equal(nav.P_bound, nav.P)


def three_sigma(p):
    return 3.0 * np.sqrt(np.diag(p)[:3].max())


def test_a_bound_belongs_to_its_interval_and_is_the_larger_of_its_ends():
    memory = loaded_memory("paper", stored_da_use=0)
    finish(run(memory, steady_calls(60, truth)))
    nav = record(memory.nav)
    by_interval = {}
    ends = {}
    for out in run(memory, calls(ticks(59.05, 75.0))):
        age = (int(out.t_gps_ns) - T0_GPS_NS) // NS
        ends.setdefault(age, [three_sigma(p) for p in (nav.P, nav.P_ahead, nav.P_bound, nav.P_bound_ahead)])
        overdue = out.fix_age_s > 1.5
        by_interval.setdefault((age, overdue), set()).add(float(out.bound_m))
    assert all(len(values) == 1 for values in by_interval.values())
    for (age, overdue), values in by_interval.items():
        own, own_ahead, bound, bound_ahead = ends[age]
        expected = max(bound, bound_ahead) if overdue else max(own, own_ahead)
        assert min(values) == pytest.approx(expected, rel=1e-14)
        if age + 1 in ends:
            assert own_ahead == ends[age + 1][0]
            assert bound_ahead == ends[age + 1][2]


@pytest.mark.compiled
def test_no_bound_above_the_limit_is_ever_published_with_a_clear_flag():
    """Persist 1. Whatever the limit, and wherever between two epochs (17) takes over from the filter's own bound."""
    for limit_m in np.geomspace(12.0, 60.0, 25):
        memory = loaded_memory("paper", limit_m=float(limit_m), clear_limit_m=1.0, overdue_s=1.5)
        finish(run(memory, steady_calls(40, truth)))
        for out in run(memory, calls(ticks(39.1, 44.0))):
            assert out.bound_m <= limit_m or out.flag == FlagState.RAISED


def test_the_row_of_the_table_is_that_of_the_sigma_a_fix_claims():
    """Rows up to 1.5 m and up to 40 m, the last also for worse ones; its floors are what the filter takes at least."""
    for sigma_m, row in ((0.5, 0), (1.5, 0), (1.5001, 1), (40.0, 1), (500.0, 1)):
        memory = loaded_memory("paper", init_fixes=1)
        finish(run(memory, steady_calls(4, truth, sigma_r_m=sigma_m, sigma_v_mps=0.01)))
        nav = record(memory.nav)
        assert nav.row == row
        floors = ((1.0, 1.0), (33.0, 5.0))[row]
        expected = np.repeat([max(sigma_m, floors[0]) ** 2, floors[1] ** 2], 3)
        np.testing.assert_allclose(np.diag(nav.P)[:6], expected, rtol=1e-12)
        inputs = calls(seconds(4, 5))
        put_fixes(inputs, 0, seconds(4, 5), truth, sigma_r_m=sigma_m, sigma_v_mps=0.01)
        ahead = np.diag(nav.P_ahead)[:6].copy()
        out = finish(run(memory, inputs))
        np.testing.assert_allclose(out.innovation_sigma, np.sqrt(ahead + expected), rtol=1e-9)


def test_a_part_of_a_step_carries_its_share_of_the_noise():
    """Half a step after a start: P = Phi P0 Phi' + Q/2."""
    memory = loaded_memory("paper", init_fixes=1)
    finish(run(memory, steady_calls(4, truth)))
    start = np.array(record(memory.nav).P)
    inputs = calls(T0_GPS_NS + np.array([7 * NS // 2]))
    put_fixes(inputs, 0, T0_GPS_NS + 7 * NS // 2, truth)
    out = finish(run(memory, inputs))
    r = truth(seconds(3, 4))[0][0]
    size = np.linalg.norm(r)
    phi = np.eye(9) + 0.5 * np.eye(9, k=3)
    phi[3:6, 0:3] = 0.5 * MU_M3PS2 / size**5 * (3.0 * np.outer(r, r) - size**2 * np.eye(3))
    ahead = phi @ start @ phi.T + 0.5 * np.diag(np.repeat(TABLE_1_INTEGRATED[:3], 3))
    np.testing.assert_allclose(out.innovation_sigma, np.sqrt(np.diag(ahead)[:6] + 1.0), rtol=1e-10)


def test_flag_and_state_do_not_depend_on_the_rate_of_calls():
    """1 Hz, 10 Hz, and calls at random: one flag age, and the same bits at the end."""
    rng = np.random.default_rng(12)
    results = []
    for times in (
        seconds(60, 801),
        ticks(60, 800.05),
        T0_GPS_NS + np.sort(np.concatenate((rng.integers(60 * NS, 800 * NS, 900), [800 * NS]))),
    ):
        memory = loaded_memory("paper", limit_m=700.0, flag_persist=3)
        finish(run(memory, steady_calls(60, truth)))
        out = finish(run(memory, calls(times)))
        assert out.flag == FlagState.RAISED
        results.append((float(out.flag_age_s), float(out.bound_m), *state_of(memory).values()))
    for other in results[1:]:
        for a, b in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.compiled
def test_after_a_stall_the_work_of_a_step_is_bounded_and_nothing_is_lost():
    """GIVEN 1000 s without a step THEN 256 epochs a step, STALE and without a bound until caught up, then as if
    there had been no stall."""
    memory, steady = loaded_memory("two_body"), loaded_memory("two_body")
    for each in (memory, steady):
        finish(run(each, steady_calls(60, truth)))
    finish(run(steady, calls(seconds(60, 1060))))
    epochs = []
    late = calls(seconds(1059, 1060))
    for _ in range(5):
        out = finish(run(memory, late))
        epochs.append((int(record(memory.nav).t_gps_ns) - T0_GPS_NS) // NS)
        if epochs[-1] < 1059:
            assert out.flag == FlagState.STALE
            assert out.verdict == Verdict.DO_NOT_USE
            assert np.isnan(out.bound_m)
            assert np.isnan(out.bound_3d_m)
    assert epochs == [59 + 256, 59 + 512, 59 + 768, 1059, 1059]
    assert out.flag == FlagState.CLEAR
    for name, value in state_of(steady).items():
        np.testing.assert_array_equal(value, state_of(memory)[name], err_msg=name)
