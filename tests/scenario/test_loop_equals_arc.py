"""Fly what you tune: the loop behind bus and codec, and the compiled arc on its inputs, are the same to the bit."""

import numpy as np
import pytest
from harness import Flight, StepRecorder, fault, faults, load, whole_difference

from flightsw.icd.enums import Mode
from flightsw.memory import Memory
from flightsw.records import INPUT, OUTPUT
from ground.campaign import arc
from ground.campaign.flown import fly_world, step_inputs
from hil_sim.world import World

HOUR = (
    "time.duration_s=3600",
    "outage=[{start_s=1200.0, duration_s=900.0}]",
    "gnss.dropout_probability=0.02",
    faults(
        fault("position_step", 300, 15, value=900.0),
        fault("time_jump", 400, 20, value=0.001),
        fault("bit_flip", 500, 60, probability=0.3),
        fault("nan", 600, 5),
        fault("late", 700, 30, value=0.7),
        fault("receiver_reset", 800, 10),
        fault("leap_second", 3000, 30),
    ),
)


@pytest.mark.parametrize(("table_set", "duration_s"), [("j2", 3600), ("paper", 1500)])
def test_an_hour_is_the_same_to_the_bit(monkeypatch: pytest.MonkeyPatch, table_set: str, duration_s: int) -> None:
    """GIVEN an hour with an outage and faults, flown through CAN, receiver, assembly and loop WHEN the inputs that the
    step was given are flown by the compiled `for` THEN every output of every step, and at the end the whole navigation
    record (state, P, P_bound, flag, clock, stored dA, counters), are the same bits.
    """
    recorder = StepRecorder().install(monkeypatch)
    hour = [one for one in HOUR if duration_s == 3600 or not one.startswith("fault")]
    with Flight(load(*hour, f"time.duration_s={duration_s}", f'flight.table_set="{table_set}"')) as flight:
        recorder.inputs.clear()  # the preflight's
        recorder.outputs.clear()
        flight.fly()
    assert flight.nav["fixes_accepted"][0] > 1000
    assert {Mode.INIT, Mode.INTEGRATED, Mode.AUTONOMOUS} <= set(flight.flown["mode"])

    inputs = np.frombuffer(bytearray().join(recorder.inputs), INPUT)
    flown = np.frombuffer(b"".join(recorder.outputs), OUTPUT)
    assert len(inputs) >= flight.k
    memory = Memory()
    memory.load(flight.navigation.values, flight.orientation.values)
    outputs = arc.fly(memory, inputs)
    assert whole_difference(memory.nav, flight.nav) == []
    assert whole_difference(outputs, flown) == []


def test_the_campaigns_short_cut_is_the_flight() -> None:
    """GIVEN a world WHEN the campaign hands its frames straight to flight's receiver THEN what comes out is that of
    the flight behind the bus, tick by tick.
    """
    loaded = load(
        *HOUR,
        "time.duration_s=900",
        "outage=[{start_s=400.0, duration_s=300.0}]",
        faults(fault("bit_flip", 100, 99, probability=0.5)),
    )
    with Flight(loaded) as flight:
        flight.fly()
    world = World.build(loaded)
    inputs, ticks = step_inputs(world)
    assert ticks[-1] == flight.k - 1
    outputs, _ = fly_world(world, flight.navigation, flight.orientation, (inputs, ticks))
    assert whole_difference(outputs, flight.flown) == []
