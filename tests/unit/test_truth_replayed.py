"""Real orbits as truth: a propagated motion written to files and replayed, holes, spans that a file does not cover."""

from pathlib import Path

import numpy as np
import orbit_writers as write
import pytest

from hil_sim import gps_time, scenario
from hil_sim.errors import DataError
from hil_sim.scenario_schema import Orbit, TruthModel
from hil_sim.truth import propagated, replayed
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.interface import TrackTruth
from hil_sim.truth.orbit_files.read import read_orbit
from hil_sim.truth.real_orbit import evenly_spaced

T0_NS = scenario.load("two_orbits").t_start_gps_ns
STEP_NS = 60 * gps_time.NS
COUNT = 41
TIMES = T0_NS + np.arange(COUNT) * STEP_NS
FINE = T0_NS + np.arange(COUNT * 6) * 10 * gps_time.NS
BETWEEN = T0_NS + np.linspace(5 * STEP_NS, 30 * STEP_NS, 777).astype(np.int64)


@pytest.fixture(scope="module")
def truth() -> TrackTruth:
    return propagated.propagate(Orbit(period_s=6000.0), TruthModel(), T0_NS, COUNT * STEP_NS)


@pytest.fixture(scope="module")
def fixed(truth: TrackTruth) -> tuple[np.ndarray, np.ndarray]:
    """The motion at TIMES in ITRF."""
    return EarthOrientation(T0_NS, T0_NS + COUNT * STEP_NS).to_itrf(TIMES, *truth.state_gcrf(TIMES))


def assert_follows(replay: TrackTruth, truth: TrackTruth, position_m: float, velocity_mps: float = 1e-3) -> None:
    """The replay is the truth between the samples too."""
    r, v = replay.state_gcrf(BETWEEN)
    true_r, true_v = truth.state_gcrf(BETWEEN)
    assert np.linalg.norm(r - true_r, axis=1).max() < position_m
    assert np.linalg.norm(v - true_v, axis=1).max() < velocity_mps


def replay_of(path: Path, **arguments: str) -> TrackTruth:
    return replayed.load_truth(path, int(BETWEEN[0]), int(BETWEEN[-1]), **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", write.EARTH_FIXED)
def test_every_earth_fixed_file_gives_back_the_motion(tmp_path, truth, fixed, name: str) -> None:
    """A wrong time scale would be kilometres, a wrong frame half a kilometre per second; left is rounding."""
    path = write.save(tmp_path / (name + ".gz"), write.EARTH_FIXED[name](TIMES, *fixed))
    assert_follows(replay_of(path), truth, 0.01)


@pytest.mark.parametrize("unit", ["dm/s", "m/s"])
@pytest.mark.parametrize("scale", ["GPS", "TAI", "UTC"])
def test_sp3_gives_back_the_motion(tmp_path, truth, fixed, unit: str, scale: str) -> None:
    path = write.save(tmp_path / "orbit.sp3.gz", write.sp3(TIMES, *fixed, scale, unit))
    assert_follows(replay_of(path), truth, 0.01)


def test_derived_velocities_serve_as_well(tmp_path, truth, fixed) -> None:
    path = write.save(tmp_path / "orbit.sp3.gz", write.sp3(TIMES, fixed[0], None))
    assert_follows(replay_of(path), truth, 0.01)


@pytest.mark.parametrize("form", [write.oem_kvn, write.oem_xml])
def test_an_inertial_message_gives_back_the_motion(tmp_path, truth, form) -> None:
    path = write.save(tmp_path / "orbit.oem", form([(TIMES, *truth.state_gcrf(TIMES))], "GCRF", "TT"))
    assert_follows(replay_of(path), truth, 1e-4, 1e-6)


def test_georb_gives_back_the_motion(tmp_path, truth) -> None:
    """Terrestrial Time is 51.184 s ahead of GPS, and 0.2 microseconds of jitter would be 1.5 mm."""
    path = write.save(tmp_path / "x.orb", write.georb(FINE, *truth.state_gcrf(FINE)))
    assert_follows(replay_of(path), truth, 1e-4)


def test_georb_with_wild_time_stamps_is_refused(tmp_path, truth) -> None:
    path = write.save(tmp_path / "x.orb", write.georb(FINE, *truth.state_gcrf(FINE), jitter_s=1e-4))
    with pytest.raises(DataError, match=r"line \d+: time stamps off the millisecond grid"):
        read_orbit(path)


def test_a_time_scale_that_overrides_moves_the_orbit(tmp_path, truth, fixed) -> None:
    """GIVEN a file in TAI whose header says GPS WHEN told so THEN the motion; believed, it is 19 s late: 140 km."""
    path = write.save(tmp_path / "x.sp3", write.sp3(TIMES, *fixed, "TAI").replace("cc TAI", "cc GPS"))
    assert_follows(replay_of(path, time_scale="tai"), truth, 0.01)
    wrong, _ = replay_of(path).state_gcrf(BETWEEN)
    assert np.linalg.norm(wrong - truth.state_gcrf(BETWEEN)[0], axis=1).min() > 1e5


def test_span_outside_the_file_is_refused(tmp_path, fixed) -> None:
    path = write.save(tmp_path / "orbit.sp3.gz", write.sp3(TIMES, *fixed))
    with pytest.raises(DataError, match=r"covers 2019-01-01 00:00:00 to 2019-01-01 00:40:00 GPS.*time\.start"):
        replayed.load_truth(path, T0_NS, T0_NS + 3 * 3600 * gps_time.NS)


def test_one_lost_sample_is_bridged_and_three_are_not(tmp_path, truth, fixed) -> None:
    """GIVEN 60 s samples WHEN one is lost THEN a millimetre or two; WHEN two more are THEN refused with the time."""
    kept = np.delete(np.arange(COUNT), 12)
    path = write.save(tmp_path / "x.sp3", write.sp3(TIMES[kept], fixed[0][kept], fixed[1][kept]))
    assert_follows(replay_of(path), truth, 0.01)
    kept = np.delete(np.arange(COUNT), [12, 13, 14])
    path = write.save(tmp_path / "y.sp3", write.sp3(TIMES[kept], fixed[0][kept], fixed[1][kept]))
    with pytest.raises(DataError, match="no samples for 240 s after 2019-01-01 00:11:00 GPS; choose a span without"):
        replay_of(path)


def test_samples_of_any_spacing_serve(tmp_path, truth) -> None:
    """GIVEN steps of 7 to 100 s, as a propagator with a free step writes WHEN replayed THEN the motion."""
    steps_s = np.random.default_rng(3).integers(7, 100, 60)
    t = T0_NS + np.concatenate(([0], np.cumsum(steps_s))) * gps_time.NS
    t = t[t <= TIMES[-1]]
    path = write.save(tmp_path / "x.oem", write.oem_kvn([(t, *truth.state_gcrf(t))], "GCRF", "GPS"))
    assert_follows(replay_of(path), truth, 1e-3, 1e-4)
    orbit = evenly_spaced(path, read_orbit(path))
    assert set(np.diff(orbit.t_gps_ns)) == {int(np.median(np.diff(t)))}


@pytest.mark.parametrize(("satellite", "message"), [("L74", "no satellite 'L74'; it holds L99")])
def test_wrong_satellite(tmp_path, fixed, satellite: str, message: str) -> None:
    path = write.save(tmp_path / "orbit.sp3.gz", write.sp3(TIMES, *fixed))
    with pytest.raises(DataError, match=message):
        replay_of(path, satellite=satellite)
