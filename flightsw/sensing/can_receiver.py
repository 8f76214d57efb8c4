"""Drains the bus, a bounded number of frames in a tick: length, CRC, alive counter, then on to epoch assembly."""

from __future__ import annotations

from collections.abc import Callable

from flightsw.can_port import CanPort
from flightsw.icd import can_codec
from flightsw.icd.can_frames import ATTITUDE, BURN, GNSS_POSITION, GNSS_VELOCITY, NAV_COMMAND, TIME_SYNC
from flightsw.icd.enums import RejectCause
from flightsw.icd.frame_layout import FrameLayout
from flightsw.journal import ERROR, EXTENDED, REMOTE, Journal
from flightsw.sensing.epoch_assembly import EpochAssembly

_BAD_LENGTH = int(RejectCause.BAD_LENGTH)
_BAD_CRC = int(RejectCause.BAD_CRC)
_UNKNOWN_ID = int(RejectCause.UNKNOWN_ID)
_REPEATED_COUNTER = int(RejectCause.REPEATED_COUNTER)
_LOST_FRAMES = int(RejectCause.LOST_FRAMES)


class _Inbox:
    """One kind of frame: where it is decoded to, who takes it, the counter of the last one."""

    __slots__ = ("buffer", "counter", "counter_offset", "layout", "take")

    def __init__(self, layout: FrameLayout, take: Callable[[bytearray], None]) -> None:
        self.layout = layout
        self.buffer = bytearray(layout.length)
        self.counter = -1
        self.counter_offset = layout.counter_offset
        self.take = take


class CanReceiver:
    """Takes frames off the port and hands intact, new ones to the assembly. Counts everything it refuses."""

    __slots__ = ("_inboxes", "_journal", "_port", "accepted", "drain_limit", "received", "rejected")

    def __init__(self, port: CanPort, journal: Journal, assembly: EpochAssembly, rejected: list[int]) -> None:
        self._port = port
        self._journal = journal
        self.rejected = rejected
        self.drain_limit = 0
        self.received = 0
        self.accepted = 0
        self._inboxes = {
            layout.frame_id: _Inbox(layout, take)
            for layout, take in (
                (TIME_SYNC, assembly.take_pulse),
                (GNSS_POSITION, assembly.take_position),
                (GNSS_VELOCITY, assembly.take_velocity),
                (BURN, assembly.take_burn),
                (ATTITUDE, assembly.take_attitude),
                (NAV_COMMAND, assembly.take_command),
            )
        }

    def listen(self, layout: FrameLayout, take: Callable[[bytearray], None]) -> None:
        """Hand intact frames of one more kind to `take`, in a buffer that the next one overwrites."""
        self._inboxes[layout.frame_id] = _Inbox(layout, take)

    def drain(self, unix_ns: int) -> None:
        """Take what waits, up to the limit; the rest waits for the next tick."""
        receive = self._port.receive
        for _ in range(self.drain_limit):
            message = receive()
            if message is None:
                return
            self.received += 1
            data = message.data
            can_id = message.arbitration_id
            if message.is_error_frame or message.is_remote_frame or message.is_extended_id:
                can_id |= ERROR if message.is_error_frame else 0
                can_id |= (EXTENDED if message.is_extended_id else 0) | (REMOTE if message.is_remote_frame else 0)
            self._journal.frame(unix_ns, can_id, True, data)
            self.take(can_id, data)

    def take(self, frame_id: int, data: bytes | bytearray) -> None:
        """Check one frame and pass it on; the identifier with its flags, so that no other sort of frame fits.

        A skipped alive counter counts the frames lost, and the frame is used; a repeated one is dropped. A
        receiver that starts anew is understood at once, or with its second frame if the counters happen to meet.
        """
        inbox = self._inboxes.get(frame_id)
        if inbox is None:
            self.rejected[_UNKNOWN_ID] += 1
            return
        outcome = can_codec.decode_into(inbox.layout, data, inbox.buffer)
        if outcome != can_codec.OK:
            self.rejected[_BAD_LENGTH if outcome == can_codec.BAD_LENGTH else _BAD_CRC] += 1
            return
        counter = inbox.buffer[inbox.counter_offset]
        if inbox.counter >= 0:
            skipped = (counter - inbox.counter - 1) & 0xFF
            if skipped == 0xFF:
                self.rejected[_REPEATED_COUNTER] += 1
                return
            self.rejected[_LOST_FRAMES] += skipped
        inbox.counter = counter
        self.accepted += 1
        inbox.take(inbox.buffer)
