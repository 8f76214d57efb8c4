"""The Earth orientation table against pyerfa, the IERS file read anew, and a real orbit in both frames."""

from __future__ import annotations

import gzip
from pathlib import Path

import astropy_iers_data
import erfa
import numpy as np
import pytest

from flightsw.icd.table_file import TableImage, decode
from ground.errors import OperatorError
from ground.tables.earth_orientation import STEP_NS, build_earth_orientation
from ground.tables.show import render

GPS_EPOCH_MJD = 44244
DAY_NS = 86_400_000_000_000
ARCSEC = np.pi / 648000.0
LEO_RADIUS_M = 6_900_000.0


def gps_ns(mjd: float) -> int:
    """GPS nanoseconds at which the GPS clock reads this day."""
    return round((mjd - GPS_EPOCH_MJD) * 86400) * 1_000_000_000


def interpolate(table: TableImage, t_gps_ns: int) -> np.ndarray:
    """Four-point interpolation by a cubic through the nodes, (6,), the way flight is meant to read them."""
    record = table.values[0]
    position = (t_gps_ns - int(record["t0_gps_ns"])) / int(record["step_ns"])
    i = int(position)
    assert 1 <= i <= int(record["count"]) - 3
    nodes = record["nodes"][i - 1 : i + 3]
    return np.array([np.polyval(np.polyfit([-1, 0, 1, 2], nodes[:, c], 3), position - i) for c in range(6)])


def tt(t_gps_ns: int) -> tuple[float, float]:
    days, rest = divmod(t_gps_ns, DAY_NS)
    return 2400000.5 + GPS_EPOCH_MJD + days, (rest * 1e-9 + 51.184) / 86400.0


def gcrf_to_itrf(orientation: np.ndarray, t_gps_ns: int) -> np.ndarray:
    """Celestial-to-terrestrial matrix (3, 3) of the IERS Conventions 2010, CIO based."""
    x, y, s, xp, yp, ut1_minus_gps = orientation
    days, rest = divmod(t_gps_ns, DAY_NS)
    era = erfa.era00(2400000.5 + GPS_EPOCH_MJD + days, (rest * 1e-9 + ut1_minus_gps) / 86400.0)
    return erfa.c2tcio(erfa.c2ixys(x, y, s), era, erfa.pom00(xp, yp, erfa.sp00(*tt(t_gps_ns))))


def read_iers(mjd_wanted: int) -> np.ndarray:
    """xp, yp [rad], UT1 - TAI [s], dX, dY [rad] of four days around one, by columns of the IERS readme: (4, 5)."""
    rows = {}
    for line in Path(astropy_iers_data.IERS_A_FILE).read_text().splitlines():
        mjd = float(line[7:15])
        if mjd_wanted - 1 <= mjd <= mjd_wanted + 2:
            year, month, day, _ = erfa.jd2cal(2400000.5, mjd)
            numbers = [float(line[a:b]) for a, b in ((18, 27), (37, 46), (58, 68), (97, 106), (116, 125))]
            numbers[2] -= float(erfa.dat(year, month, day, 0.0))
            rows[mjd] = numbers
    values = np.array([rows[mjd] for mjd in sorted(rows)])
    assert values.shape == (4, 5)
    values[:, :2] *= ARCSEC
    values[:, 3:] *= ARCSEC / 1000.0
    return values


@pytest.mark.parametrize("mjd", [53736, 57753, 58481, 59412, 60676])
def test_interpolated_nodes_equal_erfa_below_a_millimetre(mjd: int) -> None:
    """GIVEN a day (one of them ends in a leap second) WHEN flight's nodes are interpolated at random times THEN
    the matrix moves a point in low orbit by less than 1 mm from the one of pyerfa and the IERS values of then."""
    table = decode(build_earth_orientation(gps_ns(mjd), gps_ns(mjd + 1.0)))
    iers = read_iers(mjd)
    generator = np.random.default_rng(mjd)
    point_m = generator.normal(size=(3, 20))
    point_m *= LEO_RADIUS_M / np.linalg.norm(point_m, axis=0)
    for _ in range(100):
        t_gps_ns = gps_ns(mjd) + int(generator.integers(3600 * 10**9, 23 * 3600 * 10**9))
        # time of the IERS values is UTC; within this day, well away from its end, UTC - GPS is constant
        year, month, day, _ = erfa.jd2cal(2400000.5, float(mjd))
        utc_minus_gps_s = 19.0 - float(erfa.dat(year, month, day, 0.0))
        fraction = ((t_gps_ns - gps_ns(mjd)) * 1e-9 + utc_minus_gps_s) / 86400.0
        daily = [np.polyval(np.polyfit([-1, 0, 1, 2], iers[:, c], 3), fraction) for c in range(5)]
        xp, yp, ut1_minus_tai, dx, dy = daily
        x, y, s = erfa.xys06a(*tt(t_gps_ns))
        direct = np.array([x + dx, y + dy, s, xp, yp, ut1_minus_tai + 19.0])
        difference = gcrf_to_itrf(interpolate(table, t_gps_ns), t_gps_ns) - gcrf_to_itrf(direct, t_gps_ns)
        assert np.max(np.linalg.norm(difference @ point_m, axis=0)) < 1e-3


