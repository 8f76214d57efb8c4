"""Orbit parameter messages: what is read is what was written, and what is wrong is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightsw.icd import mavlink as m
from flightsw.icd.enums import RejectCause, StateFrame
from ground.console.opm import GivenState, read_opm
from ground.console.uplink import REPEAT_S, STATE_TAKEN, TRIES, Operator
from ground.errors import OperatorError

NAMES = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
STATE = (6878137.0, -12.5, 3.25, 1.5, 7612.6, -0.125)
COVARIANCE = np.diag([9.0, 64.0, 4.0, 6.4e-5, 9e-6, 4e-6]) + 1e-6


def opm(state: Any = STATE, covariance: np.ndarray = COVARIANCE, **changes: str | None) -> str:
    lines = {
        "CCSDS_OPM_VERS": "3.0",
        "CREATION_DATE": "2018-12-30T00:00:00",
        "ORIGINATOR": "TEST",
        "OBJECT_NAME": "SAT",
        "OBJECT_ID": "2018-001A",
        "CENTER_NAME": "EARTH",
        "REF_FRAME": "GCRF",
        "TIME_SYSTEM": "UTC",
        "EPOCH": "2018-12-30T12:00:00.250",
        **{name: f"{1e-3 * value!r} [km]" for name, value in zip(NAMES, state, strict=True)},
        **{f"C{NAMES[i]}_{NAMES[j]}": repr(float(1e-6 * covariance[i, j])) for i in range(6) for j in range(i + 1)},
    }
    lines |= {name: value for name, value in changes.items() if value is not None}
    return "COMMENT made by a test\n\n" + "".join(
        f"{name} = {value}\n" for name, value in lines.items() if name not in changes or changes[name] is not None
    )


def read(tmp_path: Path, text: str) -> GivenState:
    path = tmp_path / "state.opm"
    path.write_text(text)
    return read_opm(path)


def test_a_message_is_read_in_metres_and_gps_time(tmp_path: Path) -> None:
    """2018-12-30T12:00:00.250 UTC is 18 s later in GPS time: 1230206418.250 s after its epoch."""
    given_state = read(tmp_path, opm())
    assert given_state.t_gps_ns == 1_230_206_418_250_000_000
    assert given_state.frame == StateFrame.GCRF
    assert given_state.state == pytest.approx(STATE, rel=1e-14)
    whole = np.zeros((6, 6))
    whole[np.triu_indices(6)] = given_state.covariance
    np.testing.assert_allclose(whole, np.triu(COVARIANCE), rtol=1e-12)


@pytest.mark.parametrize(("scale", "later_s"), [("GPS", 0.0), ("TAI", -19.0), ("TT", -51.184), ("UTC", 18.0)])
def test_time_systems(tmp_path: Path, scale: str, later_s: float) -> None:
    gps_ns = 1_230_206_400_250_000_000
    assert read(tmp_path, opm(TIME_SYSTEM=scale)).t_gps_ns == gps_ns + round(later_s * 1e9)
    assert read(tmp_path, opm(TIME_SYSTEM=scale, EPOCH="2018-364T12:00:00.25Z")).t_gps_ns == gps_ns + round(
        later_s * 1e9
    )


@pytest.mark.parametrize("name", ["ITRF", "ITRF2014", "ITRF-93", "itrf2020"])
def test_frames_of_the_earth(tmp_path: Path, name: str) -> None:
    assert read(tmp_path, opm(REF_FRAME=name)).frame == StateFrame.ITRF


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"CCSDS_OPM_VERS": None}, "no CCSDS_OPM_VERS"),
        ({"X": None}, "no X;"),
        ({"CZ_DOT_X": None}, "no CZ_DOT_X"),
        ({"X": "seven"}, "X = seven: give a number"),
        ({"CX_X": "nan"}, "CX_X = nan: give a number"),
        ({"CENTER_NAME": "MOON"}, "EARTH only"),
        ({"REF_FRAME": "EME2000"}, "0.8 m in low orbit: convert it"),
        ({"REF_FRAME": "TEME"}, "give GCRF, ICRF or ITRF"),
        ({"COV_REF_FRAME": "RTN"}, "in the frame of the state"),
        ({"TIME_SYSTEM": "UT1"}, "give UTC, TAI, TT or GPS"),
        ({"EPOCH": "yesterday"}, "give it as"),
        ({"EPOCH": "2018-13-30T12:00:00"}, "give it as"),
        ({"EPOCH": "1970-01-01T00:00:00", "TIME_SYSTEM": "GPS"}, "before GPS time"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, changes: dict[str, str | None], words: str) -> None:
    with pytest.raises(OperatorError) as caught:
        read(tmp_path, opm(**changes))
    assert words in str(caught.value)
    assert "state.opm" in str(caught.value)


def test_lines_and_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(OperatorError, match="line 3: KEYWORD = value"):
        read(tmp_path, "CCSDS_OPM_VERS = 3.0\n\n<xml/>\n")
    with pytest.raises(OperatorError, match="X for the second time"):
        read(tmp_path, opm() + "X = 1\n")
    with pytest.raises(OperatorError, match="cannot be read"):
        read_opm(tmp_path / "none.opm")


@given(text=st.text(max_size=300))
def test_no_text_does_more_than_be_refused(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.mktemp("opm") / "x.opm"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(OperatorError):
        read_opm(path)


# -- sent until it is answered


class Sent:
    """What an operator has sent, and said."""

    def __init__(self) -> None:
        self.frames: list[Any] = []
        self.notes: list[tuple[int, str]] = []
        self.parser = m.MAVLink(None)
        self.operator = Operator(
            lambda frame: self.frames.append(self.parser.decode(bytearray(frame))),
            None,
            lambda severity, text: self.notes.append((severity, text)),
        )

    def uploads(self) -> list[Any]:
        return [frame for frame in self.frames if frame.get_type() == "LEONAV_STATE_UPLOAD"]


def answer(sequence: int, cause: int, nis: float = float("nan")) -> Any:
    return m.MAVLink_leonav_state_result_message(sequence, nis, cause)


def test_a_state_is_sent_again_until_flight_answers(tmp_path: Path) -> None:
    """GIVEN a state WHEN flight is silent for a second THEN it is sent again under the same number; WHEN the answer
    comes THEN it is told, and no more is sent."""
    there, taken = Sent(), list[bool]()
    there.operator.upload_state(read(tmp_path, opm()), "state", taken.append)
    for k in range(3):
        there.operator.step(100.0 + k * 0.6 * REPEAT_S)
    first, second = there.uploads()
    assert first.sequence == second.sequence
    assert tuple(first.state) == pytest.approx(STATE, rel=1e-14)
    there.operator.take(answer(first.sequence + 1, STATE_TAKEN))
    assert taken == []
    there.operator.take(answer(first.sequence, STATE_TAKEN, 4.25))
    there.operator.step(200.0)
    assert taken == [True]
    assert len(there.uploads()) == 2
    assert there.notes[-1] == (5, "state: taken, NIS 4.2 (6 degrees of freedom); not certified until fixes are back")


@pytest.mark.parametrize(
    ("cause", "words"), [(int(RejectCause.GATE), "refused: GATE, NIS 99.0"), (77, "refused: cause 77, NIS 99.0")]
)
def test_a_refusal_is_told_in_words(tmp_path: Path, cause: int, words: str) -> None:
    there, taken = Sent(), list[bool]()
    there.operator.upload_state(read(tmp_path, opm()), "state", taken.append)
    there.operator.step(0.0)
    there.operator.take(answer(there.uploads()[0].sequence, cause, 99.0))
    assert taken == [False]
    assert words in there.notes[-1][1]


def test_silence_is_told_and_ends(tmp_path: Path) -> None:
    there, taken = Sent(), list[bool]()
    there.operator.upload_state(read(tmp_path, opm()), "state", taken.append)
    for k in range(TRIES + 3):
        there.operator.step(2.0 * REPEAT_S * k)
    assert len(there.uploads()) == TRIES
    assert taken == [False]
    assert "flight does not answer" in there.notes[-1][1]
