"""Orbit files: time scales, units, frames and what is refused, on files written here from a motion in closed form."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import orbit_writers as write
import pytest

from hil_sim.errors import DataError
from hil_sim.truth.orbit_files.read import read_orbit
from hil_sim.truth.orbit_files.text import iso_moment, to_gps_ns

NS = 1_000_000_000
T0_NS = (14240 * 86400 + 600) * NS  # 2019-01-01T00:10:00 GPS
STEP_NS = 60 * NS
COUNT = 41
RATE = 2.0 * np.pi / 5700.0
RADIUS_M = 6.88e6


def motion(t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An inclined circle: r (n,3) [m] and its derivative v (n,3) [m/s]. Any frame will do for a reader."""
    angle = RATE * ((t_ns - T0_NS) / 1e9)
    c, s = np.cos(angle), np.sin(angle)
    r = RADIUS_M * np.stack((c, 0.6 * s, 0.8 * s), axis=1)
    return r, RADIUS_M * RATE * np.stack((-s, 0.6 * c, 0.8 * c), axis=1)


TIMES = T0_NS + np.arange(COUNT) * STEP_NS
R_M, V_MPS = motion(TIMES)


def assert_motion(orbit, position_m: float = 1e-3, velocity_mps: float = 1e-5) -> None:
    """The orbit is the motion at its own time stamps, which are those written."""
    assert np.array_equal(orbit.t_gps_ns, TIMES)
    r, v = motion(orbit.t_gps_ns)
    assert np.abs(orbit.r_m - r).max() < position_m
    assert np.abs(orbit.v_mps - v).max() < velocity_mps


@pytest.mark.parametrize("name", write.EARTH_FIXED)
@pytest.mark.parametrize("zipped", [False, True])
def test_every_format_gives_back_what_was_written(tmp_path: Path, name: str, zipped: bool) -> None:
    """GIVEN one motion in each format WHEN it is read THEN times are exact and states good to the file's digits."""
    path = write.save(tmp_path / (name + ".gz" * zipped), write.EARTH_FIXED[name](TIMES, R_M, V_MPS))
    orbit = read_orbit(path)
    assert_motion(orbit)
    assert orbit.frame == "ITRF"
    assert orbit.velocity.startswith("of the file, in ")
    assert orbit.mismatch_mps < 1e-3


@pytest.mark.parametrize("name", write.EARTH_FIXED)
def test_the_content_tells_the_format_not_the_name(tmp_path: Path, name: str) -> None:
    path = write.save(tmp_path / "download.txt", write.EARTH_FIXED[name](TIMES, R_M, V_MPS))
    assert_motion(read_orbit(path))


@pytest.mark.parametrize("unit", ["dm/s", "m/s", "km/s"])
@pytest.mark.parametrize("scale", ["GPS", "TAI", "UTC", "TT"])
def test_sp3_scales_and_units(tmp_path: Path, unit: str, scale: str) -> None:
    """GIVEN any scale and unit WHEN the file is read THEN the header tells the scale, the positions tell the unit."""
    text = write.sp3(TIMES, R_M, V_MPS, scale, unit)
    orbit = read_orbit(write.save(tmp_path / "x.sp3", text))
    assert_motion(orbit, velocity_mps=1e-2 if unit == "km/s" else 1e-5)  # six decimals of a kilometre per second
    assert ("though SP3-c says dm/s" in orbit.velocity) == (unit != "dm/s")
    other = read_orbit(tmp_path / "x.sp3", time_scale="tai")
    assert other.t_gps_ns[0] - TIMES[0] == round((write.AHEAD_OF_GPS_S[scale] - 19.0) * 1e9)


@pytest.mark.parametrize("version", ["a", "c", "d"])
def test_sp3_versions(tmp_path: Path, version: str) -> None:
    """Version a has no time scale, which means GPS, and numbers instead of letters: G07 is '  7'."""
    satellite = {"a": "  7"}.get(version, "L99")
    text = write.sp3(TIMES, R_M, V_MPS, version=version, satellite=satellite)
    orbit = read_orbit(write.save(tmp_path / "x.sp3", text))
    assert_motion(orbit)
    assert orbit.satellite == {"a": "G07"}.get(version, "L99")


