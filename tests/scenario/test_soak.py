"""`hil_sim soak`: laps that go on where the one before ended, and an account that sees what it is there to see."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightsw.icd.can_frames import TIME_SYNC
from hil_sim import scenario, soak, soak_report
from hil_sim.errors import ScenarioError
from hil_sim.laps import Lap, Prepared, laps
from hil_sim.world import World

PERIOD_NS = 100_000_000
LAP_S = 60
TICKS = 1500  # two laps and a half
WORDS = """
name = "short"
[time]
start = "2019-01-01T00:00:00"
duration_s = 60.0
[orbit]
semi_major_axis_m = 7714000.0
inclination_deg = 66.0
[truth]
gravity_degree = 4
[gnss]
sigma_position_m = 0.0
sigma_velocity_mps = 0.0
latency_s = 1.5
[pseudoranges]
[crosslink]
satellites = 12
central_angle_max_deg = 100.0
period_s = 5.0
[oscillator]
drift_ppm = 20.0
[[fault]]
kind = "bit_flip"
start_s = 30.0
duration_s = 10.0
probability = 0.1
[[satellite_fault]]
kind = "step"
count = 1
start_s = 40.0
duration_s = 10.0
value = 50.0
[flight]
table_set = "flight"
[flight.functions]
gnss = "gnss"
crosslink = "crosslink"
velocity_check = "velocity_check"
[flight.function_table.crosslink]
silence_max_s = 12.5
"""


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> scenario.LoadedScenario:
    path = tmp_path_factory.mktemp("soak") / "short.toml"
    path.write_text(WORDS)
    return scenario.load(str(path))


@pytest.fixture(scope="module")
def flown(loaded: scenario.LoadedScenario) -> list[Lap]:
    return list(laps(loaded, TICKS, PERIOD_NS))


@pytest.fixture(scope="module")
def soaked(loaded: scenario.LoadedScenario, tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Path]:
    folder = tmp_path_factory.mktemp("soak") / "out"
    return soak.run(loaded, folder, TICKS), folder


def test_every_tick_is_in_one_lap(flown: list[Lap]) -> None:
    """GIVEN a counter that is fast by 20 ppm WHEN laps are made THEN ticks follow each other by one period of the
    counter through all of them, and there are as many as were asked for."""
    assert [lap.number for lap in flown] == [0, 1, 2]
    assert [lap.first_tick for lap in flown] == [0, *np.cumsum([len(lap.due) for lap in flown])[:-1].tolist()]
    assert sum(len(lap.due) for lap in flown) == TICKS
    t = np.concatenate([lap.t_true_gps_ns for lap in flown])
    assert np.diff(t) == pytest.approx(PERIOD_NS * (1.0 - 20e-6), abs=50.0)


def test_the_satellite_flies_on_from_lap_to_lap(flown: list[Lap]) -> None:
    """GIVEN laps end to end THEN velocity is what position changes by, across their turns as well."""
    r = np.concatenate([lap.r_gcrf_m for lap in flown])
    v = np.concatenate([lap.v_gcrf_mps for lap in flown])
    t_s = np.concatenate([lap.t_true_gps_ns for lap in flown]) / 1e9
    middle = 0.5 * (v[1:] + v[:-1]) * np.diff(t_s)[:, None]
    assert np.abs(np.diff(r, axis=0) - middle).max() < 0.01


def test_the_first_lap_is_the_scenario_itself(loaded: scenario.LoadedScenario, flown: list[Lap]) -> None:
    """GIVEN a scenario WHEN it is soaked THEN its first lap brings flight the frames of a run, tick by tick."""
    world = World.build(loaded, PERIOD_NS)
    lap = flown[0]
    same = min(len(lap.due), world.n_ticks) - 20  # the last second's frames belong to the next lap
    for k in range(same):
        first = int(lap.due[k - 1]) if k else 0
        frames = [
            (int(lap.frame_id[i]), lap.payload[lap.ends[i] : lap.ends[i + 1]]) for i in range(first, int(lap.due[k]))
        ]
        assert frames == world.frames_due(k)


def test_dice_are_thrown_anew_and_nothing_is_lost_at_a_turn(flown: list[Lap]) -> None:
    """GIVEN pulses that arrive after a second and a half THEN frames of two laps differ, and the last pulse of the
    first lap arrives in the second."""
    assert flown[0].payload[:5000] != flown[1].payload[:5000]
    pulses = [int(np.count_nonzero(lap.frame_id == TIME_SYNC.frame_id)) for lap in flown[:2]]
    assert pulses == [LAP_S - 1, LAP_S]


def test_a_soak_is_flat_and_says_so(soaked: tuple[int, Path]) -> None:
    """GIVEN a short soak WHEN flown THEN ticks, digests, marks and the repeated beginning are in soak.json, nothing has
    failed and the report is written."""
    status, folder = soaked
    found = json.loads((folder / soak.RESULT).read_text())
    assert found["failures"] == []
    assert status == 0
    assert found["ticks"] == TICKS
    assert len({lap["digest"] for lap in found["laps"]}) == 3
    assert found["beginning_again"]["same"]
    assert found["rejected_by_cause"]["BAD_CRC"] > 0
    assert all(lap["published"] >= 3 * lap["messages"] / 10 > 0 for lap in found["laps"])
    assert "Flat, no slips" in (folder / "soak.md").read_text()


def test_telemetry_is_compared_with_another_soak(
    loaded: scenario.LoadedScenario, soaked: tuple[int, Path], tmp_path: Path
) -> None:
    """GIVEN the result of a soak, and one with another digest WHEN the same is flown again expecting either THEN the
    first is met, and the second is a failure that names the lap."""
    expected = soaked[1] / soak.RESULT
    assert soak.run(loaded, tmp_path / "again", TICKS, expected) == 0
    found = json.loads((tmp_path / "again" / soak.RESULT).read_text())
    assert found["expected"] == {"laps": 3, "different": []}
    other = json.loads(expected.read_text())
    other["laps"][1]["digest"] = "00" * 32
    found["expected"] = soak_report.compare(found, other)
    assert soak_report.failures(found) == ["lap 1 gave other telemetry than expected"]


def test_stopped_by_hand_it_tells_what_was_flown(
    loaded: scenario.LoadedScenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN a soak WHEN it is stopped in its second lap THEN it ends with 130 and an account of the first."""
    taken = iter(())
    original = Prepared.next

    def interrupted(self: Prepared) -> Lap | None:
        if next(taken, None) is not None:
            return original(self)
        raise KeyboardInterrupt

    taken = iter((1,))
    monkeypatch.setattr(Prepared, "next", interrupted)
    assert soak.run(loaded, tmp_path / "out", TICKS) == 130
    found = json.loads((tmp_path / "out" / soak.RESULT).read_text())
    assert len(found["laps"]) == 1
    assert "STOPPED BY HAND" in (tmp_path / "out" / "soak.md").read_text()


