"""Replay of a run that was killed, or whose logs were divided: what is whole is flown again, the rest is said."""

import json
from pathlib import Path

import pytest
from harness import Flight, load, read_tlog, save_run

from flightsw import __main__ as command_line


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    with Flight(load("time.duration_s=10"), tmp_path) as flight:
        flight.fly()
    return save_run(flight, tmp_path)


def command(*arguments: object) -> int:
    return command_line.main(["replay", *map(str, arguments)])


@pytest.mark.parametrize(
    ("can_bytes", "link_bytes", "said"),
    [
        (3, 0, "can.log: line"),  # within a line
        (250, 0, "ends within tick"),  # between lines of a tick
        (0, 5, "link.tlog ends within a message"),
        (20_000, 0, "can.log"),
        (0, 5_000, "link.tlog ends within a message"),
    ],
)
def test_a_run_that_was_killed_is_replayed_as_far_as_it_is_whole(
    run_dir: Path, capsys, can_bytes: int, link_bytes: int, said: str
) -> None:
    """GIVEN logs that end anywhere THEN exit 0, a remark that names where, and every whole tick flown again; a byte
    changed before the end is still found.
    """
    for name, count in (("can.log", can_bytes), ("link.tlog", link_bytes)):
        raw = (run_dir / name).read_bytes()
        raw = raw[: len(raw) - count]
        if name == "can.log" and count == 250:
            raw = raw[: raw.rfind(b"\n") + 1]
        (run_dir / name).write_bytes(raw)
    lines = (run_dir / "can.log").read_text().splitlines(keepends=True)
    beats = sum(" can0 202##1" in line and line.endswith("\n") for line in lines)
    assert command(run_dir) == 0
    captured = capsys.readouterr()
    assert said in captured.err
    assert "the run was cut off there" in captured.err
    assert f"{beats} ticks replayed: IDENTICAL" in captured.out
    at = next(i for i, line in enumerate(lines) if i > 40 and " can0 200##1" in line)
    digit = "1" if lines[at][45] == "0" else "0"
    lines[at] = lines[at][:45] + digit + lines[at][46:]
    (run_dir / "can.log").write_text("".join(lines))
    assert command(run_dir) == 1
    assert "can.log    differs from byte" in capsys.readouterr().out


def test_a_divided_run_is_replayed_whole_and_without_its_beginning_refused(run_dir: Path, capsys) -> None:
    """GIVEN logs in parts THEN they are flown as one; WHEN the first has gone THEN that is said with the remedy."""
    lines = (run_dir / "can.log").read_bytes().splitlines(keepends=True)
    (run_dir / "can.000001.log").write_bytes(b"".join(lines[:101]))
    (run_dir / "can.000002.log").write_bytes(b"".join(lines[101:150]))
    (run_dir / "can.log").write_bytes(b"".join(lines[150:]))
    assert command(run_dir) == 0
    assert "100 ticks replayed: IDENTICAL" in capsys.readouterr().out
    (run_dir / "can.000001.log").unlink()
    assert command(run_dir) == 2
    said = capsys.readouterr().err
    assert "its beginning was dropped" in said
    assert "--log-limit" in said


@pytest.mark.parametrize("missing", ["can", "link"])
def test_logs_of_a_live_flight_that_end_at_different_ticks_are_compared_as_far_as_both_go(
    run_dir: Path, capsys, missing: str
) -> None:
    """GIVEN a flight in real time that was killed between the writing of one log and the other THEN identical, said."""
    record = json.loads((run_dir / "run.json").read_text())
    (run_dir / "run.json").write_text(json.dumps({**record, "lockstep": False}))
    if missing == "can":
        lines = (run_dir / "can.log").read_text().splitlines(keepends=True)
        ends = [i for i, line in enumerate(lines) if " can0 202##1" in line]
        (run_dir / "can.log").write_text("".join(lines[: ends[79] + 1]))
    else:
        stamps = [(t_us, 8 + len(message.get_msgbuf())) for t_us, message in read_tlog(run_dir / "link.tlog")]
        kept = sum(length for t_us, length in stamps if t_us < stamps[-1][0])
        (run_dir / "link.tlog").write_bytes((run_dir / "link.tlog").read_bytes()[:kept])
    assert command(run_dir) == 0
    captured = capsys.readouterr()
    assert "compared as far as both go" in captured.err
    assert "IDENTICAL" in captured.out
