"""The same scenario and seed give the same bytes: in one process, in two, and at any pace."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from harness import Flight, fault, faults, load

LOGS = ("can.log", "link.tlog")
ROUGH = (
    "time.duration_s=150",
    "outage=[{start_s=80.0, duration_s=25.0}]",
    "gnss.dropout_probability=0.05",
    faults(
        fault("bit_flip", 20, 10, probability=0.5),
        fault("frame_drop", 35, 10, probability=0.4),
        fault("late", 50, 5, value=3.0),
        fault("nan", 60, 3),
        fault("position_step", 110, 14, value=800.0),
        fault("receiver_reset", 130, 4),
    ),
)


def logs_of(folder: Path, *settings: str) -> tuple[bytes, ...]:
    folder.mkdir()
    with Flight(load(*settings), folder) as flight:
        flight.fly()
    return tuple((folder / name).read_bytes() for name in LOGS)


def test_two_flights_of_one_process(tmp_path: Path) -> None:
    """GIVEN outage, noise and faults WHEN flown twice THEN both logs are the same bytes; another seed gives others."""
    first = logs_of(tmp_path / "1", *ROUGH)
    assert logs_of(tmp_path / "2", *ROUGH) == first
    other = logs_of(tmp_path / "3", *ROUGH, "seed=2")
    assert other[0] != first[0]
    assert other[1] != first[1]


def test_two_processes_and_two_paces(tmp_path: Path) -> None:
    """GIVEN `hil_sim run` in processes with other hash seeds, one of them paced THEN the logs are the same bytes and
    `flightsw replay` of the second gives them a third time.
    """
    runs = []
    for number, pace in enumerate(([], ["--speed", "60"])):
        folder = tmp_path / str(number)
        command = [sys.executable, "-m", "hil_sim", "run", "two_orbits", "--out", str(folder), *pace]
        for setting in ROUGH:
            command += ["--set", setting]
        environment = {**os.environ, "PYTHONHASHSEED": str(number + 1)}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 0, done.stderr
        runs.append(tuple((folder / name).read_bytes() for name in LOGS))
    assert runs[0] == runs[1]
    assert json.loads((folder / "timing.json").read_text())["pace_missed_ticks"] is not None

    replay = [sys.executable, "-m", "flightsw", "replay", str(folder)]
    done = subprocess.run(replay, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == "1500 ticks replayed: IDENTICAL"
    assert tuple((folder / "replay" / name).read_bytes() for name in LOGS) == runs[0]


@pytest.mark.parametrize("drift_ppm", [-5, 0, 5])
def test_log_time_is_the_scenarios_own(tmp_path: Path, drift_ppm: int) -> None:
    """GIVEN any onboard oscillator THEN the first tick is logged at the scenario's start, the others 100 ms apart."""
    can_log, _ = logs_of(tmp_path / "run", "time.duration_s=10", f"oscillator.drift_ppm={drift_ppm}")
    beats = [line.split()[0] for line in can_log.decode().splitlines() if " 202##1" in line]
    assert beats[0] == "(1546300782.000000)"  # 2019-01-01T00:00:00 GPS is 18 s earlier in UTC
    assert beats[99] == "(1546300791.900000)"
