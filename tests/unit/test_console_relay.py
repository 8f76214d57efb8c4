"""The relay: one feed of flight for several consoles, of which some may answer."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator

import pytest

from flightsw.icd import mavlink
from ground.console.link import Sending, UdpLink
from ground.console.relay import CONSOLES, FORGOTTEN_S, HELLO, ReadOnly, Relay, RelayLink


class Clock:
    """Seconds, moved by hand."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def flight() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.settimeout(2.0)
        yield end


@pytest.fixture
def relay(clock: Clock) -> Iterator[Relay]:
    one = Relay("127.0.0.1", 0, ordering=True, clock=clock)
    one.start()
    yield one
    one.close()


def port_of_flight(relay: Relay) -> tuple[str, int]:
    return relay._flight.getsockname()


def heartbeat() -> bytes:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return bytes(mavlink.MAVLink_heartbeat_message(18, 0, 0, 0, 4, 3).pack(sender))


def until(done: Callable[[], bool], limit_s: float = 5.0) -> bool:
    """Whether it came true in time."""
    end_s = time.monotonic() + limit_s
    while time.monotonic() < end_s:
        if done():
            return True
        time.sleep(0.01)
    return False


def hears(link: UdpLink | ReadOnly, flight: socket.socket, relay: Relay) -> bool:
    def once() -> bool:
        heard = link.receive()
        flight.sendto(heartbeat(), port_of_flight(relay))
        return bool(heard)

    return until(once)


def test_every_console_hears_flight_and_one_that_may_order_is_heard(
    relay: Relay, flight: socket.socket, clock: Clock
) -> None:
    """GIVEN a console that may order and one that reads WHEN flight speaks THEN both hear it; AND only the first has a
    way back, by which flight gets what it sends, unchanged."""
    assert relay.ordering is not None
    ordering, reading = RelayLink(relay.ordering, clock), RelayLink(relay.reading, clock)
    try:
        assert hears(ordering, flight, relay)
        assert hears(reading, flight, relay)
        assert isinstance(ordering, Sending)
        assert not isinstance(ReadOnly(reading), Sending)
        ordering.send(b"an order")
        assert flight.recvfrom(100)[0] == b"an order"
    finally:
        ordering.close()
        reading.close()


def test_what_readers_send_goes_nowhere(relay: Relay, flight: socket.socket, clock: Clock) -> None:
    """GIVEN a session that only reads WHEN it sends all the same, or someone sends to the other port without a hello
    THEN flight gets nothing and it is counted."""
    reading = RelayLink(relay.reading, clock)
    assert relay.ordering is not None
    try:
        assert hears(reading, flight, relay)
        reading.send(b"forbidden")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(b"forbidden", ("127.0.0.1", relay.ordering))
            assert until(lambda: relay.refused == 2)
        flight.settimeout(0.2)
        with pytest.raises(TimeoutError):
            flight.recvfrom(100)
    finally:
        reading.close()


def test_a_console_that_has_gone_makes_room(relay: Relay, clock: Clock) -> None:
    """GIVEN as many consoles as there is room for WHEN one more says hello THEN it waits until the others are
    forgotten."""
    ends = []
    try:
        for _ in range(CONSOLES + 1):
            end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            ends.append(end)
            end.sendto(HELLO, ("127.0.0.1", relay.reading))
            count = min(len(ends), CONSOLES)
            assert until(lambda count=count: len(relay._consoles) == count)
        late = (0, ("127.0.0.1", ends[-1].getsockname()[1]))
        assert late not in relay._consoles
        clock.now_s += FORGOTTEN_S + 1.0
        ends[-1].sendto(HELLO, ("127.0.0.1", relay.reading))
        assert until(lambda: set(relay._consoles) == {late})
    finally:
        for end in ends:
            end.close()


def test_without_ordering_there_is_no_such_port(clock: Clock) -> None:
    relay = Relay("127.0.0.1", 0, ordering=False, clock=clock)
    try:
        assert relay.ordering is None
    finally:
        relay.close()
