"""Broadcast ephemerides: columns of RINEX 2 and 3, what is refused, Kepler's elements against the two-body problem."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.errors import OperatorError
from ground.gnss.broadcast import LIGHT_MPS, OLDEST_S, Broadcast, kepler
from ground.gnss.rinex_nav import read_ephemerides

MU_M3PS2, RATE_RADPS = 3.986005e14, 7.2921151467e-5
TOE_S = 345_600.0  # 2020-06-25 00:00 GPS time, week 2111
TOE_NS = (2111 * 604_800 + 345_600) * 10**9
ZEROS = [0.0] * 29


def field(value: float) -> str:
    return f"{value:19.12E}"


def kepler_values(source: float = 0.0, health: float = 0.0) -> list[float]:
    values = list(ZEROS)
    values[0:3] = [1e-4, 2e-12, 0.0]
    values[6], values[8], values[10], values[11] = 0.3, 0.01, 5153.7, TOE_S
    values[13], values[15], values[17] = 1.1, 0.96, 0.5
    values[20], values[24], values[25], values[26] = source, health, 3e-9, 4e-9
    return values


def of_3(name: str, when: str, values: list[float]) -> list[str]:
    """Lines of a record of RINEX 3."""
    texts = [field(value) for value in values]
    lines = [f"{name} {when}" + "".join(texts[:3])]
    return lines + ["    " + "".join(texts[3 + 4 * k : 7 + 4 * k]) for k in range(-(-len(texts[3:]) // 4))]


def of_2(number: int, when: str, values: list[float]) -> list[str]:
    """Lines of a record of RINEX 2, with D as exponent."""
    return [line[1:].replace("E", "D") for line in of_3(f" {number:2d}", when, values)]


def header(version: str, words: str) -> list[str]:
    first = f"{version:>9}{'':11}{words:40}RINEX VERSION / TYPE"
    return [first, f"{'':60}END OF HEADER"]


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


GLONASS = [6e-5, 1e-12, 0.0, 1e4, 1.0, 0.0, 0.0, 1.2e4, 2.0, 0.0, 1.0, 2e4, -1.5, 0.0, 0.0]


def test_columns_of_both_versions(tmp_path: Path) -> None:
    """GIVEN the same record in RINEX 2 and 3 THEN the same numbers at the same time; GLONASS is 18 s later by UTC."""
    three = [*of_3("G07", "2020 06 25 00 00 00", kepler_values()), *of_3("R09", "2020 06 25 00 15 00", GLONASS)]
    three[-1] += "\n    " + field(0.0) * 2  # the line that RINEX 3.05 adds
    new = read_ephemerides(write(tmp_path / "new", *header("3.05", "N: GNSS NAV DATA    M: MIXED"), *three))
    old = read_ephemerides(
        write(tmp_path / "old", *header("2.11", "N: GPS NAV DATA"), *of_2(7, "20  6 25  0  0  0.0", kepler_values()))
    )
    assert [one.name for one in new] == ["G07", "R09"]
    assert new[0] == old[0]
    assert new[0].values[:29] == tuple(kepler_values())
    assert new[0].reference_gps_ns == new[0].clock_gps_ns == TOE_NS
    assert new[1].reference_gps_ns == TOE_NS + 918 * 10**9
    assert new[1].values[3:15] == tuple(GLONASS[3:15])


def test_what_is_refused(tmp_path: Path) -> None:
    """GIVEN no file of ephemerides, a version to come, letters for numbers, a cut THEN the place is named."""
    record = of_3("G07", "2020 06 25 00 00 00", kepler_values())
    mixed = header("3.05", "N: GNSS NAV DATA    M: MIXED")
    for lines, said in (
        (["nothing"], "no RINEX navigation file"),
        (header("4.00", "NAVIGATION DATA"), "RINEX 4 is not read"),
        (mixed, "holds no ephemeris"),
        ([*mixed, *record[:5]], ":3: not a navigation record"),
        ([*mixed, record[0].replace("06 25", "13 25"), *record[1:]], ":3: not a navigation record"),
        ([*mixed, record[0].replace("E-04", "oops"), *record[1:]], ":3: not a navigation record"),
        ([*mixed, "?07 2020"], "begins no record"),
    ):
        with pytest.raises(OperatorError, match=said):
            read_ephemerides(write(tmp_path / "bad", *lines))


@given(
    e=st.floats(0.0, 0.3), m0=st.floats(-3.0, 3.0), perigee=st.floats(-3.0, 3.0), node=st.floats(-3.0, 3.0),
    i0=st.floats(0.1, 1.5), t_s=st.floats(-7200.0, 7200.0),
)  # fmt: skip
def test_kepler_is_the_two_body_problem(
    e: float, m0: float, perigee: float, node: float, i0: float, t_s: float
) -> None:
    """GIVEN elements without perturbations THEN energy, plane and angle from perigee are those of the ellipse at t."""
    a = 2.6e7
    values = np.zeros((20, 1))
    values[[6, 8, 10, 11, 13, 15, 17], 0] = m0, e, math.sqrt(a), TOE_S, node, i0, perigee
    r, relativity_s = kepler(values, np.array([t_s]), MU_M3PS2)
    angle = RATE_RADPS * (TOE_S + t_s)  # back from the turning Earth
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = c * r[0, 0] - s * r[0, 1], s * r[0, 0] + c * r[0, 1], r[0, 2]
    normal = np.array([math.sin(node) * math.sin(i0), -math.cos(node) * math.sin(i0), math.cos(i0)])
    ahead = np.array([math.cos(node), math.sin(node), 0.0])
    place = np.array([x, y, z])
    assert abs(place @ normal) < 1e-3
    true = math.atan2(place @ np.cross(normal, ahead), place @ ahead) - perigee
    radius = float(np.linalg.norm(place))
    assert radius == pytest.approx(a * (1.0 - e * e) / (1.0 + e * math.cos(true)), rel=1e-9)
    eccentric = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(true / 2.0), math.sqrt(1.0 + e) * math.cos(true / 2.0))
    mean = eccentric - e * math.sin(eccentric) - (m0 + math.sqrt(MU_M3PS2 / a**3) * t_s)
    assert abs(math.remainder(mean, 2.0 * math.pi)) < 1e-9
    expected_s = -2.0 * math.sqrt(MU_M3PS2 * a) / LIGHT_MPS**2 * e * math.sin(eccentric)
    assert relativity_s[0] == pytest.approx(expected_s, abs=1e-15)


def test_which_record_is_taken(tmp_path: Path) -> None:
    """GIVEN an old, an unhealthy and both Galileo messages THEN the nearest healthy one, its clock for E1 and E5a."""
    lines = [
        *of_3("G07", "2020 06 25 00 00 00", kepler_values()),
        *of_3("G08", "2020 06 25 00 00 00", kepler_values(health=1.0)),
        *of_3("E03", "2020 06 25 00 00 00", kepler_values(source=517.0)),
        *of_3("E04", "2020 06 25 00 00 00", kepler_values(source=517.0)),
        *of_3("E04", "2020 06 25 00 00 00", [2e-4, *kepler_values(source=258.0)[1:]]),
    ]
    orbits = Broadcast([write(tmp_path / "nav", *header("3.04", "NAVIGATION DATA     M: MIXED"), *lines)])
    names = ("G07", "G08", "E03", "E04", "G30")
    later = round(OLDEST_S["G"] * 1e9)
    t_ns = np.array([[TOE_NS] * 5, [TOE_NS + later] * 5, [TOE_NS + later + 1] * 5])
    r, clock = orbits.states(names, t_ns)
    assert np.isfinite(r).all(axis=2).tolist() == [[True, False, True, True, False]] * 2 + [[False] * 5]
    plain = clock[0, 0]
    assert clock[0, 2] - plain == pytest.approx(3e-9 - 4e-9, abs=1e-15)  # less BGD(E1,E5b), plus BGD(E1,E5a)
    assert clock[0, 3] - plain == pytest.approx(1e-4, abs=1e-15)
    assert clock[1, 0] - plain == pytest.approx(2e-12 * OLDEST_S["G"], abs=3e-8)