def test_a_real_orbit_agrees_in_both_frames(repo_data_dir: Path) -> None:
    """GIVEN the precise orbit of GRACE-FO C in ITRF and in GCRF (both by others) WHEN turned with our table THEN
    they agree within 3 cm (sub-daily tides of the Earth orientation, left out here, are about 1 cm of it)."""

    def read(frame: str) -> np.ndarray:
        path = repo_data_dir / "leo_gracefo" / f"GRACE-C_59412_orbit_{frame}.orb.gz"
        text = gzip.decompress(path.read_bytes()).decode().split("end_of_header", 1)[1]
        return np.array([line.split()[:5] for line in text.strip().splitlines()], dtype=float)

    itrf, gcrf = read("trf"), read("crf")
    table = decode(build_earth_orientation(gps_ns(59412), gps_ns(59413)))
    worst_m = 0.0
    for row in range(0, len(itrf), 60):
        mjd, seconds_tt = itrf[row, :2]
        # the file's times carry rounding noise of 2e-7 s on whole GPS seconds
        t_gps_ns = gps_ns(mjd) + round(seconds_tt - 51.184) * 1_000_000_000
        turned = gcrf_to_itrf(interpolate(table, t_gps_ns), t_gps_ns) @ gcrf[row, 2:]
        worst_m = max(worst_m, float(np.linalg.norm(turned - itrf[row, 2:])))
    assert worst_m < 0.03


def test_nothing_jumps_at_a_leap_second() -> None:
    """GIVEN the leap second at the end of 2016 WHEN a table spans it THEN UT1 - GPS runs on smoothly."""
    record = decode(build_earth_orientation(gps_ns(57752), gps_ns(57756))).values[0]
    ut1_minus_gps_s = record["nodes"][: record["count"], 5]
    assert np.max(np.abs(np.diff(ut1_minus_gps_s))) < 1e-3
    assert np.max(np.abs(np.diff(ut1_minus_gps_s, 2))) < 2e-5


def test_validity_covers_the_span_and_keeps_a_node_on_each_side() -> None:
    for start, stop in ((gps_ns(58000.0), gps_ns(58001.0)), (gps_ns(58000.1), gps_ns(58000.1) + 1)):
        table = decode(build_earth_orientation(start, stop))
        record = table.values[0]
        t0, count = int(record["t0_gps_ns"]), int(record["count"])
        assert record["step_ns"] == STEP_NS == 6 * 3600 * 10**9
        assert table.valid_from_gps_ns == t0 + STEP_NS <= start - STEP_NS
        assert table.valid_to_gps_ns == t0 + (count - 2) * STEP_NS >= stop + STEP_NS
        assert not np.any(record["nodes"][count:])


def test_a_named_finals_file_gives_the_same_table(repo_data_dir: Path) -> None:
    """GIVEN an extract of the IERS file around the day of an arc WHEN named THEN the table is the same."""
    extract = repo_data_dir / "eop_spaceweather" / "finals2000A.extract.txt"
    span = gps_ns(59412), gps_ns(59413)
    assert build_earth_orientation(*span, finals_path=extract) == build_earth_orientation(*span)
    with pytest.raises(OperatorError, match=r"finals2000A\.extract\.txt: does not cover"):
        build_earth_orientation(gps_ns(59500), gps_ns(59501), finals_path=extract)  # a gap between the arcs


@pytest.mark.parametrize(
    ("start", "stop", "said"),
    [
        (gps_ns(70000), gps_ns(70001), "update astropy-iers-data or name a newer finals2000A file"),
        (gps_ns(58001), gps_ns(58000), "swap them"),
        (gps_ns(58000), gps_ns(58060), "ask for at most"),
        (0, 1, "start later"),
    ],
)
def test_a_span_that_cannot_be_served_is_refused(start: int, stop: int, said: str) -> None:
    with pytest.raises(OperatorError, match=said):
        build_earth_orientation(start, stop)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no Earth orientation in it"),
        ("nonsense " * 30 + "\n", "line 1"),
        (None, "cannot be read"),
    ],
)
def test_a_file_that_is_not_finals2000a_is_refused(tmp_path: Path, text: str | None, said: str) -> None:
    path = tmp_path / "finals.txt"
    if text is not None:
        path.write_text(text)
    with pytest.raises(OperatorError, match=said) as refused:
        build_earth_orientation(gps_ns(58000), gps_ns(58001), finals_path=path)
    assert str(path) in str(refused.value)


def test_an_unknown_leap_second_in_the_file_is_refused(tmp_path: Path) -> None:
    """GIVEN a file whose UT1 - UTC jumps by a second where pyerfa knows no leap second THEN refused."""
    lines = Path(astropy_iers_data.IERS_A_FILE).read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if float(line[7:15]) == 58000.0)
    changed = [line[:58] + f"{float(line[58:68]) + 1.0:10.7f}" + line[68:] for line in lines[start : start + 9]]
    path = tmp_path / "finals.txt"
    path.write_text("\n".join([*lines[start - 9 : start], *changed]))
    with pytest.raises(OperatorError, match=r"UT1 jumps at MJD 58000.*update pyerfa"):
        build_earth_orientation(gps_ns(57995), gps_ns(57996), finals_path=path)


def test_show_names_every_node() -> None:
    table = decode(build_earth_orientation(gps_ns(58482), gps_ns(58483)))
    said = render(table)
    assert said.count(" GPS ") >= int(table.values[0]["count"])
    assert "2018-12-30 00:00:00 GPS" in said
