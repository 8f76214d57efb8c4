"""The command protocol: COMMAND_LONG and COMMAND_INT in, COMMAND_ACK out in the same tick."""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import attrgetter
from typing import Any, Protocol

from flightsw.icd import mavlink as m
from flightsw.icd.enums import EditMode, MeasurementType, Mode, NavCommand
from flightsw.icd.table_file import TableRefused
from flightsw.link.downlink import Downlink
from flightsw.link.mavlink_out import MavlinkOut
from flightsw.link.message_layout import MessageLayout
from flightsw.link.open_alerts import OpenAlerts
from flightsw.link.uplink import Sender

ACCEPTED, DENIED = m.MAV_RESULT_ACCEPTED, m.MAV_RESULT_DENIED
UNSUPPORTED, REJECTED = m.MAV_RESULT_UNSUPPORTED, m.MAV_RESULT_TEMPORARILY_REJECTED
_CAPABILITIES = (
    m.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | m.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    | m.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | m.MAV_PROTOCOL_CAPABILITY_FTP
)
VERSION = 0 << 24 | 1 << 16 | 0 << 8  # 0.1.0 as AUTOPILOT_VERSION packs it, development build
_MODES = tuple(
    (index, int(mode), mode.name.encode("ascii"), mode in (Mode.INTEGRATED, Mode.AUTONOMOUS))
    for index, mode in enumerate(Mode, 1)
)
_TYPES = tuple(int(kind) for kind in MeasurementType)
_NO_CUSTOM_VERSIONS, _NO_UID2 = (0,) * 24, (0,) * 18
_COMMAND_ACK = MessageLayout(m.MAVLink_command_ack_message)
_MESSAGE_INTERVAL = MessageLayout(m.MAVLink_message_interval_message)
_AUTOPILOT_VERSION = MessageLayout(m.MAVLink_autopilot_version_message)
_AVAILABLE_MODES = MessageLayout(m.MAVLink_available_modes_message)
_CURRENT_MODE = MessageLayout(m.MAVLink_current_mode_message)

Parameters7 = tuple[float, ...]

# names that are made anew with each message would stay in the interpreter's cache of attributes
_params = attrgetter(*(f"param{i}" for i in range(1, 8)))


class Commanded(Protocol):
    """What the loop lets the ground do."""

    @property
    def out(self) -> tuple[float, ...]:
        """The output record of the last navigation step."""
        ...

    def command_navigation(self, command: int, target: int, value: int) -> bool:
        """Give navigation an order with this tick; False where the tick is full."""
        ...

    def edits_measurements(self) -> bool:
        """Whether the filter that flies edits types of measurements."""
        ...

    def arm_flag(self, armed: bool) -> None:
        """Whether a raised flag withdraws the state."""
        ...

    def end_for_restart(self) -> None:
        """End after this tick, to be started again."""
        ...

    def stage_upload(self, older: bool) -> None:
        """Validate and stage what was uploaded; TableRefused where there is nothing."""
        ...

    def activate_table(self) -> None:
        """Fly the staged table; TableRefused where there is none."""
        ...

    def roll_back_table(self) -> None:
        """Fly the table of before; TableRefused where none is on trial."""
        ...


