"""The inter-satellite monitor in the loop: complete epochs from the bus, one verdict each, alerts, frame and message.

It judges what the satellites broadcast, its own among them, and not what navigation knows: a wrong upload is wrong
however well the satellite navigates (docs/adr/0018).

The tick that completes an epoch takes it over, the next one judges it and says so, or the one after that where somebody
is to be sought; those that follow look back, a step a tick, and say so where that has found something. An epoch that
comes before the last one is through waits for nothing: what is left of that one is done at once.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flightsw.crosslink.majority import NO_VERDICT, UNRELIABLE
from flightsw.crosslink.monitor import monitor_step
from flightsw.crosslink.own import FAULT, SUSPECT
from flightsw.crosslink.records import LINKS, SATELLITES
from flightsw.crosslink.setup import MonitorMemory, Settings
from flightsw.icd import mavlink as m
from flightsw.icd.alerts import AlertId
from flightsw.icd.can_frames import CROSSLINK_EPHEMERIS, CROSSLINK_RANGES, CROSSLINK_STATUS
from flightsw.icd.crosslink_schema import MAX_CROSSLINK_SATELLITES
from flightsw.icd.enums import CrosslinkMajority, CrosslinkState, Validity
from flightsw.icd.table_file import TableImage
from flightsw.link.message_layout import MessageLayout
from flightsw.publishing import Outbox
from flightsw.records_io import RecordReader
from flightsw.sensing.crosslink_assembly import CrosslinkAssembly
from flightsw.services import Services

OWN_FAULT = 1 << int(AlertId.CROSSLINK_OWN_FAULT)
OWN_SUSPECT = 1 << int(AlertId.CROSSLINK_OWN_SUSPECT)
NEIGHBOUR_FAULTY = 1 << int(AlertId.CROSSLINK_NEIGHBOUR_FAULTY)
MAJORITY = 1 << int(AlertId.CROSSLINK_MAJORITY)
UNMONITORED = 1 << int(AlertId.CROSSLINK_UNMONITORED)
NEIGHBOUR_SILENT = 1 << int(AlertId.CROSSLINK_NEIGHBOUR_SILENT)
_SILENCE_NS = 1_000_000_000  # without an epoch the status goes out so often, and with what age
_NOBODY = 255
_CROSSLINK = MessageLayout(m.MAVLink_leonav_crosslink_message)
_STATES = {SUSPECT: int(CrosslinkState.SUSPECT), FAULT: int(CrosslinkState.FAULT)}
_AXES = ("radial", "along", "cross", "clock")


def settings_of(values: np.ndarray) -> Settings:
    """What a monitor is built from, out of the values (1,) of a crosslink table. ValueError where they allow none."""
    record = values[0]
    sigma = [float(record[f"sigma_{axis}_m"]) for axis in _AXES]
    rate = [float(record[f"sigma_{axis}_rate_mps"]) for axis in _AXES]
    return Settings(
        satellites=int(record["satellites"]),
        own=int(record["own"]),
        two_way=bool(record["two_way"]),
        both=bool(record["both"]),
        sigma_range_m=float(record["sigma_range_m"]),
        sigma_m=(sigma[0], sigma[1], sigma[2], sigma[3]),
        sigma_rate_mps=(rate[0], rate[1], rate[2], rate[3]),
        p_false_alarm=float(record["p_false_alarm"]),
        slow_share=float(record["slow_share"]),
        p_clear=float(record["p_clear"]),
        clear_epochs=int(record["clear_epochs"]),
        faulty_max=int(record["faulty_max"]),
        epoch_s=float(record["epoch_s"]),
        block_epochs=int(record["block_epochs"]),
        onset_blocks=tuple(int(blocks) for blocks in record["onset_blocks"] if blocks),
    )


class CrosslinkFunction:
    """One monitor, fed by the bus. `conditions`, `happened`: alerts, as flightsw.services says."""

    name = "crosslink"
    budget_us = 1000.0  # an epoch that finds the last one unfinished, with 228 links; a step takes a third of it

    def __init__(self, table: TableImage, services: Services) -> None:
        self.conditions = self.happened = 0
        self.values = {
            int(AlertId.CROSSLINK_OWN_FAULT): self._own_ratio,
            int(AlertId.CROSSLINK_OWN_SUSPECT): self._own_ratio,
            int(AlertId.CROSSLINK_NEIGHBOUR_FAULTY): self._neighbour,
        }
        self.settings = settings_of(table.values)
        self.memory = MonitorMemory(self.settings)
        self.assembly = CrosslinkAssembly(table.values, services.assembly.rejected, self._now_gps_ns)
        self._arguments = self.memory.arguments()
        self._left = self.memory.verdict["left"]
        self._judged = self.memory.verdict["judged"]
        self._fresh = False  # an epoch was taken over and nothing of it is done yet
        self._seeking = False  # somebody is being sought in an epoch: nothing is told of it until that is known
        self._reader = RecordReader(self.memory.verdict)
        self._at = self._reader.at
        self._verdict: tuple[Any, ...] = self._reader.read()
        self._services = services
        self._gap_max_ns = round(float(table.values["gap_max_s"][0]) * 1e9)
        self._silence_ns = round(float(table.values["silence_max_s"][0]) * 1e9)
        self._own_bit = 1 << self.settings.own
        self._faulty = 0
        self._peer = -1  # neighbour that the own links could not be told from when they were in doubt
        self._begun_gps_ns = 0  # time of the last epoch, perhaps still under way
        self._judged_gps_ns = 0  # time of the epoch that was judged last
        self._judged_counter_ns = 0
        self._told_counter_ns = self._counter_ns = services.counter_ns()
        self._monitored_ns = [self._counter_ns] * self.settings.satellites  # counter when each was judged last
        self._everyone = (1 << self.settings.satellites) - 1
        self._met = 0  # mask of those that have ever been
        self._silent = 0  # mask of those that have not been for too long
        self._clock = (0, 0)  # onboard GPS time, 0 while it is not known, and the counter that it belongs to
        self._box = Outbox(CROSSLINK_STATUS)
        self._full = 3 if self.settings.two_way else 4
        self._threshold = float(self.memory.table["network_threshold"][0, self._full])
        self._own_threshold = float(self.memory.table["own_threshold"][0, self._full])
        services.receiver.listen(CROSSLINK_EPHEMERIS, self.assembly.take_ephemeris)
        services.receiver.listen(CROSSLINK_RANGES, self.assembly.take_ranges)
        services.downlink.add(m.MAVLINK_MSG_ID_LEONAV_CROSSLINK, "status", self._send_message)

    def run(self) -> None:
        """The next step of the epoch under way; what is judged is said on the bus at once."""
        self.happened = 0
        counter_ns = self._services.counter_ns()
        judged = False
        self.assembly.assemble()
        if self.assembly.ready:
            while self._fresh or self._left[0] > 0:
                judged |= self._advance(counter_ns)
            self.assembly.fill(self.memory.epoch)
            self._fresh = True
        elif self._fresh or self._left[0] > 0:
            judged = self._advance(counter_ns)
        if not judged:
            due = not self._seeking and counter_ns - self._told_counter_ns >= _SILENCE_NS
            if self._note_silence(counter_ns, 0) or due:
                self._publish(counter_ns)
        self._read_clock()
        self._counter_ns = counter_ns

    def _advance(self, counter_ns: int) -> bool:
        """One step of the monitor; whether it was the one that finished the judgement of an epoch."""
        if self._fresh:
            self._fresh = False
            self._begin()
        else:
            monitor_step(*self._arguments, 0)
        if self._judged[0]:
            self._seeking = False
            self._conclude()
            self._judged_gps_ns = self._begun_gps_ns
            self._judged_counter_ns = counter_ns
            self._note_silence(counter_ns, int(self._verdict[self._at["monitored"]]))
            self._publish(counter_ns)
            return True
        if not self._seeking:  # a step that looks back
            before = self._found()
            self._conclude()
            if self._found() != before:
                self._publish(counter_ns)
        return False

    def _note_silence(self, counter_ns: int, monitored: int) -> bool:
        """Alert the silence of satellites; monitored: mask of this tick's epoch. Whether one has just begun."""
        self._met |= monitored
        silent = 0
        for bit in range(self.settings.satellites):
            if monitored >> bit & 1:
                self._monitored_ns[bit] = counter_ns
            elif counter_ns - self._monitored_ns[bit] > self._silence_ns:
                silent |= 1 << bit
        neighbours = silent & self._met & ~self._own_bit
        self.conditions &= ~(UNMONITORED | NEIGHBOUR_SILENT)
        if silent & self._own_bit:
            self.conditions |= UNMONITORED
        if neighbours:
            self.conditions |= NEIGHBOUR_SILENT
        begun = silent & ~self._silent
        if self._silent & self._met & ~self._own_bit and begun & neighbours:
            self.happened |= NEIGHBOUR_SILENT  # one more
        self._silent = silent
        return begun != 0

    def _read_clock(self) -> None:
        """Navigation's last step was in the tick before this one, at the counter of that tick."""
        out, places = self._services.reading(), self._services.places
        known = int(out[places["validity"]]) & int(Validity.TIME_VALID)
        self._clock = (int(out[places["t_gps_ns"]]) if known else 0, self._counter_ns)

    def _now_gps_ns(self) -> int:
        t_gps_ns, counter_ns = self._clock
        return t_gps_ns + self._services.counter_ns() - counter_ns if t_gps_ns else 0

    def _begin(self) -> None:
        memory = self.memory
        t_gps_ns = int(memory.epoch["t_gps_ns"][0])
        if self._begun_gps_ns and not 0 < t_gps_ns - self._begun_gps_ns <= self._gap_max_ns:
            memory.history["since"] = memory.history["block"] + 1  # what was measured before the gap is of another time
        self._begun_gps_ns = t_gps_ns
        self._seeking = True
        monitor_step(*self._arguments, 1)

    def _found(self) -> tuple[Any, ...]:
        verdict, at = self._verdict, self._at
        return verdict[at["faulty"]], verdict[at["named"]], verdict[at["own_state"]]

    def _conclude(self) -> None:
        """Read the verdict as it is by now; alerts follow from it, silence apart."""
        self._verdict = verdict = self._reader.read()
        at = self._at
        faulty, named = int(verdict[at["faulty"]]), int(verdict[at["named"]])
        if verdict[at["own_peer"]] >= 0:
            self._peer = int(verdict[at["own_peer"]])
        own = int(verdict[at["own_state"]])
        self.conditions &= UNMONITORED | NEIGHBOUR_SILENT
        if own == FAULT or faulty & self._own_bit:
            self.conditions |= OWN_FAULT
        elif own == SUSPECT and not (self._peer >= 0 and faulty >> self._peer & 1):
            self.conditions |= OWN_SUSPECT  # not where the network has found whose error it was
        if faulty & ~self._own_bit:
            self.conditions |= NEIGHBOUR_FAULTY
        if verdict[at["majority_latched"]]:
            self.conditions |= MAJORITY
        if self._faulty & ~self._own_bit and named & ~self._own_bit & ~self._faulty:
            self.happened |= NEIGHBOUR_FAULTY  # one more
        self._faulty = faulty

    # -- what is told

    def _own_ratio(self) -> float:
        """Statistic of the own links over its threshold; NaN where it was not this test of this epoch that found it."""
        verdict, at = self._verdict, self._at
        dof = int(verdict[at["own_dof"]])
        ratio = float(verdict[at["own_statistic"]] / self.memory.table["own_threshold"][0, dof]) if dof > 0 else 0.0
        return ratio if ratio > 1.0 else math.nan

    def _neighbour(self) -> float:
        """Number, from 1, of the neighbour named last, or of the first that is excluded; NaN where there is none."""
        verdict, at = self._verdict, self._at
        others = ~self._own_bit
        named = int(verdict[at["named"]]) & others or int(verdict[at["faulty"]]) & others
        return float((named & -named).bit_length()) if named else math.nan

    def _age_s(self) -> float:
        if not self._judged_gps_ns:
            return math.nan
        return (self._services.counter_ns() - self._judged_counter_ns) * 1e-9

    def _own_state(self) -> int:
        """CrosslinkState. What is held stays told in silence; that all is well does not."""
        verdict, at = self._verdict, self._at
        if int(verdict[at["faulty"]]) & self._own_bit:
            return int(CrosslinkState.FAULT)
        state = _STATES.get(int(verdict[at["own_state"]]))
        if state is not None:
            return state
        judged = self._met & self._own_bit and not self._silent & self._own_bit
        return int(CrosslinkState.CLEAR if judged else CrosslinkState.NOT_JUDGED)

    def _majority(self) -> int:
        verdict, at = self._verdict, self._at
        if verdict[at["majority_latched"]] or verdict[at["majority"]] == UNRELIABLE:
            return int(CrosslinkMajority.UNRELIABLE)
        fresh = self._judged_gps_ns and self._services.counter_ns() - self._judged_counter_ns <= self._silence_ns
        judged = fresh and verdict[at["majority"]] != NO_VERDICT
        return int(CrosslinkMajority.RELIABLE if judged else CrosslinkMajority.NO_VERDICT)

    def _told(self) -> tuple[Any, ...]:
        """Fields of CROSSLINK_STATUS and LEONAV_CROSSLINK, in their order."""
        verdict, at = self._verdict, self._at
        judged = self._judged_gps_ns != 0
        return (
            self._judged_gps_ns,
            int(verdict[at["faulty"]]),
            int(verdict[at["named"]]),
            float(verdict[at["own_statistic"]]) if judged else -1.0,
            self._own_threshold,
            float(verdict[at["network_statistic"]]) if judged else -1.0,
            self._threshold,
            float(verdict[at["weakest_m"]]),
            self._age_s(),
            int(verdict[at["links"]]),
            int(verdict[at["own_links"]]),
            int(verdict[at["rank"]]),
            int(verdict[at["parameters"]]),
            self.assembly.incomplete,
            self._own_state(),
            self._majority(),
            self.settings.own,
            self.settings.satellites,
            _number(verdict[at["network_worst"]], judged),
            _number(verdict[at["own_peer"]], judged),
            _number(verdict[at["weakest"]], judged),
            self._silent | self._everyone & ~self._met,
        )

    def _publish(self, counter_ns: int) -> None:
        self._told_counter_ns = counter_ns
        self._services.publisher.send(self._box, self._services.unix_ns(), *_saturated(self._told()))

    def _send_message(self) -> None:
        self._services.link.send(_CROSSLINK, *_saturated(self._told()))


_FLOAT_MAX = 3.4e38  # beyond it nothing packs a float32


def _saturated(values: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(
        min(value, _FLOAT_MAX) if isinstance(value, float) and value > _FLOAT_MAX else value for value in values
    )


def _number(satellite: float, judged: bool) -> int:
    return int(satellite) if judged and satellite >= 0 else _NOBODY


def make(table: TableImage, services: Services) -> CrosslinkFunction:
    """The function that a crosslink table stands for."""
    return CrosslinkFunction(table, services)


assert MAX_CROSSLINK_SATELLITES == SATELLITES
assert SATELLITES <= 32 < _NOBODY <= LINKS  # masks of 32 bits, numbers of 8
