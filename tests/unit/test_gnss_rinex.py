"""RINEX 2 observation files: columns, continuation lines, events, and what is refused with its line."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from gnss_files import T0_NS, rinex_header
from hypothesis import given
from hypothesis import strategies as st

from hil_sim.errors import DataError
from hil_sim.gnss.rinex_obs import read_observations

CODES = ["L1", "L2", "C1", "P1", "P2", "S1"]
# two lines a satellite: five fields of 14.3 with loss-of-lock and strength, then the rest
G11 = [
    " 107576007.03748  83825474.87148  20471032.92149  20471033.58948  20471037.276 8",
    "       669.000  ",
]
G14_SLIPPED = [
    " 112972191.77518  88030296.00648                  21497893.31348               8",
    "       469.000  ",
]
R05 = [" 100000000.00048" * 5, "       100.000  "]


def epoch(second: str, *satellites: str, flag: int = 0) -> str:
    return f" 10 07 27 00 00 {second}  {flag}{len(satellites):3d}" + "".join(satellites)


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join([*rinex_header(CODES), *lines]) + "\n")
    return path


def test_values_stand_in_their_columns(tmp_path: Path) -> None:
    """GIVEN two satellites, one with a slip and gaps WHEN read THEN numbers as written, missing as NaN, the bit too."""
    lines = [epoch("00.0000000", " 11", "G14"), *G11, *G14_SLIPPED, epoch("10.0000000", "G11"), *G11]
    observed = read_observations(write(tmp_path / "x.10o", *lines))
    assert observed.t_ns.tolist() == [T0_NS, T0_NS + 10_000_000_000]
    assert observed.epoch.tolist() == [0, 0, 1]
    assert observed.prn.tolist() == [11, 14, 11]
    assert observed.values["L1"].tolist() == [107576007.037, 112972191.775, 107576007.037]
    assert observed.values["P2"][0] == 20471037.276
    assert np.isnan(observed.values["C1"]).tolist() == [False, True, False]
    assert np.isnan(observed.values["P2"]).tolist() == [False, True, False]
    assert observed.values["S1"].tolist() == [669.0, 469.0, 669.0]
    assert observed.slipped["L1"].tolist() == [False, True, False]  # 4 is anti-spoofing, 1 is the slip


def test_other_systems_and_events_are_left_out(tmp_path: Path) -> None:
    """GIVEN GLONASS in the epoch and an event with two header lines WHEN read THEN GPS alone, and nothing is lost."""
    event = [epoch("05.0000000", flag=4)[:29] + "  2", " " * 60 + "COMMENT", " " * 60 + "COMMENT"]
    lines = [epoch("00.0000000", "G11", "R05"), *G11, *R05, *event, epoch("10.0000000", "R05", "G11"), *R05, *G11]
    observed = read_observations(write(tmp_path / "x.10o", *lines))
    assert observed.prn.tolist() == [11, 11]
    assert observed.epoch.tolist() == [0, 1]
    assert set(observed.values["P1"]) == {20471033.589}


def test_more_than_twelve_satellites_go_on_in_the_next_line(tmp_path: Path) -> None:
    names = [f"G{prn:02d}" for prn in range(1, 15)]
    lines = [epoch("00.0000000", *names)[: 32 + 36], " " * 32 + "".join(names[12:])]
    observed = read_observations(write(tmp_path / "x.10o", *lines, *(G11 * 14)))
    assert observed.prn.tolist() == list(range(1, 15))


def test_gzipped_is_the_same(tmp_path: Path) -> None:
    plain = write(tmp_path / "x.10o", epoch("00.0000000", "G11"), *G11)
    zipped = tmp_path / "x.10o.gz"
    zipped.write_bytes(gzip.compress(plain.read_bytes()))
    a, b = read_observations(plain), read_observations(zipped)
    assert a.values["P1"].tolist() == b.values["P1"].tolist()


BODY = [epoch("00.0000000", "G11", "G14"), *G11, *G14_SLIPPED]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([epoch("00.0000000", "G11", "G14"), *G11], r"line 8: not RINEX 2: the file ends within an epoch"),
        (
            [epoch("00.0000000", "G11"), G11[0].replace("1075", "10x5"), G11[1]],
            r"line 6: not RINEX 2: could not convert",
        ),
        ([epoch("00.0000000", "G11").replace("07 27", "07 32"), *G11], "line 5: not RINEX 2: day is out of range"),
        ([" 10 07 27 00 00 00.0000000  0  3G11"], "line 5: not RINEX 2: 3 satellites announced, listed are 'G11'"),
        ([*BODY, *BODY], "epoch 2 is not after the one before it"),
        ([epoch("00.0000000", "R05"), *R05], "holds no GPS observation"),
    ],
)
def test_a_broken_file_is_refused_with_its_line(tmp_path: Path, lines: list[str], said: str) -> None:
    with pytest.raises(DataError, match=said):
        read_observations(write(tmp_path / "x.10o", *lines))


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda header: header[1:], "not a RINEX file"),
        (
            lambda header: [header[0].replace("2.11", "3.02"), *header[1:]],
            "RINEX 3.02 O: only observations of version 2",
        ),
        (
            lambda header: [header[0].replace("OBSERV", "NAVIG "), *header[1:]],
            "line 1: RINEX 2.11 N: only observations",
        ),
        (lambda header: header[:-1], "ends within its header"),
        (lambda header: [header[0], header[1].replace("     6", "     7"), *header[2:]], "line 4: 7 observation types"),
        (lambda header: [*header[:2], header[2].replace("GPS", "GLO"), header[3]], "line 3: not RINEX 2: time system"),
    ],
)
def test_a_header_that_does_not_serve(tmp_path: Path, edit, said: str) -> None:
    path = tmp_path / "x.10o"
    path.write_text("\n".join([*edit(rinex_header(CODES)), *BODY]) + "\n")
    with pytest.raises(DataError, match=said):
        read_observations(path)


@given(st.data())
def test_cut_or_garbled_it_is_read_or_refused_in_one_line(tmp_path_factory: pytest.TempPathFactory, data) -> None:
    """GIVEN a file cut or with one character changed WHEN read THEN DataError in one line, or observations."""
    text = "\n".join([*rinex_header(CODES), *BODY, epoch("10.0000000", "G11"), *G11]) + "\n"
    at = data.draw(st.integers(0, len(text) - 1))
    if data.draw(st.booleans()):
        text = text[:at]
    else:
        text = text[:at] + data.draw(st.characters(min_codepoint=10, max_codepoint=126)) + text[at + 1 :]
    path = tmp_path_factory.getbasetemp() / "garbled.10o"
    path.write_text(text)
    try:
        observed = read_observations(path)
    except DataError as error:
        said = str(error)
    else:
        assert {len(values) for values in observed.values.values()} == {len(observed.prn)} == {len(observed.epoch)}
        return
    assert said.startswith(str(path))
    assert "\n" not in said
