"""Alerts: id, severity and text as data. Flight sends the id; the ground renders the text.

The id is also the bit of the `alerts` word in INTEGRITY and LEONAV_INTEGRITY, so ids stay within 0..62
(flight keeps the word in an int64), and a text fits a MAVLink STATUSTEXT (50 bytes, ASCII). Ids are never reused.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Severity(IntEnum):
    """MAV_SEVERITY (RFC 5424 levels)."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class AlertId(IntEnum):
    """Number of an alert on the link, and its bit in the `alerts` word."""

    FLAG_RAISED = 1
    FLAG_CLEARED = 2
    BOUND_STALE = 3
    OUTAGE_START = 4
    OUTAGE_END = 5
    REINITIALISED = 6
    INITIALISED = 7
    TIME_JUMP_REJECTED = 8
    CLOCK_REINITIALISED = 9
    STORED_DA_MISSING = 10
    TABLE_UNCERTIFIED = 11
    TICK_SLIP = 12
    BUS_OFF = 13
    EARTH_ORIENTATION_EXPIRED = 14
    DIVERGED = 15
    SLOW_FAULT = 16
    MANOEUVRE_DETECTED = 17
    BURN_REFUSED = 18
    FORCES_EXPIRED = 19
    EDITING_OVERRIDDEN = 20
    BURN_ACTIVE = 21
    FIXES_IN_DOUBT = 22
    TABLE_STAGED = 23
    TABLE_ACTIVATED = 24
    TABLE_REFUSED = 25
    TABLE_ROLLED_BACK = 26
    FLAG_DISARMED = 27
    LINK_REFUSED = 28
    STATE_UPLOADED = 29
    UPLOAD_REFUSED = 30
    GNSS_EXCLUDED = 31
    GNSS_INCONSISTENT = 32
    GNSS_PROTECTION = 33
    GNSS_UNTESTED = 34
    CROSSLINK_OWN_FAULT = 35
    CROSSLINK_OWN_SUSPECT = 36
    CROSSLINK_NEIGHBOUR_FAULTY = 37
    CROSSLINK_MAJORITY = 38
    RECEIVER_VELOCITY_FAULT = 39
    CROSSLINK_UNMONITORED = 44
    CROSSLINK_NEIGHBOUR_SILENT = 45


class Alert(NamedTuple):
    """What the ground shows for an id."""

    id: AlertId
    severity: Severity
    text: str