@pytest.mark.parametrize("asked", ["auto", "derive"])
def test_missing_velocities_are_derived(tmp_path: Path, asked: str) -> None:
    """GIVEN positions to a millimetre, 60 s apart WHEN velocities are derived THEN 0.1 mm/s, a tenth at the ends."""
    has = V_MPS * 1.001 if asked == "derive" else None
    orbit = read_orbit(write.save(tmp_path / "x.sp3", write.sp3(TIMES, R_M, has)), velocity_unit=asked)
    error = np.abs(orbit.v_mps - V_MPS).max(axis=1)
    assert error[4:-4].max() < 1e-4
    assert error.max() < 5e-3
    assert orbit.velocity == "derived from the positions"
    assert np.median(error) < orbit.mismatch_mps * 3.0 < 1e-3


def test_several_satellites_must_be_told_apart(tmp_path: Path) -> None:
    one, two = (write.sp3(TIMES, R_M, V_MPS, satellite=name).splitlines() for name in ("L98", "L99"))
    both = [line for pair in zip(one, two, strict=True) for line in (pair if pair[0][:1] in "PV" else pair[:1])]
    path = write.save(tmp_path / "x.sp3", "\n".join(both))
    with pytest.raises(DataError, match=r"x\.sp3: holds 2 satellites; name one .*: L98, L99"):
        read_orbit(path)
    assert read_orbit(path, "L98").satellite == "L98"
    with pytest.raises(DataError, match="no satellite 'L97'; it holds L98, L99"):
        read_orbit(path, "L97")


def test_a_position_of_zeros_is_missing(tmp_path: Path) -> None:
    """The standard's sign for a missing position is 0.000000; such an epoch is left out, not taken as the centre."""
    lines = write.sp3(TIMES, R_M, V_MPS).splitlines()
    at = [k for k, line in enumerate(lines) if line.startswith("P")][17]
    lines[at] = "PL99" + "      0.000000" * 3 + " 999999.999999"
    orbit = read_orbit(write.save(tmp_path / "x.sp3", "\n".join(lines)))
    assert orbit.t_gps_ns.tolist() == [int(t) for k, t in enumerate(TIMES) if k != 17]


@pytest.mark.parametrize("scale", ["UTC", "TAI", "TT", "GPS"])
@pytest.mark.parametrize("day_of_year", [False, True])
def test_oem_scales_and_dates(tmp_path: Path, scale: str, day_of_year: bool) -> None:
    text = write.oem_kvn([(TIMES, R_M, V_MPS)], scale=scale, day_of_year=day_of_year)
    orbit = read_orbit(write.save(tmp_path / "x.oem", text))
    assert_motion(orbit)
    assert (orbit.satellite, orbit.name) == ("2019-001A", "TESTSAT")


@pytest.mark.parametrize("frame", ["ITRF", "ITRF-97", "ITRF2000", "ITRF2014"])
def test_oem_terrestrial_frames(tmp_path: Path, frame: str) -> None:
    orbit = read_orbit(write.save(tmp_path / "x.oem", write.oem_kvn([(TIMES, R_M, V_MPS)], frame)))
    assert orbit.frame == "ITRF"


