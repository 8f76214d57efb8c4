"""Where MAVLink messages go: packed, numbered, noted in the journal, offered to the socket. Never waits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from flightsw.icd import mavlink
from flightsw.journal import Journal

SYSTEM_ID = 1


class Sink(Protocol):
    """Takes whole messages; must return at once, lost or not."""

    def send(self, message: bytes | bytearray) -> None: ...

    def close(self) -> None: ...


class Nowhere:
    """The sink of a flight without a link: the journal still has every message."""

    __slots__ = ()

    def send(self, message: bytes | bytearray) -> None:
        """Drop the message."""

    def close(self) -> None:
        """Nothing to close."""


class MavlinkOut:
    """Flight's transmitter. `mav` packs; writing through it steps the sequence number."""

    __slots__ = ("_journal", "_sink", "_unix_ns", "mav", "messages")

    def __init__(self, sink: Sink, journal: Journal, unix_ns: Callable[[], int]) -> None:
        self._sink = sink
        self._journal = journal
        self._unix_ns = unix_ns
        self.messages = 0
        self.mav = mavlink.MAVLink(
            self, srcSystem=SYSTEM_ID, srcComponent=mavlink.MAV_COMP_ID_AUTOPILOT1, use_native=False
        )

    def sign(self, key: bytes | None, stamp: int) -> None:
        """Sign what is sent from now on with this key and stamps not below this one; None: not at all."""
        signing = self.mav.signing
        signing.secret_key = key
        signing.sign_outgoing = key is not None
        if stamp > signing.timestamp:
            signing.timestamp = stamp

    def note_received(self, unix_ns: int, frame: bytes) -> None:
        """Enter a frame of the ground into the journal: flight's answers depend on it."""
        self._journal.link(unix_ns, frame)

    def write(self, message: bytes | bytearray) -> None:
        """Called by pymavlink with every packed message."""
        self.messages += 1
        self._journal.link(self._unix_ns(), message)
        self._sink.send(message)
