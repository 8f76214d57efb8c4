"""Flight's ends of the ground link: UDP, TCP and serial lines behind one port. Nothing here waits or grows.

A source is where bytes came from: a datagram is whole by itself, a stream keeps the unfinished end of a frame. Messages
go to every peer, so that one sequence of numbers serves all and nobody counts a loss that was none. A peer is one that
was configured, or that has sent something authenticated; others hear nothing.
"""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from typing import Any, NamedTuple, Protocol

from flightsw.link.mavlink_out import Sink

DATAGRAM = 2048
_PEERS_MAX = 4
_UNSENT_MAX = 8192  # bytes that a stream's socket did not take; what does not fit is lost as a whole message


class Source:
    """Where bytes came from. `rest`: unfinished end of a stream, None for datagrams. `trusted`: replies go there."""

    __slots__ = ("address", "idle", "owner", "rest", "trusted", "unsent")

    def __init__(self, owner: Transport | None, address: Any, stream: bool, trusted: bool) -> None:
        self.owner = owner
        self.address = address
        self.rest: bytes | None = b"" if stream else None
        self.idle = 0
        self.trusted = trusted
        self.unsent = b""


class Chunk(NamedTuple):
    """Bytes of one source."""

    source: Source
    data: bytes


class Transport(Protocol):
    """One socket or line."""

    def receive(self) -> Chunk | None:
        """What has arrived, one datagram or piece, or None; never waits."""
        ...

    def send(self, message: bytes | bytearray) -> int:
        """Offer a message to every trusted peer; how many did not take it."""
        ...

    def trust(self, source: Source) -> None:
        """This source has proven who it is."""
        ...

    def streams(self) -> list[Source]:
        """Sources that keep an unfinished end."""
        ...

    def close(self) -> None:
        """Give the socket back."""
        ...


class UdpPeer:
    """Datagrams to and from one configured peer. family, address: as `socket.getaddrinfo` gives them."""

    def __init__(self, family: int, address: tuple[Any, ...]) -> None:
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._source = Source(self, address, False, True)

    def receive(self) -> Chunk | None:
        try:
            data, address = self._socket.recvfrom(DATAGRAM)
        except OSError:  # nothing there, or the ICMP error of an earlier datagram
            return None
        if address[:2] != self._source.address[:2]:
            return Chunk(_STRANGER, data)
        return Chunk(self._source, data)

    def send(self, message: bytes | bytearray) -> int:
        try:
            self._socket.sendto(message, self._source.address)
        except OSError:
            return 1
        return 0

    def trust(self, source: Source) -> None:
        """The peer is the configured one."""

    def streams(self) -> list[Source]:
        return []

    def close(self) -> None:
        self._socket.close()


_STRANGER = Source(None, None, False, False)


class UdpListener:
    """Datagrams from anywhere; answers go to at most four addresses that have proven themselves."""

    def __init__(self, family: int, address: tuple[Any, ...], open_to_all: bool = False) -> None:
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(address)
        self.address = self._socket.getsockname()
        self._open = open_to_all
        self._peers: list[Source] = []

    def receive(self) -> Chunk | None:
        try:
            data, address = self._socket.recvfrom(DATAGRAM)
        except OSError:
            return None
        for peer in self._peers:
            if peer.address == address:
                return Chunk(peer, data)
        source = Source(self, address, False, False)
        if self._open:
            self.trust(source)
        return Chunk(source, data)

    def send(self, message: bytes | bytearray) -> int:
        lost = 0
        for peer in self._peers:
            try:
                self._socket.sendto(message, peer.address)
            except OSError:
                lost += 1
        return lost

    def trust(self, source: Source) -> None:
        """Answers go there from now on; the peer longest known gives way."""
        if source.trusted:
            return
        source.trusted = True
        if len(self._peers) == _PEERS_MAX:
            self._peers.pop(0).trusted = False
        self._peers.append(source)

    def streams(self) -> list[Source]:
        return []

    def close(self) -> None:
        self._socket.close()


