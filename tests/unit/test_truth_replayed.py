"""Orbit files: their time scales, units and frames, on files written here from a known motion."""

import gzip
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from hil_sim import gps_time, scenario
from hil_sim.errors import DataError
from hil_sim.scenario_schema import Orbit, TruthModel
from hil_sim.truth import propagated, replayed
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.interface import TrackTruth

T0_NS = scenario.load("nominal").t_start_gps_ns
STEP_NS = 60 * gps_time.NS
COUNT = 41


@pytest.fixture(scope="module")
def truth() -> TrackTruth:
    return propagated.propagate(Orbit(period_s=6000.0), TruthModel(), T0_NS, COUNT * STEP_NS)


@pytest.fixture(scope="module")
def orientation() -> EarthOrientation:
    return EarthOrientation(T0_NS, T0_NS + COUNT * STEP_NS)


def write_sp3(path: Path, truth: TrackTruth, orientation: EarthOrientation, unit: str, scale: str) -> Path:
    """SP3-c with the habits of real files: blank '++' lines, missing clocks, millimetres and 0.1 micrometres/s."""
    offset_s = {"GPS": 0, "TAI": 19, "UTC": -18}[scale]
    t = T0_NS + np.arange(COUNT) * STEP_NS
    r, v = orientation.to_itrf(t, *truth.state_gcrf(t))
    per_mps = {"dm/s": 10.0, "m/s": 1.0}[unit]
    lines = ["#cV2019  1  1  0  0  0.00000000      41 ORBIT ITRF  FIT TEST", "## 2034 172800.00000000    60.00000000"]
    lines += ["+    1   L99  0  0", "++", "++", f"%c L  cc {scale} ccc cccc", "%c cc cc ccc ccc cccc", "/* TEST"]
    for k in range(COUNT):
        moment = datetime(2019, 1, 1) + timedelta(seconds=offset_s + 60 * k)
        lines.append(f"*  {moment:%Y %m %d %H %M} {moment.second:11.8f}")
        lines.append("PL99" + "".join(f"{x / 1e3:14.6f}" for x in r[k]) + " 999999.999999")
        lines.append("VL99" + "".join(f"{x * per_mps:14.6f}" for x in v[k]) + " 999999.999999")
    with gzip.open(path, "wt", encoding="ascii") as out:
        out.write("\n".join([*lines, "EOF"]) + "\n")
    return path


def write_georb(path: Path, truth: TrackTruth, jitter_s: float = 2e-7) -> Path:
    rng = np.random.default_rng(5)
    t = T0_NS + np.arange(COUNT * 6) * 10 * gps_time.NS
    r, v = truth.state_gcrf(t)
    mjd = gps_time.GPS_EPOCH_MJD + T0_NS // gps_time.DAY_NS
    lines = ["GEORB format file", "Reference Frame  :  ICRF ", "Time scale  :  Terrestrial Time ", "end_of_header  "]
    for k in range(len(t)):
        seconds = 51.184 + 10.0 * k + jitter_s * rng.uniform(-1.0, 1.0)
        lines.append(f"{mjd:9d} {seconds:18.9f}" + "".join(f"{x:26.11f}" for x in (*r[k], *v[k])))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("unit", ["dm/s", "m/s"])
@pytest.mark.parametrize("scale", ["GPS", "TAI", "UTC"])
def test_sp3_gives_back_the_motion(tmp_path, truth, orientation, unit: str, scale: str) -> None:
    """A wrong time scale would be kilometres, a wrong unit nonsense; what is left is the file's rounding."""
    path = write_sp3(tmp_path / "orbit.sp3.gz", truth, orientation, unit, scale)
    replay = replayed.load_sp3(path, T0_NS + 5 * STEP_NS, T0_NS + 30 * STEP_NS)
    t = T0_NS + np.linspace(5 * STEP_NS, 30 * STEP_NS, 777).astype(np.int64)
    r, v = replay.state_gcrf(t)
    true_r, true_v = truth.state_gcrf(t)
    assert np.linalg.norm(r - true_r, axis=1).max() < 0.01
    assert np.linalg.norm(v - true_v, axis=1).max() < 1e-3


def test_georb_gives_back_the_motion(tmp_path, truth) -> None:
    """Terrestrial Time is 51.184 s ahead of GPS, and 0.2 microseconds of jitter would be 1.5 mm."""
    replay = replayed.load_georb(write_georb(tmp_path / "x.orb", truth), T0_NS + STEP_NS, T0_NS + 30 * STEP_NS)
    t = T0_NS + np.linspace(STEP_NS, 30 * STEP_NS, 777).astype(np.int64)
    assert np.linalg.norm(replay.state_gcrf(t)[0] - truth.state_gcrf(t)[0], axis=1).max() < 1e-4


def test_georb_with_wild_time_stamps_is_refused(tmp_path, truth) -> None:
    with pytest.raises(DataError, match="grid"):
        replayed.read_georb(write_georb(tmp_path / "x.orb", truth, jitter_s=1e-4))


def test_span_outside_the_file_is_refused(tmp_path, truth, orientation) -> None:
    path = write_sp3(tmp_path / "orbit.sp3.gz", truth, orientation, "dm/s", "GPS")
    with pytest.raises(DataError, match=r"covers 2019-01-01 00:00:00 to 2019-01-01 00:40:00 GPS.*time\.start"):
        replayed.load_sp3(path, T0_NS, T0_NS + 3 * 3600 * gps_time.NS)


def test_gap_is_refused(tmp_path, truth, orientation) -> None:
    path = write_sp3(tmp_path / "orbit.sp3.gz", truth, orientation, "dm/s", "GPS")
    with gzip.open(path, "rt") as text:
        lines = text.read().splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("*  2019 01 01 00 10"))
    del lines[start : start + 3]
    with gzip.open(path, "wt") as out:
        out.write("\n".join(lines))
    with pytest.raises(DataError, match="equidistant near 2019-01-01 00:09"):
        replayed.load_sp3(path, T0_NS + 2 * STEP_NS, T0_NS + 30 * STEP_NS)


def test_velocities_that_fit_no_unit_are_refused(tmp_path, truth, orientation) -> None:
    path = write_sp3(tmp_path / "orbit.sp3.gz", truth, orientation, "dm/s", "GPS")
    with gzip.open(path, "rt") as text:
        swapped = text.read().replace("VL99", "VL99   ")
    with gzip.open(path, "wt") as out:
        out.write(swapped)
    with pytest.raises(DataError):
        replayed.read_sp3(path)


@pytest.mark.parametrize(("satellite", "message"), [("L74", "no satellite 'L74'; it holds L99")])
def test_wrong_satellite(tmp_path, truth, orientation, satellite: str, message: str) -> None:
    path = write_sp3(tmp_path / "orbit.sp3.gz", truth, orientation, "dm/s", "GPS")
    with pytest.raises(DataError, match=message):
        replayed.read_sp3(path, satellite)


@pytest.mark.parametrize("content", ["", "hello\nworld\n", "*  2019 xx\n"])
def test_what_is_no_orbit_is_refused(tmp_path, content: str) -> None:
    path = tmp_path / "x.sp3"
    path.write_text(content)
    with pytest.raises(DataError, match=r"x\.sp3"):
        replayed.read_sp3(path)
    with pytest.raises(DataError, match=r"x\.sp3"):
        replayed.read_georb(path)
