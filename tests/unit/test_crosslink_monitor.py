"""The inter-satellite monitor epoch by epoch: naming, exclusion, re-inclusion, slow faults, the paper's rule."""

from __future__ import annotations

import numpy as np
import pytest
from crosslink_bench import WALKER, Bench, jump, ramp
from hypothesis import given, settings
from hypothesis import strategies as st

from flightsw.crosslink.majority import NO_VERDICT, RELIABLE, UNRELIABLE, heard_by, majority
from flightsw.crosslink.monitor import monitor_epoch, monitor_step
from flightsw.crosslink.own import FAULT, SUSPECT
from flightsw.crosslink.setup import MonitorMemory, Settings

pytestmark = pytest.mark.compiled  # matrices of 96 by 96: plain Python would take minutes an epoch


@pytest.mark.parametrize(
    ("residuals", "verdict"),
    [
        ([], NO_VERDICT),
        ([1.0, 2.0, 3.0], RELIABLE),  # the paper's variant 1
        ([70.0, 2.0, 3.0], RELIABLE),  # 2
        ([70.0, -70.0, 3.0], UNRELIABLE),  # 3
        ([70.0, -70.0, 90.0], UNRELIABLE),  # 4
        ([70.0, 70.0, 1.0, 1.0], RELIABLE),  # a tie is no majority
        ([59.7, 59.7, 59.7], RELIABLE),  # not beyond
        ([np.nan, np.nan, 70.0], RELIABLE),
    ],
)
def test_the_papers_rule(residuals: list[float], verdict: int) -> None:
    """GIVEN range differences of the paper's four variants, ties and gaps THEN the verdict is as the rule says."""
    assert majority(np.array([*residuals, 0.0]), len(residuals), 59.7) == verdict


@given(st.lists(st.floats(-200.0, 200.0), min_size=1, max_size=31), st.floats(1.0, 100.0))
def test_the_rule_is_a_strict_majority(residuals: list[float], threshold: float) -> None:
    beyond = sum(abs(value) > threshold for value in residuals)
    expected = UNRELIABLE if beyond > len(residuals) / 2 else RELIABLE
    assert majority(np.array(residuals), len(residuals), threshold) == expected


def test_whose_links_count() -> None:
    assert heard_by(3, 3, 5, True)
    assert not heard_by(5, 3, 5, True)
    assert heard_by(5, 3, 5, False)
    assert not heard_by(4, 3, 5, False)


@pytest.mark.parametrize("direction", range(4))
def test_a_jump_of_70_m_is_named_in_its_epoch_where_the_paper_misses_it(direction: int) -> None:
    """GIVEN healthy epochs WHEN satellite 1 jumps by 70 m THEN its own and the network monitor say so in that epoch,
    and the paper's rule does for the clock alone."""
    bench = Bench(seed=4)
    bench.step(5)
    assert bench.verdict["faulty"] == 0
    bench.faults = [jump(0, direction, 70.0)]
    verdict = bench.step()
    assert verdict["named"] == 1
    assert bench.state["own_state"] in (SUSPECT, FAULT)
    assert (verdict["majority"] == UNRELIABLE) == (direction == 3)


def test_four_at_a_time_are_named_exactly() -> None:
    """GIVEN jumps of four satellites, two of them neighbours WHEN judged THEN exactly these are named."""
    bench = Bench(seed=2)
    bench.faults = [jump(4, 0, 90.0), jump(5, 2, -90.0), jump(11, 1, 90.0), jump(20, 3, 70.0)]
    assert bench.step()["named"] == (1 << 4) | (1 << 5) | (1 << 11) | (1 << 20)


def test_a_neighbours_fault_is_not_the_own_one() -> None:
    """GIVEN a jump of a neighbour WHEN the own satellite judges alone THEN it is not sure of its own fault, and the
    network monitor names the neighbour."""
    bench = Bench(seed=5)
    bench.faults = [jump(1, 3, 90.0)]
    verdict = bench.step()
    assert bench.state["own_state"] != FAULT
    assert verdict["named"] == 2


def test_who_agrees_again_is_taken_in_again() -> None:
    """GIVEN a jump of 20 s WHEN it is over THEN the satellite is taken in again after 30 epochs that agree, and what
    the history holds of the jump names nobody."""
    bench = Bench(seed=6)
    bench.faults = [jump(7, 1, 100.0, onset_s=40.0, duration_s=20.0)]
    bench.step(40)
    assert bench.step()["named"] == 1 << 7
    bench.step(19)
    assert bench.verdict["faulty"] == 1 << 7
    included = 0
    for second in range(200):
        verdict = bench.step()
        if verdict["included"]:
            included = second + 1
            assert verdict["included"] == 1 << 7
        assert verdict["named"] == 0
    assert included >= 30
    assert bench.verdict["faulty"] == 0


