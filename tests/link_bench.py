"""A ground station on a test's bench: pymavlink's own codecs and signing on a wire in memory, or on real sockets.

The station packs and signs with pymavlink's `common` dialect, which is not of our making; our own messages it reads
with the generated dialect, whose CRC_EXTRA the dialect's tests hold.
"""

from __future__ import annotations

import struct
from collections import deque
from pathlib import Path
from typing import Any

from harness import Flight, load
from pymavlink.dialects.v20 import common

from flightsw.icd import mavlink
from flightsw.link.access import Access, Ceiling, stamp_of
from flightsw.link_port import Chunk, Source

KEY = bytes(range(32))
OTHER_KEY = bytes(range(1, 33))
GROUND_SYSTEM, GROUND_COMPONENT = 255, 190


class Wire:
    """Stands for the link's sockets: `up` holds what is on its way to flight, `down` what flight sent."""

    def __init__(self, trusted: bool = False, stream: bool = False) -> None:
        self.source = Source(self, None, stream, trusted)  # type: ignore[arg-type]
        self.up: deque[bytes] = deque()
        self.down: list[bytes] = []
        self.lost = 0
        self.parser = mavlink.MAVLink(None)

    def receive(self) -> Chunk | None:
        return Chunk(self.source, self.up.popleft()) if self.up else None

    def trust(self, source: Source) -> None:
        source.trusted = True

    def streams(self) -> list[Source]:
        return [self.source] if self.source.rest is not None else []

    def send(self, message: bytes | bytearray) -> None:
        self.down.append(bytes(message))

    def close(self) -> None:
        pass

    def heard(self, kind: str | None = None) -> list[Any]:
        """Messages of flight since the last call, of one type if that is asked for."""
        frames, self.down = self.down, []
        messages = [self.parser.decode(bytearray(frame)) for frame in frames]
        return [message for message in messages if kind is None or message.get_type() == kind]


class Station:
    """Packs messages as a ground station does. key None: unsigned."""

    def __init__(self, wire: Wire | None = None, key: bytes | None = KEY, system: int = GROUND_SYSTEM) -> None:
        self.wire = wire
        self.mav = common.MAVLink(self, srcSystem=system, srcComponent=GROUND_COMPONENT)
        self.mav.WIRE_PROTOCOL_VERSION = "2.0"
        if key is not None:
            self.mav.signing.secret_key = key
            self.mav.signing.sign_outgoing = True
        self.packed: list[bytes] = []

    def write(self, frame: bytes) -> None:
        """Called by pymavlink with each packed message."""
        self.packed.append(bytes(frame))
        if self.wire is not None:
            self.wire.up.append(bytes(frame))

    def at(self, unix_ns: int) -> Station:
        """Sign from now on with stamps from this time on, but never one twice."""
        self.mav.signing.timestamp = max(self.mav.signing.timestamp, stamp_of(unix_ns))
        return self

    def command(self, number: int, *values: float, target: tuple[int, int] = (1, 1)) -> None:
        self.mav.command_long_send(*target, number, 0, *(*values, *(0.0,) * (7 - len(values))))

    def parameter(self, name: bytes, value: float, kind: int = 9, target: tuple[int, int] = (1, 1)) -> None:
        self.mav.param_set_send(*target, name, value, kind)


class Linked(Flight):
    """A flight with a ground station on a wire; `obeys` counts the orders that were taken."""

    def __init__(
        self,
        *settings: str,
        key: bytes | None = KEY,
        bench: bool = False,
        folder: Path | None = None,
        logs: Path | None = None,
        stream: bool = False,
    ) -> None:
        self.wire = Wire(stream=stream)
        super().__init__(load(*settings), logs, sink=self.wire)  # type: ignore[arg-type]
        self.folder = folder
        ceiling = Ceiling(folder / "signature.ceiling") if folder is not None else None
        keys = (key,) if key is not None else ()
        self.access = Access(lambda: keys, ceiling, self.world.start_unix_ns, bench)
        self.access.keep_ahead(self.world.start_unix_ns)
        self.loop.listen(self.wire, self.access, folder)
        self.station = Station(self.wire, key)
        self.station.at(self.world.start_unix_ns)

    @property
    def ground(self) -> Any:
        return self.loop.ground

    @property
    def refused(self) -> dict[str, int]:
        from flightsw.link.access import Refusal

        counts = self.ground.uplink.refused
        return {refusal.name: counts[refusal] for refusal in Refusal if counts[refusal]}

    def now(self) -> Station:
        """The station, its stamps at flight's time."""
        unix_ns = self.loop.unix_start_ns + self.k * self.period_ns
        return self.station.at(unix_ns)

    def ask(self, number: int, *values: float) -> int:
        """One command, obeyed or not in the next tick: its MAV_RESULT."""
        self.wire.heard()
        self.now().command(number, *values)
        self.tick()
        (ack,) = [a for a in self.wire.heard("COMMAND_ACK") if a.command == number]
        return int(ack.result)


def split_tlog(path: Path) -> list[tuple[int, bytes]]:
    """(Unix time [us], frame) of a link.tlog."""
    data, at, found = path.read_bytes(), 0, []
    while at < len(data):
        (unix_us,) = struct.unpack_from(">Q", data, at)
        length = 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
        found.append((unix_us, data[at + 8 : at + 8 + length]))
        at += 8 + length
    return found
