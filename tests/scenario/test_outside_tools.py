"""What a run leaves is read by tools not ours: cantools and mavlogdump, with what `ground icd export` gives."""

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pymavlink
import pytest
from harness import Flight, fault, faults, load, read_tlog

from flightsw.icd.can_frames import LAYOUTS
from ground.__main__ import main as ground

BIN = Path(sys.executable).parent

# what a run without tables of functions has none of; tests/property/test_can_codec.py holds their layouts to cantools
OF_FUNCTIONS = {
    *("GNSS_EPOCH", "GNSS_RANGES", "GNSS_EPHEMERIS", "GNSS_CHECK", "GNSS_USED", "GNSS_EXCLUDED"),
    *("CROSSLINK_EPHEMERIS", "CROSSLINK_RANGES", "CROSSLINK_STATUS"),
}


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    settings = (
        "time.duration_s=90",
        "outage=[{start_s=40.0, duration_s=20.0}]",
        "flight.table.limit_m=8",
        "flight.table.clear_limit_m=7.9",
        "attitude.sigma_rad=0.001",
        "burn=[{start_s=80.0, duration_s=5.0, dv_mps=[0.0, 0.1, 0.0], sigma_mps=[0.0, 0.002, 0.0]}]",
        'command=[{at_s=30.0, command="edit", target="velocity", value="auto"}]',
        faults(fault("position_step", 70, 3, value=900.0), fault("nan", 75, 2)),
    )
    with Flight(load(*settings), folder) as flight:
        flight.fly()
    return folder


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("icd")
    assert ground(["icd", "export", str(folder)]) == 0
    return folder


def test_cantools_decodes_every_frame_of_flight_and_world(run_dir: Path, exported: Path) -> None:
    """GIVEN can.log of a run without functions beside navigation WHEN cantools reads it with the exported DBC
    THEN every line is decoded, all kinds of frame but those of such functions are there, the numbers are flight's.
    """
    text = (run_dir / "can.log").read_text()
    done = subprocess.run(
        [sys.executable, "-m", "cantools", "decode", "--single-line", str(exported / "sensor_bus.dbc")],
        input=text,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if line.strip()]
    assert len(lines) == len(text.splitlines())
    decoded = Counter(match[1] for line in lines if (match := re.search(r":: (\w+)\(", line)))
    names = {layout.frame_id: layout.name for layout in LAYOUTS.values()}
    logged = Counter(names[int(line.split()[2][:3], 16)] for line in text.splitlines())
    assert decoded == logged
    assert set(decoded) == set(names.values()) - OF_FUNCTIONS
    assert decoded["FLIGHT_HEARTBEAT"] == 900
    beats = [int(match[1]) for line in lines if (match := re.search(r"FLIGHT_HEARTBEAT\(tick: (\d+)", line))]
    assert beats == list(range(900))


def test_mavlogdump_reads_link_tlog_once_the_dialect_is_installed(
    run_dir: Path, exported: Path, tmp_path: Path
) -> None:
    """GIVEN a pymavlink of its own into which the exported dialect is copied, as `ground icd export` says WHEN
    mavlogdump reads link.tlog THEN it shows every message, by name, and no bad data.
    """
    private = tmp_path / "site"
    shutil.copytree(
        Path(pymavlink.__file__).parent, private / "pymavlink", ignore=shutil.ignore_patterns("__pycache__")
    )
    for name in ("leonav.py", "leonav.xml"):
        shutil.copy(exported / name, private / "pymavlink" / "dialects" / "v20")
    environment = {**os.environ, "PYTHONPATH": str(private), "MAVLINK20": "1"}
    script = shutil.which("mavlogdump.py", path=str(BIN))
    assert script is not None, "pymavlink ships mavlogdump.py"
    done = subprocess.run(
        [sys.executable, script, "--dialect", "leonav", "--show-source", str(run_dir / "link.tlog")],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    shown = Counter(
        match[1] for line in done.stdout.splitlines() if (match := re.search(r": ([A-Z][A-Z0-9_]+) ", line))
    )
    ours = Counter(message.get_type() for _, message in read_tlog(run_dir / "link.tlog"))
    assert shown == ours
    assert {"HEARTBEAT", "LEONAV_NAV_STATE", "LEONAV_INTEGRITY", "LEONAV_ALERT", "LEONAV_COUNTERS"} <= set(shown)
    assert "BAD_DATA" not in done.stdout
