"""Where MAVLink messages go: packed, numbered, signed, noted in the journal, offered to the socket. Never waits."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any, Protocol

from flightsw.icd import mavlink
from flightsw.journal import Journal
from flightsw.link.message_layout import MessageLayout

SYSTEM_ID = 1
_COMPONENT_ID = mavlink.MAV_COMP_ID_AUTOPILOT1
# of a MAVLink 2 frame (mavlink.io/en/guide/serialization.html)
_MAGIC, _SIGNED = 0xFD, mavlink.MAVLINK_IFLAG_SIGNED
_LENGTH, _FLAGS, _SEQUENCE, _SYSTEM, _COMPONENT, _ID, _PAYLOAD = 1, 2, 4, 5, 6, 7, 10
_PAYLOAD_MAX = 255
_LINK_ID, _STAMP_BYTES, _SIGNATURE_BYTES = b"\0", 6, 6


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
    """Flight's transmitter."""

    __slots__ = ("_buffer", "_journal", "_key", "_sequence", "_sink", "_stamp", "_unix_ns", "_view", "messages")

    def __init__(self, sink: Sink, journal: Journal, unix_ns: Callable[[], int]) -> None:
        self._sink = sink
        self._journal = journal
        self._unix_ns = unix_ns
        self._key: bytes | None = None
        self._stamp = 0
        self._sequence = 0
        self.messages = 0
        self._buffer = bytearray(_PAYLOAD + _PAYLOAD_MAX + 2)
        self._buffer[0], self._buffer[_SYSTEM], self._buffer[_COMPONENT] = _MAGIC, SYSTEM_ID, _COMPONENT_ID
        self._view = memoryview(self._buffer)

    def sign(self, key: bytes | None, stamp: int) -> None:
        """Sign what is sent from now on with this key and stamps not below this one; None: not at all."""
        self._key = key
        self._stamp = max(self._stamp, stamp)
        self._buffer[_FLAGS] = 0 if key is None else _SIGNED

    def note_received(self, unix_ns: int, frame: bytes) -> None:
        """Enter a frame of the ground into the journal: flight's answers depend on it."""
        self._journal.link(unix_ns, frame)

    def send(self, layout: MessageLayout, *values: Any) -> None:
        """Pack a message and let it go. values: in the order of its definition, arrays element by element.

        A defect of the caller: ValueError where there are too many or too few, struct.error where one does not fit.
        """
        if len(values) != layout.count:
            raise ValueError(f"{layout.name} has {layout.count} values, not {len(values)}")
        buffer, view = self._buffer, self._view
        # not pack_into: with its two arguments LEONAV_INTEGRITY would make twenty, and of freed tuples of that length
        # CPython 3.11 hoards two thousand before it uses one again
        packed = layout.pack(*(values if layout.order is None else layout.order(values)))
        payload = packed.rstrip(b"\0") or b"\0"  # trailing zeros are not sent, but for the first byte
        end = _PAYLOAD + len(payload)
        buffer[_PAYLOAD:end] = payload
        buffer[_LENGTH] = end - _PAYLOAD
        buffer[_SEQUENCE] = self._sequence
        buffer[_ID:_PAYLOAD] = layout.id_bytes
        buffer[end] = layout.seed
        crc = mavlink.x25crc(bytes(view[_LENGTH : end + 1])).crc
        buffer[end], buffer[end + 1] = crc & 0xFF, crc >> 8
        message = bytes(view[: end + 2])
        if self._key is not None:
            message = self._signed(message, self._key)
        self._sequence = (self._sequence + 1) & 0xFF
        self.messages += 1
        self._journal.link(self._unix_ns(), message)
        self._sink.send(message)

    def _signed(self, message: bytes, key: bytes) -> bytes:
        """The message and its signature (mavlink.io/en/guide/message_signing.html); steps the stamp."""
        message += _LINK_ID + self._stamp.to_bytes(8, "little")[:_STAMP_BYTES]
        self._stamp += 1
        return message + hashlib.sha256(key + message).digest()[:_SIGNATURE_BYTES]
