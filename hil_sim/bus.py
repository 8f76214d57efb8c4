"""The sensor bus in one process, and the monitor that listens as the other onboard systems would."""

from __future__ import annotations

from binascii import crc_hqx
from collections import deque
from pathlib import Path
from types import TracebackType

import can
import numpy as np

from flightsw.icd.can_frames import (
    CROSSLINK_STATUS,
    FLIGHT_HEARTBEAT,
    GNSS_CHECK,
    GNSS_EXCLUDED,
    INTEGRITY,
    NAV_STATE,
)
from flightsw.icd.frame_layout import FrameLayout
from hil_sim.errors import BusError

SEND_TIMEOUT_S = 1.0  # a bus of another process may block for ever without one
RECEIVE_QUEUE_FRAMES = 4096
_NAV_ID, _NAV_LENGTH = NAV_STATE.frame_id, NAV_STATE.length
_INTEGRITY_ID, _INTEGRITY_LENGTH = INTEGRITY.frame_id, INTEGRITY.length
_HEARTBEAT_ID = FLIGHT_HEARTBEAT.frame_id
_GNSS = {"gnss_check": GNSS_CHECK, "gnss_excluded": GNSS_EXCLUDED}
_GNSS_LAYOUTS = {layout.frame_id: layout for layout in _GNSS.values()}


class BusEnd(can.BusABC):
    """One end of a bus within one thread: what it sends waits at all other ends, time stamp and all.

    python-can's own `virtual` makes a deep copy of every frame and locks a queue for it: half of a run's time. Here the
    data alone are copied, since flight fills the same buffer again. A full queue refuses at once.
    """

    def __init__(self, ends: list[BusEnd], limit: int) -> None:
        self._waiting: deque[can.Message] = deque()
        self._ends = ends
        self._limit = limit
        super().__init__(channel="lockstep")
        ends.append(self)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put a copy where every other end finds it; CanOperationError where one of them is full or this one closed."""
        del timeout  # nobody could make room meanwhile
        if self._is_shutdown:
            raise can.CanOperationError("this end of the bus is closed")
        full = False
        for end in self._ends:
            if end is self:
                continue
            if len(end._waiting) >= end._limit:
                full = True
                continue
            end._waiting.append(
                can.Message(
                    timestamp=msg.timestamp,
                    arbitration_id=msg.arbitration_id,
                    is_extended_id=msg.is_extended_id,
                    is_remote_frame=msg.is_remote_frame,
                    is_error_frame=msg.is_error_frame,
                    data=bytearray(msg.data),
                    dlc=msg.dlc,
                    is_fd=msg.is_fd,
                    bitrate_switch=msg.bitrate_switch,
                    error_state_indicator=msg.error_state_indicator,
                )
            )
        if full:
            raise can.CanOperationError("another end of the bus takes no more frames")

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next waiting frame, or None: whoever could send one is the caller itself."""
        del timeout
        if self._is_shutdown:
            raise can.CanOperationError("this end of the bus is closed")
        return self._waiting.popleft() if self._waiting else None

    def shutdown(self) -> None:
        """Leave the bus; what waits here is gone."""
        if not self._is_shutdown:
            self._ends.remove(self)
            self._waiting.clear()
        super().shutdown()


