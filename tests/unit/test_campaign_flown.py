"""Worlds flown through the arc: the flight filter gets its force tables."""

from __future__ import annotations

import numpy as np
import pytest
from harness import load

from flightsw.icd.enums import Mode
from ground.campaign import flown
from ground.errors import OperatorError
from ground.studies.flights import HOUR_NS, NS, prepare
from hil_sim.world import World

pytestmark = pytest.mark.compiled


def test_the_flight_set_flies_with_forces() -> None:
    """GIVEN the flight set on a world whose outage begins after 120 s WHEN flown through the arc THEN the flag never
    says that a bound is missing, and 100 s into the outage the error is metres, within the bound."""
    prepared = prepare(
        "two_orbits",
        ['flight.table_set="flight"', "time.duration_s=220", "outage=[{start_s=120.0, duration_s=150.0}]"],
        NS,
    )
    outputs, monitor = prepared.fly(prepared.table())
    assert outputs["mode"][-1] == Mode.AUTONOMOUS
    started = outputs["mode"] != Mode.INIT
    assert np.isfinite(outputs["bound_m"][started]).all()
    error_m = prepared.error_m(outputs)[started]
    assert (error_m <= outputs["bound_m"][started]).all()
    assert error_m[-1] < 60.0
    assert len(monitor["tick"]) == prepared.world.n_ticks


def test_forces_are_those_of_the_worlds_own_day_and_flux() -> None:
    """GIVEN a world with a fixed solar flux WHEN its force tables are made THEN they hold that flux."""
    world = World.build(load("truth.solar=fixed:187", "time.duration_s=10"), NS)
    forces = flown.force_images(world).forces
    assert forces.values["f107"][0] == 187.0
    assert world.t_start_gps_ns > HOUR_NS


def test_a_drawn_scenario_that_contradicts_itself_is_refused_by_name() -> None:
    """GIVEN a tree without a size of the orbit WHEN a world is built THEN an OperatorError names run and key."""
    tree = {
        "name": "run",
        "time": {"start": "2019-01-01T00:00:00", "duration_s": 60.0},
        "orbit": {},
        "gnss": {"sigma_position_m": 10.0, "sigma_velocity_mps": 0.1},
        "flight": {"table_set": "flight"},
    }
    with pytest.raises(OperatorError, match=r"run 7: orbit\.period_s"):
        flown.build_world(tree, "run 7", NS)
