"""A recorded receiver in the simulated world: its fixes on the bus, under outages and faults; scenarios refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import orbit_writers as write
import pytest
from gnss_files import T0_NS, World, write_rinex

from flightsw.icd.can_frames import GNSS_POSITION, GNSS_VELOCITY
from hil_sim import scenario
from hil_sim.errors import DataError, ScenarioError
from hil_sim.world import World as SimulatedWorld

NS = 1_000_000_000
STAMPS_S = np.arange(0.0, 3600.0, 10.0)
SCENARIO = """
[time]
start = "2010-07-27T00:00:00"
duration_s = 1200.0
[orbit]
source = "file"
file = "orbit.csv"
[gnss]
recorded = "x.10o"
recorded_orbits = ["x.sp3"]
recorded_antennas = false
sigma_position_m = 0.0
sigma_velocity_mps = 0.0
[flight]
table_set = "flight"
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scenario, a recording, its orbits and the true orbit of the receiver."""
    folder = tmp_path_factory.mktemp("recorded")
    world = World()
    write_rinex(folder / "x.10o", STAMPS_S, world.observe(STAMPS_S))
    world.write_sp3(folder / "x.sp3")
    t_s = np.arange(-60.0, 3600.0, 10.0)
    r = world.receiver_earth_fixed(t_s)
    h = 0.05
    v = (world.receiver_earth_fixed(t_s + h) - world.receiver_earth_fixed(t_s - h)) / (2.0 * h)
    write.save(folder / "orbit.csv", write.leogps(T0_NS + (t_s * NS).astype(np.int64), r, v))
    (folder / "case.toml").write_text(SCENARIO)
    return folder


def built(files: Path, *settings: str) -> SimulatedWorld:
    return SimulatedWorld.build(scenario.load(str(files / "case.toml"), settings), NS)


def frames_of(world: SimulatedWorld, layout) -> np.ndarray:
    """Records of one kind on the bus, in order of arrival."""
    found = [payload for k in range(world.n_ticks) for name, payload in world.frames_due(k) if name == layout.frame_id]
    return np.frombuffer(b"".join(p[: layout.dtype.itemsize] for p in found), layout.dtype)


def test_fixes_on_the_bus_are_the_recorded_ones(files: Path) -> None:
    """GIVEN a recording at 0.1 Hz WHEN the world is built THEN a position every 10 s, true to time, and no velocity."""
    world = built(files, "gnss.velocity=false")
    positions = frames_of(world, GNSS_POSITION)
    assert len(positions) == 119  # that of the start is 300 ns too early, that of the end arrives too late
    assert set(positions["fix_type"]) == {4}
    assert len(frames_of(world, GNSS_VELOCITY)) == 0
    # 300 ns before the receiver's stamps, by which its clock is fast
    assert set((positions["t_gps_ns"] - T0_NS) % (10 * NS)) == {10 * NS - 300}
    truth = World().receiver_earth_fixed((positions["t_gps_ns"] - T0_NS) / 1e9)
    found = np.column_stack([positions[f"{axis}_itrf_m"] for axis in "xyz"])
    assert np.linalg.norm(found - truth, axis=1).max() < 0.02
    sigma = np.column_stack([positions[f"sigma_{axis}_m"] for axis in "xyz"])
    assert 0.3 < np.median(sigma) < 3.0
    assert np.linalg.norm(world.truth_arrays()["fix_error_m"], axis=1).max() < 0.05


def test_velocities_come_with_the_fixes_that_have_one(files: Path) -> None:
    """GIVEN velocity asked for WHEN the world is built THEN the fix that has none, the first, is not sent."""
    world = built(files)
    positions, velocities = frames_of(world, GNSS_POSITION), frames_of(world, GNSS_VELOCITY)
    assert len(positions) == len(velocities) == 119
    assert set(positions["fix_type"]) == {3}
    assert np.array_equal(positions["t_gps_ns"], velocities["t_gps_ns"])
    speed = np.linalg.norm(np.column_stack([velocities[f"v{axis}_itrf_mps"] for axis in "xyz"]), axis=1)
    assert 7e3 < speed.min() < speed.max() < 8.2e3


def test_outages_dropouts_and_faults_befall_them(files: Path) -> None:
    """GIVEN an outage and a fault WHEN the world is built THEN both strike the recorded fixes as any other."""
    outage = ("outage.0.start_s=200", "outage.0.duration_s=300")
    fault = ("fault.0.kind=position_step", "fault.0.start_s=900", "fault.0.duration_s=100", "fault.0.value=500")
    usual = frames_of(built(files, "gnss.velocity=false"), GNSS_POSITION)
    struck = frames_of(built(files, "gnss.velocity=false", *outage, *fault), GNSS_POSITION)
    age_s = (struck["t_gps_ns"] - T0_NS) / NS
    assert not np.any((age_s >= 200.0) & (age_s < 500.0))
    assert len(struck) == len(usual) - 31  # the one before it would arrive in it
    same = usual[np.isin(usual["t_gps_ns"], struck["t_gps_ns"])]
    step = struck["x_itrf_m"] - same["x_itrf_m"]
    hit = (age_s >= 900.0) & (age_s < 1000.0)
    assert hit.sum() == 10
    assert np.allclose(step[hit], 500.0)
    assert not step[~hit].any()
    thinned = frames_of(built(files, "gnss.velocity=false", "gnss.dropout_probability=0.5"), GNSS_POSITION)
    assert 30 < len(thinned) < 90


def test_the_lever_arm_is_part_of_the_true_position(files: Path) -> None:
    """GIVEN an antenna said to be a metre above the centre of mass WHEN errors are told THEN they are a metre more."""
    world = built(files, "gnss.antenna_offset_m=[0.0, 0.0, -1.0]")
    assert np.linalg.norm(world.truth_arrays()["fix_error_m"], axis=1) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["gnss.recorded_orbits=[]"], "gnss.recorded_orbits: observations are solved with precise orbits"),
        (["gnss.sigma_position_m=1.0"], "gnss.sigma_position_m: a recorded receiver has its own noise"),
        (["gnss.coloured_sigma_m=1.0"], "gnss.sigma_position_m: a recorded receiver has its own noise"),
        (["orbit={period_s=5700.0}"], "gnss.recorded: a recorded receiver flew one orbit only"),
    ],
)
def test_contradictions_are_refused(files: Path, settings: list[str], said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        scenario.load(str(files / "case.toml"), settings)


def test_files_that_are_not_there_are_named(files: Path) -> None:
    with pytest.raises(DataError, match=r"gnss\.recorded_orbits\.0: no file .*none\.sp3"):
        built(files, 'gnss.recorded_orbits=["none.sp3"]')
    with pytest.raises(DataError, match=r"gnss\.recorded: no file .*none\.10o"):
        built(files, "gnss.recorded=none.10o")


def test_a_run_outside_the_recording_is_refused(files: Path, tmp_path: Path) -> None:
    short = World()
    write_rinex(tmp_path / "short.10o", STAMPS_S[:20], short.observe(STAMPS_S[:20]))
    with pytest.raises(DataError, match=r"short\.10o: no fixes in the run, which begins 2010-07-27 00:30:00 GPS"):
        built(
            files,
            f'gnss.recorded="{tmp_path / "short.10o"}"',
            "gnss.velocity=false",
            'time.start="2010-07-27T00:30:00"',
        )