class VirtualBusPair:
    """Two ends of one bus in this process: `flight` and `world`. Use as a context manager."""

    def __init__(self) -> None:
        self._ends: list[BusEnd] = []
        self.flight = self.open_end()
        self.world = self.open_end()

    def open_end(self) -> can.BusABC:
        """One more end of the bus; time stamps of the sender are kept."""
        return BusEnd(self._ends, RECEIVE_QUEUE_FRAMES)

    def close(self) -> None:
        """Shut both ends down."""
        self.flight.shutdown()
        self.world.shutdown()

    def __enter__(self) -> VirtualBusPair:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Monitor:
    """What flight published, tick by tick, as received on the bus.

    A tick's NAV_STATE and INTEGRITY are those between the heartbeat before it and its own, which comes last.
    Frames with a wrong length or CRC are counted and left out.
    """

    def __init__(self, n_ticks: int) -> None:
        self._capacity = n_ticks
        self._tick = np.zeros(n_ticks, dtype=np.int64)
        self._nav = bytearray(n_ticks * NAV_STATE.length)
        self._integrity = bytearray(n_ticks * INTEGRITY.length)
        self._has_nav = bytearray(n_ticks)
        self._has_integrity = bytearray(n_ticks)
        self._crosslink = bytearray()  # verdicts of the inter-satellite monitor, and the rows they belong to
        self._crosslink_row: list[int] = []
        self._gnss = {layout.frame_id: bytearray() for layout in _GNSS.values()}  # all that is said of pseudoranges
        self._beat = np.zeros(1, dtype=FLIGHT_HEARTBEAT.dtype)
        self.rows = 0
        self.received = 0
        self.bad_frames = 0
        self.other_frames = 0

    def drain(self, bus: can.BusABC) -> int:
        """Take in everything waiting on the bus; returns how many frames that was."""
        taken = 0
        receive = bus.recv
        while True:
            message = receive(0.0)
            if message is None:
                break
            taken += 1
            self._accept(message.arbitration_id, message.data)
        self.received += taken
        return taken

    def _accept(self, frame_id: int, data: bytearray) -> None:
        row = self.rows
        if row >= self._capacity:
            raise BusError(f"flight published more than the {self._capacity} ticks of the run")
        if frame_id == _NAV_ID:
            if _intact(data, NAV_STATE):
                self._nav[row * _NAV_LENGTH : (row + 1) * _NAV_LENGTH] = data
                self._has_nav[row] = 1
                return
        elif frame_id == _INTEGRITY_ID:
            if _intact(data, INTEGRITY):
                self._integrity[row * _INTEGRITY_LENGTH : (row + 1) * _INTEGRITY_LENGTH] = data
                self._has_integrity[row] = 1
                return
        elif frame_id == _HEARTBEAT_ID:
            if _intact(data, FLIGHT_HEARTBEAT):
                self._tick[row] = int.from_bytes(data[:8], "little")
                self.rows = row + 1
                return
        elif frame_id == CROSSLINK_STATUS.frame_id:
            if _intact(data, CROSSLINK_STATUS):
                self._crosslink += data
                self._crosslink_row.append(row)
                return
        elif frame_id in self._gnss:
            if _intact(data, _GNSS_LAYOUTS[frame_id]):
                self._gnss[frame_id] += data
                return
        else:
            self.other_frames += 1
            return
        self.bad_frames += 1

    def records(self) -> dict[str, np.ndarray]:
        """tick (n,), nav (n,) NAV_STATE and integrity (n,) INTEGRITY records, has_nav and has_integrity (n,) bool.

        crosslink (m,): CROSSLINK_STATUS records, if there are any, each of the row crosslink_row (m,). gnss_check,
        gnss_excluded: GNSS_CHECK, GNSS_EXCLUDED records, if there are any.
        """
        n = self.rows
        records = {
            "tick": self._tick[:n].copy(),
            "nav": np.frombuffer(bytes(self._nav), dtype=NAV_STATE.dtype)[:n],
            "integrity": np.frombuffer(bytes(self._integrity), dtype=INTEGRITY.dtype)[:n],
            "has_nav": np.frombuffer(bytes(self._has_nav), dtype=bool)[:n],
            "has_integrity": np.frombuffer(bytes(self._has_integrity), dtype=bool)[:n],
        }
        if self._crosslink_row:
            records["crosslink"] = np.frombuffer(bytes(self._crosslink), dtype=CROSSLINK_STATUS.dtype)
            records["crosslink_row"] = np.array(self._crosslink_row, np.int64)
        for name, layout in _GNSS.items():
            if self._gnss[layout.frame_id]:
                records[name] = np.frombuffer(bytes(self._gnss[layout.frame_id]), dtype=layout.dtype)
        return records

    def save(self, path: Path) -> None:
        """Write monitor.npz."""
        np.savez(path, **self.records())  # type: ignore[arg-type]


def _intact(data: bytearray, layout: FrameLayout) -> bool:
    if len(data) != layout.length:
        return False
    at = layout.crc_offset
    crc = crc_hqx(layout.data_id_bytes, crc_hqx(data[:at], 0xFFFF))
    return data[at] == crc & 0xFF and data[at + 1] == crc >> 8
