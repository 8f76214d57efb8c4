"""Flight's end of the sensor bus. A bus that fails is counted and reopened in the slack; it never stops a tick."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import can

Opener = Callable[[], can.BusABC]

_SEND_TIMEOUT_S = 0.005  # python-can's queues and sockets would otherwise wait for ever


class CanPort:
    """Sends and receives frames; `open_bus` makes a new bus after a failure.

    python-can reports a dead bus as CanError or as OSError, by backend; both mean BUS_OFF here. `tell` is called with
    True when the bus is lost and with False when it is back.
    """

    __slots__ = ("_broken", "_bus", "_open_bus", "errors", "reconnects", "sent", "tell")

    def __init__(self, open_bus: Opener) -> None:
        self._open_bus = open_bus
        self._bus: can.BusABC | None = open_bus()
        self._broken: can.BusABC | None = None
        self.tell: Callable[[bool], None] = _nobody
        self.errors = 0
        self.reconnects = 0
        self.sent = 0

    @property
    def is_off(self) -> bool:
        """Whether the bus has failed and not been reopened yet."""
        return self._bus is None

    def receive(self) -> can.Message | None:
        """The next waiting frame, or None; never waits."""
        if self._bus is None:
            return None
        try:
            return self._bus.recv(0.0)
        except (can.CanError, OSError):
            self._fail()
            return None

    def send(self, frame_id: int, payload: bytearray, timestamp_s: float) -> bool:
        """Send one CAN FD frame; False if the bus does not take it."""
        if self._bus is None:
            return False
        message = can.Message(
            timestamp=timestamp_s,
            arbitration_id=frame_id,
            is_extended_id=False,
            is_fd=True,
            bitrate_switch=True,
            data=payload,
        )
        try:
            self._bus.send(message, timeout=_SEND_TIMEOUT_S)
        except (can.CanError, OSError):
            self._fail()
            return False
        self.sent += 1
        return True

    def reopen(self) -> None:
        """Put a failed bus away and attempt once to open another; a slack job."""
        if self._bus is not None:
            return
        self._put_away()
        try:
            self._bus = self._open_bus()
        except (can.CanError, OSError):
            return
        self.reconnects += 1
        self.tell(False)

    def _fail(self) -> None:
        # Shutting a dead bus down may take its time: that is left to the slack.
        self.errors += 1
        self._bus, self._broken = None, self._bus
        self.tell(True)

    def _put_away(self) -> None:
        broken, self._broken = self._broken, None
        if broken is not None:
            with suppress(can.CanError, OSError):
                broken.shutdown()

    def close(self) -> None:
        """Shut the bus down."""
        self._put_away()
        if self._bus is not None:
            with suppress(can.CanError, OSError):
                self._bus.shutdown()
            self._bus = None


def _nobody(lost: bool) -> None:
    del lost
