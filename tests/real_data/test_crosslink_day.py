"""Real GLONASS ephemerides of 1 April 2009: the reader against the data's known figures, R03 found by the monitor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from harness import Flight, Telemetry

from flightsw.icd.alerts import AlertId
from flightsw.icd.can_frames import CROSSLINK_STATUS
from ground.crosslink import real_day
from hil_sim import scenario
from hil_sim.truth.constellation.glonass_day import GlonassDay

pytestmark = pytest.mark.real_data


@pytest.fixture(scope="module")
def day(repo_data_dir: Path) -> GlonassDay:
    if not (repo_data_dir / real_day.PRECISE).is_file():
        pytest.skip(f"no {real_day.PRECISE} in the shared real data")
    return real_day.load_day(repo_data_dir)


def test_errors_are_those_of_the_data(day: GlonassDay) -> None:
    """GIVEN the files WHEN compared THEN 3D errors have the median, 95 % and maximum that the data's notes give, but
    for the radial offset of the antennas (2.2 m), which is taken off."""
    size = np.linalg.norm(day.errors_m[:, :, :3], axis=2)
    assert np.nanmedian(size) == pytest.approx(3.4, abs=0.3)
    assert np.nanpercentile(size, 95) == pytest.approx(14.2, abs=0.5)
    assert np.nanmax(size) == pytest.approx(22.6, abs=0.5)
    assert len(day.names) == 18


def test_r03_is_wrong_all_day_and_says_it_is_healthy(day: GlonassDay) -> None:
    """GIVEN R03 THEN its along-track error is near 22 m from 02:45 to 04:00 and near 20 m for most of the day."""
    along = day.errors_m[day.names.index("R03"), :, 1]
    at = day.grid_s / 3600.0
    assert np.nanmax(np.abs(along[(at > 2.75) & (at < 4.0)])) > 22.0
    assert np.nanmin(np.abs(along[(at > 0.5) & (at < 10.0)])) > 19.0
    assert day.healthy[day.names.index("R03"), (3 * 60)]


@pytest.mark.slow
def test_the_network_monitor_finds_r03_and_nobody_else(day: GlonassDay) -> None:
    """GIVEN the first forty minutes with simulated ranges of 11.8 m WHEN flown THEN R03 alone is excluded, while it
    says it is healthy and is 20 m off."""
    settings = real_day.settings_of(day, real_day.SPREAD, 11.8)
    found = real_day.fly_day(day, settings, stop_s=2400.0)
    assert [one["satellite"] for one in found["findings"]] == ["R03"]
    (one,) = found["findings"]
    assert one["healthy"]
    assert 19.0 < one["size_m"] < 22.0
    assert (found["rank"], found["parameters"]) == (65, 72)


@pytest.mark.slow
def test_r03_is_excluded_in_the_loop_and_nobody_else(repo_data_dir: Path) -> None:
    """GIVEN real messages of 02:45 to 03:00 as frames on the bus WHEN flight judges them as R04 THEN it excludes R03,
    which is wrong by 22 m and calls itself healthy, and nobody else; its alert is out within 2 s of that epoch."""
    if not (repo_data_dir / real_day.PRECISE).is_file():
        pytest.skip(f"no {real_day.PRECISE} in the shared real data")
    sink = Telemetry()
    with Flight(scenario.load("crosslink_glonass"), sink=sink) as flight:
        flight.fly()
    told = [m for m in flight.published if m[1] == CROSSLINK_STATUS.frame_id]
    records = np.frombuffer(b"".join(payload for _, _, payload in told), CROSSLINK_STATUS.dtype)
    assert len(np.unique(records["t_gps_ns"])) == 900
    assert len(records) <= 900 + 3  # a second frame where the search for slow faults has found, or given up, something
    assert set(records["faulty"].tolist()) == {0, 1 << 2}
    first = records[np.flatnonzero(records["faulty"])[0]]
    (alert, *_) = [m for m in sink.of("LEONAV_ALERT") if m.alert_id == AlertId.CROSSLINK_NEIGHBOUR_FAULTY]
    assert 0 < alert.t_gps_ns - int(first["t_gps_ns"]) <= 2_000_000_000