@pytest.mark.parametrize(("direction", "limit_s"), [(1, 160), (3, 160)])
def test_a_ramp_is_found_long_before_the_paper_would(direction: int, limit_s: int) -> None:
    """GIVEN a minute or five of history WHEN a ramp of 0.05 m/s begins THEN it is named, and by the right name."""
    bench = Bench(seed=8)
    bench.faults = [ramp(3, direction, 0.05, onset_s=300.0)]
    bench.step(300)
    assert bench.verdict["faulty"] == 0
    second = -1
    while second < limit_s + 40:
        second += 1
        verdict = bench.step()
        if verdict["named"]:
            break
    assert verdict["named"] == 1 << 3
    assert second <= limit_s
    assert verdict["majority"] == RELIABLE
    assert bench.state["slow"][3] == 1


def test_a_new_ephemeris_ends_a_slow_fault() -> None:
    """GIVEN a satellite excluded for a ramp WHEN it broadcasts a new, good ephemeris THEN it is taken in again."""
    bench = Bench(seed=9)
    bench.faults = [ramp(3, 3, 0.1, onset_s=100.0)]
    bench.step(260)
    assert bench.state["faulty"][3] == 1
    assert bench.state["slow"][3] == 1
    bench.faults = []
    bench.issue[3] += 1
    bench.step(80)
    assert bench.state["faulty"][3] == 0


def test_new_ephemerides_are_no_fault() -> None:
    """GIVEN uploads that change every error by metres WHEN they come one after the other THEN nobody is named."""
    bench = Bench(seed=10)
    for satellite in range(0, WALKER.total, 3):
        bench.step(12)
        bench.issue[satellite] += 1
        bench.bias[satellite] = bench.errors.draw(1, bench.rng)[0]
        assert bench.state["faulty"].sum() == 0
    bench.step(120)
    assert bench.state["faulty"].sum() == 0
    assert bench.state["own_state"] == 0


def test_dropouts_and_two_ways() -> None:
    """GIVEN two-way ranging with a third of the links lost WHEN a satellite jumps THEN it is named; a clock is not."""
    bench = Bench(seed=11, directions=False, two_way=True)
    object.__setattr__(bench.ranging, "dropout", 0.3)
    bench.step(15)
    assert 50 < bench.verdict["links"] < 110
    bench.faults = [jump(12, 3, 1000.0)]
    assert bench.step()["faulty"] == 0
    bench.faults = [jump(12, 1, 300.0)]
    assert bench.step()["named"] == 1 << 12


def test_without_exchange_the_own_monitors_go_on() -> None:
    """GIVEN the own links alone WHEN the own satellite jumps THEN its monitors say so, and the network's has none."""
    bench = Bench(seed=12, own=5)
    bench.faults = [jump(5, 1, 120.0)]
    bench.put(0.0)
    epoch = bench.memory.epoch
    m = int(epoch["links"][0])
    mine = np.flatnonzero((epoch["receiver"][0, :m] == 5) | (epoch["sender"][0, :m] == 5))
    for name in ("receiver", "sender", "range_m"):
        epoch[name][0, : len(mine)] = epoch[name][0, mine].copy()
    epoch["links"] = len(mine)
    monitor_epoch(*bench.memory.arguments())
    assert bench.verdict["network_ready"] == 0
    assert bench.verdict["named"] == 0
    assert bench.state["own_state"] == FAULT


def _kept(bench: Bench, wanted: np.ndarray) -> None:
    """Leave only the wanted links (m,) in the epoch that the bench has filled."""
    epoch = bench.memory.epoch
    rows = np.flatnonzero(wanted)
    for name in ("receiver", "sender", "range_m"):
        epoch[name][0, : len(rows)] = epoch[name][0, rows].copy()
    epoch["links"] = len(rows)


def test_who_is_monitored() -> None:
    """GIVEN all links, those without satellite 8's, those with three left of it, the own ones, and none WHEN judged
    THEN monitored are all; all but 8; the same, as three links leave it a direction; the own satellite; nobody."""
    everyone = (1 << WALKER.total) - 1
    for case, expected in (
        ("all", everyone),
        ("none of 8", everyone & ~(1 << 8)),
        ("three of 8", everyone & ~(1 << 8)),
        ("own", 1 << 5),
        ("nothing", 0),
    ):
        bench = Bench(seed=12, own=5, directions=False)
        bench.put(0.0)
        m = int(bench.memory.epoch["links"][0])
        ends = np.stack((bench.memory.epoch["receiver"][0, :m], bench.memory.epoch["sender"][0, :m]))
        of_8, of_5 = (ends == 8).any(axis=0), (ends == 5).any(axis=0)
        few = of_8 & (np.cumsum(of_8) <= 3)
        wanted = {
            "all": of_8 | True,
            "none of 8": ~of_8,
            "three of 8": ~of_8 | few,
            "own": of_5,
            "nothing": of_8 & False,
        }
        _kept(bench, wanted[case])
        monitor_epoch(*bench.memory.arguments())
        assert bench.verdict["monitored"] == expected, case


