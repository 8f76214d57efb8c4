"""`ground timing`: what it reads from a flight, what it writes, and what it says where it cannot."""

import argparse
import json
from pathlib import Path

import pytest

from flightsw.process_account import ProcessAccount
from flightsw.schedule import Member, Schedule
from ground.__main__ import main
from ground.errors import OperatorError
from ground.exit_status import STOPPED
from ground.timing import command, flights, instructions, report


def timing(folder: Path) -> None:
    """What a flight leaves, written as flight writes it."""
    idle = Member("idle", 0, 100.0, lambda: None)
    schedule = Schedule([Member("navigate", 1, 100.0, lambda: None), idle], [], 1000.0)
    for tick in range(50):
        schedule.run_tick(tick)
        schedule.wake.account(70_000)
    record = {"wall_s": 2.0, "scheduling": "SCHED_FIFO", "slips": 3, "ticks": 50, "process": ProcessAccount().summary()}
    folder.mkdir(parents=True)
    (folder / "timing.json").write_text(json.dumps({**record, "members": schedule.summary()}))
    (folder / "summary.json").write_text(json.dumps({"simulated_s": 500.0}))


def test_parts_flown_are_in_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN flights that leave their timing WHEN the command runs THEN speed, slips, wake-up and members that ran are
    in what is printed and in the document, and the JSON holds the parts that were asked for."""

    def run(*words: str, environment: dict[str, str] | None = None) -> None:
        timing(Path(words[words.index("--out") + 1]))

    monkeypatch.setattr(flights, "_run", run)
    doc, data = tmp_path / "timing.md", tmp_path / "timing.json"
    words = ["--parts", "ticks", "realtime", "--out", str(tmp_path / "out"), "--doc", str(doc), "--json", str(data)]
    assert main(["timing", "--quick", *words]) == 0
    text = doc.read_text()
    assert capsys.readouterr().out == text + "\n"
    assert "50 ticks, 250 times real time, 3 slips" in text
    assert "| wake | 50 | 70.0 | " in text
    assert "### 10 Hz, ordinary scheduling" in text
    assert "SCHED_FIFO scheduling, 50 ticks, 3 slips" in text
    assert "| navigate | 50 |" in text
    assert "| idle |" not in text
    assert set(json.loads(data.read_text())) == {"machine", "ticks", "realtime"}


def test_parts_measured_before_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN a call that was stopped after one part WHEN it is called with --resume THEN only the other is measured, and
    the report has both; figures of another machine are not mixed with this one's."""
    measured: list[str] = []

    def count(args: argparse.Namespace) -> dict[str, object]:
        measured.append("instructions")
        return {"missing": "no tool"}

    def stop(args: argparse.Namespace) -> dict[str, object]:
        raise KeyboardInterrupt

    monkeypatch.setitem(command._MEASURES, "instructions", count)
    monkeypatch.setitem(command._MEASURES, "start", stop)
    words = ["timing", "--out", str(tmp_path), "--parts", "instructions", "start"]
    assert main(words) == STOPPED
    assert "--resume goes on" in capsys.readouterr().err
    monkeypatch.setitem(command._MEASURES, "start", lambda args: {"with compiled kernels": 1.5})
    assert main([*words, "--resume"]) == 0
    assert measured == ["instructions"]
    text = capsys.readouterr().out
    assert "Not counted: no tool." in text
    assert "1.5" in text
    figures = tmp_path / "timing.json"
    found = json.loads(figures.read_text())
    figures.write_text(json.dumps({**found, "machine": {**found["machine"], "processors": 99}}))
    assert main([*words, "--resume"]) == 2
    assert "processors 99" in capsys.readouterr().err
    figures.write_text("[]")
    assert main([*words, "--resume"]) == 2
    assert "no figures to go on from" in capsys.readouterr().err


def test_a_flight_that_fails_is_named_with_what_it_said(tmp_path: Path) -> None:
    with pytest.raises(OperatorError, match=r"hil_sim run nowhere has ended with status 2: .*nowhere"):
        flights.lockstep("nowhere", (), tmp_path)


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["timing", "--parts", "ticks", "--out", str(tmp_path / "file" / "out")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_ways_are_told_by_their_ratio_to_flight() -> None:
    ways = [
        {"name": "flight", "step_ns": 400.0, "difference": 0.0},
        {"name": "C", "step_ns": 200.0, "difference": 2e-15},
    ]
    text = report.render({"machine": {**command._machine(False), "load": 0.5}, "kernels": ways})
    assert "| C | 200 | 0.50 | 2e-15 |" in text


def test_a_soak_is_told_from_its_account(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN the account of a soak of three laps WHEN the command is given it THEN growth, passes and digest are told;
    a file that is none is named."""
    timing(tmp_path / "run")
    members = json.loads((tmp_path / "run" / "timing.json").read_text())["members"]
    mark = {"ticks": 1000, "rss_bytes": 1 << 20, "collected": [5, 1, 0], "grown": 90, "dropped": 0}
    laps = [mark, {**mark, "ticks": 2000, "grown": 3}, {**mark, "ticks": 3000, "grown": -1, "collected": [9, 2, 0]}]
    account = {"scenario": "soak", "ticks": 3000, "simulated_s": 300.0, "flown_s": 2.0, "slips": 0, "alerts": 4}
    path = tmp_path / "soak.json"
    path.write_text(json.dumps({**account, "digest": "ab", "failures": [], "laps": laps, "members": members}))
    words = ["timing", "--parts", "--out", str(tmp_path / "out"), "--soak"]
    assert main([*words, str(path)]) == 0
    text = capsys.readouterr().out
    assert "3,000 ticks in 3 laps, 150 times real time, 0 slips" in text
    assert "in 2,000 ticks: +2 blocks" in text
    assert "collector passes 4/1/0" in text
    path.write_text("{}")
    assert main([*words, str(path)]) == 2
    assert "not the account of a soak" in capsys.readouterr().err


def test_lanes_and_instructions_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    ways = [{"name": "lanes", "arcs_per_s": 18_000.0}, {"name": "flight's", "arcs_per_s": 1_500.0}]
    counted = {"nominal": {"ticks": 400, "instructions": 512_345.6}}
    machine = command._machine(False)
    text = report.render({"machine": {**machine, "load": 0.5}, "lanes": ways, "instructions": counted})
    assert "| lanes | 18,000 | 12.0 |" in text
    assert "| nominal | 512,346 | 400 |" in text
    monkeypatch.setattr(instructions.shutil, "which", lambda name: None)
    why = instructions.missing()
    assert why is not None
    assert f"Not counted: {why}." in report.render({"machine": machine, "instructions": {"missing": why}})
