"""Pseudoranges before the filter: assemble an epoch, place its satellites, test, exclude, offer the fix, protect.

One epoch a second or so, in two ticks or three; a tick without one does nothing. In its own tick the epoch is solved
and tested, and the fix goes to navigation as that of a receiver which gives positions only: its gate judges it as any
other. Where the satellites disagree, who is to be left out is found in the next tick, and the fix goes out there. A
tick after the fix come its protection levels, and only then is anything said of the epoch, alerts included: whoever
listens gets fix and levels of one epoch together. Where the table holds fixes back by their levels, and where another
epoch follows before that, what is left to do is done at once. See docs/adr/0019-pseudoranges-before-the-filter.md.
"""

from __future__ import annotations

import math

from flightsw.gnss.fix import gnss_exclude, gnss_test
from flightsw.gnss.ionosphere import correct_ionosphere
from flightsw.gnss.protection import gnss_levels
from flightsw.gnss.records import AXES, CONSTELLATIONS, SATELLITES, Row, Verdict
from flightsw.gnss.satellites import place_satellites
from flightsw.gnss.setup import Memory
from flightsw.gnss.solution import LIGHT_MPS
from flightsw.icd import mavlink
from flightsw.icd.alerts import AlertId
from flightsw.icd.can_frames import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_RANGES
from flightsw.icd.enums import FlagState, Validity
from flightsw.icd.table_file import TableImage
from flightsw.pseudoranges.assembly import RawAssembly
from flightsw.pseudoranges.judged import Judged
from flightsw.pseudoranges.latch import Latch
from flightsw.pseudoranges.settings import settings_of
from flightsw.pseudoranges.telling import Teller
from flightsw.records_io import RecordReader
from flightsw.services import Services

_BEGINNING = int(Validity.STATE_VALID) | int(Validity.TIME_VALID)
_UNTESTED, _EXCLUDED = int(Verdict.UNTESTED), int(Verdict.EXCLUDED)
_AMBIGUOUS, _INCONSISTENT = int(Verdict.AMBIGUOUS), int(Verdict.INCONSISTENT)
_USED, _LEFT_OUT = int(Row.USED), int(Row.EXCLUDED)
_CLEAR = int(FlagState.CLEAR)
_NOTHING, _SEARCH, _LEVELS = 0, 1, 2
_LATEST_NS = 1 << 62  # beyond it no int64 holds the time less the clock's error
# Earth rotation angle at the GPS epoch and its rate (IERS Conventions 2010, eq. 5.15). UT1 is taken for GPS time, the
# pole for the axis: half a minute of time and a third of a degree, up to 40 km, are near enough to begin from.
_ERA_0 = 2.0 * math.pi * (0.7790572732640 + 1.00273781191135448 * (2_444_244.5 - 2_451_545.0))
_ERA_RATE = 2.0 * math.pi * 1.00273781191135448 / 86_400.0


