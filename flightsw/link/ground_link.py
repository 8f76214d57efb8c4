"""The two-way link as the loop sees it: take orders at the beginning of a tick, answer and repeat at its end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from flightsw.events import EventRing
from flightsw.icd import mavlink as m
from flightsw.link.access import Access
from flightsw.link.commands import Commanded, Commands
from flightsw.link.downlink import Downlink
from flightsw.link.file_transfer import FileTransfer
from flightsw.link.mavlink_out import SYSTEM_ID, MavlinkOut
from flightsw.link.message_layout import MessageLayout
from flightsw.link.open_alerts import OpenAlerts
from flightsw.link.parameters import Parameters
from flightsw.link.state_upload import StateUpload, Uploaded
from flightsw.link.telemetry import Telemetry
from flightsw.link.uplink import Port, Sender, Uplink

PARAMETERS_FILE = "parameters.txt"
UPLOAD_FOLDER = "upload"
UPLOADED_TABLE = "navigation.tbl"
_STATE_FILE_SLICES = 10
_REPORT_NS = 10_000_000_000
_TEXT = 50
_STATUSTEXT = MessageLayout(m.MAVLink_statustext_message)
_TIMESYNC = MessageLayout(m.MAVLink_timesync_message)
_NS_PER_S = 1_000_000_000


class Linked(Commanded, Uploaded, Protocol):
    """What the link needs of the loop. `upload`: the file of a table that was sent up."""

    upload: Path | None

    @property
    def armed(self) -> bool:
        """Whether a raised flag withdraws the state."""
        ...

    @property
    def counter_ns(self) -> int:
        """The onboard counter at this tick."""
        ...

    def unix_ns(self) -> int:
        """Log time of the tick."""
        ...

    def note_refused_orders(self) -> None:
        """Tell with the next tick that orders were refused."""
        ...

    def table_state(self) -> int:
        """0 nothing new, 1 a table is staged, 2 the active one is on trial."""
        ...

    def table_reason(self) -> str:
        """Why the last table was refused or rolled back."""
        ...

    def active_table(self) -> bytes:
        """The table that flies, as a file."""
        ...

    def work_slice(self) -> None:
        """Go on with what was ordered, in the slack."""
        ...


class GroundLink:
    """Uplink, commands, parameters, files and what is told of them.

    folder: where parameters are kept and uploads go; None: nowhere. log: folder of what may be read. table: the
    navigation record (1,) that flies.
    """

    def __init__(
        self,
        port: Port,
        access: Access,
        out: MavlinkOut,
        telemetry: Telemetry,
        downlink: Downlink,
        events: EventRing,
        loop: Linked,
        table: np.ndarray,
        mode_at: int,
        folder: Path | None,
        log: Path | None = None,
    ) -> None:
        self._port = port
        self.access = access
        self._out = out
        self._telemetry = telemetry
        self._events = events
        self._loop = loop
        self.alerts = OpenAlerts(telemetry, events)
        self.parameters = Parameters(out, table, folder / PARAMETERS_FILE if folder is not None else None)
        upload = folder / UPLOAD_FOLDER if folder is not None else None
        loop.upload = upload / UPLOADED_TABLE if upload is not None else None
        self.files = FileTransfer(out, log, upload, loop.active_table, lambda: self.parameters.value("LNK_FTP_TICK"))
        self.commands = Commands(out, loop, downlink, self.alerts, mode_at)
        self.states = StateUpload(out, loop)
        self.uplink = Uplink(port, access, SYSTEM_ID, m.MAV_COMP_ID_AUTOPILOT1, out.note_received)
        self.take_in: Callable[[int], None] = self.uplink.poll  # a replay has the frames of the run
        self.jobs: list[Callable[[], None]] = [
            self._keep_ahead,
            self.parameters.save_slice,
            loop.work_slice,
            self.files.work_slice,
        ]
        self._reported_orders = 0
        self._reported_ns = -_REPORT_NS
        self._reason = ""
        self._text_id = 0
        self._slices = 0
        for number, handler, order in (
            (m.MAVLINK_MSG_ID_HEARTBEAT, _nothing, False),
            (m.MAVLINK_MSG_ID_PARAM_REQUEST_LIST, self.parameters.request_list, False),
            (m.MAVLINK_MSG_ID_PARAM_REQUEST_READ, self.parameters.request_read, False),
            (m.MAVLINK_MSG_ID_PARAM_SET, self.parameters.set, True),
            (m.MAVLINK_MSG_ID_COMMAND_LONG, self.commands.take_long, True),
            (m.MAVLINK_MSG_ID_COMMAND_INT, self.commands.take_int, True),
            (m.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL, self.files.take, True),
            (m.MAVLINK_MSG_ID_TIMESYNC, self._timesync, True),
            (m.MAVLINK_MSG_ID_LEONAV_STATE_UPLOAD, self.states.take, True),
        ):
            self.uplink.take(number, handler, order)
        downlink.add(m.MAVLINK_MSG_ID_LEONAV_LINK, "status", self._send_link)
        downlink.add(m.MAVLINK_MSG_ID_LEONAV_TIMING, "status", downlink.timing)
        downlink.add(m.MAVLINK_MSG_ID_CURRENT_MODE, "status", self.commands.send_current_mode)

    # -- in the tick

    def receive(self) -> None:
        """Take orders; the first thing of a tick, so that they hold for its navigation step."""
        unix_ns = self._loop.unix_ns()
        self._out.sign(self.access.signing_key, self.access.now(unix_ns))
        self.take_in(unix_ns)

    def answer(self) -> None:
        """Repeat what is not acknowledged, go on with lists, report refusals."""
        loop = self._loop
        now_ns = loop.counter_ns
        self.states.answer()
        self.alerts.repeat(now_ns, int(self.parameters.value("LNK_REPEAT_S") * _NS_PER_S))
        self.parameters.send_some()
        if self.uplink.refused_orders != self._reported_orders and now_ns - self._reported_ns >= _REPORT_NS:
            self._reported_orders, self._reported_ns = self.uplink.refused_orders, now_ns
            loop.note_refused_orders()
        if loop.table_reason() is not self._reason:
            self._reason = loop.table_reason()
            self.say(m.MAV_SEVERITY_NOTICE, f"table {self._reason}" if self._reason else "")

    def say(self, severity: int, text: str) -> None:
        """STATUSTEXT, in pieces where it is longer than one holds."""
        raw = text.encode("ascii", "replace")[: 8 * _TEXT]
        if len(raw) <= _TEXT:
            if raw:
                self._out.send(_STATUSTEXT, severity, raw, 0, 0)
            return
        self._text_id = self._text_id % 0xFFFF + 1
        for piece in range(-(-len(raw) // _TEXT)):
            part = raw[piece * _TEXT : (piece + 1) * _TEXT]
            self._out.send(_STATUSTEXT, severity, part, self._text_id, piece)

    def _timesync(self, message: Any, sender: Sender) -> None:
        del sender
        if message.tc1 == 0:
            self._out.send(_TIMESYNC, self._loop.unix_ns(), message.ts1)

    def _send_link(self) -> None:
        uplink = self.uplink
        self._telemetry.link(
            self._events.sequence,
            uplink.accepted,
            self._port.lost,
            uplink.refused,
            self.alerts.bits,
            (int(self.access.bench), int(self._loop.armed), self._loop.table_state()),
        )

    # -- in the slack

    def work_slice(self) -> None:
        """What waits for the disk."""
        for job in self.jobs:
            job()

    def _keep_ahead(self) -> None:
        self._slices += 1
        if self._slices % _STATE_FILE_SLICES == 1:
            self.access.keep_ahead(self._loop.unix_ns())


def _nothing(message: Any, sender: Sender) -> None:
    """A heartbeat of the ground: that it came is all it says."""
    del message, sender
