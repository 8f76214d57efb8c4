"""One real orbit in other formats: Sentinel-1A's file is written as SP3, OEM in KVN and OEM in XML, and read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import orbit_writers as write
import pytest

from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.orbit_files.read import read_orbit
from hil_sim.truth.real_orbit import RealOrbit

pytestmark = pytest.mark.real_data

SENTINEL_1A = "leo_sentinel1a/S1A_OPER_AUX_RESORB_OPOD_20230823T162050_V20230823T123139_20230823T154909.EOF.gz"


@pytest.fixture(scope="module")
def sentinel(real_data: Path) -> RealOrbit:
    if not (real_data / SENTINEL_1A).is_file():
        pytest.skip(f"{SENTINEL_1A} is not among the real data")
    return read_orbit(real_data / SENTINEL_1A)


def halves(orbit: RealOrbit, r_m: np.ndarray, v_mps: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Two segments that share their middle sample."""
    k = len(r_m) // 2
    return [(orbit.t_gps_ns[: k + 1], r_m[: k + 1], v_mps[: k + 1]), (orbit.t_gps_ns[k:], r_m[k:], v_mps[k:])]


@pytest.mark.parametrize("form", [write.oem_kvn, write.oem_xml])
@pytest.mark.parametrize("scale", ["UTC", "TT", "GPS"])
def test_as_an_earth_fixed_message(tmp_path: Path, sentinel: RealOrbit, form, scale: str) -> None:
    """GIVEN the real orbit as an OEM of two segments WHEN it is read THEN the same samples to the file's digits."""
    text = form(halves(sentinel, sentinel.r_m, sentinel.v_mps), "ITRF2014", scale)
    again = read_orbit(write.save(tmp_path / "x.oem", text))
    assert np.array_equal(again.t_gps_ns, sentinel.t_gps_ns)
    assert np.abs(again.r_m - sentinel.r_m).max() < 1e-6
    assert np.abs(again.v_mps - sentinel.v_mps).max() < 1e-9
    assert again.frame == sentinel.frame == "ITRF"


def test_as_an_inertial_message(tmp_path: Path, sentinel: RealOrbit) -> None:
    """GIVEN the real orbit turned to GCRF WHEN it is written, read and turned back THEN the same to a micrometre."""
    t = sentinel.t_gps_ns
    orientation = EarthOrientation(int(t[0]), int(t[-1]))
    text = write.oem_kvn(halves(sentinel, *orientation.to_gcrf(t, sentinel.r_m, sentinel.v_mps)), "GCRF", "TAI")
    again = read_orbit(write.save(tmp_path / "x.oem", text))
    r_m, v_mps = orientation.to_itrf(t, again.r_m, again.v_mps)
    assert again.frame == "GCRF"
    assert np.abs(r_m - sentinel.r_m).max() < 2e-6
    assert np.abs(v_mps - sentinel.v_mps).max() < 1e-8


def test_as_sp3(tmp_path: Path, sentinel: RealOrbit) -> None:
    """SP3 prints millimetres; the times, 35127 microseconds past the second, are kept."""
    again = read_orbit(write.save(tmp_path / "x.sp3", write.sp3(sentinel.t_gps_ns, sentinel.r_m, sentinel.v_mps)))
    assert np.array_equal(again.t_gps_ns, sentinel.t_gps_ns)
    assert np.abs(again.r_m - sentinel.r_m).max() <= 0.5001e-3
    assert np.abs(again.v_mps - sentinel.v_mps).max() < 1e-6