class PseudorangeFunction:
    """The function of a table of kind `gnss`."""

    name = "pseudoranges"
    budget_us = 1000.0  # 64 satellites all faulty, or with every pair a fault mode, take half of it

    def __init__(self, table: TableImage, services: Services) -> None:
        record = table.values[0]
        settings = settings_of(record)
        self._services = services
        self._memory = Memory(settings)
        self._arguments = self._memory.arguments()
        self._rejected = services.receiver.rejected
        self._raw = RawAssembly(self._rejected, float(record["latency_max_s"]))
        self._raws = [self._raw.raws[k : k + 1] for k in range(len(self._raw.raws))]
        self._protects = settings.protect
        self._one_frequency = settings.iono_share > 0.0
        self._offer_untested = bool(record["offer_untested"])
        self._holds = self._protects and bool(record["hold_beyond_limit"])
        self._floor_m = float(record["sigma_floor_m"])
        after, until = int(record["raise_epochs"]), int(record["clear_epochs"])
        self._latches = {
            1 << int(alert): Latch(after, until)
            for alert in (
                *(AlertId.GNSS_EXCLUDED, AlertId.GNSS_INCONSISTENT),
                *(AlertId.GNSS_PROTECTION, AlertId.GNSS_UNTESTED),
            )
        }
        self._of = tuple(self._latches.values())
        self.conditions = self.happened = 0
        self.judged = Judged()
        self._next = _NOTHING  # to be done with the epoch that is under way
        self._times = (0, 0)  # of it, GPS and counter [ns]
        self._was_offered = 0
        self._reader = RecordReader(self._memory.result)
        self._at = self._reader.at
        self.values = {
            int(AlertId.GNSS_EXCLUDED): lambda: float(_count(self.judged.excluded)),
            int(AlertId.GNSS_INCONSISTENT): self._ratio,
            int(AlertId.GNSS_PROTECTION): lambda: max(self.judged.protection_m),
            int(AlertId.GNSS_UNTESTED): lambda: float(_count(self.judged.used)),
        }
        self.epochs = self.offered = 0
        self._teller = Teller(services.publisher, services.link, settings.alert_limit_m)
        services.receiver.listen(GNSS_RANGES, self._raw.take_ranges)
        services.receiver.listen(GNSS_EPHEMERIS, self._raw.take_ephemeris)
        services.receiver.listen(GNSS_EPOCH, self._take_epoch)
        services.downlink.add(mavlink.MAVLINK_MSG_ID_LEONAV_GNSS_CHECK, "status", self._tell)

    def _take_epoch(self, frame: bytearray) -> None:
        self._raw.take_epoch(frame, self._services.counter_ns())

    def run(self) -> None:
        """Take the epoch of a tick before one step further, then solve what this tick has completed."""
        raw = self._raw
        self._advance()
        for index in range(raw.count):
            self._finish()
            self._solve(index)
            if self._holds:
                self._finish()
        raw.clear()

    def _advance(self) -> None:
        """One step of the epoch under way, if there is one: who is to be left out, or how far it can be wrong."""
        if self._next == _SEARCH:
            gnss_exclude(*self._arguments)
            self._settle()
        elif self._next == _LEVELS:
            self._next = _NOTHING
            if not self._holds:
                self._protect()
            self._conclude()

    def _finish(self) -> None:
        """All that is left of it, at once."""
        while self._next != _NOTHING:
            self._advance()

    def _solve(self, index: int) -> None:
        """From pseudoranges to a fix that is offered, or to a search that has to be made first."""
        memory = self._memory
        place_satellites(memory.table, self._raws[index], self._raw.ephemerides, memory.epoch)
        self._start_from_prediction()
        if self._one_frequency:
            self._correct()
        gnss_test(*self._arguments)
        self._times = self._raw.times(index)
        if memory.work["search"][0]:
            self._next = _SEARCH
        else:
            self._settle()

    def _settle(self) -> None:
        """The fix is what it will be: offer it; levels before that only if it depends on them."""
        if self._holds:
            self._protect()
        self._was_offered = self._offer(*self._times)
        self._next = _LEVELS

    def _protect(self) -> None:
        memory = self._memory
        gnss_levels(memory.table, memory.work, memory.result)

    def _conclude(self) -> None:
        """The epoch under way is the last that was judged, and is told."""
        (t_gps_ns, t_counter_ns), offered = self._times, self._was_offered
        result, at = self._reader.read(), self._at
        verdict, available = int(result[at["verdict"]]), int(result[at["available"]])
        used, excluded, refused = self._name_rows(verdict, result[at["row_state"] : at["row_state"] + SATELLITES])
        self.judged = Judged(
            t_gps_ns,
            t_counter_ns,
            verdict,
            used,
            excluded,
            refused,
            int(result[at["dof"]]),
            result[at["statistic"]],
            result[at["threshold"]],
            result[at["protection_m"] : at["protection_m"] + AXES],
            result[at["sigma_m"] : at["sigma_m"] + AXES],
            available,
            offered,
        )
        self.epochs += 1
        self.offered += offered
        self._note(verdict, available)
        self._teller.publish(self._services.unix_ns(), self.judged)

    def _start_from_prediction(self) -> None:
        """Begin from the predicted position while it is trusted: few steps, and the right one of two solutions."""
        services, epoch = self._services, self._memory.epoch
        out, at = services.reading(), services.places
        trusted = int(out[at["validity"]]) & _BEGINNING == _BEGINNING and int(out[at["flag"]]) == _CLEAR
        epoch["start_known"] = 1 if trusted else 0
        if trusted:
            angle = _ERA_0 + _ERA_RATE * (out[at["t_gps_ns"]] * 1e-9)
            c, s = math.cos(angle), math.sin(angle)
            place = at["r_gcrf_m"]
            x, y, z = out[place : place + 3]
            epoch["start_m"] = (c * x + s * y, c * y - s * x, z)

    def _correct(self) -> None:
        """Take the ionosphere off, as seen from the prediction; without one, from a fix with the ionosphere in it."""
        memory = self._memory
        if not memory.epoch["start_known"][0]:
            gnss_test(*self._arguments)
            gnss_exclude(*self._arguments)
            if int(memory.result["verdict"][0]) > _INCONSISTENT:
                return
            memory.epoch["start_known"], memory.epoch["start_m"] = 1, memory.result["r_m"]
        correct_ionosphere(memory.table, memory.epoch)

    def _name_rows(self, verdict: int, states: tuple[float, ...]) -> tuple[tuple[int, ...], tuple[int, ...], int]:
        """Masks of the satellites used and left out, and how many rows never came to the test."""
        epoch = self._memory.epoch[0]
        used, excluded, refused = [0] * CONSTELLATIONS, [0] * CONSTELLATIONS, 0
        states = states[: min(int(epoch["count"]), SATELLITES)]
        if verdict > _INCONSISTENT:  # no solution: nothing was used
            return tuple(used), tuple(excluded), sum(state > _LEFT_OUT for state in states)
        systems, numbers = epoch["constellation"].tolist(), epoch["satellite"].tolist()
        for state, system, number in zip(states, systems, numbers, strict=False):
            if state == _USED:
                used[system] |= 1 << number - 1
            elif state == _LEFT_OUT:
                excluded[system] |= 1 << number - 1
            else:
                refused += 1
        return tuple(used), tuple(excluded), refused

    def _offer(self, t_gps_ns: int, t_counter_ns: int) -> int:
        """Hand the fix to navigation if it may be; 1 or 0.

        A level beyond the alert limit does not hold it back unless the table says so: sigma says how good the fix is
        when nothing is wrong, the gate and the bound work with that, and a poor geometry would become an outage.
        """
        result, at = self._reader.read(), self._at
        verdict = result[at["verdict"]]
        if not (verdict <= _EXCLUDED or (verdict == _UNTESTED and self._offer_untested)):
            return 0
        if self._holds and not result[at["available"]]:
            return 0
        clocks_m = result[at["clock_m"] : at["clock_m"] + CONSTELLATIONS]
        late_ns = next((value for value in clocks_m if math.isfinite(value)), math.nan) / LIGHT_MPS * 1e9
        if not abs(late_ns) < 1e12 or abs(t_gps_ns) > _LATEST_NS:
            return 0
        covariance, r = at["covariance_m2"], at["r_m"]
        sigma = [max(math.sqrt(result[covariance + 4 * a]), self._floor_m) for a in range(AXES)]  # of the diagonal
        self._services.assembly.put_position(
            t_gps_ns - round(late_ns), t_counter_ns, result[r : r + AXES], sigma, int(result[at["used"]])
        )
        return 1

    def _note(self, verdict: int, available: int) -> None:
        solved = verdict <= _UNTESTED
        excluded, inconsistent, protection, untested = self._of
        excluded.note(verdict in (_EXCLUDED, _AMBIGUOUS))
        inconsistent.note(verdict in (_AMBIGUOUS, _INCONSISTENT))
        protection.note(self._protects and solved and not available)
        untested.note(verdict > _INCONSISTENT or (verdict == _UNTESTED and not self._offer_untested))
        self.conditions = 0
        for bit, latch in self._latches.items():
            if latch.holds:
                self.conditions |= bit

    def _ratio(self) -> float:
        """Statistic over its threshold; NaN where another test of the last epoch has refused it."""
        above = self.judged.statistic > self.judged.threshold > 0.0
        return self.judged.statistic / self.judged.threshold if above else math.nan

    def _tell(self) -> None:
        judged = self.judged
        known = judged.verdict != Verdict.NO_EPOCH
        age_s = (self._services.counter_ns() - judged.t_counter_ns) * 1e-9 if known else math.nan
        self._teller.tell(judged, age_s, self.epochs, self.offered)


def _count(masks: tuple[int, ...]) -> int:
    return sum(mask.bit_count() for mask in masks)


def make(table: TableImage, services: Services) -> PseudorangeFunction:
    """The function that flies this table."""
    return PseudorangeFunction(table, services)
