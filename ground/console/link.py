"""From datagrams or a .tlog to MAVLink messages, each with the time it was heard.

Frames are cut out by their own length field and decoded one by one, so nothing left over from one datagram
can swallow the start of the next, and a damaged frame costs only itself. A .tlog is a sequence of 8-byte
big-endian Unix microseconds, each followed by one MAVLink frame.
"""

from __future__ import annotations

import errno
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

from flightsw.icd import mavlink
from ground.console.authentication import Verifier
from ground.console.text import seconds
from ground.errors import OperatorError

FLIGHT_SYSTEM = 1
MAGIC = 0xFD  # MAVLink 2; flight sends nothing else
HEADER, CHECKSUM, SIGNATURE = 10, 2, 13
SIGNED = 0x01
STAMP = 8
US_PER_S = 1_000_000
EARLIEST_US = 315_964_800 * US_PER_S  # 1980-01-06: no log of ours is older than GPS time
LATEST_US = 4_102_444_800 * US_PER_S  # 2100-01-01
RESYNC_WINDOW_US = 7 * 86_400 * US_PER_S
MAX_DATAGRAM = 65_535
RECEIVE_BUFFER = 4 << 20
DATAGRAMS_PER_CALL = 500
RECORDS_PER_CALL = 4000


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
        self._peer: Any = None  # who speaks for flight: answers go there
        self._decoder = FrameDecoder(verifier)
        self.statistics = self._decoder.statistics
        try:
            self._socket = _listen(host, port)
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
            now_s = self._clock()
            messages = list(self._decoder.datagram(data))
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


def _listen(host: str, port: int) -> socket.socket:
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


class TlogLink:
    """Replays a .tlog at its own times, `speed` times as fast as `clock`."""

    live = False

    def __init__(self, path: Path, speed: float, clock: Callable[[], float]) -> None:
        self._records, self.skipped_bytes = read_tlog(path)
        self._decoder = FrameDecoder()
        self.statistics = self._decoder.statistics
        probe = FrameDecoder()
        if not any(probe.frame(frame) is not None for _, frame in self._records):
            raise OperatorError(
                f"{path}: no MAVLink 2 message in it that this console knows; "
                "give the link.tlog of a run, written by the same version"
            )
        self.name = f"{path.parent.name}/{path.name}" if path.parent.name else path.name
        self._next = 0
        self._speed, self._clock = speed, clock
        self._paused = False
        self._anchor_s, self._anchor_log_s = clock(), self._records[0][0] / US_PER_S
        self._behind_s: float | None = None
        self._goal_s: float | None = None

    @property
    def start_s(self) -> float:
        """Time of the first record [Unix s]."""
        return self._records[0][0] / US_PER_S

    @property
    def stop_s(self) -> float:
        """Time of the last record [Unix s]."""
        return self._records[-1][0] / US_PER_S

    def now_s(self) -> float:
        """Time in the log; it stands still while paused, and after the last record."""
        if self._paused:
            return self._anchor_log_s
        now_s = self._anchor_log_s + self._speed * (self._clock() - self._anchor_s)
        if self._behind_s is not None:
            now_s = min(now_s, self._behind_s)
        return min(now_s, self.stop_s)

    def receive(self) -> list[Received]:
        """Messages due by now; when too many are due at once, the log's time waits for them."""
        if self._goal_s is not None:
            return self._hurry(self._goal_s)
        self._behind_s = None
        due_us = round(self.now_s() * US_PER_S)
        heard: list[Received] = []
        last = min(len(self._records), self._next + RECORDS_PER_CALL)
        while self._next < last and self._records[self._next][0] <= due_us:
            t_us, frame = self._records[self._next]
            self._next += 1
            message = self._decoder.frame(frame)
            if message is not None:
                heard.append(Received(t_us / US_PER_S, message))
        if self._next < len(self._records) and self._records[self._next][0] <= due_us:
            self._rebase(self._records[self._next - 1][0] / US_PER_S)
            due_us = self._records[self._next - 1][0]
        # What is drawn from these messages is drawn at their time: at a high speed the log would run on meanwhile
        # and the console would call a link silent that it has not listened to yet.
        self._behind_s = due_us / US_PER_S
        return heard

    def seek(self, seconds_on: float) -> bool:
        """Go to a time later or earlier; `receive` hurries there. Whether what was heard must be forgotten."""
        goal_s = min(max(self.now_s() + seconds_on, self.start_s), self.stop_s)
        back = goal_s < self.now_s()
        if back:
            self._next = 0
        self._goal_s = goal_s
        return back

    def faster(self, factor: float) -> float:
        """Change the speed; returns the new one."""
        self._rebase(self.now_s())
        self._speed = min(max(self._speed * factor, 1 / 16), 1e4)
        return self._speed

    def _hurry(self, goal_s: float) -> list[Received]:
        heard: list[Received] = []
        last = min(len(self._records), self._next + RECORDS_PER_CALL)
        while self._next < last and self._records[self._next][0] <= goal_s * US_PER_S:
            t_us, frame = self._records[self._next]
            self._next += 1
            message = self._decoder.frame(frame)
            if message is not None:
                heard.append(Received(t_us / US_PER_S, message))
        if self._next < last or last == len(self._records):
            self._goal_s = self._behind_s = None
            self._rebase(goal_s)
        else:
            self._rebase(self._records[self._next - 1][0] / US_PER_S)
        return heard

    def everything(self) -> Iterator[Received]:
        """All messages at once, in order, for reports that do not wait."""
        while self._next < len(self._records):
            t_us, frame = self._records[self._next]
            self._next += 1
            message = self._decoder.frame(frame)
            if message is not None:
                yield Received(t_us / US_PER_S, message)

    def pause(self, paused: bool) -> None:
        """Stop or resume the log's time."""
        if paused != self._paused:
            self._rebase(self.now_s())
            self._paused = paused

    def _rebase(self, log_s: float) -> None:
        self._anchor_s, self._anchor_log_s = self._clock(), log_s

    def finished(self) -> bool:
        """True after the last record."""
        return self._next >= len(self._records)

    def close(self) -> None:
        """Nothing is held open."""


