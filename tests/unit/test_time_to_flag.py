"""Time to flag: the prediction against the flag that then really rises, and what a prediction must leave alone."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import (
    NS,
    T0_GPS_NS,
    calls,
    circular_orbit,
    finish,
    loaded_memory,
    record,
    run,
    steady_calls,
    two_body,
)

from flightsw.icd.enums import FlagState, Governing
from flightsw.icd.table_file import decode
from flightsw.memory import Memory
from ground.tables.forces import build_forces
from ground.tables.gravity_field import build_gravity_field

ORBIT = circular_orbit(500e3)
FIXED_S = 120


def truth(t_gps_ns):
    return two_body(ORBIT, t_gps_ns)


def flying(name: str, **overrides: float) -> tuple[Memory, np.ndarray]:
    """A flight after two minutes of fixes, and the inputs of what follows without any."""
    memory = loaded_memory(name, **overrides)
    if overrides.get("filter_model") == "flight":
        forces = build_forces({"degree": 8, "order": 8, "area_to_mass_m2pkg": 0.01})
        memory.load_forces(decode(forces).values, decode(build_gravity_field(None, 8)).values)
    finish(run(memory, steady_calls(FIXED_S, truth, sigma_r_m=10.0, sigma_v_mps=0.1)))
    after = T0_GPS_NS + np.arange(FIXED_S, FIXED_S + 6000, dtype=np.int64) * NS
    return memory, calls(after)


def flag_after_s(memory: Memory, inputs: np.ndarray) -> float:
    for index, out in enumerate(run(memory, inputs)):
        if out.flag == FlagState.RAISED:
            return float(index + 1)
    pytest.fail("the flag never rose")


FLIGHT = {"filter_model": "flight", "gravity_model": "J2", "integrator": "RK4", "stored_da_use": "no"}


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("paper", {"limit_m": 2000.0, "clear_limit_m": 1000.0}),
        ("two_body", {**FLIGHT, "limit_m": 300.0, "clear_limit_m": 150.0, "k_axis": 4.0}),
    ],
    ids=["paper", "flight"],
)
def test_the_flag_rises_when_it_was_predicted(name, overrides):
    """GIVEN fixes THEN a loss of GNSS raises the flag within 2 % of what was said before, at 60 s, at half time."""
    memory, inputs = flying(name, **overrides)
    ahead = record(memory.ahead)
    twin = Memory()
    twin.share_tables(memory)
    twin.nav[:] = memory.nav
    actual_s = flag_after_s(twin, inputs)
    assert 100.0 < actual_s < 5900.0
    done = 0
    for age_s in (0, 60, int(actual_s / 2)):
        finish(run(memory, inputs[done:age_s]))
        done = age_s
        memory.ahead["valid"] = memory.ahead["running"] = 0
        memory.predict(int(inputs["counter_now_ns"][max(age_s - 1, 0)]))
        assert ahead.valid
        assert ahead.governing == Governing.BOUND
        predicted_s = (ahead.t_flag_gps_ns - T0_GPS_NS) / NS - (FIXED_S - 1)
        assert predicted_s == pytest.approx(actual_s, abs=max(0.02 * actual_s, 10.0))


def test_a_prediction_in_slices_is_the_same_and_changes_nothing_else():
    memory, inputs = flying("paper", limit_m=500.0, clear_limit_m=250.0)
    counter_ns = int(inputs["counter_now_ns"][0])
    before = memory.nav.copy()
    memory.predict(counter_ns)
    at_once = memory.ahead.copy()
    memory.ahead.view(np.uint8)[:] = 0
    slices = 0
    while not memory.ahead["valid"][0]:
        memory.predict(counter_ns, 7)
        slices += 1
    assert slices > 3
    assert memory.ahead.tobytes() == at_once.tobytes()
    assert memory.nav.tobytes() == before.tobytes()


def test_it_is_made_anew_when_it_is_old_and_not_before():
    memory, inputs = flying("paper", limit_m=500.0, clear_limit_m=250.0)
    counter_ns = int(inputs["counter_now_ns"][0])
    memory.predict(counter_ns)
    first = memory.ahead.copy()
    memory.predict(counter_ns + 20 * NS)
    assert memory.ahead.tobytes() == first.tobytes()
    memory.predict(counter_ns + 26 * NS)
    assert memory.ahead["t_result_gps_ns"][0] - first["t_result_gps_ns"][0] == 26 * NS


def test_nothing_is_said_before_there_is_a_state():
    memory = loaded_memory("paper")
    memory.predict(0)
    assert not memory.ahead["valid"][0]
    assert memory.ahead["governing"][0] == Governing.NOT_READY


def test_a_raised_flag_leaves_no_time():
    memory, inputs = flying("paper", limit_m=500.0, clear_limit_m=250.0)
    left_s = int(flag_after_s(memory, inputs))
    memory.predict(int(inputs["counter_now_ns"][left_s]))
    assert memory.ahead["governing"][0] == Governing.FLAG
    assert memory.ahead["t_flag_gps_ns"][0] <= T0_GPS_NS + (FIXED_S + left_s) * NS


def test_a_table_that_saturates_is_seen_to_the_horizon_and_no_further():
    """GIVEN Table 1, whose bound settles at 494 m THEN no time is invented: the horizon governs."""
    memory, inputs = flying("paper_table1", ahead_horizon_s=3000.0)
    memory.predict(int(inputs["counter_now_ns"][0]))
    assert memory.ahead["governing"][0] == Governing.HORIZON
    last_fix_s = FIXED_S - 1
    seen_s = (memory.ahead["t_flag_gps_ns"][0] - T0_GPS_NS) / NS - last_fix_s
    assert seen_s == pytest.approx(3000.0, abs=2.0)


def test_without_a_refresh_time_there_is_no_prediction():
    memory, inputs = flying("paper", ahead_refresh_s=0.0)
    memory.predict(int(inputs["counter_now_ns"][0]))
    assert not memory.ahead["valid"][0]
    assert not memory.ahead["running"][0]
