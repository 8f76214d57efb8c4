"""Frames into epochs: a fix is a position and a velocity of the same counter and time, or a position whose receiver
gives no velocity; a pulse, an announced burn, an attitude, a command is one frame each.

Only complete epochs go on. Anything else changes a counter and nothing more. What an epoch says is not judged here.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from flightsw.icd.can_frames import ATTITUDE, BURN, GNSS_POSITION, GNSS_VELOCITY, NAV_COMMAND, TIME_SYNC
from flightsw.icd.enums import FixType, RejectCause
from flightsw.records import INPUT, MEASUREMENTS

EPOCHS = 16  # complete epochs that one tick can hold

_TIME_SYNC = struct.Struct(TIME_SYNC.struct_format)
_POSITION = struct.Struct(GNSS_POSITION.struct_format)
_VELOCITY = struct.Struct(GNSS_VELOCITY.struct_format)
_BURN = struct.Struct(BURN.struct_format)
_ATTITUDE = struct.Struct(ATTITUDE.struct_format)
_NAV_COMMAND = struct.Struct(NAV_COMMAND.struct_format)
_PRESENT = ("pulse_present", "fix_present", "burn_present", "attitude_present", "command_present", "upload_present")
_UPPER = [(i, j) for i in range(MEASUREMENTS) for j in range(i, MEASUREMENTS)]
_FIX_TYPE = GNSS_POSITION.field_names.index("fix_type")
_POSITION_3D = int(FixType.POSITION_3D)
_INCOMPLETE = int(RejectCause.INCOMPLETE_EPOCH)
_OVERFLOW = int(RejectCause.RECEIVE_OVERFLOW)


class EpochAssembly:
    """Collects the epochs of a tick in preallocated inputs of the navigation step.

    `calls` holds one view for each input; the first `count`, but at least one, are to be stepped through.
    """

    __slots__ = ("_fields", "_position", "_present", "_velocity", "calls", "count", "inputs", "rejected")

    def __init__(self, rejected: list[int]) -> None:
        self.rejected = rejected
        self.inputs = np.zeros(EPOCHS, INPUT)
        self.calls = [self.inputs[index : index + 1] for index in range(EPOCHS)]
        self._fields = {name: self.inputs[name] for name in INPUT.names or ()}
        self._present = [self.inputs[name] for name in _PRESENT]
        self.count = 0
        self._position: tuple[float, ...] | None = None
        self._velocity: tuple[float, ...] | None = None

    def begin(self, counter_now_ns: int) -> None:
        """Forget the epochs of the last tick; frames that wait for their other half stay."""
        for present in self._present:
            present[: max(self.count, 1)] = 0
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
        position = _POSITION.unpack(frame)
        if position[_FIX_TYPE] == _POSITION_3D:  # the receiver gives no velocity: nothing to wait for
            self._position = None
            self._put_fix(position, None)
            return
        self._position = position
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
        self._put_fix(position, velocity)

    def put_position(
        self, t_gps_ns: int, t_counter_ns: int, r_itrf_m: Sequence[float], sigma_m: Sequence[float], satellites: int
    ) -> None:
        """A position that was solved on board, as if a receiver without velocity had sent it."""
        self._put_fix((t_gps_ns, t_counter_ns, *r_itrf_m, *sigma_m, satellites, _POSITION_3D), None)

    def _put_fix(self, position: tuple[float, ...], velocity: tuple[float, ...] | None) -> None:
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
        if velocity is None:
            fields["fix_has_velocity"][index] = 0
            fields["fix_v_itrf_mps"][index] = np.nan
            fields["fix_sigma_v_mps"][index] = np.nan
        else:
            fields["fix_has_velocity"][index] = 1
            fields["fix_v_itrf_mps"][index] = velocity[1:4]
            fields["fix_sigma_v_mps"][index] = velocity[4:7]

    def take_burn(self, frame: bytearray) -> None:
        """One BURN frame, checked by the codec."""
        index = self._claim()
        if index < 0:
            return
        burn = _BURN.unpack(frame)
        fields = self._fields
        fields["burn_present"][index] = 1
        fields["burn_start_gps_ns"][index] = burn[0]
        fields["burn_duration_ns"][index] = burn[1]
        fields["burn_dv_mps"][index] = burn[2:5]
        fields["burn_sigma_mps"][index] = burn[5:8]
        fields["burn_frame"][index] = burn[8]
        fields["burn_id"][index] = burn[9]

    def take_attitude(self, frame: bytearray) -> None:
        """One ATTITUDE frame, checked by the codec."""
        index = self._claim()
        if index < 0:
            return
        attitude = _ATTITUDE.unpack(frame)
        fields = self._fields
        fields["attitude_present"][index] = 1
        fields["attitude_gps_ns"][index] = attitude[0]
        fields["attitude_q"][index] = attitude[1:5]
        fields["attitude_sigma_rad"][index] = attitude[5]

    def take_command(self, frame: bytearray) -> None:
        """One NAV_COMMAND frame, checked by the codec."""
        command = _NAV_COMMAND.unpack(frame)
        self.put_command(int(command[0]), int(command[1]), int(command[2]))

    def put_command(self, command: int, target: int, value: int) -> bool:
        """One command, from the bus or the ground; False where the tick holds no more."""
        index = self._claim()
        if index < 0:
            return False
        fields = self._fields
        fields["command_present"][index] = 1
        fields["command_id"][index] = command
        fields["command_target"][index] = target
        fields["command_value"][index] = value
        return True

    def put_upload(self, t_gps_ns: int, frame: int, state: Sequence[float], covariance: Sequence[float]) -> bool:
        """A state from the ground: (6), and the upper triangle of its covariance (21); False where no more is held."""
        index = self._claim()
        if index < 0:
            return False
        fields = self._fields
        fields["upload_present"][index] = 1
        fields["upload_gps_ns"][index] = t_gps_ns
        fields["upload_frame"][index] = frame
        fields["upload_x"][index] = state
        whole = fields["upload_covariance"]
        for (i, j), value in zip(_UPPER, covariance, strict=True):
            whole[index, i, j] = value
            whole[index, j, i] = value
        return True
