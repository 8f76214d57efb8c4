"""Frames into epochs: a pulse is one frame, a fix is a position and a velocity of the same counter and time.

Only complete epochs go on. Anything else changes a counter and nothing more.
"""

from __future__ import annotations

import struct

import numpy as np

from flightsw.icd.can_frames import GNSS_POSITION, GNSS_VELOCITY, TIME_SYNC
from flightsw.icd.enums import RejectCause
from flightsw.records import INPUT

EPOCHS = 16  # complete epochs that one tick can hold

_TIME_SYNC = struct.Struct(TIME_SYNC.struct_format)
_POSITION = struct.Struct(GNSS_POSITION.struct_format)
_VELOCITY = struct.Struct(GNSS_VELOCITY.struct_format)
_INCOMPLETE = int(RejectCause.INCOMPLETE_EPOCH)
_OVERFLOW = int(RejectCause.RECEIVE_OVERFLOW)


class EpochAssembly:
    """Collects the epochs of a tick in preallocated inputs of the navigation step.

    `calls` holds one view for each input; the first `count`, but at least one, are to be stepped through.
    """

    __slots__ = ("_fields", "_position", "_velocity", "calls", "count", "inputs", "rejected")

    def __init__(self, rejected: list[int]) -> None:
        self.rejected = rejected
        self.inputs = np.zeros(EPOCHS, INPUT)
        self.calls = [self.inputs[index : index + 1] for index in range(EPOCHS)]
        self._fields = {name: self.inputs[name] for name in INPUT.names or ()}
        self.count = 0
        self._position: tuple[float, ...] | None = None
        self._velocity: tuple[float, ...] | None = None

    def begin(self, counter_now_ns: int) -> None:
        """Forget the epochs of the last tick; frames that wait for their other half stay."""
        for index in range(max(self.count, 1)):
            self._fields["pulse_present"][index] = 0
            self._fields["fix_present"][index] = 0
        self._fields["counter_now_ns"][:] = counter_now_ns
        self.count = 0

    def _claim(self) -> int:
        if self.count == EPOCHS:
            self.rejected[_OVERFLOW] += 1
            return -1
        self.count += 1
        return self.count - 1

    def take_pulse(self, frame: bytearray) -> None:
        """One TIME_SYNC frame, checked by the codec."""
        index = self._claim()
        if index < 0:
            return
        gps_ns, counter_ns, sigma_ns, _leap, status, _counter, _crc = _TIME_SYNC.unpack(frame)
        fields = self._fields
        fields["pulse_present"][index] = 1
        fields["pulse_status"][index] = status
        fields["pulse_gps_ns"][index] = gps_ns
        fields["pulse_counter_ns"][index] = counter_ns
        fields["pulse_sigma_ns"][index] = sigma_ns

    def take_position(self, frame: bytearray) -> None:
        """One GNSS_POSITION frame, checked by the codec."""
        if self._position is not None:
            self.rejected[_INCOMPLETE] += 1
        self._position = _POSITION.unpack(frame)
        self._join()

    def take_velocity(self, frame: bytearray) -> None:
        """One GNSS_VELOCITY frame, checked by the codec."""
        if self._velocity is not None:
            self.rejected[_INCOMPLETE] += 1
        self._velocity = _VELOCITY.unpack(frame)
        self._join()

    def _join(self) -> None:
        position, velocity = self._position, self._velocity
        if position is None or velocity is None:
            return
        # Both end with the alive counter and the CRC; both begin with the time.
        if position[-2] != velocity[-2] or position[0] != velocity[0]:
            return
        self._position = self._velocity = None
        index = self._claim()
        if index < 0:
            return
        fields = self._fields
        fields["fix_present"][index] = 1
        fields["fix_gps_ns"][index] = position[0]
        fields["fix_counter_ns"][index] = position[1]
        fields["fix_r_itrf_m"][index] = position[2:5]
        fields["fix_sigma_r_m"][index] = position[5:8]
        fields["fix_satellites"][index] = position[8]
        fields["fix_type"][index] = position[9]
        fields["fix_v_itrf_mps"][index] = velocity[1:4]
        fields["fix_sigma_v_mps"][index] = velocity[4:7]
