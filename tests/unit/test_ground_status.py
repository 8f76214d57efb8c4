"""`ground status` and `ground compare`: a verdict and a difference that scripts can rely on."""

from __future__ import annotations

import json
import socket
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from console_story import LIMIT_M, START_UNIX_S, frames, write_tlog

from flightsw.icd import mavlink
from flightsw.icd.enums import Certificate
from ground.__main__ import main
from ground.console.link import Received, Statistics
from ground.console.status_command import HEALTHY, watch
from ground.reports.compare_command import facts, flatten, same


def status(capsys: Any, *arguments: object) -> tuple[int, dict[str, Any]]:
    code = main(["status", "--json", *map(str, arguments)])
    (line,) = capsys.readouterr().out.splitlines()
    return code, json.loads(line)


@pytest.mark.parametrize(
    ("stop_s", "word", "code"),
    [(2, "NOT READY", 1), (100, "TRUSTED", 0), (400, "TRUSTED, COASTING", 0), (900, "DO NOT USE", 1)],
)
def test_the_last_word_of_a_log(tmp_path: Path, capsys: Any, stop_s: int, word: str, code: int) -> None:
    """GIVEN the story up to some second THEN exit status and JSON say what the screen says."""
    ended, told = status(capsys, "--tlog", write_tlog(tmp_path / "link.tlog", stop_s))
    assert (ended, told["verdict"], told["healthy"]) == (code, word, code == 0)
    assert told["limit_m"] == LIMIT_M
    assert told["table_crc32"] == "1234abcd"
    assert told["certificate"] == "uncertified table"
    if word == "DO NOT USE":
        assert told["bound_m"] > LIMIT_M
        assert "FLAG_RAISED" in told["alerts"]
    if word == "NOT READY":
        assert told["bound_m"] is None  # JSON has no NaN


class Scripted:
    """A link whose messages come at times of their own, on a clock that `sleep` moves."""

    def __init__(self, stop_s: int, start_s: int = 0) -> None:
        self.time_s = START_UNIX_S + start_s - 0.5
        self.statistics = Statistics()
        decoder = mavlink.MAVLink(None)
        self.waiting = [(t / 1e6, decoder.decode(bytearray(f))) for t, f in frames(stop_s) if t >= self.time_s * 1e6]

    def now_s(self) -> float:
        return self.time_s

    def receive(self) -> list[Received]:
        due = [Received(t, message) for t, message in self.waiting if t <= self.time_s]
        self.waiting = self.waiting[len(due) :]
        return due

    def sleep(self, seconds: float) -> None:
        self.time_s += max(seconds, 0.25)


@pytest.mark.parametrize(
    ("start_s", "stop_s", "wait_s", "healthy", "at_s"),
    [
        (0, 60, 60.0, True, 4.0),  # starts, then is trusted
        (900, 960, 20.0, False, 920.0),  # the flag stays up
        (1100, 1200, 60.0, True, 1130.0),  # the flag is cleared
        (0, 2, 10.0, False, 10.0),  # silence after the start
    ],
)
def test_it_waits_until_it_is_healthy_and_no_longer_than_told(
    start_s: int, stop_s: int, wait_s: float, healthy: bool, at_s: float
) -> None:
    link = Scripted(stop_s, start_s)
    told = watch(link, HEALTHY, wait_s, False, link.sleep)
    assert told["healthy"] is healthy
    assert link.time_s - START_UNIX_S == pytest.approx(at_s, abs=1.0)
    if stop_s == 2:
        assert told["verdict"] == "NO LINK"
        assert told["stale"] is True


