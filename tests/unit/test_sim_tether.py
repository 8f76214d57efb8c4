"""A child that is tied to its parent ends with it, also when the parent is killed."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PARENT = """
import signal, subprocess, sys
from hil_sim.tether import tethered
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"], start_new_session=True,
                         preexec_fn=tethered(signal.SIGKILL) if sys.argv[1] == "tied" else None)
print(child.pid, flush=True)
child.wait()
"""


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the tie is Linux's")
@pytest.mark.parametrize("how", ["tied", "loose"])
def test_a_killed_parent_leaves_no_child_that_is_tied_to_it(how: str) -> None:
    """GIVEN a child in a session of its own WHEN its parent is killed THEN it ends too; without the tie it stays."""
    parent = subprocess.Popen([sys.executable, "-c", PARENT, how], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    assert runs(child)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    end = time.monotonic() + (10.0 if how == "tied" else 0.3)
    while time.monotonic() < end and runs(child):
        time.sleep(0.02)
    assert runs(child) is (how == "loose")
    if how == "loose":
        subprocess.run(["kill", str(child)], check=True)


def test_a_flight_that_is_started_again_keeps_the_logs_of_before() -> None:
    from hil_sim.demo import with_logs_in

    words = ["flightsw", "run", "--tables", "t", "--out", "runs/live", "--link", "udp:h:1"]
    assert with_logs_in(words, Path("r")) == ["flightsw", "run", "--tables", "t", "--out", "r", "--link", "udp:h:1"]
    assert words[5] == "runs/live"