class _Stream:
    """One connection or line: pieces in, whole messages out, a bounded remainder where the other end is slow."""

    def __init__(self, owner: Transport, fd: int, trusted: bool) -> None:
        self.fd = fd
        self.source = Source(owner, fd, True, trusted)

    def read(self) -> bytes | None:
        """Bytes, empty where the other end has gone, None where nothing waits."""
        try:
            return os.read(self.fd, DATAGRAM)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:
            return b""

    def write(self, message: bytes | bytearray) -> bool:
        source = self.source
        if len(source.unsent) + len(message) > _UNSENT_MAX:
            self._push()
            if len(source.unsent) + len(message) > _UNSENT_MAX:
                return False
        source.unsent += message
        self._push()
        return True

    def _push(self) -> None:
        with suppress(OSError):
            self.source.unsent = self.source.unsent[os.write(self.fd, self.source.unsent) :]


class TcpListener:
    """At most four connections at a time; a fifth is closed."""

    def __init__(self, family: int, address: tuple[Any, ...], open_to_all: bool = False) -> None:
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.setblocking(False)
        self._socket.bind(address)
        self._socket.listen(_PEERS_MAX)
        self.address = self._socket.getsockname()
        self._open = open_to_all
        self._connections: list[tuple[socket.socket, _Stream]] = []
        self._next = 0

    def _accept(self) -> None:
        try:
            connection, _ = self._socket.accept()
        except OSError:
            return
        if len(self._connections) == _PEERS_MAX:
            connection.close()
            return
        connection.setblocking(False)
        with suppress(OSError):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connections.append((connection, _Stream(self, connection.fileno(), self._open)))

    def receive(self) -> Chunk | None:
        self._accept()
        for _ in range(len(self._connections)):
            self._next = (self._next + 1) % len(self._connections)
            connection, stream = self._connections[self._next]
            data = stream.read()
            if data:
                return Chunk(stream.source, data)
            if data == b"":
                connection.close()
                del self._connections[self._next]
                if not self._connections:
                    break
        return None

    def send(self, message: bytes | bytearray) -> int:
        lost = 0
        for _, stream in self._connections:
            if stream.source.trusted and not stream.write(message):
                lost += 1
        return lost

    def trust(self, source: Source) -> None:
        source.trusted = True

    def streams(self) -> list[Source]:
        return [stream.source for _, stream in self._connections]

    def close(self) -> None:
        for connection, _ in self._connections:
            connection.close()
        self._connections.clear()
        self._socket.close()


class SerialLine:
    """A serial line, raw, 8N1; what is at its other end is configured, so it is a peer."""

    def __init__(self, device: str, baud: int) -> None:
        import termios
        import tty

        self._fd = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            speed = getattr(termios, f"B{baud}")
            tty.setraw(self._fd)
            attributes = termios.tcgetattr(self._fd)
            attributes[4] = attributes[5] = speed
            termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
        except (AttributeError, termios.error) as error:
            os.close(self._fd)
            raise OSError(0, f"no serial line of {baud} baud: {error}") from None
        self._stream = _Stream(self, self._fd, True)

    def receive(self) -> Chunk | None:
        data = self._stream.read()
        return Chunk(self._stream.source, data) if data else None

    def send(self, message: bytes | bytearray) -> int:
        return 0 if self._stream.write(message) else 1

    def trust(self, source: Source) -> None:
        """The line is configured."""

    def streams(self) -> list[Source]:
        return [self._stream.source]

    def close(self) -> None:
        with suppress(OSError):
            os.close(self._fd)


class LinkPort(Sink):
    """All ends of the link as one. `lost`: messages that a peer did not take."""

    def __init__(self, transports: list[Transport]) -> None:
        self._transports = transports
        self._turn = 0
        self.lost = 0

    def receive(self) -> Chunk | None:
        """The next bytes of any source, in turn; None where nothing waits. Never waits."""
        for _ in range(len(self._transports)):
            self._turn = (self._turn + 1) % len(self._transports)
            chunk = self._transports[self._turn].receive()
            if chunk is not None:
                return chunk
        return None

    def send(self, message: bytes | bytearray) -> None:
        """Offer a message to all peers."""
        for transport in self._transports:
            self.lost += transport.send(message)

    def trust(self, source: Source) -> None:
        """This source has proven who it is: it is answered from now on."""
        if not source.trusted and source.owner is not None:
            source.owner.trust(source)

    def streams(self) -> list[Source]:
        """Sources that keep an unfinished end of a frame."""
        return [source for transport in self._transports for source in transport.streams()]

    def close(self) -> None:
        """Close every end."""
        for transport in self._transports:
            transport.close()
