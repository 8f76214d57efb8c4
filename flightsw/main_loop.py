"""The loop: one tick, top to bottom.

    take orders -> drain the bus -> assemble epochs -> navigate -> publish -> alert -> telemetry -> mark the tick

Everything else (writing logs, reopening a bus) is slack: it runs after the tick, while there is time.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from flightsw.can_port import CanPort
from flightsw.checkpoint import CheckpointWriter, Resume
from flightsw.clock import Clock
from flightsw.events import EventRing
from flightsw.icd.alerts import AlertId
from flightsw.icd.certificate import open_certificate
from flightsw.icd.enums import REJECT_CAUSES, Certificate, FlagState, RejectCause, Validity, Verdict
from flightsw.icd.table_file import TableImage
from flightsw.icd.table_schema import SCHEMAS
from flightsw.journal import BUS_LOST, BUS_REOPENED, TABLE_SWAPPED, Journal
from flightsw.link.access import Access
from flightsw.link.downlink import Downlink, Prediction
from flightsw.link.ground_link import GroundLink
from flightsw.link.mavlink_out import MavlinkOut, Sink
from flightsw.link.telemetry import Telemetry
from flightsw.link.uplink import Port
from flightsw.memory import Memory
from flightsw.nav.step import step
from flightsw.orders import NO_STATE, Orders
from flightsw.publishing import Publisher
from flightsw.records import OUTPUT
from flightsw.records_io import RecordReader
from flightsw.schedule import Member, Schedule
from flightsw.sensing.can_receiver import CanReceiver
from flightsw.sensing.epoch_assembly import EpochAssembly
from flightsw.services import Function, Services
from flightsw.tables.service import TableService

_BUS_ERROR = int(RejectCause.BUS_ERROR)
_DISARMED_BIT = 1 << int(AlertId.FLAG_DISARMED)
_BUS_OFF_BIT = 1 << int(AlertId.BUS_OFF)
_TRUSTING = (int(Verdict.TRUSTED), int(Verdict.TRUSTED_COASTING))
_SLIP_BIT = 1 << int(AlertId.TICK_SLIP)
_NO_UPLOAD = NO_STATE[0]
_UNCERTIFIED_BIT = 1 << int(AlertId.TABLE_UNCERTIFIED)


class MainLoop:
    """Flight's cyclic executive. `run` ticks for ever or so many times; nothing in a tick grows, logs or waits."""

    def __init__(
        self,
        clock: Clock,
        port: CanPort,
        journal: Journal,
        sink: Sink,
        memory: Memory,
        navigation: TableImage,
        unix_start_ns: int,
    ) -> None:
        self.clock = clock
        self.port = port
        self.journal = journal
        self.memory = memory
        certificate = open_certificate(navigation, None)
        self.certificate = int(certificate.grade if certificate is not None else Certificate.UNCERTIFIED)
        self.resume: Resume | None = None  # a state of before the restart, until onboard time is known
        self.checkpoints: CheckpointWriter | None = None
        self.counter_start_ns = clock.counter_ns()
        self.counter_ns = self.counter_start_ns
        self.anchor(unix_start_ns)
        self.tick = 0
        self.slips = 0
        self.out_reader = RecordReader(memory.output)
        self.out = self.out_reader.read()
        self.rejected = [0] * REJECT_CAUSES
        self._rejected_nav = memory.nav["rejected"][0]
        self.fix_input = memory.input
        self._told_reader = RecordReader(self.fix_input)
        self._fix = RecordReader(np.zeros(1, OUTPUT)).read()  # until there was one
        self._ahead_reader = RecordReader(memory.ahead)
        self.alerts = 0
        self._happened = 0
        self._slipped = False
        self._noted = 0  # alerts of what happens between ticks, told with the next one
        self.tables: TableService | None = None
        self.ground: GroundLink | None = None
        self.armed = True  # a raised flag withdraws the state
        self.restart = False  # the ground wants flight to end and be started again
        self.prediction = Prediction()
        self.require_certificate = False  # an uncertified table's state is then offered to nobody
        self.verdict, self.validity = int(Verdict.NOT_READY), 0
        table = memory.table[0]
        self.period_ns = int(table["tick_period_ns"])
        self._ahead_steps = int(table["ahead_steps"])
        self._assembly = EpochAssembly(self.rejected)
        self.orders = Orders(self, self._assembly)
        self.receiver = CanReceiver(port, journal, self._assembly, self.rejected)
        self.receiver.drain_limit = int(table["drain_frames_max"])
        port.tell = lambda lost: journal.bus(self.unix_ns(), BUS_LOST if lost else BUS_REOPENED)
        self.link = MavlinkOut(sink, journal, self.unix_ns)
        schema = SCHEMAS[navigation.kind]
        self.telemetry = Telemetry(
            self.link, self.out_reader, navigation.crc32, schema.hash, navigation.set_name.encode(), self.certificate
        )
        rates = ("nav_state", "status", "counters", "table_status")
        self.downlink = Downlink(
            self.telemetry,
            self,
            {name.partition("_")[0]: int(table[f"rate_{name}_ticks"]) for name in rates},
            schema.number,
            self.period_ns,
        )
        self.publisher = Publisher(port, journal, self.out_reader)
        self.events = EventRing(self._announce)
        self._functions: list[Function] = []
        self.schedule = Schedule(
            [
                Member("receive", 1, 200.0, self._receive),
                Member("orders", 1, 500.0, self._take_orders),
                Member("navigate", 1, 100.0, self._navigate),
                Member("publish", 1, 100.0, self._publish),
                Member("alert", 1, 100.0, self._alert),
                Member("time_to_flag", int(table["rate_status_ticks"]), 100.0, self._time_to_flag),
                Member("telemetry", 1, 500.0, self.downlink.run),
                Member("answer", 1, 500.0, self._answer),
                Member("mark", 1, 50.0, self._mark),
            ],
            [
                Member("look_ahead", 1, 2000.0, self._look_ahead),
                Member("journal", 1, 2000.0, journal.write_slice),
                Member("bus", 1, 2000.0, port.reopen),
            ],
            1000.0,
        )

    # -- the members, in order

    def _receive(self) -> None:
        self._assembly.begin(self.counter_ns)
        self.receiver.drain(self.unix_ns())

    def _take_orders(self) -> None:
        if self.ground is not None:
            self.ground.receive()

    def _navigate(self) -> None:
        memory, assembly = self.memory, self._assembly
        self._happened = 0
        for index in range(max(assembly.count, 1)):
            call = assembly.calls[index]
            step(
                memory.nav,
                call,
                memory.table,
                memory.orientation,
                memory.forces,
                memory.field,
                memory.work,
                memory.scratch,
                memory.output,
            )
            self.out = out = self.out_reader.read()
            at = self.out_reader.at
            self._happened |= int(out[at["events"]])
            if out[at["upload_cause"]] != _NO_UPLOAD:
                self.orders.outcome = (int(out[at["upload_cause"]]), float(out[at["upload_nis"]]))
            if out[at["fix_seen"]]:
                self.fix_input[:] = call
                self._fix = out
        if self.resume is not None and self.resume.pending and memory.nav["clock_valid"][0]:
            self.resume.settle(memory.nav, int(self.out[self.out_reader.at["t_gps_ns"]]))

    def _publish(self) -> None:
        out, at = self.out, self.out_reader.at
        alerts = int(out[at["alerts"]])
        if self.certificate == Certificate.UNCERTIFIED:
            alerts |= _UNCERTIFIED_BIT
        if self.port.is_off:
            alerts |= _BUS_OFF_BIT
        if not self.armed:
            alerts |= _DISARMED_BIT
        for function in self._functions:
            alerts |= function.conditions
            self._happened |= function.happened
        self.alerts = alerts
        self.verdict, self.validity = self._judge(int(out[at["verdict"]]), int(out[at["validity"]]))
        nis = self._fix[at["nis"]]
        self.publisher.state(self.unix_ns(), out, nis, alerts, self.certificate, self.verdict, self.validity)

    def _judge(self, verdict: int, validity: int) -> tuple[int, int]:
        """Verdict and validity as they are published: the step's, which knows no table without a certificate.

        Such a table is never trusted in words. Its state stays valid for those who fly it, unless told otherwise.
        """
        if verdict in _TRUSTING and self.certificate == Certificate.UNCERTIFIED:
            verdict = int(Verdict.NOT_CERTIFIED)
            if self.require_certificate:
                validity &= ~int(Validity.STATE_VALID)
        if not self.armed:  # nobody guards the state: it is offered, but never called trusted
            if verdict in _TRUSTING:
                verdict = int(Verdict.NOT_CERTIFIED)
            if self.out[self.out_reader.at["flag"]] == FlagState.RAISED and validity & Validity.INITIALISED:
                validity |= int(Validity.STATE_VALID)
        return verdict, validity

    def _alert(self) -> None:
        if self._slipped:
            self._happened |= _SLIP_BIT
            self._slipped = False
        self._happened |= self._noted
        self._noted = 0
        out, at = self.out, self.out_reader.at
        self.events.note(int(out[at["t_gps_ns"]]), self._happened, self.alerts, out[at["bound_m"]])

    def _announce(self, sequence: int, t_gps_ns: int, alert_id: int, active: int, value: float) -> None:
        self.telemetry.alert(sequence, t_gps_ns, alert_id, active, value)
        if self.ground is not None:
            self.ground.alerts.note(sequence, t_gps_ns, alert_id, active, value)

    def _answer(self) -> None:
        if self.ground is not None:
            self.ground.answer()

    def _time_to_flag(self) -> None:
        ahead, at = self._ahead_reader.read(), self._ahead_reader.at
        out, place = self.out, self.out_reader.at
        t_gps_ns = int(out[place["t_gps_ns"]])
        left_s = age_s = math.nan
        if ahead[at["valid"]]:
            left_s = max(0.0, (ahead[at["t_flag_gps_ns"]] - t_gps_ns) * 1e-9)
            age_s = (t_gps_ns - ahead[at["t_result_gps_ns"]]) * 1e-9
            if out[place["outage_age_s"]] == 0.0:
                left_s += age_s  # what was predicted for a loss then holds for a loss now
        governing = int(ahead[at["governing"]])
        lost = 1 if out[place["outage_age_s"]] > 0.0 else 0
        self.publisher.time_to_flag(self.unix_ns(), t_gps_ns, left_s, age_s, governing, lost)
        self.prediction = Prediction(t_gps_ns, left_s, age_s, governing, lost)

    # -- in the slack

    def _look_ahead(self) -> None:
        self.memory.predict(self.counter_ns, self._ahead_steps)

    # -- last

    def _mark(self) -> None:
        mode = int(self.out[self.out_reader.at["mode"]])
        self.publisher.heartbeat(self.unix_ns(), self.tick, self.counter_ns, self.slips, self.rejections(), mode)

    # -- accounts

    def count_slips(self, count: int) -> None:
        """Enter ticks that did not begin when they should have; the alert goes out with the next tick."""
        self.slips += count
        self._slipped = True

    def anchor(self, unix_ns: int) -> None:
        """Set the log time of the first tick, in whole microseconds as the logs hold it."""
        self.unix_start_ns = unix_ns // 1000 * 1000

    def unix_ns(self) -> int:
        """Log time: Unix UTC, anchored once to the counter at the first tick and never stepped afterwards."""
        return self.unix_start_ns + self.counter_ns - self.counter_start_ns

    def rejected_by_cause(self) -> list[int]:
        """Rejections since start, by RejectCause: of frames and of what they carried."""
        counts = [frames + int(content) for frames, content in zip(self.rejected, self._rejected_nav, strict=True)]
        counts[_BUS_ERROR] += self.port.errors
        return counts

    def rejections(self) -> int:
        """All rejections since start."""
        return sum(self.rejected) + int(self._rejected_nav.sum()) + self.port.errors

    def keep_checkpoints(self, writer: CheckpointWriter) -> None:
        """Write checkpoints in the slack from now on."""
        self.checkpoints = writer
        self.schedule.add_slack(Member("checkpoint", 1, 2000.0, writer.write_slice))

    def fix(self) -> tuple[float, ...]:
        """The output record of the step that took the last fix."""
        return self._fix

    def fix_told(self) -> tuple[float, ...]:
        """The input record of that step."""
        return self._told_reader.read()

    def listen(self, port: Port, access: Access, folder: Path | None, log: Path | None = None) -> None:
        """Take orders from the ground from now on. folder: of parameters and uploads. log: what it may read."""
        self.ground = GroundLink(
            port,
            access,
            self.link,
            self.telemetry,
            self.downlink,
            self.events,
            self.orders,
            self.memory.table,
            self.out_reader.at["mode"],
            folder,
            log,
        )
        self.schedule.add_slack(Member("ground_link", 1, 5000.0, self.ground.work_slice))

    def services(self) -> Services:
        """What a function works with."""
        return Services(
            self.receiver,
            self._assembly,
            self.publisher,
            self.downlink,
            self.link,
            self.unix_ns,
            lambda: self.counter_ns,
            lambda: self.out,
            self.out_reader.at,
        )

    def add_function(self, function: Function) -> None:
        """Run a function in every tick from now on, after the bus was drained and before navigation."""
        self._functions.append(function)
        self.events.values.update(function.values)
        self.schedule.insert_before("navigate", Member(function.name, 1, function.budget_us, function.run))

    # -- tables

    def keep_tables(self, service: TableService) -> None:
        """Take new navigation tables from now on."""
        self.tables = service
        self.schedule.add_slack(Member("tables", 1, 5000.0, self._table_slice))

    def _table_slice(self) -> None:
        if self.tables is not None:
            self.tables.work_slice(int(self.out[self.out_reader.at["t_gps_ns"]]))

    def note(self, alert: AlertId) -> None:
        """Tell this with the next tick."""
        self._noted |= 1 << int(alert)

    def fly_table(self, table: TableImage, nav_row_last: int) -> None:
        """Swap the navigation table, between two ticks; its period and rates of the grid are those of the old one."""
        memory = self.memory
        memory.load_navigation(table.values)
        memory.nav["row"] = min(int(memory.nav["row"][0]), nav_row_last)
        certificate = open_certificate(table, None)
        memory.load_envelope(certificate.values if certificate is not None else None)
        self.certificate = int(certificate.grade if certificate is not None else Certificate.UNCERTIFIED)
        record = memory.table[0]
        self._ahead_steps = int(record["ahead_steps"])
        self.receiver.drain_limit = int(record["drain_frames_max"])
        schema = SCHEMAS[table.kind]
        self.telemetry.name_table(table.crc32, schema.hash, table.set_name.encode(), self.certificate)
        if self.checkpoints is not None:
            self.checkpoints.belongs_to(table.crc32)
        self.journal.bus(self.unix_ns(), TABLE_SWAPPED)

    # -- the cycle

    def run_tick(self) -> None:
        """One tick at the clock's present reading."""
        self.counter_ns = self.clock.counter_ns()
        if self.tick == 0:
            self.counter_start_ns = self.counter_ns
        if self.tables is not None:
            at = self.out_reader.at
            self.tables.between_ticks(int(self.out[at["flag"]]), self.out[at["bound_m"]], self._happened)
        self.schedule.run_tick(self.tick)
        self.tick += 1

    def run(self, ticks: int | None = None) -> None:
        """Tick at fixed steps of the counter from now on. A late tick is counted as a slip, never caught up."""
        deadline_ns = self.clock.counter_ns()
        last = None if ticks is None else self.tick + ticks
        while (last is None or self.tick < last) and not self.restart:
            self.clock.wait_until(deadline_ns)
            self.run_tick()
            self.schedule.wake.account(max(0, self.counter_ns - deadline_ns))
            deadline_ns += self.period_ns
            self.rest(deadline_ns)
            late_ns = self.clock.counter_ns() - deadline_ns
            if late_ns > 0 and not self.clock.lockstep:
                missed = late_ns // self.period_ns + 1
                self.count_slips(missed)
                deadline_ns += (missed - 1) * self.period_ns

    def rest(self, deadline_ns: int) -> None:
        """The slack of a tick: until the deadline, or in lockstep one slice of every job."""
        if self.clock.lockstep:
            self.schedule.run_slack(_always)
        else:
            self.schedule.run_slack(lambda: self.clock.counter_ns() < deadline_ns)


def _always() -> bool:
    return True