@pytest.mark.parametrize("form", [write.oem_kvn, write.oem_xml])
def test_eme2000_is_turned_by_the_frame_bias(tmp_path: Path, form) -> None:
    """GIVEN EME2000 WHEN it is read THEN GCRF by the bias of IERS TN 36 (5.21, 5.33), and 0.6 to 0.9 m are not lost."""
    mas = np.pi / 180.0 / 3.6e6
    xi, eta, alpha = -16.6170 * mas, -6.8192 * mas, -14.6 * mas
    to_eme = np.array([[1.0, alpha, -xi], [-alpha, 1.0, -eta], [xi, eta, 1.0]])  # first order; the second is 1e-14
    text = form([(TIMES, R_M @ to_eme.T, V_MPS @ to_eme.T)], "EME2000", "TT")
    orbit = read_orbit(write.save(tmp_path / "x.oem", text))
    assert orbit.frame == "GCRF"
    assert_motion(orbit, 2e-5, 1e-8)
    as_is = read_orbit(write.save(tmp_path / "y.oem", form([(TIMES, R_M, V_MPS)], "ICRF", "TT")))
    assert_motion(as_is, 2e-5, 1e-8)
    apart = np.linalg.norm(R_M @ to_eme.T - R_M, axis=1)
    assert 0.5 < apart.max() < 1.0


@pytest.mark.parametrize("form", [write.oem_kvn, write.oem_xml])
def test_segments_are_joined(tmp_path: Path, form) -> None:
    """GIVEN three segments, two of which share an instant WHEN they are read THEN one series without repetition."""
    parts = [(TIMES[a:b], R_M[a:b], V_MPS[a:b]) for a, b in ((0, 15), (14, 30), (30, COUNT))]
    assert_motion(read_orbit(write.save(tmp_path / "x.oem", form(parts))))
    moved = [parts[0], (parts[1][0], parts[1][1] + 3.0, parts[1][2]), parts[2]]
    with pytest.raises(DataError, match=r"line \d+: 5\.2 m from line \d+, which gives the same instant; keep one"):
        read_orbit(write.save(tmp_path / "y.oem", form(moved)))


def test_usable_times_limit_a_segment(tmp_path: Path) -> None:
    stop = write.calendar(int(TIMES[30]), "UTC").isoformat()
    text = write.oem_kvn([(TIMES, R_M, V_MPS)], USEABLE_STOP_TIME=stop)
    assert len(read_orbit(write.save(tmp_path / "x.oem", text)).t_gps_ns) == 31


