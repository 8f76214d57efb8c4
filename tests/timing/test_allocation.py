"""Ten thousand ticks leave no block of memory behind and give the garbage collector nothing to do."""

import gc
import sys

import pytest
from budgets import BUDGETS
from harness import Flight, fault, faults, load

from flightsw import realtime
from hil_sim import sil

BUDGET = BUDGETS["allocation"]
WARM_TICKS, TICKS = BUDGET["warm_ticks"], BUDGET["ticks"]


def fly(flight: Flight, ticks: int) -> None:
    """Ticks without the bench's own records: world, flight, slack, and a monitor that forgets what it hears."""
    world, loop, clock, pair = flight.world, flight.loop, flight.clock, flight.pair
    for k in range(flight.k, flight.k + ticks):
        counter_ns = world.counter_ns(k)
        clock.wait_until(counter_ns)
        world.send_due(k, pair.world, 0.0)
        loop.run_tick()
        loop.rest(counter_ns + flight.period_ns)
        while pair.world.recv(0.0) is not None:
            pass
    flight.k += ticks


SETTINGS = {
    "fixes": (),
    "velocity check beside": ('flight.functions.velocity_check="velocity_check"',),
    "outage": ("outage=[{start_s=320.0, duration_s=900.0}]",),
    "refused fixes and damaged frames": (
        faults(
            fault("bit_flip", 300, 400, probability=0.5),
            fault("nan", 700, 300),
            fault("position_step", 1000, 200, value=9e4),
        ),
    ),
    "pseudoranges with faults": (
        'satellite_fault=[{kind="step", constellation="gps", count=2, start_s=900.0, duration_s=300.0, value=30.0}]',
    ),
    "pseudoranges of one frequency": ("outage=[]", "satellite_fault=[]"),
}
# the others: two_orbits
SCENARIOS = {"pseudoranges with faults": "gnss_faults", "pseudoranges of one frequency": "single_frequency"}


@pytest.mark.parametrize("name", SETTINGS)
def test_ten_thousand_ticks_net_no_blocks(name: str, tmp_path) -> None:
    """GIVEN a warm flight with its journal on WHEN it ticks 10,000 times through bus, codec, step and telemetry THEN
    sys.getallocatedblocks is what it was, within a handful: nothing grows by the tick or by the frame.
    """
    scenario = SCENARIOS.get(name, "two_orbits")
    with Flight(load("time.duration_s=1310", *SETTINGS[name], name=scenario), tmp_path) as flight:
        fly(flight, WARM_TICKS)
        gc.collect()
        before = sys.getallocatedblocks()
        fly(flight, TICKS)
        gc.collect()
        left = sys.getallocatedblocks() - before
    print(f"{left} blocks after {TICKS} ticks")
    assert abs(left) <= BUDGET["spare_blocks"]


def test_ticks_with_crosslinks_net_no_blocks(tmp_path) -> None:
    """GIVEN a warm flight of one of 24 satellites WHEN it takes and judges 100 epochs of 228 links, a neighbour
    wrong, THEN no block stays."""
    jump = "crosslink_fault=[{satellites=[9], start_s=30.0, jump_m=[0.0, 70.0, 0.0, 0.0]}]"
    with Flight(load("time.duration_s=150", jump, name="crosslink_jump"), tmp_path) as flight:
        fly(flight, 450)
        gc.collect()
        before = sys.getallocatedblocks()
        fly(flight, 1000)
        gc.collect()
        left = sys.getallocatedblocks() - before
    assert abs(left) <= BUDGET["spare_blocks"]


def test_the_collector_has_nothing_to_collect(tmp_path) -> None:
    """GIVEN the collector left on WHEN flight ticks 10,000 times THEN no generation-2 pass is due, and a pass made
    afterwards finds not one unreachable object: the loop makes no cycles, so switching the collector off loses nothing.
    """
    with Flight(load("time.duration_s=1310"), tmp_path) as flight:
        fly(flight, WARM_TICKS)
        gc.collect()
        before = [generation["collections"] for generation in gc.get_stats()]
        fly(flight, TICKS)
        passes = [now["collections"] - then for now, then in zip(gc.get_stats(), before, strict=True)]
        found = gc.collect()
    print(f"passes by generation: {passes}")
    assert passes[2] == 0
    assert found == 0


def test_hygiene_switches_the_collector_off() -> None:
    enabled = gc.isenabled()
    gc.unfreeze()  # tests/conftest.py has frozen what was imported
    try:
        realtime.settle_garbage()
        assert not gc.isenabled()
        assert gc.get_freeze_count() > 1000
    finally:
        if enabled:
            gc.enable()


def test_a_lockstep_run_hides_from_the_collector_what_was_there_before() -> None:
    """GIVEN a process that froze nothing WHEN a run is flown THEN no pass looks at what was there, and all is as it was
    afterwards; what somebody else had frozen stays so.
    """
    gc.unfreeze()  # tests/conftest.py has frozen what was imported
    try:
        with sil.collector_at_rest():
            assert gc.get_freeze_count() > 1000
        assert gc.get_freeze_count() == 0
    finally:
        gc.freeze()
    frozen = gc.get_freeze_count()
    with sil.collector_at_rest():
        pass
    assert gc.get_freeze_count() >= frozen > 1000
