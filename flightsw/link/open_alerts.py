"""Alerts that nobody has acknowledged: told again until somebody has; and events told again when one was lost."""

from __future__ import annotations

from flightsw.events import EventRing
from flightsw.icd.alerts import ALERTS, Severity
from flightsw.link.telemetry import Telemetry

_REPEATED = frozenset(int(alert.id) for alert in ALERTS.values() if alert.severity <= Severity.WARNING)
_RESENT_PER_TICK = 8


class OpenAlerts:
    """One place for each alert of severity WARNING or graver: its last raising, until that is acknowledged."""

    __slots__ = ("_due_ns", "_ring", "_slots", "_telemetry", "_wanted", "bits")

    def __init__(self, telemetry: Telemetry, ring: EventRing) -> None:
        self._telemetry = telemetry
        self._ring = ring
        # alert id -> sequence, GPS time, value of the event
        self._slots: dict[int, tuple[int, int, float]] = {}
        self._due_ns = 0
        self._wanted = (1, 0)  # first and last sequence still to be sent again
        self.bits = 0

    def note(self, sequence: int, t_gps_ns: int, alert_id: int, active: int, value: float) -> None:
        """An event has just been told."""
        if active and alert_id in _REPEATED:
            self._slots[alert_id] = (sequence, t_gps_ns, value)
            self.bits |= 1 << alert_id

    def acknowledge(self, sequence: int) -> bool:
        """The event of this number was seen; an alert raised again since then stays open. False: none such is open."""
        for alert_id, (raised, _, _) in self._slots.items():
            if raised == sequence:
                del self._slots[alert_id]
                self.bits &= ~(1 << alert_id)
                return True
        return False

    def ask(self, first: int, last: int) -> bool:
        """Tell events first..last again, a few in a tick; False where none of them is held any more."""
        newest = self._ring.sequence
        first, last = max(first, 1, newest - len(self._ring.records) + 1), min(last, newest)
        if first > last:
            return False
        self._wanted = (first, last)
        return True

    def repeat(self, now_ns: int, period_ns: int) -> None:
        """Tell what is due again. now_ns: the onboard counter."""
        first, last = self._wanted
        if first <= last:
            stop = min(last, first + _RESENT_PER_TICK - 1)
            for sequence in range(first, stop + 1):
                record = self._ring.records[sequence % len(self._ring.records)]
                if int(record["sequence"]) == sequence:
                    self._telemetry.alert_again(
                        sequence,
                        int(record["t_gps_ns"]),
                        int(record["alert_id"]),
                        int(record["active"]),
                        float(record["value"]),
                    )
            self._wanted = (stop + 1, last)
        if not self._slots:
            self._due_ns = now_ns + period_ns
        elif now_ns >= self._due_ns:
            self._due_ns = now_ns + period_ns
            for alert_id, (sequence, t_gps_ns, value) in self._slots.items():
                self._telemetry.alert_again(sequence, t_gps_ns, alert_id, 1, value)