def test_an_unreadable_expectation_is_refused(loaded: scenario.LoadedScenario, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"--expect .*nothing\.json: cannot be read"):
        soak.run(loaded, tmp_path, TICKS, tmp_path / "nothing.json")


def lap_of(**changed: Any) -> dict[str, Any]:
    names = ("blocks", "grown", "rss_bytes", "unreachable", "slips", "dropped", "bad", "unheard", "violations")
    return {**dict.fromkeys(names, 0), "collected": [0, 0, 0], "ticks": 1000, "digest": "a", **changed}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"grown": 65}, "65 more blocks"),
        ({"rss_bytes": 17 << 20}, "17 MiB more resident"),
        ({"collected": [9, 3, 1]}, "1 generation-2 passes"),
        ({"unreachable": 1}, "1 objects in cycles"),
        ({"dropped": 2}, "2 entries of the journal dropped"),
        ({"bad": 1}, "1 published frames that are not intact"),
        ({"unheard": 3}, "3 ticks of which nothing was heard"),
        ({"violations": 4}, "4 epochs with a bound below the error"),
    ],
)
def test_what_must_hold_is_seen_to(changed: dict[str, Any], said: str) -> None:
    """GIVEN an account in which one thing is wrong THEN that is named; with nothing wrong there is no failure."""
    assert soak_report.failures({"laps": [lap_of(), lap_of()], "slips": 0}) == []
    (one,) = soak_report.failures({"laps": [lap_of(), lap_of(**changed)], "slips": 0})
    assert said in one
    assert soak_report.failures({"laps": [lap_of()], "slips": 7}) == ["7 slips in lockstep"]
