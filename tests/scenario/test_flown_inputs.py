"""What an arc is told: the inputs of the step, made in bulk, against the same frames taken tick by tick."""

from __future__ import annotations

import numpy as np
import pytest
from harness import fault, faults, load

from flightsw.can_port import CanPort
from flightsw.icd.enums import REJECT_CAUSES
from flightsw.journal import Journal
from flightsw.sensing.can_receiver import CanReceiver
from flightsw.sensing.epoch_assembly import EpochAssembly
from ground.campaign import flown
from hil_sim.world import World


def tick_by_tick(world: World) -> tuple[np.ndarray, np.ndarray]:
    """The plain loop that `step_inputs` replaces: every tick begun, every frame taken, every input copied."""
    rejected = [0] * REJECT_CAUSES
    assembly = EpochAssembly(rejected)
    port = CanPort(lambda: flown._NoBus())  # type: ignore[arg-type, return-value]
    receiver = CanReceiver(port, Journal(None), assembly, rejected)
    calls, ticks = [], []
    for tick in range(world.n_ticks):
        frames = world.frames_due(tick)
        counter_ns = world.counter_ns(tick)
        if not frames:
            blank = np.zeros(1, assembly.inputs.dtype)
            blank["counter_now_ns"] = counter_ns
            calls.append(blank)
            ticks.append(tick)
            continue
        assembly.begin(counter_ns)
        for frame_id, payload in frames:
            receiver.take(frame_id, payload)
        for index in range(max(assembly.count, 1)):
            calls.append(assembly.calls[index].copy())
            ticks.append(tick)
    return np.concatenate(calls), np.array(ticks, np.int64)


@pytest.mark.parametrize(
    "settings",
    [
        (),
        ("gnss.rate_hz=10", "gnss.latency_s=0.35"),
        ("outage=[{start_s=20.0, duration_s=15.0}]",),
        (
            "gnss.velocity=false",
            "attitude={sigma_rad=0.001, rate_hz=20.0}",
            "burn=[{start_s=30.0, duration_s=5.0, dv_mps=[0.0, 1.0, 0.0], announce_lead_s=20.0}]",
            'command=[{at_s=40.0, command="edit", target="velocity", value="inhibit"}]',
        ),
        (
            faults(
                fault("frame_drop", 5, 20, probability=0.3),
                fault("bit_flip", 10, 20, probability=0.5),
                fault("late", 25, 20, value=0.7),
            ),
        ),
    ],
    ids=["plain", "several epochs in a tick", "outage", "every other kind of frame", "faults"],
)
def test_bulk_inputs_are_those_of_the_plain_loop(settings: tuple[str, ...]) -> None:
    """GIVEN a minute of frames WHEN its inputs are made in bulk THEN they are those of the plain loop, bit for bit."""
    world = World.build(load(*settings))
    inputs, ticks = flown.step_inputs(world)
    expected_inputs, expected_ticks = tick_by_tick(world)
    assert inputs.tobytes() == expected_inputs.tobytes()
    assert ticks.tobytes() == expected_ticks.tobytes()


def test_the_step_is_told_of_burns_attitudes_commands_and_positions_alone() -> None:
    """GIVEN a world that sends them WHEN its inputs are made THEN each is there once, with the world's own numbers."""
    world = World.build(
        load(
            "gnss.velocity=false",
            "attitude={sigma_rad=0.001, rate_hz=2.0}",
            "burn=[{start_s=30.0, duration_s=5.0, dv_mps=[0.0, 1.0, 0.0], announce_lead_s=20.0}]",
            'command=[{at_s=40.0, command="edit", target="velocity", value="inhibit"}]',
        )
    )
    inputs, ticks = flown.step_inputs(world)
    (burn,) = inputs[inputs["burn_present"] == 1]
    assert (burn["burn_start_gps_ns"] - world.t_start_gps_ns, burn["burn_duration_ns"]) == (30 * 10**9, 5 * 10**9)
    assert burn["burn_dv_mps"].tolist() == [0.0, 1.0, 0.0]
    (command,) = inputs[inputs["command_present"] == 1]
    assert (command["command_id"], command["command_target"], command["command_value"]) == (1, 1, 3)
    assert ticks[inputs["command_present"] == 1].tolist() == [401]  # the counter runs fast by 1 ppm
    fixes = inputs[inputs["fix_present"] == 1]
    assert len(fixes) == 60
    assert not fixes["fix_has_velocity"].any()
    assert np.isnan(fixes["fix_v_itrf_mps"]).all()
    attitudes = inputs[inputs["attitude_present"] == 1]
    assert len(attitudes) == 120
    np.testing.assert_allclose(np.linalg.norm(attitudes["attitude_q"], axis=1), 1.0, atol=1e-6)
    assert (np.diff(attitudes["attitude_gps_ns"]) == 5 * 10**8).all()


def test_a_world_without_frames_still_ticks() -> None:
    """GIVEN an outage over the whole run WHEN inputs are made THEN there is one blank input for each tick."""
    world = World.build(load("outage=[{start_s=0.0, duration_s=60.0}]"))
    inputs, ticks = flown.step_inputs(world)
    assert ticks.tolist() == list(range(world.n_ticks))
    assert inputs["counter_now_ns"].tolist() == [world.counter_ns(k) for k in range(world.n_ticks)]
    assert not inputs["pulse_present"].any()
    assert not inputs["fix_present"].any()