def test_over_a_socket_with_a_deadline(capsys: Any) -> None:
    """GIVEN a flight that speaks after a moment THEN exit 0; GIVEN nobody THEN exit 1 at the deadline, in words."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    told = list(frames(60))

    def speak() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flight:
            for _ in range(100):
                for _, frame in told[-30:]:
                    flight.sendto(frame, ("127.0.0.1", port))
                time.sleep(0.05)
                if done.is_set():
                    return

    done = threading.Event()
    speaker = threading.Thread(target=speak)
    speaker.start()
    code, said = status(capsys, "--udp", f"127.0.0.1:{port}", "--wait-healthy", "20")
    done.set()
    speaker.join()
    assert (code, said["verdict"]) == (0, "TRUSTED")
    began = time.monotonic()
    code, said = status(capsys, "--udp", f"127.0.0.1:{port}", "--wait-healthy", "0.3")
    assert (code, said["verdict"], said["messages"]) == (1, "NO LINK", 0)
    assert time.monotonic() - began >= 0.3


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--wait-healthy", "0"), "give seconds above 0"),
        (("--wait-healthy", "nan"), "give seconds above 0"),
        (("--tlog", "absent.tlog"), "cannot be read"),
        (("--tlog", "x.tlog", "--wait-healthy", "3"), "leave out"),
        (("--udp", "nonsense"), "give HOST:PORT"),
    ],
)
def test_mistakes_are_one_line(arguments: tuple[str, ...], says: str, capsys: Any) -> None:
    assert main(["status", *arguments]) == 2
    captured = capsys.readouterr()
    assert says in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


def test_an_uncertified_table_is_healthy_only_where_that_is_said(capsys: Any) -> None:
    from flightsw.icd.enums import Verdict

    def told(words: tuple[str, ...]) -> bool:
        link = Scripted(10)
        for _, message in link.waiting:
            if message.get_type() == "LEONAV_INTEGRITY":
                message.verdict, message.certificate = Verdict.NOT_CERTIFIED, Certificate.UNCERTIFIED
                message.mode = 1
        return bool(watch(link, words, 8.0, False, link.sleep)["healthy"])

    assert not told(HEALTHY)
    assert told((*HEALTHY, "NOT CERTIFIED"))


# -- compare


def run_folder(folder: Path, stop_s: int, **figures: Any) -> Path:
    folder.mkdir()
    write_tlog(folder / "link.tlog", stop_s)
    (folder / "run.json").write_text(json.dumps({"seed": 1, "versions": {"numpy": "2.4"}}))
    (folder / "summary.json").write_text(json.dumps({"wall_s": stop_s, "outages": [{"flag_age_s": 513.0}], **figures}))
    return folder


def test_two_runs_that_are_one_agree_and_others_differ_where_they_do(tmp_path: Path, capsys: Any) -> None:
    a, b = run_folder(tmp_path / "a", 290, slips=0), run_folder(tmp_path / "b", 290, slips=0)
    assert main(["compare", str(a), str(b)]) == 0
    assert "figures agree" in capsys.readouterr().out
    c = run_folder(tmp_path / "c", 310, slips=3, outages=[{"flag_age_s": 500.0}, {"flag_age_s": 7.0}])
    assert main(["compare", str(a), str(c), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)["facts"]
    assert told["summary.slips"] == {"a": 0, "b": 3}
    assert told["summary.outages[0].flag_age_s"] == {"a": 513.0, "b": 500.0}
    assert told["summary.outages.count"] == {"a": 1, "b": 2}
    assert told["summary.outages[1].flag_age_s"] == {"a": None, "b": 7.0}
    assert told["said.alerts.OUTAGE_START"] == {"a": None, "b": 1}
    assert "summary.wall_s" not in told
    assert "run.seed" not in told
    assert main(["compare", str(a), str(c), "--all"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("summary.wall_s") for line in lines)
    assert any("-13 (-2.53 %)" in line for line in lines)
    assert any("only in B" in line for line in lines)


def test_seconds_of_each_verdict_are_those_of_the_story(tmp_path: Path) -> None:
    """The story is not ready for 4 s, loses GNSS at 300 s, raises the flag at 813 s."""
    told = facts(run_folder(tmp_path / "a", 900))
    assert told["said.seconds_of.NOT READY"] == pytest.approx(4.0, abs=1.5)
    assert told["said.seconds_of.TRUSTED, COASTING"] == pytest.approx(513.0 - 4.0, abs=1.0)
    assert told["said.seconds_of.DO NOT USE"] == pytest.approx(900.0 - 813.0, abs=1.5)
    assert sum(v for k, v in told.items() if k.startswith("said.seconds_of.")) == pytest.approx(900.0)


def test_a_folder_without_a_run_is_refused_and_a_live_one_needs_no_summary(tmp_path: Path, capsys: Any) -> None:
    a = run_folder(tmp_path / "a", 5)
    assert main(["compare", str(a), str(tmp_path)]) == 2
    assert "run.json: cannot be read" in capsys.readouterr().err
    (a / "summary.json").unlink()
    assert main(["compare", str(a), str(a)]) == 0


def test_values_of_other_kinds_are_not_the_same() -> None:
    into: dict[str, Any] = {}
    flatten("x", {"a": [1, {"b": None}], "c": True}, into)
    assert into == {"x.a.count": 2, "x.a[0]": 1, "x.a[1].b": None, "x.c": True}
    assert same(1, 1.0)
    assert same(float("nan"), float("nan"))
    assert not same(True, 1)
    assert not same(None, 0)
    assert not same("1", 1)
