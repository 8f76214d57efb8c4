"""Gravity field and force tables: what the files say, what is refused and how the refusal reads."""

from __future__ import annotations

import gzip
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from flightsw.icd.table_file import decode
from ground.__main__ import main
from ground.errors import OperatorError
from ground.tables.forces import build_forces, packaged_space_weather, read_space_weather
from ground.tables.gravity_field import build_gravity_field, packaged_model, read_gfc
from ground.tables.show import render

HEAD = """product_type gravity_field
modelname    SMALL
earth_gravity_constant 0.3986004415E+15
radius       0.63781363E+07
max_degree   2
norm         fully_normalized
tide_system  tide_free
end_of_head =====
"""
BODY = """gfc 0 0 1.0d0 0.0d0
gfc 2 0 -0.484165143790815D-03 0.0
gfc 2 1 -0.2e-9 0.13e-8
gfc 2 2 0.24e-5 -0.14e-5
"""


def model_file(folder: Path, text: str) -> Path:
    path = folder / "small.gfc"
    path.write_text(text)
    return path


def test_packaged_model_to_degree_120() -> None:
    """EGM96: GM, radius, C20, C21 and the last coefficient kept, as the file's own text has them."""
    image = build_gravity_field(packaged_model("EGM96"))
    table = decode(image)
    assert 118_000 < len(image) < 119_000
    assert (table.kind, table.set_name) == ("gravity_field", "EGM96 120")
    record = table.values[0]
    assert (record["gm_m3ps2"], record["radius_m"]) == (0.3986004415e15, 0.6378136300e7)
    assert (record["tide_system"], record["degree"]) == (0, 120)
    for line in packaged_model("EGM96").read_text().splitlines():
        words = line.split()
        if words[:1] == ["gfc"] and int(words[1]) in (0, 2, 77, 120):
            place = int(words[1]) * (int(words[1]) + 1) + 2 * int(words[2])
            assert tuple(record["coefficients"][place : place + 2]) == (float(words[3]), float(words[4]))


def test_a_lower_degree_leaves_zeros_and_says_so() -> None:
    record = decode(build_gravity_field(degree=20)).values[0]
    assert record["degree"] == 20
    assert (record["coefficients"][21 * 22 :] == 0.0).all()
    assert record["coefficients"][20 * 21] != 0.0


@pytest.mark.parametrize("zipped", [False, True])
def test_a_small_file_plain_and_gzipped_with_exponents_of_fortran(tmp_path: Path, zipped: bool) -> None:
    path = model_file(tmp_path, HEAD + BODY)
    if zipped:
        path = tmp_path / "small.gfc.gz"
        path.write_bytes(gzip.compress((HEAD + BODY).encode()))
    model = read_gfc(path)
    assert (model.name, model.degree, model.tide_system) == ("SMALL", 2, 0)
    assert model.c[2, 0] == -0.484165143790815e-3
    assert model.s[2, 1] == 0.13e-8
    assert (model.c[1, 0], model.c[1, 1], model.s[1, 1]) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("c20", "system"), [("-0.4841651437e-3", 0), ("-0.4841694e-3", 1)])
