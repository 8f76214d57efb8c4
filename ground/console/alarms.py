"""Alarms: every alert that was raised stays until somebody has acknowledged it, also after it has ended."""

from __future__ import annotations

from typing import Any, NamedTuple

from flightsw.icd.alerts import ALERTS, Severity

LATCHED = Severity.WARNING  # graver ones too; lesser alerts are events only


class Alarm(NamedTuple):
    """One alert's last raising. Times are the link's (Unix s); None for what has not happened."""

    alert_id: int
    sequence: int
    severity: int
    raised_s: float
    ended_s: float | None = None
    acknowledged_s: float | None = None
    by: str = ""

    @property
    def open(self) -> bool:
        """Whether it is active, or nobody has acknowledged it."""
        return self.ended_s is None or self.acknowledged_s is None


# Alerts that are moments, not conditions: they end as they are raised.
MOMENTS = frozenset(
    int(alert.id)
    for alert in ALERTS.values()
    if alert.id.name
    in (
        *("REINITIALISED", "TIME_JUMP_REJECTED", "CLOCK_REINITIALISED", "TICK_SLIP", "DIVERGED", "MANOEUVRE_DETECTED"),
        *("BURN_REFUSED", "TABLE_REFUSED", "TABLE_ROLLED_BACK", "LINK_REFUSED"),
    )
)
_ENDS = {"FLAG_CLEARED": "FLAG_RAISED", "OUTAGE_END": "OUTAGE_START"}
_ENDED_BY = {
    int(alert.id): int(other.id)
    for alert in ALERTS.values()
    for other in ALERTS.values()
    if _ENDS.get(alert.id.name) == other.id.name
}


def fold_alarm(alarms: tuple[Alarm, ...], message: Any, now_s: float) -> tuple[Alarm, ...]:
    """The alarms after a LEONAV_ALERT that was not heard before."""
    number = int(message.alert_id)
    if number in _ENDED_BY:
        return _end(alarms, _ENDED_BY[number], now_s)
    if not message.active:
        return _end(alarms, number, now_s)
    if message.severity > LATCHED:
        return alarms
    ended_s = now_s if number in MOMENTS else None
    raised = Alarm(number, int(message.sequence), int(message.severity), now_s, ended_s)
    return (*(alarm for alarm in alarms if alarm.alert_id != number), raised)


def fold_late(
    alarms: tuple[Alarm, ...], message: Any, heard: tuple[tuple[int, int, int], ...], now_s: float
) -> tuple[Alarm, ...]:
    """The alarms after an alert that is told again, and was lost before: what came after it stands.

    heard: sequence, alert id and time of the alerts heard before.
    """
    number, sequence = int(message.alert_id), int(message.sequence)
    if not message.active or any(alarm.alert_id == number and alarm.sequence > sequence for alarm in alarms):
        return alarms
    after = fold_alarm(alarms, message, now_s)
    over = any(s > sequence and (a == number or _ENDED_BY.get(a) == number) for s, a, _ in heard)
    return _end(after, number, now_s) if over else after


def _end(alarms: tuple[Alarm, ...], number: int, now_s: float) -> tuple[Alarm, ...]:
    return tuple(
        alarm._replace(ended_s=now_s) if alarm.alert_id == number and alarm.ended_s is None else alarm
        for alarm in alarms
    )


def acknowledge(alarms: tuple[Alarm, ...], sequence: int, now_s: float, by: str) -> tuple[Alarm, ...]:
    """The alarms after flight has taken an acknowledgement."""
    return tuple(
        alarm._replace(acknowledged_s=now_s, by=by) if alarm.sequence == sequence else alarm for alarm in alarms
    )


def standing(alarms: tuple[Alarm, ...]) -> list[Alarm]:
    """Alarms to be shown: open ones, gravest first, then the newest; what is over and acknowledged is gone."""
    return sorted((a for a in alarms if a.open), key=lambda a: (a.acknowledged_s is not None, a.severity, -a.raised_s))