class Commands:
    """Flight's commands by number. What is refused says so in its acknowledgement."""

    __slots__ = ("_alerts", "_downlink", "_loop", "_mode_at", "_out", "_table")

    def __init__(self, out: MavlinkOut, loop: Commanded, downlink: Downlink, alerts: OpenAlerts, mode_at: int) -> None:
        self._out = out
        self._loop = loop
        self._downlink = downlink
        self._alerts = alerts
        self._mode_at = mode_at
        self._table: dict[int, Callable[[Parameters7], int]] = {
            m.MAV_CMD_DO_SET_MODE: self._set_mode,
            m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._reboot,
            m.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            m.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            m.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            m.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            m.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._request_capabilities,
            m.LEONAV_CMD_EDIT: self._edit,
            m.LEONAV_CMD_RESET_FILTER: self._reset_filter,
            m.LEONAV_CMD_TABLE_STAGE: self._stage,
            m.LEONAV_CMD_TABLE_ACTIVATE: self._activate,
            m.LEONAV_CMD_TABLE_ROLL_BACK: self._roll_back,
            m.LEONAV_CMD_ACKNOWLEDGE_ALERT: self._acknowledge,
            m.LEONAV_CMD_REQUEST_EVENTS: self._request_events,
        }

    # -- messages

    def take_long(self, message: Any, sender: Sender) -> None:
        """COMMAND_LONG."""
        values = _params(message)
        self._take(int(message.command), values, sender)

    def take_int(self, message: Any, sender: Sender) -> None:
        """COMMAND_INT; x and y are whole numbers."""
        values = (message.param1, message.param2, message.param3, message.param4, message.x, message.y, message.z)
        self._take(int(message.command), values, sender)

    def _take(self, command: int, values: Parameters7, sender: Sender) -> None:
        handler = self._table.get(command)
        if handler is None:
            result = UNSUPPORTED
        else:
            try:
                result = handler(values)
            except TableRefused:
                result = REJECTED
        self._out.send(_COMMAND_ACK, command, result, 0, 0, sender.system, sender.component)

    # -- navigation

    def _set_mode(self, values: Parameters7) -> int:
        mode = _whole(values[1], 0, 3)
        if mode == Mode.AUTONOMOUS:
            return self._edit_all(EditMode.INHIBIT)
        if mode == Mode.INTEGRATED:
            return self._edit_all(EditMode.AUTO)
        return DENIED

    def _edit_all(self, how: int) -> int:
        if not self._loop.edits_measurements():
            return UNSUPPORTED
        done = [self._loop.command_navigation(int(NavCommand.EDIT), kind, int(how)) for kind in _TYPES]
        return ACCEPTED if all(done) else REJECTED

    def _edit(self, values: Parameters7) -> int:
        kind, how = _whole(values[0], 0, len(_TYPES) - 1), _whole(values[1], 0, max(EditMode))
        if kind is None or how is None:
            return DENIED
        if not self._loop.edits_measurements():
            return UNSUPPORTED
        return ACCEPTED if self._loop.command_navigation(int(NavCommand.EDIT), kind, how) else REJECTED

    def _reset_filter(self, values: Parameters7) -> int:
        del values
        return ACCEPTED if self._loop.command_navigation(int(NavCommand.RESET_FILTER), 0, 0) else REJECTED

    def _arm(self, values: Parameters7) -> int:
        armed = _whole(values[0], 0, 1)
        if armed is None:
            return DENIED
        self._loop.arm_flag(armed == 1)
        return ACCEPTED

    def _reboot(self, values: Parameters7) -> int:
        if _whole(values[0], 1, 1) is None:
            return DENIED
        self._loop.end_for_restart()
        return ACCEPTED

    # -- tables

    def _stage(self, values: Parameters7) -> int:
        older = _whole(values[0], 0, 1)
        if older is None:
            return DENIED
        self._loop.stage_upload(older == 1)
        return ACCEPTED

    def _activate(self, values: Parameters7) -> int:
        del values
        self._loop.activate_table()
        return ACCEPTED

    def _roll_back(self, values: Parameters7) -> int:
        del values
        self._loop.roll_back_table()
        return ACCEPTED

    # -- messages and events

    def _acknowledge(self, values: Parameters7) -> int:
        sequence = _whole(values[0], 1, 1 << 24)
        return ACCEPTED if sequence is not None and self._alerts.acknowledge(sequence) else DENIED

    def _request_events(self, values: Parameters7) -> int:
        first, last = _whole(values[0], 1, 1 << 24), _whole(values[1], 1, 1 << 24)
        if first is None or last is None:
            return DENIED
        return ACCEPTED if self._alerts.ask(first, last) else DENIED

    def _get_interval(self, values: Parameters7) -> int:
        number = _whole(values[0], 0, (1 << 16) - 1)
        if number is None:
            return DENIED
        self._out.send(_MESSAGE_INTERVAL, number, self._downlink.interval_us(number))
        return ACCEPTED

    def _set_interval(self, values: Parameters7) -> int:
        number = _whole(values[0], 0, (1 << 24) - 1)
        return ACCEPTED if number is not None and self._downlink.set_interval(number, values[1]) else DENIED

    def _request_capabilities(self, values: Parameters7) -> int:
        del values
        self._send_version()
        return ACCEPTED

    def _request_message(self, values: Parameters7) -> int:
        number = _whole(values[0], 0, (1 << 24) - 1)
        if number == m.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            self._send_version()
        elif number == m.MAVLINK_MSG_ID_AVAILABLE_MODES:
            return self._send_modes(_whole(values[1], 0, len(_MODES)))
        elif number == m.MAVLINK_MSG_ID_CURRENT_MODE:
            self.send_current_mode()
        elif number is None or not self._downlink.send_once(number):
            return DENIED
        return ACCEPTED

    def _send_version(self) -> None:
        self._out.send(_AUTOPILOT_VERSION, _CAPABILITIES, VERSION, 0, 0, 0, *_NO_CUSTOM_VERSIONS, 0, 0, 1, *_NO_UID2)

    def _send_modes(self, wanted: int | None) -> int:
        if wanted is None:
            return DENIED
        for index, mode, name, selectable in _MODES:
            if wanted in (0, index):
                properties = 0 if selectable else m.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
                self._out.send(_AVAILABLE_MODES, len(_MODES), index, 0, mode, properties, name)
        return ACCEPTED

    def send_current_mode(self) -> None:
        """CURRENT_MODE."""
        mode = int(self._loop.out[self._mode_at])
        self._out.send(_CURRENT_MODE, 0, mode, mode)


def _whole(value: float, low: int, high: int) -> int | None:
    """The whole number that a parameter stands for, or None where it is none or out of range."""
    if not math.isfinite(value) or value != int(value) or not low <= value <= high:
        return None
    return int(value)