def test_a_message_that_copies_another_satellites_is_named() -> None:
    """GIVEN that satellite 3 broadcasts the place of satellite 4, to which its distance then is zero WHEN judged THEN
    it is named, and nothing becomes NaN."""
    bench = Bench(seed=3)
    bench.put(0.0)
    epoch = bench.memory.epoch
    epoch["r_m"][0, 3], epoch["v_mps"][0, 3] = epoch["r_m"][0, 4], epoch["v_mps"][0, 4]
    monitor_epoch(*bench.memory.arguments())
    assert bench.verdict["named"] >> 3 & 1
    assert np.isfinite(bench.memory.network["statistic"][0]).all()


def test_an_unhealthy_neighbour_is_left_out() -> None:
    """GIVEN a neighbour that says it is unhealthy and is wrong WHEN judged alone THEN the own satellite is clear."""
    bench = Bench(seed=13)
    bench.faults = [jump(1, 3, 300.0)]
    bench.put(0.0)
    bench.memory.epoch["healthy"][0, 1] = 0
    monitor_epoch(*bench.memory.arguments())
    assert bench.state["own_state"] == 0


def test_memory_begins_afresh() -> None:
    """GIVEN a monitor with a fault latched WHEN reset THEN the same epochs give the same verdict as a new one."""
    bench = Bench(seed=14)
    bench.faults = [jump(2, 0, 200.0)]
    bench.step(3)
    assert bench.state["faulty"].sum() == 1
    bench.memory.reset()
    fresh = Bench(seed=14)
    bench.rng.bit_generator.state = fresh.rng.bit_generator.state
    bench.faults, bench.t_s = [], 0.0
    a, b = bench.step(25).copy(), fresh.step(25).copy()
    assert a.tobytes() == b.tobytes()


VALUES = st.one_of(
    st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1e300, -1e300, 2.5e7]),
    st.floats(allow_nan=True, allow_infinity=True),
)


@settings(max_examples=60)
@given(st.data())
def test_any_content_gives_a_verdict(data: st.DataObject) -> None:
    """GIVEN epochs with any numbers in them WHEN judged THEN no exception, and counts stay within their sizes; a
    healthy constellation afterwards is judged again."""
    bench = Bench(seed=15)
    bench.step()
    epoch = bench.memory.epoch[0]
    for _ in range(data.draw(st.integers(1, 5))):
        satellite = data.draw(st.integers(0, 23))
        field = data.draw(st.sampled_from(["r_m", "v_mps", "clock_m", "range_m", "receiver", "sender", "issue"]))
        if field in ("receiver", "sender", "issue"):
            epoch[field][satellite] = data.draw(st.integers(-(2**40), 2**40))
        elif field in ("r_m", "v_mps"):
            epoch[field][satellite, data.draw(st.integers(0, 2))] = data.draw(VALUES)
        else:
            epoch[field][satellite] = data.draw(VALUES)
    monitor_epoch(*bench.memory.arguments())
    verdict = bench.verdict
    assert 0 <= verdict["links"] <= 256
    assert 0 <= verdict["own_links"] <= 62
    assert 0 <= verdict["rank"] <= 96
    bench.memory.state.view(np.uint8)[:] = 0
    assert bench.step()["links"] > 150


def test_a_monitor_of_few_satellites() -> None:
    """GIVEN three satellites and one link WHEN judged THEN a verdict that knows what it cannot see."""
    memory = MonitorMemory(Settings(satellites=3, faulty_max=2))
    r, v = WALKER.states(0.0)
    memory.epoch["known"][0, :3] = 1
    memory.epoch["r_m"][0, :3], memory.epoch["v_mps"][0, :3] = r[:3], v[:3]
    memory.epoch["links"] = 1
    memory.epoch["receiver"][0, 0], memory.epoch["sender"][0, 0] = 1, 2
    memory.epoch["range_m"][0, 0] = np.linalg.norm(r[1] - r[2])
    monitor_epoch(*memory.arguments())
    verdict = memory.verdict[0]
    assert (verdict["rank"], verdict["parameters"], verdict["undetectable"]) == (1, 8, 7)
    assert verdict["majority"] == NO_VERDICT


@pytest.mark.compiled
def test_an_epoch_allocates_nothing() -> None:
    """GIVEN epochs quiet, with faults, at the end of a block WHEN judged THEN the compiled code allocates no array."""
    from numba.core.runtime import _nrt_python, rtsys

    bench = Bench(seed=16)
    bench.step(25)
    bench.faults = [jump(4, 1, 200.0), jump(9, 0, 200.0)]
    arguments = bench.memory.arguments()
    bench.put(bench.t_s)
    calls = 0
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        for _ in range(25):
            monitor_step(*arguments, 1)
            calls += 1
            while bench.verdict["left"] > 0:
                monitor_step(*arguments, 0)
                calls += 1
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    assert bench.state["faulty"][[4, 9]].all()
    # a call wraps its arguments, arrays of Python, and lets them go again; nothing more
    assert calls > 50
    wrapped = calls * len(arguments)
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free == wrapped
    assert after.alloc - before.alloc == after.free - before.free == wrapped
