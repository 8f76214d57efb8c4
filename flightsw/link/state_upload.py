"""A state from the ground: LEONAV_STATE_UPLOAD in, LEONAV_STATE_RESULT out in the same tick.

The link checks that there is a message; whether its state can be taken is for navigation to say.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

from flightsw.icd import mavlink as m
from flightsw.icd.enums import RejectCause
from flightsw.link.mavlink_out import MavlinkOut
from flightsw.link.message_layout import MessageLayout
from flightsw.link.uplink import Sender

TAKEN = 255  # in the place of a RejectCause
_STATE_RESULT = MessageLayout(m.MAVLink_leonav_state_result_message)
_OVERFLOW = int(RejectCause.RECEIVE_OVERFLOW)
_NOTHING = -2  # of the step: there was no upload


class Uploaded(Protocol):
    """What the loop lets the ground do."""

    def upload_state(self, t_gps_ns: int, frame: int, state: Any, covariance: Any) -> bool:
        """Give navigation a state with this tick; False where the tick is full."""
        ...

    def upload_outcome(self) -> tuple[int, float]:
        """What this tick's step said: RejectCause, -1 taken, -2 there was none; NIS against the state there was."""
        ...


class StateUpload:
    """One upload a tick; a second one in the same tick is answered as not taken.

    An upload that is repeated because its answer was lost is answered again, and not taken twice: what it knows would
    count double.
    """

    __slots__ = ("_answered", "_loop", "_out", "_sequence", "_waiting")

    def __init__(self, out: MavlinkOut, loop: Uploaded) -> None:
        self._out = out
        self._loop = loop
        self._waiting = False
        self._sequence = 0
        self._answered: tuple[int, float, int] | None = None  # the last: sequence, NIS, cause

    def take(self, message: Any, sender: Sender) -> None:
        """LEONAV_STATE_UPLOAD."""
        del sender
        if self._answered is not None and self._answered[0] == message.sequence:
            self._out.send(_STATE_RESULT, *self._answered)
            return
        if self._waiting or not self._loop.upload_state(
            int(message.t_gps_ns), int(message.frame), message.state, message.covariance
        ):
            self._out.send(_STATE_RESULT, int(message.sequence), math.nan, _OVERFLOW)
            return
        self._waiting = True
        self._sequence = int(message.sequence)

    def answer(self) -> None:
        """What navigation made of it."""
        if not self._waiting:
            return
        self._waiting = False
        cause, nis = self._loop.upload_outcome()
        if cause != _NOTHING:
            self._answered = (self._sequence, nis, TAKEN if cause < 0 else cause)
            self._out.send(_STATE_RESULT, *self._answered)
