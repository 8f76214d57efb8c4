"""A bus hub that dies or is stopped: the port says BUS_OFF, never waits, and comes back with the hub."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

pytest.importorskip("can_remote", reason="python-can-remote (extra sim) is not installed")

from flightsw.can_port import CanPort
from flightsw.onboard import Refused, open_port

LONGEST_S = 0.09  # a tick is 0.1 s; a healthy hub takes two milliseconds


def start_hub(port: int = 0) -> tuple[subprocess.Popen[str], int]:
    process = subprocess.Popen(
        [sys.executable, "-m", "hil_sim", "hub", "--port", str(port)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    return process, int(process.stdout.readline().split()[-1])


@pytest.fixture
def hub() -> Iterator[tuple[subprocess.Popen[str], int]]:
    process, port = start_hub()
    yield process, port
    process.send_signal(signal.SIGCONT)
    process.kill()
    process.wait(10)


class Ticks:
    """What a tick asks of the port, over and over; the longest that one took, attempts to reopen included."""

    def __init__(self, port: CanPort) -> None:
        self.port = port
        self.longest_s = 0.0
        self.received = 0

    def until(self, off: bool, patience_s: float = 20.0) -> float:
        """Tick until the bus is off, or on again; seconds it took."""
        began = time.monotonic()
        while self.port.is_off is not off:
            assert time.monotonic() - began < patience_s
            self.tick()
        return time.monotonic() - began

    def tick(self) -> None:
        start = time.monotonic()
        while self.port.receive() is not None:
            self.received += 1
        for frame_id in (0x200, 0x201, 0x202):
            self.port.send(frame_id, bytearray(64), 0.0)
        self.port.reopen()
        took = time.monotonic() - start
        self.longest_s = max(self.longest_s, took)
        time.sleep(max(0.0, 0.05 - took))


def test_frames_go_through_the_hub_as_they_are(hub: tuple[subprocess.Popen[str], int]) -> None:
    one, other = open_port(f"remote:127.0.0.1:{hub[1]}"), open_port(f"remote:127.0.0.1:{hub[1]}")
    payload = bytearray(range(64))
    one.send(0x123, payload, 0.0)
    end = time.monotonic() + 10.0
    message = None
    while message is None and time.monotonic() < end:
        message = other.receive()
    assert message is not None
    assert (message.arbitration_id, message.data, message.is_fd) == (0x123, payload, True)
    one.close()
    other.close()


@pytest.mark.parametrize("how", ["killed", "stopped"])
def test_a_hub_that_fails_is_bus_off_and_blocks_no_tick(hub: tuple[subprocess.Popen[str], int], how: str) -> None:
    """GIVEN a port on a hub WHEN the hub is killed, or stopped without dying THEN within 3 s the bus is off, no tick is
    held up by a tenth of a second; WHEN the hub is back THEN the port reconnects and counts it."""
    process, number = hub
    ticks = Ticks(open_port(f"remote:127.0.0.1:{number}"))
    for _ in range(20):
        ticks.tick()
    assert not ticks.port.is_off
    process.send_signal(signal.SIGKILL if how == "killed" else signal.SIGSTOP)
    took_s = ticks.until(off=True)
    for _ in range(40):
        ticks.tick()
    assert ticks.port.is_off
    again = None
    if how == "killed":
        process.wait(10)
        again, _ = start_hub(number)
    else:
        process.send_signal(signal.SIGCONT)
    back_s = ticks.until(off=False)
    print(
        f"hub {how}: off after {took_s:.2f} s, back after {back_s:.2f} s, longest tick {ticks.longest_s * 1e3:.0f} ms"
    )
    assert took_s < 3.0
    assert ticks.longest_s < LONGEST_S
    assert ticks.port.errors >= 1
    assert ticks.port.reconnects == 1
    ticks.port.close()
    if again is not None:
        again.kill()
        again.wait(10)


def test_no_hub_at_the_start_is_refused_in_words() -> None:
    with pytest.raises(Refused, match="no hub answers"):
        open_port("remote:127.0.0.1:9")
