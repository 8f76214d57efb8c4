"""A bus that dies and a disk that is full: counted, told, worked around, and never an exception in a tick."""

import errno
import os
from pathlib import Path

import can
import numpy as np
import pytest
from harness import Flight, Telemetry, load, read_tlog

from flightsw import onboard
from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import Mode

ERRORS = [OSError("device gone"), can.CanOperationError("bus off"), can.CanInitializationError("no"), BrokenPipeError()]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("place", ["receive", "send 0", "send 1", "send 2"])
def test_a_failed_bus_is_reopened_in_the_slack(error: Exception, place: str) -> None:
    """GIVEN a bus that fails once, while receiving or at any of the three frames of a tick THEN it is counted, put away
    and opened again in the slack of that tick, and flight goes on with the next tick.
    """
    with Flight(load("time.duration_s=40")) as flight:
        flight.fly(20.0)
        if place == "receive":
            flight.bus.fail_receiving(error)
        else:
            flight.bus.fail_sending(error, after=int(place[-1]))
        flight.tick()
        assert flight.loop.port.reconnects == 1
        assert flight.bus.shutdowns == 1
        assert not flight.loop.port.is_off
        flight.fly()
    assert flight.counts["BUS_ERROR"] == 1
    assert flight.flown["mode"][-1] == Mode.INTEGRATED
    assert flight.flown["fix_age_s"][-1] < 1.3


def test_autonomous_while_the_bus_is_off_and_told_on_the_link() -> None:
    """GIVEN a bus that stays off for 20 s THEN flight coasts: AUTONOMOUS 3 s after the last fix, error within bounds,
    BUS_OFF raised at once and over when the bus is back, all of it on the MAVLink link; then fixes are used again.
    """
    sink = Telemetry()
    with Flight(load("time.duration_s=70"), sink=sink) as flight:
        flight.fly(30.0)
        flight.bus.fail_receiving(OSError("gone"))
        flight.bus.stays_down = True
        for _ in range(200):
            flight.tick()
        assert flight.loop.port.is_off
        while flight.pair.flight.recv(0.0) is not None:  # what a real bus would have lost
            pass
        flight.bus.stays_down = False
        flight.fly()
    off = slice(300, 500)
    assert (flight.flown["mode"][335:500] == Mode.AUTONOMOUS).all()
    assert (flight.error_m()[off] <= flight.flown["bound_m"][off]).all()
    assert [tick for tick, frame_id, _ in flight.published if frame_id == 0x202 and 300 <= tick < 500] == []
    assert flight.loop.port.reconnects == 1
    assert flight.counts["BUS_ERROR"] == 1
    told = [(m.active, m.t_gps_ns) for m in sink.of("LEONAV_ALERT") if m.alert_id == AlertId.BUS_OFF]
    assert [active for active, _ in told] == [1, 0]
    since_s = [(t - flight.world.t_start_gps_ns) / 1e9 for _, t in told]
    assert since_s == [pytest.approx(30.0, abs=0.01), pytest.approx(50.0, abs=0.11)]
    states = [m.t_gps_ns for m in sink.of("LEONAV_NAV_STATE") if m.t_gps_ns]
    assert np.diff(states).max() < 0.6e9
    assert flight.flown["mode"][-1] == Mode.INTEGRATED


def test_a_bus_that_fails_in_every_tick_stops_nothing() -> None:
    """GIVEN a bus that opens and fails again in each tick THEN each failure is counted and no tick is missed."""
    with Flight(load("time.duration_s=30")) as flight:
        flight.fly(10.0)
        for _ in range(100):
            flight.bus.fail_receiving(can.CanOperationError("again"))
            flight.tick()
        flight.fly()
    assert flight.loop.port.errors == 100
    assert flight.loop.port.reconnects == 100
    assert flight.loop.tick == 300
    assert flight.flown["mode"][-1] == Mode.INTEGRATED


