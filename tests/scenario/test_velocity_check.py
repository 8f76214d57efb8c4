"""The velocity check in the loop: a biased receiver is told of, a healthy one is not, and a replay says the same."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from harness import Flight, fault, faults, load, save_run

from flightsw import replay
from flightsw.icd import mavlink
from flightsw.icd.alerts import AlertId
from flightsw.link.mavlink_out import Sink
from ground.__main__ import main
from ground.errors import OperatorError
from ground.tables.function_sets import build_function

ALERT = int(AlertId.RECEIVER_VELOCITY_FAULT)
ONSET_S, BIAS_MPS = 700.0, 0.5


class Heard(Sink):
    """Keeps the messages of this function and the alerts."""

    def __init__(self) -> None:
        self.parser = mavlink.MAVLink(None)
        self.checks: list[mavlink.MAVLink_message] = []
        self.alerts: list[mavlink.MAVLink_message] = []

    def send(self, message: bytes | bytearray) -> None:
        for told in self.parser.parse_buffer(bytes(message)) or ():
            if told.get_type() == "LEONAV_VELOCITY_CHECK":
                self.checks.append(told)
            elif told.get_type() == "LEONAV_ALERT" and told.alert_id == ALERT:
                self.alerts.append(told)

    def close(self) -> None:
        """Nothing to close."""


def fly(heard: Heard, folder: Path | None, *settings: str) -> Flight:
    """The shipped scenario, shortened; its fault comes earlier and is larger."""
    with Flight(load("time.duration_s=740", *settings, name="velocity_bias"), folder, heard) as flight:
        return flight.fly()


@pytest.fixture(scope="module")
def biased(tmp_path_factory: pytest.TempPathFactory) -> tuple[Flight, Heard, Path]:
    folder, heard = tmp_path_factory.mktemp("biased"), Heard()
    bias = fault("velocity_step", ONSET_S, 40.0, axis="y", value=BIAS_MPS)
    return fly(heard, folder, faults(bias)), heard, folder


def test_a_biased_velocity_is_told_of_within_seconds(biased: tuple[Flight, Heard, Path]) -> None:
    """GIVEN ten minutes of healthy fixes WHEN the receiver's velocity is wrong by 0.5 m/s THEN the alert is raised
    within 20 s and not before, the message names the bias, and navigation's state is as good as before."""
    flight, heard, _ = biased
    (raised,) = heard.alerts
    start_ns = flight.loaded.t_start_gps_ns
    assert raised.active == 1
    assert ONSET_S < (raised.t_gps_ns - start_ns) * 1e-9 < ONSET_S + 20.0
    before = [told for told in heard.checks if told.t_gps_ns < start_ns + ONSET_S * 1e9]
    assert before[-1].armed == 1
    assert all(told.fault == 0 for told in before)
    assert next(told for told in heard.checks if told.fault).statistic > 30.1
    # the mean of the last fifty fixes holds forty biased ones
    assert math.hypot(*heard.checks[-1].bias_mps) == pytest.approx(0.55 * BIAS_MPS, rel=0.25)
    assert flight.out["flag"][0] == 0
    # the alert carries what the message says of the same fix, not navigation's bound
    said = next(math.hypot(*told.bias_mps) for told in heard.checks if told.fault)
    assert raised.value == pytest.approx(said, rel=0.1)


def test_the_replay_says_the_same(biased: tuple[Flight, Heard, Path]) -> None:
    """GIVEN the journal of that flight WHEN it is flown again THEN every byte is the same."""
    flight, _, folder = biased
    assert replay.replay(save_run(flight, folder), folder / "again") == (flight.k, None, None)


def test_a_bias_from_the_first_fix_is_found_once_the_check_is_armed() -> None:
    """GIVEN a receiver whose velocity is wrong by 0.2 m/s from the beginning THEN the alert comes when the slope of
    its positions is known, though the state has started from that velocity."""
    heard = Heard()
    fly(heard, None, "time.duration_s=520", faults(fault("velocity_step", 0.0, 520.0, axis="y", value=0.2)))
    (raised,) = heard.alerts
    armed = next(told for told in heard.checks if told.armed)
    assert 0.0 < (raised.t_gps_ns - armed.t_gps_ns) * 1e-9 < 40.0


def test_a_receiver_without_velocity_and_spikes_are_no_fault() -> None:
    """GIVEN numbers that are none, one absurd velocity and a frozen fix THEN nothing is told and nothing raised."""
    heard = Heard()
    spike = fault("velocity_step", 20, 1, value=1e5)
    fly(heard, None, "time.duration_s=40", faults(fault("nan", 10, 5, axis="all", target="velocity"), spike))
    assert heard.alerts == []
    assert np.isfinite(heard.checks[-1].statistic)


def test_without_a_table_there_is_no_check() -> None:
    heard = Heard()
    with Flight(load("time.duration_s=10"), None, heard) as flight:
        flight.fly()
    assert heard.checks == []


def test_the_table_is_built_and_mistakes_in_it_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "velocity_check.tbl"
    words = ["velocity_check", "velocity_check", "--set", "threshold=40"]
    assert main(["table", "build-function", *words, "--out", str(out)]) == 0
    assert main(["table", "show", str(out)]) == 0
    assert "threshold" in capsys.readouterr().out
    for kind, settings, says in (
        ("velocity", {}, "there are: gnss, crosslink, velocity_check"),
        ("velocity_check", {"thresold": 1.0}, "did you mean"),
        ("velocity_check", {"threshold": "x"}, "not a number"),
        ("velocity_check", {"threshold": 5.0}, "clear"),
        ("velocity_check", {"gap_s": -1.0}, "gap_s"),
    ):
        with pytest.raises(OperatorError, match=says):
            build_function(kind, "velocity_check", settings)
