"""What the console sends: commands that are repeated until acknowledged, parameters, files. No socket, no screen.

Every order leaves a line for the event log when it is sent, and one when it is answered, or has not been.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple

from flightsw.icd import mavlink as m
from flightsw.icd.enums import RejectCause
from ground.console.authentication import Verifier
from ground.console.opm import GivenState
from ground.console.text import safe
from ground.console.transfer import Download, Transfer, Upload

SYSTEM, COMPONENT = 255, m.MAV_COMP_ID_MISSIONPLANNER
FLIGHT = (1, m.MAV_COMP_ID_AUTOPILOT1)
REPEAT_S = 1.0
TRIES = 5
HEARTBEAT_S = 1.0
TABLE_PATH = "/upload/navigation.tbl"
ACTIVE_PATH = "/upload/active.tbl"
STATE_TAKEN = 255  # LEONAV_STATE_RESULT.cause
RESULTS = {
    m.MAV_RESULT_ACCEPTED: "accepted",
    m.MAV_RESULT_TEMPORARILY_REJECTED: "rejected: not now",
    m.MAV_RESULT_DENIED: "denied: not valid",
    m.MAV_RESULT_UNSUPPORTED: "not supported by this flight",
    m.MAV_RESULT_FAILED: "failed",
}

Note = Callable[[int, str], None]


class _State(NamedTuple):
    given: GivenState
    label: str
    sequence: int
    due_s: float
    tries: int
    then: Callable[[bool], None]


class _Order(NamedTuple):
    label: str
    values: tuple[float, ...]
    due_s: float
    tries: int
    then: Callable[[bool], None] | None


class Operator:
    """The operator's end. send: takes a frame. note: takes severity and text. verifier None: nothing is signed."""

    def __init__(self, send: Callable[[bytes], None], verifier: Verifier | None, note: Note) -> None:
        self._send = send
        self._verifier = verifier
        self._note = note
        self._mav = m.MAVLink(self, srcSystem=SYSTEM, srcComponent=COMPONENT, use_native=False)
        if verifier is not None:
            self._mav.signing.secret_key = verifier.signing_key
            self._mav.signing.sign_outgoing = True
        self._orders: dict[int, _Order] = {}
        self._beat_s = -HEARTBEAT_S
        self._state: _State | None = None
        self._states = 0
        self.transfer: Transfer | None = None
        self._label = ""
        self._then: Callable[[Transfer], None] | None = None
        self.parameters: dict[str, tuple[int, float]] = {}
        self.parameter_count = 0
        self.table_read: bytes = b""

    def write(self, frame: bytes | bytearray) -> None:
        """Called by pymavlink with every packed frame."""
        self._send(bytes(frame))

    def _pack(self) -> Any:
        if self._verifier is not None:
            self._mav.signing.timestamp = self._verifier.next_stamp()
        return self._mav

    # -- orders

    def command(
        self, number: int, values: tuple[float, ...], label: str, then: Callable[[bool], None] | None = None
    ) -> None:
        """Send a command until it is acknowledged. then: called with whether it was accepted."""
        self._orders[number] = _Order(label, values, -1.0, 0, then)

    def acknowledge(self, sequence: int, label: str, then: Callable[[bool], None]) -> None:
        """Tell flight that the alert of this number was seen."""
        self.command(m.LEONAV_CMD_ACKNOWLEDGE_ALERT, (float(sequence),), label, then)

    def request_events(self, first: int, last: int) -> None:
        """Ask for events that were lost."""
        if m.LEONAV_CMD_REQUEST_EVENTS not in self._orders:
            self.command(m.LEONAV_CMD_REQUEST_EVENTS, (float(first), float(last)), f"events {first} to {last} again")

    def upload_state(self, given: GivenState, label: str, then: Callable[[bool], None]) -> None:
        """Send a state until flight says what it made of it. then: called with whether it was taken."""
        self._states += 1
        sequence = zlib.crc32(repr((given, self._states)).encode())  # another console's answer is not taken for ours
        self._state = _State(given, label, sequence, -1.0, 0, then)

    def list_parameters(self) -> None:
        """Ask for all parameters."""
        self.parameters.clear()
        self._pack().param_request_list_send(*FLIGHT)

    def set_parameter(self, name: str, value: float) -> None:
        """Ask flight to set one; its echo says what holds."""
        self._note(6, f"parameter {name} = {value:g} sent")
        self._pack().param_set_send(*FLIGHT, name.encode("ascii"), value, m.MAV_PARAM_TYPE_REAL32)

    def upload_table(self, data: bytes, label: str) -> None:
        """Send a table up; once it is there whole, have it validated and staged."""
        self._begin(Upload(self._send_file, TABLE_PATH, data), label, self._stage)

    def read_table(self) -> None:
        """Read the table that flies back; `table_read` holds it."""
        self._begin(Download(self._send_file, ACTIVE_PATH), "table read back", self._keep)

    def _stage(self, done: Transfer) -> None:
        if not done.error:
            self.command(m.LEONAV_CMD_TABLE_STAGE, (0.0,), "validate and stage the table")

    def _keep(self, done: Transfer) -> None:
        if isinstance(done, Download) and not done.error:
            self.table_read = done.content

    def _begin(self, transfer: Transfer, label: str, then: Callable[[Transfer], None]) -> None:
        self.transfer, self._label, self._then = transfer, label, then
        self._note(6, f"{label}: begun")

    def _send_file(self, payload: bytes) -> None:
        self._pack().file_transfer_protocol_send(0, *FLIGHT, payload)

    # -- time and answers

    def step(self, now_s: float) -> None:
        """Send what is due."""
        if now_s - self._beat_s >= HEARTBEAT_S:
            self._beat_s = now_s
            self._pack().heartbeat_send(m.MAV_TYPE_GCS, m.MAV_AUTOPILOT_INVALID, 0, 0, m.MAV_STATE_ACTIVE)
        for number, order in list(self._orders.items()):
            if now_s < order.due_s:
                continue
            if order.tries >= TRIES:
                del self._orders[number]
                self._note(3, f"{order.label}: flight does not answer; nothing is known of it")
                if order.then is not None:
                    order.then(False)
                continue
            if order.tries == 0:
                self._note(6, f"{order.label}: sent")
            self._orders[number] = order._replace(due_s=now_s + REPEAT_S, tries=order.tries + 1)
            values = (*order.values, *(0.0,) * (7 - len(order.values)))
            self._pack().command_long_send(*FLIGHT, number, order.tries, *values)
        self._step_state(now_s)
        if self.transfer is not None:
            self.transfer.step(now_s)
            if self.transfer.done:
                done, self.transfer = self.transfer, None
                self._note(3 if done.error else 5, f"{self._label}: {done.error or f'{done.total} bytes, checked'}")
                if self._then is not None:
                    self._then(done)

    def _step_state(self, now_s: float) -> None:
        state = self._state
        if state is None or now_s < state.due_s:
            return
        if state.tries >= TRIES:
            self._state = None
            self._note(3, f"{state.label}: flight does not answer; nothing is known of it")
            state.then(False)
            return
        if state.tries == 0:
            self._note(6, f"{state.label}: sent")
        self._state = state._replace(due_s=now_s + REPEAT_S, tries=state.tries + 1)
        given = state.given
        self._pack().leonav_state_upload_send(
            given.t_gps_ns, given.state, given.covariance, state.sequence, *FLIGHT, int(given.frame)
        )

    def take(self, message: Any) -> None:
        """Something was heard from flight."""
        kind = message.get_type()
        if kind == "COMMAND_ACK" and message.target_system in (0, SYSTEM):
            order = self._orders.pop(int(message.command), None)
            if order is not None:
                accepted = message.result == m.MAV_RESULT_ACCEPTED
                words = RESULTS.get(message.result, f"result {message.result}")
                self._note(5 if accepted else 4, f"{order.label}: {words}")
                if order.then is not None:
                    order.then(accepted)
        elif kind == "LEONAV_STATE_RESULT":
            if self._state is not None and message.sequence == self._state.sequence:
                state, self._state = self._state, None
                taken, said = state_answer(int(message.cause), float(message.nis))
                self._note(5 if taken else 4, f"{state.label}: {said}")
                state.then(taken)
        elif kind == "PARAM_VALUE":
            self.parameters[safe(message.param_id, 16)] = (int(message.param_index), float(message.param_value))
            self.parameter_count = int(message.param_count)
        elif kind == "FILE_TRANSFER_PROTOCOL" and self.transfer is not None and message.target_system == SYSTEM:
            self.transfer.take(message)


def state_answer(cause: int, nis: float) -> tuple[bool, str]:
    """Whether a state was taken, and flight's answer in words."""
    distance = "" if math.isnan(nis) else f", NIS {nis:.1f} (6 degrees of freedom)"
    if cause == STATE_TAKEN:
        return True, f"taken{distance}; not certified until fixes are back"
    name = RejectCause(cause).name if cause in {int(each) for each in RejectCause} else f"cause {cause}"
    return False, f"refused: {name}{distance}"
