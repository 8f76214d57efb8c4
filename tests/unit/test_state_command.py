"""`ground state send` as the operator starts it, a process of its own, against a flight on a real socket."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from harness import Flight, load
from test_console_state import written

from flightsw.icd.enums import Mode
from flightsw.link.access import Refusal
from flightsw.link_open import LinkOptions, open_ground_link
from ground.__main__ import main

SETTINGS = ("flight.table_set=flight", "time.duration_s=3600", "outage=[{start_s=60.0, duration_s=3500.0}]")
PACE_S = 0.01  # of a tick on the wall: ten times real time
PATIENCE_S = 60.0


class Linked(Flight):
    """A flight in an outage that speaks to a UDP peer of this machine, signed."""

    def __init__(self, folder: Path, port: int) -> None:
        self.key = folder / "link.key"
        assert main(["link", "key", str(self.key)]) == 0
        options = LinkOptions((f"udp:127.0.0.1:{port}",), self.key, folder / "state")
        self.opened = open_ground_link(options, time.time_ns())
        super().__init__(load(*SETTINGS), sink=self.opened.port)
        self.loop.anchor(time.time_ns())
        self.loop.listen(self.opened.port, self.opened.access, folder / "state")


@pytest.fixture
def flight(tmp_path: Path, free_port: int) -> Iterator[Linked]:
    with Linked(tmp_path, free_port) as linked:
        yield linked.fly(until_s=360.0)  # type: ignore[misc]
    linked.opened.port.close()


@pytest.fixture
def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def send(flight: Flight, port: int, file: Path, *more: str) -> tuple[int, str]:
    """Exit status and words of the command, flight ticking meanwhile."""
    command = [sys.executable, "-m", "ground", "state", "send", str(file), "--udp", f"127.0.0.1:{port}", *more]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    end_s = time.monotonic() + PATIENCE_S
    while process.poll() is None:
        assert time.monotonic() < end_s, "the command does not end"
        flight.tick()
        time.sleep(PACE_S)
    said, _ = process.communicate()
    return process.returncode, said


@pytest.mark.compiled
def test_a_state_flies_up_and_its_fate_comes_down(flight: Linked, free_port: int, tmp_path: Path) -> None:
    """GIVEN five minutes of outage WHEN the operator sends the true state THEN the command says it was taken and ends
    with 0, the bound has shrunk, and the mode is still AUTONOMOUS; WHEN he sends one 50 km away THEN it is refused by
    name with 1; without the key nothing is obeyed, and the command says that no answer came."""
    bound_m = float(flight.out["bound_m"][0])
    key = ("--key", str(flight.key))
    fits, astray = tmp_path / "fits.opm", tmp_path / "astray.opm"
    written(flight, fits, 0.0)
    written(flight, astray, 5e4)
    code, words = send(flight, free_port, fits, *key)
    assert code == 0, words
    assert "taken" in words
    assert flight.out["bound_m"][0] < bound_m
    assert flight.out["mode"][0] == Mode.AUTONOMOUS
    code, words = send(flight, free_port, astray, *key)
    assert code == 1, words
    assert "GATE" in words
    uplink = flight.loop.ground.uplink  # type: ignore[union-attr]
    assert uplink.refused[Refusal.UNSIGNED] == 0
    code, words = send(flight, free_port, fits)
    assert code == 1, words
    assert "does not answer" in words
    assert uplink.refused[Refusal.UNSIGNED] >= 1
