"""The demo in processes of its own: it starts, its console shows flight, and a death ends it with one line."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from link_bench import split_tlog

pytest.importorskip("can_remote", reason="python-can-remote (extra sim) is not installed")


def children(pid: int) -> dict[str, int]:
    """Child processes by the word after -m."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = path.read_text()
            words = (path.parent / "cmdline").read_bytes().decode().split("\0")
        except OSError:
            continue
        if int(text.rpartition(")")[2].split()[1]) == pid and "-m" in words:
            found[" ".join(words[words.index("-m") + 1 :][:2])] = int(path.parent.name)
    return found


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_the_death_of_flight_ends_the_demo_with_one_line_and_the_log_is_there(tmp_path: Path) -> None:
    """GIVEN a demo at ten times real time WHEN flight is killed without warning THEN the demo ends with one line that
    says so, no process is left, and what flight recorded reaches to within a second of its death."""
    out = tmp_path / "live"
    command = [sys.executable, "-m", "hil_sim", "demo", "--plain", "--speed", "10", "--out", str(out)]
    demo = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert demo.stdout is not None
        shown = ""
        for line in demo.stdout:
            shown += line
            if re.search(r"INTEGRATED", line):
                break
        assert "INTEGRATED" in shown
        parts = children(demo.pid)
        assert {"hil_sim world", "flightsw run", "ground console"} <= set(parts)
        os.kill(parts["flightsw run"], signal.SIGKILL)
        died_s = time.time()
        _, said = demo.communicate(timeout=60)
        assert demo.returncode == 1
        (reason,) = [line for line in said.splitlines() if "has ended" in line]
        assert reason.startswith("demo: flight has ended by SIGKILL")
        assert not [name for name, pid in parts.items() if Path(f"/proc/{pid}/cmdline").exists() and alive(pid)]
    finally:
        demo.kill()
        demo.wait(20)
    written_s = (out / "link.tlog").stat().st_mtime
    print(f"last write {died_s - written_s:.2f} s before the death")
    assert died_s - written_s < 1.0
    records = split_tlog(out / "link.tlog")
    assert len(records) > 100


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_closed_terminal_leaves_no_process(tmp_path: Path) -> None:
    """GIVEN a demo that ignores ctrl-C, as one that a script has put into the background WHEN its terminal is closed
    (SIGHUP) THEN it says so, nothing of it goes on, and flight has ended in order: its timing is written."""
    out = tmp_path / "live"
    command = [sys.executable, "-m", "hil_sim", "demo", "--plain", "--speed", "10", "--out", str(out)]
    command += ["--no-real-time"]
    demo = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_ignore_interrupts
    )
    try:
        assert demo.stdout is not None
        assert any("INTEGRATED" in line for line in demo.stdout)
        parts = children(demo.pid)
        assert {"hil_sim world", "flightsw run", "ground console"} <= set(parts)
        demo.send_signal(signal.SIGHUP)
        _, said = demo.communicate(timeout=60)
        assert demo.returncode == 128 + signal.SIGHUP
        assert json.loads((out / "timing.json").read_text())["scheduling"] == "ordinary"
        assert "demo: ended by SIGHUP" in said.splitlines()
        assert not [name for name, pid in parts.items() if Path(f"/proc/{pid}/cmdline").exists() and alive(pid)]
    finally:
        demo.kill()
        demo.wait(20)


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def alive(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
