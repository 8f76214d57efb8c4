"""A simulated world flown through the compiled arc: the same frames and the same step as on the bus, without the bus.

A test flies an hour both ways and finds the same bits; here it is merely two hundred times faster.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flightsw.can_port import CanPort
from flightsw.icd.can_frames import INTEGRITY, NAV_STATE
from flightsw.icd.enums import REJECT_CAUSES
from flightsw.icd.table_file import TableImage, decode
from flightsw.journal import Journal
from flightsw.memory import Memory
from flightsw.nav.flight_model import FLIGHT
from flightsw.records import INPUT
from flightsw.sensing.can_receiver import CanReceiver
from flightsw.sensing.epoch_assembly import EpochAssembly
from ground.campaign import arc
from ground.errors import OperatorError
from ground.tables.forces import build_force_tables
from hil_sim import scenario
from hil_sim.errors import SimulationError
from hil_sim.world import World, space_weather_file


class ForceImages(NamedTuple):
    """The two tables that the flight filter needs besides."""

    forces: TableImage
    gravity_field: TableImage


class _NoBus:
    """A bus on which nothing is ever heard: frames are handed to the receiver directly."""

    def recv(self, timeout: float | None = None) -> None:
        del timeout

    def shutdown(self) -> None:
        """Nothing to shut down."""


def step_inputs(world: World) -> tuple[np.ndarray, np.ndarray]:
    """What the navigation step is told on this world, by flight's own receiver and epoch assembly.

    Returns inputs (n,) of `records.INPUT` and, for each, the tick it belongs to (n,). A tick has at least one.
    """
    rejected = [0] * REJECT_CAUSES
    assembly = EpochAssembly(rejected)
    port = CanPort(lambda: _NoBus())  # type: ignore[arg-type, return-value]
    receiver = CanReceiver(port, Journal(None), assembly, rejected)
    busy = world.busy_ticks()
    epochs = bytearray()  # the inputs of busy ticks, one after the other
    steps = np.ones(world.n_ticks, np.int64)
    for tick in busy.tolist():
        assembly.begin(world.counter_ns(tick))
        for frame_id, payload in world.frames_due(tick):
            receiver.take(frame_id, payload)
        steps[tick] = max(assembly.count, 1)
        epochs += assembly.inputs[: steps[tick]].tobytes()
    ticks = np.repeat(np.arange(world.n_ticks, dtype=np.int64), steps)
    inputs = np.zeros(len(ticks), INPUT)
    # most ticks bring nothing but the reading of the counter
    inputs["counter_now_ns"] = world.counter0_ns + ticks * world.tick_period_ns
    inputs[np.isin(ticks, busy)] = np.frombuffer(epochs, INPUT)
    return inputs, ticks


def build_world(tree: dict[str, Any], where: str, tick_period_ns: int) -> World:
    """The world of a scenario that was drawn, not written. tree: what its file would hold; where: its name in messages.

    Raises OperatorError where scenario or data do not allow it.
    """
    try:
        return World.build(scenario.from_tree(tree, where), tick_period_ns)
    except SimulationError as error:
        raise OperatorError(str(error)) from error


def force_images(world: World) -> ForceImages:
    """The force tables of a run on this world: those that a run in real time would build."""
    try:
        weather = space_weather_file(world.loaded)
    except SimulationError as error:
        raise OperatorError(str(error)) from error
    made = build_force_tables(world.t_start_gps_ns, world.scenario.truth.fixed_f107, weather)
    return ForceImages(*map(decode, made))


def flies_forces(navigation: TableImage) -> bool:
    """Whether a navigation table flies the flight filter, and so force tables."""
    return int(navigation.values["filter_model"][0]) == FLIGHT


def fly_world(
    world: World,
    navigation: TableImage,
    orientation: TableImage,
    inputs: tuple[np.ndarray, np.ndarray] | None = None,
    forces: ForceImages | None = None,
) -> tuple[np.ndarray, dict[str, Any]]:
    """Fly a world; returns outputs, one for each tick (n_ticks,) of `records.OUTPUT`, and what a monitor would hold.

    inputs: of `step_inputs`, if made before. forces: for the flight filter; None builds those of the world's run.
    """
    steps, ticks = inputs if inputs is not None else step_inputs(world)
    memory = Memory()
    memory.load(navigation.values, orientation.values)
    if flies_forces(navigation):
        memory.load_forces(*(image.values for image in (forces if forces is not None else force_images(world))))
    outputs = last_of_tick(arc.fly(memory, steps), ticks)
    return outputs, as_monitor(outputs)


def last_of_tick(outputs: np.ndarray, ticks: np.ndarray) -> np.ndarray:
    """The last output of each tick: a tick has as many calls as it brought fixes and pulses."""
    return outputs[np.r_[np.flatnonzero(np.diff(ticks)), len(ticks) - 1]]


def as_monitor(outputs: np.ndarray) -> dict[str, Any]:
    """Outputs of the step as a monitor on the bus would have recorded them, for the evaluation of a run."""
    n = len(outputs)
    nav = np.zeros(n, NAV_STATE.dtype)
    integrity = np.zeros(n, INTEGRITY.dtype)
    for axis, name in enumerate("xyz"):
        nav[f"{name}_gcrf_m"] = outputs["r_gcrf_m"][:, axis]
        nav[f"v{name}_gcrf_mps"] = outputs["v_gcrf_mps"][:, axis]
    for record in (nav, integrity):
        record["t_gps_ns"] = outputs["t_gps_ns"]
        record["mode"] = outputs["mode"]
        record["flag_state"] = outputs["flag"]
    nav["validity"] = outputs["validity"]
    for name in ("bound_m", "bound_3d_m", "limit_m", "fix_age_s", "outage_age_s", "flag_age_s", "verdict", "driver"):
        integrity[name] = outputs[name]
    return {"tick": np.arange(n, dtype=np.int64), "nav": nav, "integrity": integrity}