ALERTS: dict[int, Alert] = {
    alert.id: alert
    for alert in (
        Alert(AlertId.FLAG_RAISED, Severity.CRITICAL, "Error bound above the limit: do not use the state"),
        Alert(AlertId.FLAG_CLEARED, Severity.NOTICE, "Failure flag cleared: state back in service"),
        Alert(AlertId.BOUND_STALE, Severity.ALERT, "Error bound cannot be computed: do not use"),
        Alert(AlertId.OUTAGE_START, Severity.WARNING, "GNSS lost: navigating alone"),
        Alert(AlertId.OUTAGE_END, Severity.NOTICE, "GNSS back: fixes accepted again"),
        Alert(AlertId.REINITIALISED, Severity.ALERT, "State restarted from fixes it had rejected"),
        Alert(AlertId.INITIALISED, Severity.INFO, "Navigation initialised"),
        Alert(AlertId.TIME_JUMP_REJECTED, Severity.WARNING, "Jump of GPS time rejected"),
        Alert(AlertId.CLOCK_REINITIALISED, Severity.ALERT, "Onboard time restarted from time pulses"),
        Alert(AlertId.STORED_DA_MISSING, Severity.WARNING, "No stored dA for this part of the orbit"),
        Alert(AlertId.TABLE_UNCERTIFIED, Severity.NOTICE, "Navigation table carries no certificate"),
        Alert(AlertId.TICK_SLIP, Severity.WARNING, "Tick began late"),
        Alert(AlertId.BUS_OFF, Severity.ERROR, "CAN bus lost: reconnecting"),
        Alert(AlertId.EARTH_ORIENTATION_EXPIRED, Severity.ALERT, "Earth orientation table does not cover now"),
        Alert(AlertId.DIVERGED, Severity.ALERT, "Consistent fixes rejected: state unreliable"),
        Alert(AlertId.SLOW_FAULT, Severity.ALERT, "Slow GNSS fault found: measurements excluded"),
        Alert(AlertId.MANOEUVRE_DETECTED, Severity.ALERT, "Unannounced velocity change found"),
        Alert(AlertId.BURN_REFUSED, Severity.ALERT, "Announced burn refused: late or not valid"),
        Alert(AlertId.FORCES_EXPIRED, Severity.WARNING, "Force table is past its validity"),
        Alert(AlertId.EDITING_OVERRIDDEN, Severity.NOTICE, "Measurement editing overridden"),
        Alert(AlertId.FIXES_IN_DOUBT, Severity.ALERT, "Fixes drift off the state: fault or manoeuvre"),
        Alert(AlertId.TABLE_STAGED, Severity.INFO, "New navigation table validated and staged"),
        Alert(AlertId.TABLE_ACTIVATED, Severity.NOTICE, "New navigation table active, on trial"),
        Alert(AlertId.TABLE_REFUSED, Severity.WARNING, "New navigation table refused: old one flies on"),
        Alert(AlertId.TABLE_ROLLED_BACK, Severity.ALERT, "New navigation table failed: old one flies again"),
        Alert(AlertId.FLAG_DISARMED, Severity.WARNING, "Failure flag disarmed: state not guarded"),
        Alert(AlertId.LINK_REFUSED, Severity.WARNING, "Commands refused: signature or address wrong"),
        Alert(AlertId.STATE_UPLOADED, Severity.NOTICE, "State from the ground taken: not certified"),
        Alert(AlertId.UPLOAD_REFUSED, Severity.WARNING, "State from the ground refused"),
        Alert(AlertId.GNSS_EXCLUDED, Severity.WARNING, "Faulty GNSS satellites found and left out"),
        Alert(AlertId.GNSS_INCONSISTENT, Severity.ALERT, "Pseudoranges contradict themselves: no fix"),
        Alert(AlertId.GNSS_PROTECTION, Severity.NOTICE, "GNSS protection level beyond its alert limit"),
        Alert(AlertId.GNSS_UNTESTED, Severity.WARNING, "Too few GNSS satellites to test a fix: not used"),
        Alert(AlertId.CROSSLINK_OWN_FAULT, Severity.CRITICAL, "Own broadcast message is wrong: do not use it"),
        Alert(AlertId.CROSSLINK_OWN_SUSPECT, Severity.WARNING, "Own broadcast message in doubt"),
        Alert(
            AlertId.CROSSLINK_NEIGHBOUR_FAULTY, Severity.WARNING, "Another satellite's message found wrong: excluded"
        ),
        Alert(AlertId.CROSSLINK_MAJORITY, Severity.WARNING, "Most crosslinks disagree with own message"),
        Alert(AlertId.CROSSLINK_UNMONITORED, Severity.WARNING, "Own broadcast message is not monitored"),
        Alert(AlertId.CROSSLINK_NEIGHBOUR_SILENT, Severity.WARNING, "Another satellite is not monitored any more"),
        Alert(AlertId.RECEIVER_VELOCITY_FAULT, Severity.ALERT, "Receiver's velocity contradicts its positions"),
        Alert(AlertId.BURN_ACTIVE, Severity.INFO, "Announced burn in progress"),
    )
}


class Quantity(NamedTuple):
    """What the value of an alert is. No name: it has none, and flight sends NaN."""

    name: str
    unit: str = ""


BOUND = Quantity("bound", "m")  # navigation's, of that tick: of every alert that stands below with no other
_NONE = Quantity("")
_RATIO = Quantity("statistic over threshold")
_QUANTITIES: dict[AlertId, Quantity] = {
    AlertId.TIME_JUMP_REJECTED: _NONE,
    AlertId.CLOCK_REINITIALISED: _NONE,
    AlertId.STORED_DA_MISSING: _NONE,
    AlertId.TABLE_UNCERTIFIED: _NONE,
    AlertId.TICK_SLIP: _NONE,
    AlertId.BUS_OFF: _NONE,
    AlertId.EARTH_ORIENTATION_EXPIRED: _NONE,
    AlertId.BURN_REFUSED: _NONE,
    AlertId.FORCES_EXPIRED: _NONE,
    AlertId.EDITING_OVERRIDDEN: _NONE,
    AlertId.TABLE_STAGED: _NONE,
    AlertId.TABLE_ACTIVATED: _NONE,
    AlertId.TABLE_REFUSED: _NONE,
    AlertId.TABLE_ROLLED_BACK: _NONE,
    AlertId.FLAG_DISARMED: _NONE,
    AlertId.LINK_REFUSED: _NONE,
    AlertId.UPLOAD_REFUSED: _NONE,
    AlertId.GNSS_EXCLUDED: Quantity("satellites left out"),
    AlertId.GNSS_INCONSISTENT: _RATIO,
    AlertId.GNSS_PROTECTION: Quantity("protection level", "m"),
    AlertId.GNSS_UNTESTED: Quantity("satellites used"),
    AlertId.CROSSLINK_OWN_FAULT: _RATIO,
    AlertId.CROSSLINK_OWN_SUSPECT: _RATIO,
    AlertId.CROSSLINK_NEIGHBOUR_FAULTY: Quantity("satellite"),
    AlertId.CROSSLINK_MAJORITY: _NONE,
    AlertId.RECEIVER_VELOCITY_FAULT: Quantity("velocity error", "m/s"),
}
QUANTITIES: dict[int, Quantity] = {int(alert): _QUANTITIES.get(alert, BOUND) for alert in AlertId}
