"""A .tlog as a link: 8-byte big-endian Unix microseconds, each followed by one MAVLink frame, at its own times.

A log that flight divided to keep a limit of size is read with its older parts, and one that was cut off up to there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from flightsw.icd.log_parts import all_parts, lacks_beginning
from ground.console.link import MAGIC, FrameDecoder, Received, frame_length
from ground.console.text import seconds
from ground.errors import OperatorError

STAMP = 8
US_PER_S = 1_000_000
EARLIEST_US = 315_964_800 * US_PER_S  # 1980-01-06: no log of ours is older than GPS time
LATEST_US = 4_102_444_800 * US_PER_S  # 2100-01-01
RESYNC_WINDOW_US = 7 * 86_400 * US_PER_S
RECORDS_PER_CALL = 4000


class TlogLink:
    """Replays a .tlog at its own times, `speed` times as fast as `clock`."""

    live = False

    def __init__(self, path: Path, speed: float, clock: Callable[[], float]) -> None:
        self._records, self.skipped_bytes, self.remarks = read_tlog(path)
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

    @property
    def seeking(self) -> bool:
        """Whether `receive` still hurries to where it was sent."""
        return self._goal_s is not None

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


class Tlog(NamedTuple):
    """Records (Unix us, frame) of a .tlog; the bytes skipped as damaged; what to say of how it begins and ends."""

    records: list[tuple[int, bytes]]
    skipped: int
    remarks: tuple[str, ...]


def read_tlog(path: Path) -> Tlog:
    """A .tlog with the older parts beside it; OperatorError when there is no record in it."""
    try:
        parts = [part.read_bytes() for part in all_parts(path)]
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read ({error.strerror}); give the link.tlog of a run") from None
    records: list[tuple[int, bytes]] = []
    skipped, cut = 0, 0
    for data in parts:
        at, bad_from = 0, len(data)
        while at < len(data):
            length = frame_length(data, at + STAMP)
            t_us = int.from_bytes(data[at : at + STAMP], "big")
            if length and _plausible(t_us, records):
                records.append((t_us, data[at + STAMP : at + STAMP + length]))
                at, bad_from = at + STAMP + length, len(data)
                continue
            bad_from = min(bad_from, at)
            magic = data.find(MAGIC, at + STAMP + 1)
            after = len(data) if magic < 0 else magic - STAMP
            skipped += after - at
            at = after
        cut = len(data) - bad_from if _begins_record(data[bad_from:]) else 0
    if not records:
        raise OperatorError(f"{path}: no MAVLink 2 frame with a time stamp in it; give the link.tlog of a run")
    remarks = []
    if lacks_beginning(path):
        remarks.append("the beginning of the log was dropped to keep the limit of its size")
    if skipped - cut:
        remarks.append(damage_words(skipped - cut))
    if cut:
        remarks.append(f"the log ends within a message, {cut} bytes of it: flight was killed, or the copy is not whole")
    return Tlog(records, skipped, tuple(remarks))


def _begins_record(data: bytes) -> bool:
    """Whether this could be the beginning of a record that was cut off."""
    return len(data) <= STAMP or data[STAMP] == MAGIC


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
