"""What the console knows: a pure reducer from messages and time to a state, without any screen.

`reduce(state, message, now_s)` folds one MAVLink message into the state; `ground.console.verdict.judge`
reads a verdict out of it. `now_s` is the link's time (Unix seconds): the receive clock when live, the log's
own time stamps in a replay. Every value keeps the time it was heard, so that silence can be told from health.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from flightsw.icd.alerts import ALERTS, QUANTITIES, Severity
from flightsw.icd.enums import Mode, RejectCause
from ground.console.alarms import Alarm, fold_alarm, fold_late
from ground.console.axes import sigma_rtn_m
from ground.console.crosslink_told import Crosslink, fold_crosslink
from ground.console.gnss import GnssCheck, of_message
from ground.console.text import safe
from ground.console.told import (
    Counters,
    Innovation,
    Integrity,
    LinkStatus,
    NavState,
    Protection,
    Table,
    TimeToFlag,
    Timing,
)

FLIGHT_SYSTEM, FLIGHT_COMPONENT = 1, 1  # who may speak for the satellite
MAX_EVENTS = 500
MAX_HISTORY = 1024  # samples; beyond it neighbours merge, so a whole mission stays in view
HISTORY_STEP_S = 1.0
HISTORY_RESTART_S = 86_400.0  # a jump of flight time beyond this is another run
SEQUENCES = 1 << 32
RECENT_ALERTS = 64
RECENT_EVENTS = 256  # that flight can tell again
NO_CAUSE = 0xFF


class Event(NamedTuple):
    """A line of the event log: time heard, severity as in MAV_SEVERITY, text already safe to show."""

    t_s: float
    severity: int
    text: str


class Sample(NamedTuple):
    """A point of the plot: flight's GPS time [s], driving bound and limit [m], mode; levels of x, y, z and 3-D [m]."""

    t_gps_s: float
    bound_m: float
    limit_m: float
    mode: int
    levels_m: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class State:
    """Everything heard so far. `*_s` are times of hearing (link's time), None when never heard."""

    started_s: float = 0.0
    heard_s: float | None = None
    heartbeat_s: float | None = None
    integrity: Integrity | None = None
    integrity_s: float | None = None
    protection: Protection | None = None
    protection_s: float | None = None
    nav: NavState | None = None
    nav_s: float | None = None
    counters: Counters | None = None
    counters_s: float | None = None
    innovation: Innovation | None = None
    innovation_s: float | None = None
    time_to_flag: TimeToFlag | None = None
    time_to_flag_s: float | None = None
    table: Table | None = None
    link: LinkStatus | None = None
    link_s: float | None = None
    crosslink: Crosslink | None = None
    crosslink_s: float | None = None
    timing: tuple[tuple[Timing, float], ...] = ()  # by place, each with the time it was heard
    sigma_rtn_m: tuple[float, float, float] | None = None  # 1-sigma, radial, along-track, cross-track
    sigma_rtn_s: float | None = None
    gnss: GnssCheck | None = None
    gnss_s: float | None = None
    alarms: tuple[Alarm, ...] = ()
    satellites: int | None = None
    satellites_s: float | None = None
    messages: int = 0
    foreign: int = 0
    alerts_lost: int = 0
    alert_sequence: int | None = None
    recent_alerts: tuple[tuple[int, int, int], ...] = ()
    events: tuple[Event, ...] = ()
    history: tuple[Sample, ...] = ()
    history_step_s: float = HISTORY_STEP_S


def reduce(state: State, message: Any, now_s: float) -> State:
    """The state after `message` (a decoded MAVLink message) was heard at `now_s`. Never raises."""
    if message.get_srcSystem() != FLIGHT_SYSTEM or message.get_srcComponent() != FLIGHT_COMPONENT:
        return replace(state, foreign=state.foreign + 1)
    state = replace(state, heard_s=now_s, messages=state.messages + 1)
    fold = _FOLDS.get(message.get_type())
    return state if fold is None else fold(state, message, now_s)


def note(state: State, now_s: float, severity: int, text: str) -> State:
    """The state with a line of the console's own in the event log."""
    return replace(state, events=(*state.events[-(MAX_EVENTS - 1) :], Event(now_s, severity, text)))


def age_s(now_s: float, heard_s: float | None) -> float:
    """Seconds since something was heard; infinite when it never was."""
    return math.inf if heard_s is None else max(0.0, now_s - heard_s)


def _heartbeat(state: State, message: Any, now_s: float) -> State:
    return replace(state, heartbeat_s=now_s)


def _integrity(state: State, message: Any, now_s: float) -> State:
    integrity = Integrity(*(getattr(message, name) for name in Integrity._fields))
    return _remember(replace(state, integrity=integrity, integrity_s=now_s), integrity, now_s)