def read_tlog(path: Path) -> tuple[list[tuple[int, bytes]], int]:
    """Records (Unix us, frame) of a .tlog and the bytes skipped as damaged; OperatorError when there are none."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read ({error.strerror}); give the link.tlog of a run") from None
    records: list[tuple[int, bytes]] = []
    at = skipped = 0
    while at < len(data):
        length = frame_length(data, at + STAMP)
        t_us = int.from_bytes(data[at : at + STAMP], "big")
        if length and _plausible(t_us, records):
            records.append((t_us, data[at + STAMP : at + STAMP + length]))
            at += STAMP + length
            continue
        magic = data.find(MAGIC, at + STAMP + 1)
        after = len(data) if magic < 0 else magic - STAMP
        skipped += after - at
        at = after
    if not records:
        raise OperatorError(f"{path}: no MAVLink 2 frame with a time stamp in it; give the link.tlog of a run")
    return records, skipped


def _plausible(t_us: int, records: list[tuple[int, bytes]]) -> bool:
    """Inside the years of GPS; once under way, near the record before (damage must not stretch the log)."""
    if not EARLIEST_US <= t_us <= LATEST_US:
        return False
    return not records or abs(t_us - records[-1][0]) <= RESYNC_WINDOW_US


def damage_words(skipped_bytes: int) -> str:
    """What to tell the operator about a log that is not whole; empty when it is."""
    return f"{skipped_bytes} damaged bytes of the log skipped" if skipped_bytes else ""


def progress_words(link: TlogLink) -> str:
    """Where a replay stands: `812 s of 3 h 06 min`."""
    return f"{seconds(link.now_s() - link.start_s)} of {seconds(link.stop_s - link.start_s)}"
