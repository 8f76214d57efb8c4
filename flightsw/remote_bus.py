"""python-can's remote bus with every wait bounded, for a bus hub in another process. For machines without CAN only.

As it comes it waits for ever where the hub is stopped: in sending, in closing, in opening; and it does not notice. Here
each of these ends after a few milliseconds, a hub that answers no ping for a while is a dead bus, and all of it is
CanOperationError, which the port turns into BUS_OFF and attempts to reconnect.
"""

from __future__ import annotations

import socket
import time
from contextlib import suppress
from typing import Any

import can
from can_remote.client import RemoteBus, RemoteClientProtocol
from can_remote.protocol import BINARY_MESSAGE_TYPE, BINARY_MSG_STRUCT, IS_BRS, IS_EXTENDED_ID, IS_FD
from can_remote.websocket import BINARY, PING, WebSocket, WebsocketClosed

_TIMEOUT_S = 0.02  # a healthy hub on loopback answers in two milliseconds
_FIRST_S = 2.0  # at the start there is time
_PING_EVERY_S = 0.5
_SILENT_S = 1.5
_HEAD = 1 + BINARY_MSG_STRUCT.size
_FAILURES = (OSError, WebsocketClosed, can.CanError, AssertionError, ValueError, KeyError, AttributeError)


class _Protocol(RemoteClientProtocol):
    """Waits for the hub's first answer no longer than told."""

    patience_s = _TIMEOUT_S

    def recv(self, timeout: float | None = None) -> Any:
        return super().recv(self.patience_s if timeout is None or timeout > self.patience_s else timeout)


class BoundedRemoteBus(RemoteBus):
    """A bus at `HOST:PORT` of a hub. first: flight is starting, so that there is time to wait."""

    def __init__(self, channel: str, first: bool = False) -> None:
        patience_s = _FIRST_S if first else _TIMEOUT_S
        before = socket.getdefaulttimeout()
        socket.setdefaulttimeout(patience_s)
        try:
            self._web = WebSocket(f"ws://{channel}/", ["can.binary+json.v1"])
            self.socket = self._web.socket
            _Protocol.patience_s = patience_s
            self.remote_protocol = _Protocol({"fd": True}, self._web)
        except _FAILURES as error:
            raise can.CanInitializationError(
                f"no hub answers at {channel} ({error or type(error).__name__})"
            ) from error
        finally:
            socket.setdefaulttimeout(before)
            _Protocol.patience_s = _TIMEOUT_S
        self.socket.settimeout(_TIMEOUT_S)
        self.channel_info = self.remote_protocol.channel_info
        self.channel = channel
        self._heard_s = self._pinged_s = time.monotonic()
        can.BusABC.__init__(self, channel)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame; a hub that is gone, or stops within a frame, is a dead bus."""
        try:
            while self._web.wait(timeout):
                kind, data = self._web.read_frame()
                self._heard_s = time.monotonic()
                if kind == BINARY and len(data) >= _HEAD and data[0] == BINARY_MESSAGE_TYPE:
                    return _message(data)
                timeout = 0.0
        except _FAILURES as error:
            raise can.CanOperationError(str(error)) from error
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hand a frame to the hub, or CanOperationError within milliseconds."""
        del timeout
        now_s = time.monotonic()
        try:
            if now_s - self._pinged_s >= _PING_EVERY_S:
                if self._pinged_s - self._heard_s > _SILENT_S:
                    raise OSError(f"the hub has not answered for {now_s - self._heard_s:.1f} s")
                self._pinged_s = now_s
                self._web.send_frame(PING, bytearray())
            super().send(msg)
        except _FAILURES as error:
            raise can.CanOperationError(str(error)) from error

    def shutdown(self) -> None:
        """Close the socket; the hub is not asked, it may be stopped."""
        self._is_shutdown = True
        with suppress(OSError):
            self.socket.close()


def _message(data: bytearray) -> can.Message:
    timestamp, frame_id, length, flags = BINARY_MSG_STRUCT.unpack_from(data, 1)
    return can.Message(
        timestamp=timestamp,
        arbitration_id=frame_id,
        dlc=length,
        is_extended_id=bool(flags & IS_EXTENDED_ID),
        is_remote_frame=bool(flags & 2),
        is_error_frame=bool(flags & 4),
        is_fd=bool(flags & IS_FD),
        bitrate_switch=bool(flags & IS_BRS),
        data=data[_HEAD:],
    )
