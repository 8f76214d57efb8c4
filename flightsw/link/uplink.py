"""From bytes to orders: frames cut out, checked, authenticated, and handed to who knows their kind.

A tick takes so many bytes and looks at so many possible frames, and no more; what is refused changes a counter and
nothing else. Nothing of a frame is believed before its checksum, nothing of an order before its signature.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from flightsw.icd import mavlink as m
from flightsw.link.access import ACCEPTED, SIGNATURE_LENGTH, Access, Refusal
from flightsw.link_port import Chunk, Source

MAGIC = 0xFD
HEADER, CHECKSUM = 10, 2
LONGEST = HEADER + 255 + CHECKSUM + SIGNATURE_LENGTH
CHUNKS_PER_TICK = 64
FRAMES_PER_TICK = 128  # possible frames looked at: a flood of false beginnings must not cost more
_SIGNED = 0x01
_IDLE_TICKS = 3  # a stream that is silent so long will not finish what it has begun


class Sender(NamedTuple):
    """Who sent a message: MAVLink system and component."""

    system: int
    component: int


Handler = Callable[[Any, Sender], None]


class Port(Protocol):
    """Where bytes come from (flightsw/link_port.py)."""

    lost: int

    def receive(self) -> Chunk | None:
        """The next bytes, or None."""
        ...

    def trust(self, source: Source) -> None:
        """Answer this source from now on."""
        ...

    def streams(self) -> list[Source]:
        """Sources that keep an unfinished end."""
        ...


class Uplink:
    """Flight's receiver. `refused`: counts by Refusal. `note_frame`: told every frame that was taken."""

    __slots__ = (
        "_access", "_component", "_decode", "_frames_left", "_handlers", "_note_frame", "_port", "_system",
        "accepted", "refused", "refused_orders",
    )  # fmt: skip

    def __init__(
        self, port: Port, access: Access, system: int, component: int, note_frame: Callable[[int, bytes], None]
    ) -> None:
        self._port = port
        self._access = access
        self._system = system
        self._component = component
        self._note_frame = note_frame
        self._decode = m.MAVLink(None).decode
        self._handlers: dict[int, tuple[Handler, bool, int]] = {}
        self._frames_left = 0
        self.accepted = 0
        self.refused = [0] * len(Refusal)
        self.refused_orders = 0  # refused for their signature or address

    def take(self, message_id: int, handler: Handler, order: bool) -> None:
        """Messages of this kind go to the handler. order: it changes state, so it must be signed."""
        self._handlers[message_id] = (handler, order, m.mavlink_map[message_id].crc_extra)

    def poll(self, unix_ns: int) -> None:
        """Take in what waits, up to the limits of a tick; the rest waits for the next one."""
        self._frames_left = FRAMES_PER_TICK
        receive = self._port.receive
        for _ in range(CHUNKS_PER_TICK):
            chunk = receive()
            if chunk is None:
                break
            chunk.source.idle = 0
            self._cut(chunk.source, chunk.data, unix_ns, chunk.source.rest is not None)
            if self._frames_left <= 0:
                break
        for source in self._port.streams():
            if source.rest:
                source.idle += 1
                if source.idle > _IDLE_TICKS:  # a false beginning must not keep back a frame that stands behind it
                    source.idle = 0
                    self._cut(source, b"", unix_ns, False)

    def _cut(self, source: Source, data: bytes, unix_ns: int, goes_on: bool) -> None:
        """Frames of what has come. goes_on: an unfinished one at the end may still be finished."""
        if source.rest:
            data, source.rest = source.rest + data, b""
        at, end, damaged = 0, len(data), False
        while at < end:
            found = data.find(MAGIC, at)
            if found != at:
                damaged = True
                if found < 0:
                    break
                at = found
            if self._frames_left <= 0:
                self.refused[Refusal.FLOOD] += 1
                break
            self._frames_left -= 1
            whole = end - at >= HEADER + CHECKSUM
            length = 0
            if whole:
                signed = data[at + 2] & _SIGNED
                length = HEADER + data[at + 1] + CHECKSUM + (SIGNATURE_LENGTH if signed else 0)
            if not whole or at + length > end:
                if goes_on:
                    source.rest = data[at:]
                    break
                damaged = True
                at += 1
                continue
            frame = data[at : at + length]
            if self._frame(source, frame, unix_ns):
                at += length
            elif int.from_bytes(frame[7:10], "little") not in self._handlers:
                # Its checksum cannot be verified; its length is believed only where it leads to another frame.
                self.refused[Refusal.UNKNOWN] += 1
                at += length if at + length == end or data[at + length] == MAGIC else 1
            else:
                damaged = True
                at += 1
        if damaged:
            self.refused[Refusal.DAMAGED] += 1

    def _frame(self, source: Source, frame: bytes, unix_ns: int) -> bool:
        """Whether it is a frame of a kind that flight takes; what is done with it is not said."""
        known = self._handlers.get(int.from_bytes(frame[7:10], "little"))
        if known is None or frame[2] & ~_SIGNED:
            return False
        _, order, crc_extra = known
        end = HEADER + frame[1]
        if m.x25crc(frame[1:end] + bytes((crc_extra,))).crc != frame[end] | frame[end + 1] << 8:
            return False
        refusal = self._judge(source, frame, order, unix_ns)
        if refusal == ACCEPTED:
            self.obey(frame, unix_ns)
        else:
            self.refused[refusal] += 1
            self.refused_orders += 1
        return True

    def _judge(self, source: Source, frame: bytes, order: bool, unix_ns: int) -> int:
        if frame[5] == self._system and frame[6] == self._component:
            return Refusal.PEER  # nobody but flight speaks for flight
        bench = self._access.bench
        if frame[2] & _SIGNED and self._access.signing_key is not None:
            outcome = self._access.verify(frame, unix_ns)
            if outcome != ACCEPTED:
                return outcome
            self._port.trust(source)
            return ACCEPTED
        if order and not bench:
            return Refusal.UNSIGNED
        if not source.trusted and not bench:
            return Refusal.PEER
        return ACCEPTED

    def obey(self, frame: bytes, unix_ns: int) -> None:
        """Hand a frame on that has been judged, now or in the run that is replayed."""
        known = self._handlers.get(int.from_bytes(frame[7:10], "little"))
        if known is None:
            return
        try:
            message = self._decode(bytearray(frame))
        except (m.MAVError, struct.error, ValueError, TypeError, IndexError, UnicodeError):
            self.refused[Refusal.DAMAGED] += 1
            return
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        if system not in (0, self._system) or component not in (0, self._component):
            self.refused[Refusal.WRONG_TARGET] += 1
            self.refused_orders += 1
            return
        self.accepted += 1
        self._note_frame(unix_ns, frame)
        known[0](message, Sender(frame[5], frame[6]))