def test_where_the_header_is_silent_c20_tells_the_tide_system(tmp_path: Path, c20: str, system: int) -> None:
    """4.17e-9 lie between the systems: JGM3's own file is such a one, and zero-tide by its value."""
    head = HEAD.replace("tide_system  tide_free\n", "")
    path = model_file(tmp_path, head + BODY.replace("-0.484165143790815D-03", c20))
    assert read_gfc(path).tide_system == system


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("gravity_field", "topography", "not an ICGEM gravity field"),
        ("end_of_head", "end_of_heart", "not an ICGEM gravity field"),
        ("fully_normalized", "unnormalized", "norm unnormalized"),
        ("radius       0.63781363E+07\n", "", "radius"),
        ("tide_free", "mean_tide", "mean_tide"),
        ("tide_free", "zero_tide", "header says zero_tide, but C20"),
        ("gfc 2 1", "gfct 2 1", "line 11: 'gfct'"),
        ("gfc 2 1 -0.2e-9 0.13e-8\n", "", "degree 2 are missing"),
        ("-0.14e-5", "-0.14x-5", "line 12"),
        ("1.0d0", "1.1d0", "C00"),
        ("max_degree   2", "max_degree   3", "degree 3 are missing"),
    ],
)
def test_a_file_that_does_not_serve_is_refused_with_its_place(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(OperatorError, match=said):
        read_gfc(model_file(tmp_path, (HEAD + BODY).replace(old, new, 1)))


def test_more_than_a_file_or_a_table_holds_is_refused(tmp_path: Path) -> None:
    path = model_file(tmp_path, HEAD + BODY)
    with pytest.raises(OperatorError, match="complete to degree 2"):
        build_gravity_field(path, 3)
    with pytest.raises(OperatorError, match="2 to 120"):
        build_gravity_field(path, 121)
    with pytest.raises(OperatorError, match="cannot be read"):
        build_gravity_field(tmp_path / "none.gfc", 2)
    broken = tmp_path / "broken.gfc.gz"
    broken.write_bytes(gzip.compress(b"x" * 1000)[:20])
    with pytest.raises(OperatorError, match="cannot be read"):
        read_gfc(broken)


def test_force_table_defaults_words_and_validity() -> None:
    table = decode(build_forces({"integrator": "RK4", "sun": "no", "degree": 70, "area_to_mass_m2pkg": 0.002}))
    record = table.values[0]
    assert (record["integrator"], record["sun"], record["moon"]) == (0, 0, 1)
    assert (record["degree"], record["order"]) == (70, 70)  # the order follows the degree unless given
    assert record["area_to_mass_m2pkg"] == 0.002
    assert (table.valid_from_gps_ns, table.valid_to_gps_ns) == (0, 0)


def test_space_weather_of_a_day_as_it_would_be_known_on_board() -> None:
    """The row of CelesTrak's file by hand: flux of the day before, mean of the 81 days up to it, ap of the day."""
    day = date(2021, 7, 17)
    rows = {line[:10]: line.split(",") for line in packaged_space_weather().read_text().splitlines()}
    names = rows.pop("DATE,BSRN,")
    flux, ap = names.index("F10.7_OBS"), names.index("AP_AVG")
    days = [date.fromordinal(day.toordinal() - k).isoformat() for k in range(1, 82)]
    weather = read_space_weather(day)
    assert weather.f107 == float(rows[days[0]][flux])
    assert weather.f107_mean == pytest.approx(np.mean([float(rows[d][flux]) for d in days]))
    assert weather.ap == float(rows[day.isoformat()][ap])
    table = decode(build_forces(day=day, valid_days=2.0))
    assert table.values[0]["f107"] == weather.f107


def test_a_force_table_stands_for_the_days_around_that_of_its_space_weather() -> None:
    """2021-07-17 is day 15168 of GPS time; the table and the header of its file say the same."""
    table = decode(build_forces(day=date(2021, 7, 17), valid_days=2.0))
    record, day_ns = table.values[0], 86_400 * 10**9
    noon_ns = 15168 * day_ns + day_ns // 2
    assert (record["valid_from_gps_ns"], record["valid_until_gps_ns"]) == (noon_ns - 2 * day_ns, noon_ns + 2 * day_ns)
    assert (table.valid_from_gps_ns, table.valid_to_gps_ns) == (noon_ns - 2 * day_ns, noon_ns + 2 * day_ns)
    record = decode(build_forces(day=date(2021, 7, 17))).values[0]
    assert record["valid_until_gps_ns"] - record["valid_from_gps_ns"] == 90 * day_ns
    shown = render(decode(build_forces(day=date(2021, 7, 17), valid_days=2.0)))
    assert "2021-07-15 12:00:00" in next(line for line in shown.splitlines() if line.startswith("valid_from_gps_ns"))
    assert "2021-07-19 12:00:00" in next(line for line in shown.splitlines() if line.startswith("valid_until_gps_ns"))
    assert "without end" in render(decode(build_forces()))


@pytest.mark.parametrize("days", [0.0, -1.0, float("nan"), 1e9])
def test_a_validity_that_is_none_is_refused(days: float) -> None:
    with pytest.raises(OperatorError, match="--valid-days"):
        build_forces(day=date(2021, 7, 17), valid_days=days)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"degre": 50}, 'did you mean "degree"'),
        ({"degree": 121}, "outside"),
        ({"degree": 50.5}, "whole number"),
        ({"degree": 20, "order": 30}, "order = 30 exceeds degree = 20; lower order"),
        ({"integrator": "RK5"}, "none of RK4, RK8, RKN5"),
        ({"f107": float("nan")}, "outside"),
        ({"drag_coefficient": "big"}, "numbers"),
        ({"sun": True}, "whole number"),
        ({"valid_from_gps_ns": 5, "valid_until_gps_ns": 5}, "is that of valid_until_gps_ns"),
    ],
)
def test_a_wrong_setting_is_refused_by_name(overrides: dict[str, object], said: str) -> None:
    with pytest.raises(OperatorError, match=said):
        build_forces(overrides)


def test_a_day_without_space_weather_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OperatorError, match="no space weather"):
        build_forces(day=date(2300, 1, 1))
    path = tmp_path / "other.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(OperatorError, match="not CelesTrak"):
        build_forces(day=date(2021, 7, 17), space_weather_path=path)


def test_commands_build_and_show(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN the command line WHEN tables are built and shown THEN every field is there with unit and word."""
    gravity, forces = tmp_path / "g.tbl", tmp_path / "f.tbl"
    small = str(model_file(tmp_path, HEAD + BODY))
    assert main(["table", "build-gravity", small, "--degree", "2", "--out", str(gravity)]) == 0
    arguments = ["--day", "2021-07-17", "--set", "degree=60", "--set", "integrator=RK4", "--out", str(forces)]
    assert main(["table", "build-forces", *arguments]) == 0
    capsys.readouterr()
    assert main(["table", "show", str(gravity)]) == 0
    shown = capsys.readouterr().out
    assert "SMALL 2" in shown
    assert "tide_free" in shown
    assert "-4.841651437908150e-04" in shown
    assert main(["table", "show", str(forces)]) == 0
    shown = capsys.readouterr().out
    assert "2021-06-02 12:00:00 GPS to 2021-08-31 12:00:00 GPS" in shown
    assert "RK4" in shown
    assert "[atmosphere]" in shown
    assert main(["table", "build-forces", "--day", "17.7.2021", "--out", str(forces)]) == 2
    assert "YYYY-MM-DD" in capsys.readouterr().err
