"""The ends of the link on real sockets and a pseudo-terminal: nothing waits, nothing grows, strangers hear nothing."""

from __future__ import annotations

import os
import pty
import socket
import time
from collections.abc import Callable

import pytest

from flightsw import link_port
from flightsw.link_open import LinkOptions, open_ground_link
from flightsw.link_port import Chunk, LinkPort, SerialLine, Source, TcpListener, UdpListener, UdpPeer

LOCAL = ("127.0.0.1", 0)
PATIENCE_S = 10.0


def eventually(look: Callable[[], object]) -> object:
    """What `look` gives once it gives something; a failure after ten seconds."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        found = look()
        if found:
            return found
        time.sleep(0.001)
    raise AssertionError("nothing came")


def ground_socket(kind: int = socket.SOCK_DGRAM) -> socket.socket:
    made = socket.socket(socket.AF_INET, kind)
    made.bind(LOCAL)
    made.settimeout(PATIENCE_S)
    return made


def test_a_configured_peer_is_heard_and_told_and_a_stranger_is_not_believed() -> None:
    """GIVEN a configured peer WHEN it and a stranger send THEN the peer's source is trusted, the stranger's not, and
    what flight sends arrives at the peer alone."""
    with ground_socket() as peer, ground_socket() as stranger:
        end = UdpPeer(socket.AF_INET, peer.getsockname())
        end.send(b"first")
        data, flight_address = peer.recvfrom(100)
        assert data == b"first"
        peer.sendto(b"hello", flight_address)
        heard = eventually(end.receive)
        assert isinstance(heard, Chunk)
        assert (heard.data, heard.source.trusted) == (b"hello", True)
        stranger.sendto(b"me too", flight_address)
        heard = eventually(end.receive)
        assert isinstance(heard, Chunk)
        assert not heard.source.trusted
        LinkPort([end]).trust(heard.source)
        assert not heard.source.trusted
        end.close()


def test_a_listener_answers_only_who_has_proven_himself() -> None:
    end = UdpListener(socket.AF_INET, LOCAL)
    port = LinkPort([end])
    with ground_socket() as one, ground_socket() as other:
        one.sendto(b"x", end.address)
        heard = eventually(port.receive)
        assert isinstance(heard, Chunk)
        port.send(b"nobody hears this")
        port.trust(heard.source)
        port.send(b"now")
        assert one.recv(100) == b"now"
        other.sendto(b"y", end.address)
        eventually(port.receive)
        port.send(b"again")
        assert one.recv(100) == b"again"
        other.setblocking(False)
        with pytest.raises(BlockingIOError):
            other.recv(100)
    port.close()


def test_the_fifth_peer_takes_the_place_of_the_first() -> None:
    end = UdpListener(socket.AF_INET, LOCAL, True)
    stations = [ground_socket() for _ in range(5)]
    for station in stations:
        station.sendto(b"x", end.address)
        eventually(end.receive)
    assert end.send(b"all") == 0
    for station in stations[1:]:
        assert station.recv(100) == b"all"
    stations[0].setblocking(False)
    with pytest.raises(BlockingIOError):
        stations[0].recv(100)
    for station in stations:
        station.close()
    end.close()


def test_tcp_connections_are_bounded_and_a_slow_one_loses_whole_messages() -> None:
    """GIVEN four connections WHEN a fifth comes THEN it is closed; WHEN one stops reading THEN flight's sending never
    waits, holds at most 8 kB, and what that one gets later is whole messages."""
    end = TcpListener(socket.AF_INET, LOCAL, True)
    clients = []
    for _ in range(5):
        client = ground_socket(socket.SOCK_STREAM)
        client.connect(end.address)
        clients.append(client)
        client.sendall(b"x")
        if len(clients) < 5:
            eventually(end.receive)
    eventually(lambda: turned_away(end, clients[4]))
    message = bytes(range(250))
    lost = 0
    for _ in range(40_000):
        lost += end.send(message)
        assert all(len(source.unsent) <= link_port._UNSENT_MAX for source in end.streams())
        if lost > 100:
            break
    assert lost > 100
    got = bytearray()
    clients[0].setblocking(False)
    quiet = time.monotonic() + 0.5
    while time.monotonic() < quiet:
        end.send(message)
        try:
            got += clients[0].recv(1 << 20)
            quiet = time.monotonic() + 0.2 if len(got) < 4_000_000 else 0.0
        except BlockingIOError:
            break
    whole = len(got) // len(message)
    assert got[: whole * len(message)] == message * whole
    for client in clients:
        client.close()
    eventually(lambda: end.receive() is None and not end.streams())
    end.close()


def turned_away(end: TcpListener, client: socket.socket) -> bool:
    end.receive()
    try:
        return client.recv(1, socket.MSG_DONTWAIT) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


def test_a_serial_line_carries_bytes_both_ways() -> None:
    """GIVEN a pseudo-terminal WHEN bytes of every value go both ways THEN they arrive as they are."""
    master, slave = pty.openpty()
    line = SerialLine(os.ttyname(slave), 57600)
    every = bytes(range(256))
    os.write(master, every)
    got = b""
    while len(got) < 256:
        chunk = eventually(line.receive)
        assert isinstance(chunk, Chunk)
        got += chunk.data
    assert got == every
    assert line.send(every) == 0
    back = b""
    while len(back) < 256:
        back += os.read(master, 256)
    assert back == every
    line.close()
    os.close(master)
    os.close(slave)


def test_listeners_are_on_loopback_unless_told_otherwise() -> None:
    opened = open_ground_link(LinkOptions(("udpin:0", "tcpin:0")), 0)
    for transport in opened.port._transports:
        assert transport.address[0] == "127.0.0.1"  # type: ignore[attr-defined]
    opened.port.close()


def test_ends_take_turns() -> None:
    """GIVEN two ends of which one never falls silent WHEN bytes are taken THEN the other has its turn."""

    class Chatty:
        def __init__(self, data: bytes) -> None:
            self.source, self.data = Source(None, None, False, True), data

        def receive(self) -> Chunk:
            return Chunk(self.source, self.data)

    port = LinkPort([Chatty(b"a"), Chatty(b"b")])  # type: ignore[list-item]
    assert sorted(port.receive().data for _ in range(10)) == [b"a"] * 5 + [b"b"] * 5  # type: ignore[union-attr]