def test_a_leap_second_in_utc(tmp_path: Path) -> None:
    """GIVEN a file in UTC across the end of 2016 WHEN it is read THEN 10 s steps stay 10 s, 23:59:60 among them."""
    (before, leap, after) = (iso_moment(f"2016-12-31T23:59:{s}") for s in ("50", "60", "60.5"))
    later = iso_moment("2017-01-01T00:00:09Z")
    t = to_gps_ns([before, leap, after, later], "UTC")
    assert np.diff(t).tolist() == [10 * NS, NS // 2, 19 * NS // 2]
    # the GPS second of 2017-01-01T00:00:00 UTC, 18 s ahead of it: IERS Bulletin C 52
    assert t[3] == (13510 * 86400 + 18 + 9) * NS


def test_sentinel_times_must_agree(tmp_path: Path) -> None:
    """GIVEN UTC a second off TAI WHEN the file is read THEN refused with the line; told which to take, it is read."""
    late = write.eof(TIMES + NS, R_M, V_MPS).splitlines()
    lines = [late[k] if "UTC=" in x else x for k, x in enumerate(write.eof(TIMES, R_M, V_MPS).splitlines())]
    path = write.save(tmp_path / "x.EOF", "\n".join(lines))
    with pytest.raises(DataError, match=r"x\.EOF: line 6: TAI and UTC are -1\.000000 s .*--time-scale"):
        read_orbit(path)
    assert_motion(read_orbit(path, time_scale="TAI"))
    assert np.array_equal(read_orbit(path, time_scale="utc").t_gps_ns, TIMES + NS)
    with pytest.raises(DataError, match="give --time-scale TAI or UTC"):
        read_orbit(path, time_scale="GPS")


WRONG = {
    "frame": (write.eof(TIMES, R_M, V_MPS, "MOON_FIXED"), r"Ref_Frame is MOON_FIXED"),
    "count": (write.eof(TIMES, R_M, V_MPS).replace('count="41"', 'count="42"'), "declares 42 .* holds 41"),
    "cut xml": (write.eof(TIMES, R_M, V_MPS)[:3000], r"line \d+: not a Sentinel orbit file: no element found"),
    "unit": (write.eof(TIMES, R_M, V_MPS).replace('unit="m"', 'unit="km"'), r"line 10: X is '\d+\.\d+' km, not"),
    "no number": (write.eof(TIMES, R_M, V_MPS).replace(">0.000000<", ">nan<"), r"line \d+: Y is 'nan' m, not a number"),
    "entity": ('<?xml version="1.0"?><!DOCTYPE oem [<!ENTITY a "b">]><oem>&a;</oem>', "line 1: 'a': entities"),
    "centre": (write.oem_kvn([(TIMES, R_M, V_MPS)], CENTER_NAME="MOON"), "line 6: CENTER_NAME is MOON"),
    "of date": (write.oem_kvn([(TIMES, R_M, V_MPS)], "TEME"), r"line 6: REF_FRAME is TEME: known are .*; convert"),
    "scale": (write.oem_kvn([(TIMES, R_M, V_MPS)], TIME_SYSTEM="UT1"), r"line 6: TIME_SYSTEM is UT1: .*--time-scale"),
    "no data": (write.oem_kvn([]), "without ephemeris data"),
    "sp3 scale": (write.sp3(TIMES, R_M, V_MPS, "GPS").replace("cc GPS", "cc XYZ"), "time scale 'XYZ' .*--time-scale"),
    "sp3 twice": (write.sp3(TIMES, R_M, V_MPS).replace("VL99", "PL99"), r"line 11: not SP3: a second position of L99"),
    "backwards": (write.leogps(TIMES[::-1], R_M[::-1], V_MPS[::-1]), "line 2: its time is not after that of line 1"),
    "repeated": (write.leogps(TIMES[[0, 1, 1, *range(2, 20)]], R_M[:21], V_MPS[:21]), "line 3: its time is not after"),
    "kilometres": (write.oem_kvn([(TIMES, R_M / 1e3, V_MPS / 1e3)]), "line 17: 6880 m from the Earth's centre"),
    "metres": (write.oem_kvn([(TIMES, R_M * 1e3, V_MPS * 1e3)]), r"line 17: 6\.88e\+09 m from the Earth's centre"),
    "inertial": (write.sp3(TIMES, R_M, V_MPS * 1.06), r"line \d+: velocity and differentiated position are 45\d m/s"),
    "no unit": (write.sp3(TIMES, R_M, V_MPS * 3.0), r"velocities of 227\d+.* in none of m/s, dm/s, km/s; give --vel"),
    "nothing": ("", "unknown kind of orbit file; known are SP3"),
    "text": ("hello\nworld\n", "unknown kind of orbit file"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_does_not_serve_is_refused_with_place_and_remedy(tmp_path: Path, case: str) -> None:
    """GIVEN a file that is wrong in one way WHEN it is read THEN one line says which file, where and what to do."""
    text, said = WRONG[case]
    path = write.save(tmp_path / "x.txt", text)
    with pytest.raises(DataError, match=said) as refused:
        read_orbit(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)


def test_a_gzip_stream_that_was_cut_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.sp3.gz"
    path.write_bytes(gzip.compress(write.sp3(TIMES, R_M, V_MPS).encode())[:-500])
    with pytest.raises(DataError, match=r"x\.sp3\.gz: its gzip stream is damaged .*fetch it again"):
        read_orbit(path)


def test_options_that_do_not_exist_are_refused(tmp_path: Path) -> None:
    path = write.save(tmp_path / "x.sp3", write.sp3(TIMES, R_M, V_MPS))
    with pytest.raises(DataError, match="velocity unit 'knots': one of auto, m/s"):
        read_orbit(path, velocity_unit="knots")
    with pytest.raises(DataError, match="time scale UT1: one of GPS"):
        read_orbit(path, time_scale="ut1")
    with pytest.raises(DataError, match="no such orbit file"):
        read_orbit(tmp_path / "none.sp3")