def _protection(state: State, message: Any, now_s: float) -> State:
    """Levels of the axes; they belong to the point of the plot that the bound of the same instant has made."""
    told = Protection(
        message.t_gps_ns,
        tuple(message.level_m),
        tuple(message.limit_m),
        message.level_3d_m,
        tuple(message.level_rtn_m),
        message.driver,
    )
    state = replace(state, protection=told, protection_s=now_s)
    if not state.history or state.integrity is None or state.integrity.t_gps_ns != told.t_gps_ns:
        return state
    last = state.history[-1]
    levels = _worst(last.levels_m, (*told.level_m, told.level_3d_m))
    return replace(state, history=(*state.history[:-1], last._replace(levels_m=levels)))


def _worst(one: tuple[float, ...], other: tuple[float, ...]) -> tuple[float, ...]:
    """The larger of each pair; not a number is worst. Where one knows nothing, the other."""
    if not (one and other):
        return one or other
    return tuple(math.nan if math.isnan(a + b) else max(a, b) for a, b in zip(one, other, strict=True))


def _remember(state: State, integrity: Integrity, now_s: float) -> State:
    """Add a point to the plot, merging points closer than the step: the worst bound of them stays."""
    t = integrity.t_gps_ns / 1e9
    sample = Sample(t, integrity.driving_bound_m, integrity.limit_m, integrity.mode)
    history = state.history
    if history and not -1.0 <= t - history[-1].t_gps_s <= HISTORY_RESTART_S:
        if history[-1].mode != Mode.INIT:  # before its first fix flight does not know the time
            state = note(state, now_s, Severity.NOTICE, "console: flight time jumped, plot starts again")
        return replace(state, history=(sample,), history_step_s=HISTORY_STEP_S)
    if len(history) > 1 and t - history[-2].t_gps_s < state.history_step_s:
        return replace(state, history=(*history[:-1], _worse(history[-1], sample)))
    history = (*history, sample)
    step_s = state.history_step_s
    if len(history) > MAX_HISTORY:
        older = history[:-1]
        pairs = zip(older[::2], older[1::2], strict=False)
        history = (*(_worse(a, b) for a, b in pairs), *older[len(older) // 2 * 2 :], history[-1])
        step_s *= 2.0
    return replace(state, history=history, history_step_s=step_s)


def _worse(earlier: Sample, later: Sample) -> Sample:
    """The later sample, with the larger bound, levels and the graver mode of the two; not a number is worst."""
    (worst,) = _worst((earlier.bound_m,), (later.bound_m,))
    levels = _worst(earlier.levels_m, later.levels_m)
    return later._replace(bound_m=worst, mode=max(earlier.mode, later.mode), levels_m=levels)


def _nav(state: State, message: Any, now_s: float) -> State:
    r_m, v_mps = tuple(message.r_gcrf_m), tuple(message.v_gcrf_mps)
    nav = NavState(message.t_gps_ns, math.hypot(*r_m), math.hypot(*v_mps), message.validity, r_m, v_mps)
    return replace(state, nav=nav, nav_s=now_s)


def _counters(state: State, message: Any, now_s: float) -> State:
    counters = Counters(
        message.tick,
        message.received,
        message.accepted,
        message.slips,
        message.journal_dropped,
        tuple(message.rejected),
    )
    return replace(state, counters=counters, counters_s=now_s)


def _innovation(state: State, message: Any, now_s: float) -> State:
    innovation = Innovation(*(getattr(message, name) for name in Innovation._fields))
    if state.innovation is not None and state.innovation.t_gps_ns == innovation.t_gps_ns:
        return state  # a repeat must not make an old fix look fresh
    return replace(state, innovation=innovation, innovation_s=now_s)


def _time_to_flag(state: State, message: Any, now_s: float) -> State:
    told = TimeToFlag(*(getattr(message, name) for name in TimeToFlag._fields))
    return replace(state, time_to_flag=told, time_to_flag_s=now_s)


def _table(state: State, message: Any, now_s: float) -> State:
    if message.kind != NAVIGATION_TABLE:
        return state
    return replace(state, table=Table(message.crc32, safe(message.set_name, 32), message.certificate))


def _timing(state: State, message: Any, now_s: float) -> State:
    values = [getattr(message, name) for name in Timing._fields[3:]]
    told = Timing(message.index, message.count, safe(message.name, 16), *values)
    told = told._replace(histogram=tuple(message.histogram))
    if not told.place < told.members:
        return state
    others = (entry for entry in state.timing if entry[0].place != told.place and entry[0].members == told.members)
    return replace(state, timing=tuple(sorted((*others, (told, now_s)), key=lambda entry: entry[0].place)))


def _covariance(state: State, message: Any, now_s: float) -> State:
    """1-sigma of the position along the axes of the orbit; None where state and covariance allow none."""
    nav = state.nav
    sigma = None if nav is None else sigma_rtn_m(nav.r_gcrf_m, nav.v_gcrf_mps, message.covariance)
    return replace(state, sigma_rtn_m=sigma, sigma_rtn_s=now_s)


def _gps(state: State, message: Any, now_s: float) -> State:
    return replace(state, satellites=message.satellites_visible, satellites_s=now_s)


def _alert(state: State, message: Any, now_s: float) -> State:
    key = (message.sequence, message.alert_id, message.t_gps_ns)
    if key in state.recent_alerts:
        return state  # a repeat of one already shown
    last = state.alert_sequence
    if last is not None:
        missing = (message.sequence - last - 1) % SEQUENCES
        late = message.sequence < last and last - message.sequence < RECENT_EVENTS
        if late:  # one that was asked for again
            return replace(
                note(state, now_s, message.severity, alert_text(message.alert_id, message.active, message.value)),
                alarms=fold_late(state.alarms, message, state.recent_alerts, now_s),
                recent_alerts=(*state.recent_alerts[-(RECENT_ALERTS - 1) :], key),
            )
        if missing >= SEQUENCES // 2:
            state = note(state, now_s, Severity.NOTICE, "console: alert numbers start again (flight restarted?)")
        elif missing:
            state = replace(state, alerts_lost=state.alerts_lost + missing)
            text = f"console: {missing} alert{'s' if missing > 1 else ''} lost on the link"
            state = note(state, now_s, Severity.WARNING, f"{text} before number {message.sequence}")
    state = replace(
        state,
        alarms=fold_alarm(state.alarms, message, now_s),
        alert_sequence=message.sequence,
        recent_alerts=(*state.recent_alerts[-(RECENT_ALERTS - 1) :], key),
    )
    return note(state, now_s, message.severity, alert_text(message.alert_id, message.active, message.value))


def alert_text(alert_id: int, active: int, value: float) -> str:
    """An alert in words: flight sends a number, the words are the ground's."""
    known = ALERTS.get(alert_id)
    text = known.text if known else f"unknown alert {alert_id}: console older than flight?"
    text += quantity_words(alert_id, value)
    if not active:
        text = f"ended: {text}"
    return f"{text} ({known.id.name})" if known else text


def quantity_words(alert_id: int, value: float) -> str:
    """The value of an alert, named and with its unit, in brackets; nothing where it has none."""
    quantity = QUANTITIES.get(alert_id)
    if not math.isfinite(value) or value == 0.0 or (quantity is not None and not quantity.name):
        return ""
    words = f"{value:.6g}" if quantity is None else f"{quantity.name} {value:.6g} {quantity.unit}".rstrip()
    return f" [{words}]"


def _link(state: State, message: Any, now_s: float) -> State:
    values = [getattr(message, name) for name in LinkStatus._fields]
    told = LinkStatus(*values)._replace(refused=tuple(message.refused))
    return replace(state, link=told, link_s=now_s)


def _statustext(state: State, message: Any, now_s: float) -> State:
    text = safe(message.text)
    if text in ALERT_TEXTS:
        # Flight sends an alert's words too, for stations without this dialect: shown here only if it was lost.
        shown = (e for e in state.events[-8:] if now_s - e.t_s <= REPEAT_S and e.text.startswith(text))
        if next(shown, None) is not None:
            return state
    return note(state, now_s, message.severity, f"flight says: {text}")


def cause_name(cause: int) -> str:
    """Name of a rejection counter; numbers this console does not know stay visible."""
    if cause == NO_CAUSE:
        return "cause not given"
    try:
        return RejectCause(cause).name
    except ValueError:
        return f"CAUSE_{cause}"


def active_alerts(word: int) -> list[str]:
    """Names of the alerts whose bit is set in the `alerts` word."""
    return [ALERTS[i].id.name if i in ALERTS else f"ALERT_{i}" for i in range(64) if word >> i & 1]


ALERT_TEXTS = frozenset(alert.text for alert in ALERTS.values())
REPEAT_S = 2.0
NAVIGATION_TABLE = 1  # kind number of the navigation table (flightsw/icd/table_schema.py)

_FOLDS: dict[str, Callable[[State, Any, float], State]] = {
    "HEARTBEAT": _heartbeat,
    "LEONAV_INTEGRITY": _integrity,
    "LEONAV_PROTECTION": _protection,
    "LEONAV_NAV_STATE": _nav,
    "LEONAV_COUNTERS": _counters,
    "LEONAV_INNOVATION": _innovation,
    "LEONAV_TIME_TO_FLAG": _time_to_flag,
    "LEONAV_TABLE_STATUS": _table,
    "LEONAV_ALERT": _alert,
    "LEONAV_LINK": _link,
    "LEONAV_CROSSLINK": fold_crosslink,
    "LEONAV_TIMING": _timing,
    "LEONAV_COVARIANCE": _covariance,
    "LEONAV_GNSS_CHECK": lambda state, message, now_s: replace(state, gnss=of_message(message), gnss_s=now_s),
    "GPS_RAW_INT": _gps,
    "STATUSTEXT": _statustext,
}
