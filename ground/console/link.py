"""From datagrams to MAVLink messages, each with the time it was heard.

Frames are cut out by their own length field and decoded one by one, so nothing left over from one datagram
can swallow the start of the next, and a damaged frame costs only itself.
"""

from __future__ import annotations

import errno
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, runtime_checkable

from flightsw.icd import mavlink
from ground.console.authentication import Verifier
from ground.errors import OperatorError

FLIGHT_SYSTEM = 1
MAGIC = 0xFD  # MAVLink 2; flight sends nothing else
HEADER, CHECKSUM, SIGNATURE = 10, 2, 13
SIGNED = 0x01
MAX_DATAGRAM = 65_535
RECEIVE_BUFFER = 4 << 20
DATAGRAMS_PER_CALL = 500


class Received(NamedTuple):
    """A message and the link's time [Unix s] at which it was heard."""

    time_s: float
    message: Any


@dataclass
class Statistics:
    """What the link itself saw. `lost` counts gaps in the sender's sequence numbers."""

    frames: int = 0
    damaged: int = 0
    unknown: int = 0
    lost: int = 0
    unauthenticated: int = 0  # not signed with our key, or heard before: not believed
    unverified: int = 0  # signed, and believed without a key to verify it with
    last_sequence: dict[tuple[int, int], int] = field(default_factory=dict)


class Link(Protocol):
    """Where messages come from; the view knows no more than this."""

    name: str
    live: bool
    statistics: Statistics

    def now_s(self) -> float:
        """The link's time, Unix seconds."""

    def receive(self) -> list[Received]:
        """Messages that have arrived by now, never blocking, bounded in number."""

    def pause(self, paused: bool) -> None:
        """Stop or resume the link's time; only a replay can."""

    def finished(self) -> bool:
        """True when nothing will ever come again (end of a log)."""

    def close(self) -> None:
        """Give back the socket or file."""


@runtime_checkable
class Sending(Protocol):
    """A link that flight can be answered on."""

    verifier: Verifier | None

    def send(self, frame: bytes) -> None:
        """Offer a frame to flight."""


class FrameDecoder:
    """Frames to messages, with the statistics of what could not be used. Keeps no bytes between calls."""

    def __init__(self, verifier: Verifier | None = None) -> None:
        self.statistics = Statistics()
        self._verifier = verifier
        self.forged = False  # something was heard that could not be authenticated
        # pymavlink keeps state in the parser; only its `decode` of one whole frame is used here.
        self._mavlink = mavlink.MAVLink(None)

    def datagram(self, data: bytes) -> Iterator[Any]:
        """Messages in one datagram; whatever is not a frame is skipped and counted once per stretch."""
        at = 0
        while at < len(data):
            length = frame_length(data, at)
            if not length:
                self.statistics.damaged += 1
            message = self.frame(data[at : at + length]) if length else None
            if message is not None:
                yield message
            end = at + length
            # The length of a frame that was not verified is believed only where it leads to another.
            if message is not None or (length and (end == len(data) or data[end] == MAGIC)):
                at = end
                continue
            found = data.find(MAGIC, at + 1)
            at = len(data) if found < 0 else found

    def frame(self, frame: bytes) -> Any | None:
        """The message of one whole frame, or None when it is damaged or of a kind not in the dialect."""
        try:
            message = self._mavlink.decode(bytearray(frame))
        except (mavlink.MAVError, struct.error, ValueError, IndexError, TypeError, KeyError):
            self.statistics.damaged += 1
            return None
        if isinstance(message, mavlink.MAVLink_unknown):
            # Its checksum cannot be verified without the dialect, so nothing of it is believed.
            self.statistics.unknown += 1
            return None
        if self._verifier is not None and not self._verifier.accept(frame):
            self.statistics.unauthenticated += 1
            self.forged = True
            return None
        if self._verifier is None and frame[2] & SIGNED:
            self.statistics.unverified += 1
        self._follow_sequence(message)
        self.statistics.frames += 1
        return message

    def _follow_sequence(self, message: Any) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        last = self.statistics.last_sequence.get(sender)
        if last is not None:
            missing = (message.get_seq() - last - 1) % 256
            self.statistics.lost += missing if missing < 128 else 0
        self.statistics.last_sequence[sender] = message.get_seq()


def frame_length(data: bytes, at: int) -> int:
    """Length of the MAVLink 2 frame that starts at `at`, 0 when none starts there or it is cut off."""
    if len(data) - at < HEADER + CHECKSUM or data[at] != MAGIC:
        return 0
    length = HEADER + data[at + 1] + CHECKSUM + (SIGNATURE if data[at + 2] & SIGNED else 0)
    return length if at + length <= len(data) else 0


class UdpLink:
    """Listens for flight's datagrams. `clock` gives Unix seconds that never step back."""

    live = True

    def __init__(self, host: str, port: int, clock: Callable[[], float], verifier: Verifier | None = None) -> None:
        self._clock = clock
        self.verifier = verifier
        self.forged_s: float | None = None  # when something was heard last that could not be authenticated
        self.unverified_s: float | None = None  # when a signature was heard last that there is no key for
        self._peer: Any = None  # who speaks for flight: answers go there
        self._decoder = FrameDecoder(verifier)
        self.statistics = self._decoder.statistics
        try:
            self._socket = listen(host, port)
        except OSError as error:
            busy = error.errno == errno.EADDRINUSE
            remedy = "another console runs there? " if busy else ""
            raise OperatorError(
                f"--udp {host}:{port}: cannot listen ({error.strerror or error}); "
                f"{remedy}give another address with --udp HOST:PORT"
            ) from None
        self.port: int = self._socket.getsockname()[1]
        self.name = f"udp {host}:{self.port}"

    def now_s(self) -> float:
        """The receive clock."""
        return self._clock()

    def receive(self) -> list[Received]:
        """Messages of at most DATAGRAMS_PER_CALL datagrams."""
        heard: list[Received] = []
        for _ in range(DATAGRAMS_PER_CALL):
            try:
                data, address = self._socket.recvfrom(MAX_DATAGRAM)
            except BlockingIOError:
                break
            except OSError:  # an ICMP error of an earlier datagram; the socket itself stays good
                continue
            now_s, unverified = self._clock(), self.statistics.unverified
            messages = list(self._decoder.datagram(data))
            if self.statistics.unverified != unverified:
                self.unverified_s = now_s
            if self._decoder.forged:
                self._decoder.forged, self.forged_s = False, now_s
            heard += [Received(now_s, message) for message in messages]
            if any(message.get_srcSystem() == FLIGHT_SYSTEM for message in messages):
                self._peer = address
        return heard

    def send(self, frame: bytes) -> None:
        """Offer a frame to where flight was last heard from; lost where nothing was heard yet."""
        if self._peer is not None:
            with suppress(OSError):
                self._socket.sendto(frame, self._peer)

    def pause(self, paused: bool) -> None:
        """A live link cannot be stopped: messages go on being heard."""

    def finished(self) -> bool:
        """Never: flight may speak again."""
        return False

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def listen(host: str, port: int) -> socket.socket:
    """A UDP socket that never blocks, with room for a burst."""
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    listener = socket.socket(family, socket.SOCK_DGRAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        listener.setblocking(False)
        listener.bind(address)
    except OSError:
        listener.close()
        raise
    return listener