class Disk:
    """Stands for os.write: `room` bytes, then no space left, until `room` is set again."""

    def __init__(self, room: int) -> None:
        self.room = room
        self.refused = 0
        self._write = os.write

    def write(self, fd: int, data: bytes) -> int:
        if self.room <= 0:
            self.refused += 1
            raise OSError(errno.ENOSPC, "No space left on device")
        taken = self._write(fd, data[: self.room])
        self.room -= taken
        return taken


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    disk = Disk(10**9)
    monkeypatch.setattr("flightsw.rotating_file.os.write", disk.write)
    return disk


def test_a_full_disk_stops_neither_flight_nor_what_is_told(tmp_path: Path, disk: Disk) -> None:
    """GIVEN a disk that is full from 10 s on THEN flight goes on, the rings drop their oldest entries, the ground is
    told how many by LEONAV_COUNTERS; closing the journal ends.
    """
    sink = Telemetry()
    with Flight(load("time.duration_s=300"), tmp_path, sink=sink) as flight:
        flight.fly(10.0)
        disk.room = 777  # the last write is cut in the middle of a line
        flight.fly()
    assert disk.refused > 1000
    assert flight.flown["mode"][-1] == Mode.INTEGRATED
    assert flight.journal.dropped > 1000
    told = [m.journal_dropped for m in sink.of("LEONAV_COUNTERS")]
    assert told[0] == 0
    assert told[-1] > 1000
    lines = (tmp_path / "can.log").read_text().splitlines()
    assert all(line.endswith((" R", " T")) for line in lines[:-1])


def test_a_disk_that_has_room_again_loses_nothing_that_still_waited(tmp_path: Path, disk: Disk) -> None:
    """GIVEN a disk full for 30 s THEN the logs hold every frame and message in the end: the rings last that long."""
    with Flight(load("time.duration_s=80"), tmp_path) as flight:
        flight.fly(20.0)
        disk.room = 0
        flight.fly(50.0)
        disk.room = 10**9
        flight.fly()
    assert disk.refused > 100
    assert flight.journal.dropped == 0
    lines = (tmp_path / "can.log").read_text().splitlines()
    assert sum(line.endswith(" T") for line in lines) == 3 * 800 + 80  # three frames a tick, and one a second
    assert sum(line.endswith(" R") for line in lines) == flight.loop.receiver.received
    assert len(read_tlog(tmp_path / "link.tlog")) == flight.loop.link.messages


@pytest.mark.parametrize(
    "text",
    [
        "udp",
        "tcp:127.0.0.1:5",
        "udp:127.0.0.1",
        "udp::14550",
        "udp:h:0",
        "udp:h:65536",
        "udp:h:x",
        "udp:no such host:5",
    ],
)
def test_a_link_that_cannot_be_is_refused_before_flight(text: str) -> None:
    with pytest.raises(onboard.Refused, match="--link"):
        onboard.open_link(text)


def test_a_link_that_takes_nothing_never_stops_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a socket that refuses every datagram THEN each is counted as lost and flight goes on."""
    sink = onboard.open_link("udp:127.0.0.1:9")

    class Refusing:
        def sendto(self, *_: object) -> int:
            raise ConnectionRefusedError

    sink.close()
    monkeypatch.setattr(sink, "_socket", Refusing())
    with Flight(load("time.duration_s=10"), sink=sink) as flight:
        flight.fly()
    assert flight.loop.tick == 100
    assert sink.lost == flight.loop.link.messages  # type: ignore[attr-defined]


def test_datagrams_hold_one_whole_message_each() -> None:
    """GIVEN a listener THEN every datagram is one MAVLink message, and all of them arrive."""
    import socket

    from flightsw.icd import mavlink

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        listener.setblocking(False)
        sink = onboard.open_link(f"udp:127.0.0.1:{listener.getsockname()[1]}")
        with Flight(load("time.duration_s=10"), sink=sink) as flight:
            flight.fly()
        sink.close()
        parser = mavlink.MAVLink(None)
        heard = []
        for _ in range(flight.loop.link.messages):
            heard.append(parser.parse_char(listener.recv(4096)))
    assert [m.get_header().seq for m in heard] == [n % 256 for n in range(len(heard))]
