"""A link log in miniature for the console's tests: start-up, an outage, the flag, and the way back.

Bound 2 m, growing as 0.0076 age^2 in the outage: 2000 m at an age of 513 s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from flightsw.icd import mavlink
from flightsw.icd.enums import (
    REJECT_CAUSES,
    Certificate,
    DaSource,
    FlagState,
    Governing,
    Mode,
    RejectCause,
    Validity,
    Verdict,
)

START_UNIX_S = 1_230_768_000
START_GPS_NS = 914_803_215 * 10**9
OUTAGE_START_S, OUTAGE_STOP_S, STOP_S = 300, 1100, 1300
FLAG_AGE_S, LIMIT_M = 513, 2000.0
NAN = math.nan


def integrity(**changes: Any) -> mavlink.MAVLink_leonav_integrity_message:
    """A LEONAV_INTEGRITY of a healthy flight, with changes."""
    values: dict[str, Any] = {
        "t_gps_ns": START_GPS_NS,
        "bound_m": 2.0,
        "limit_m": LIMIT_M,
        "bound_3d_m": 2.5,
        "fix_age_s": 0.4,
        "outage_age_s": 0.0,
        "flag_age_s": NAN,
        "alerts": 0,
        "table_crc32": 0x1234ABCD,
        "accepted_streak": 60,
        "mode": Mode.INTEGRATED,
        "flag_state": FlagState.CLEAR,
        "verdict": Verdict.TRUSTED,
        "driver": 0,
        "certificate": Certificate.UNCERTIFIED,
        "stored_da_coverage_pct": 87,
        "da_source": DaSource.FILTER,
        "uncovered": 0,
    }
    return mavlink.MAVLink_leonav_integrity_message(**(values | changes))


def protection(t_gps_ns: int, bound_m: float, **changes: Any) -> mavlink.MAVLink_leonav_protection_message:
    """A LEONAV_PROTECTION: the bound is that of y."""
    values: dict[str, Any] = {
        "level_m": [0.5 * bound_m, bound_m, 0.25 * bound_m],
        "limit_m": [LIMIT_M] * 3,
        "level_3d_m": 1.2 * bound_m,
        "level_rtn_m": [0.3 * bound_m, 1.1 * bound_m, 0.2 * bound_m],
        "driver": 0,
    }
    return mavlink.MAVLink_leonav_protection_message(t_gps_ns, **(values | changes))


def alert(sequence: int, alert_id: int, severity: int, **changes: Any) -> mavlink.MAVLink_leonav_alert_message:
    """A LEONAV_ALERT."""
    values = {"t_gps_ns": START_GPS_NS + sequence, "value": 0.0, "active": 1} | changes
    return mavlink.MAVLink_leonav_alert_message(sequence=sequence, alert_id=alert_id, severity=severity, **values)


def heartbeat() -> mavlink.MAVLink_heartbeat_message:
    """HEARTBEAT of a spacecraft."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_SPACECRAFT_ORBITER, mavlink.MAV_AUTOPILOT_GENERIC, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )


def heard(message: Any, system: int = 1, component: int = 1) -> Any:
    """The message as it arrives: packed, sent, decoded again."""
    sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    return mavlink.MAVLink(None).decode(bytearray(message.pack(sender)))


def second(t_s: int) -> Iterator[Any]:
    """Messages flight sends in second `t_s` of the story."""
    t_gps_ns = START_GPS_NS + t_s * 10**9
    age_s = t_s - OUTAGE_START_S if OUTAGE_START_S <= t_s < OUTAGE_STOP_S else 0
    returned_s = t_s - OUTAGE_STOP_S if t_s >= OUTAGE_STOP_S else None
    starting = t_s < 4
    raised = age_s >= FLAG_AGE_S or (returned_s is not None and returned_s < 30)
    mode, verdict = Mode.INTEGRATED, Verdict.TRUSTED
    if starting:
        mode, verdict = Mode.INIT, Verdict.NOT_READY
    elif raised:
        mode = Mode.INTEGRATED if age_s == 0 else Mode.FAILED
        verdict = Verdict.DO_NOT_USE
    elif age_s > 3:
        mode, verdict = Mode.AUTONOMOUS, Verdict.TRUSTED_COASTING
    bound_m = NAN if starting else 2.0 + 30.0 * math.exp(-t_s / 20.0) + 0.0076 * age_s**2
    yield heartbeat()
    yield integrity(
        t_gps_ns=t_gps_ns,
        bound_m=bound_m,
        bound_3d_m=1.2 * bound_m,
        fix_age_s=NAN if starting else float(age_s) or 0.4,
        outage_age_s=float(age_s),
        flag_age_s=float(FLAG_AGE_S) if raised else NAN,
        alerts=(1 << 11) | (bool(age_s) << 4) | (raised << 1),
        accepted_streak=max(0, min(t_s, 65535)) if age_s == 0 else 0,
        mode=mode,
        flag_state=FlagState.RAISED if raised else FlagState.CLEAR,
        verdict=verdict,
        stored_da_coverage_pct=min(100, t_s // 10),
        da_source=DaSource.STORED if age_s else DaSource.FILTER,
    )
    yield protection(t_gps_ns, bound_m)
    phase = 2.0 * math.pi * t_s / 5580.0
    yield mavlink.MAVLink_leonav_nav_state_message(
        t_gps_ns,
        [6.8e6 * math.cos(phase), 6.8e6 * math.sin(phase), 0.0],
        [-7650.0 * math.sin(phase), 7650.0 * math.cos(phase), 0.0],
        mode,
        0 if starting else Validity.INITIALISED | (0 if raised else Validity.STATE_VALID),
        FlagState.RAISED if raised else FlagState.CLEAR,
    )
    if age_s == 0:
        yield mavlink.MAVLink_leonav_innovation_message(t_gps_ns, [0.3] * 6, [1.0] * 6, 5.1, 22.46, 5.9, 1, 0xFF)
        yield mavlink.MAVLink_gps_raw_int_message(t_s * 10**6, 3, 0, 0, 0, 120, 150, 65535, 65535, 11)
    left_s = max(0.0, FLAG_AGE_S - age_s)
    governing = Governing.NOT_READY if starting else Governing.FLAG if raised else Governing.BOUND
    yield mavlink.MAVLink_leonav_time_to_flag_message(t_gps_ns, left_s, 12.0, governing, 1 if age_s else 0)
    if t_s % 5 == 0:
        rejected = [0] * REJECT_CAUSES
        rejected[RejectCause.BAD_CRC], rejected[RejectCause.GATE] = t_s // 100, t_s // 400
        yield mavlink.MAVLink_leonav_counters_message(t_s * 10, t_s * 3, max(0, t_s * 3 - 7), 0, 0, rejected)
        yield mavlink.MAVLink_leonav_table_status_message(0x1234ABCD, 99, b"paper_1m", 1, 0)
    for when_s, number, alert_id, severity, value in (
        (1, 0, 11, 5, 0.0),
        (4, 1, 7, 6, 0.0),
        (OUTAGE_START_S + 3, 2, 4, 4, 3.0),
        (OUTAGE_START_S + FLAG_AGE_S, 3, 1, 2, 2003.2),
        (OUTAGE_STOP_S, 4, 5, 5, 800.0),
        (OUTAGE_STOP_S + 30, 5, 2, 5, 0.0),
    ):
        if t_s == when_s:
            yield alert(number, alert_id, severity, value=value, t_gps_ns=t_gps_ns)
    if t_s == 2:
        yield mavlink.MAVLink_statustext_message(6, b"leonav 0.1.0 \x1b[31mstarting")


def frames(stop_s: int = STOP_S) -> Iterator[tuple[int, bytes]]:
    """The story as (Unix microseconds, MAVLink frame)."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for t_s in range(stop_s + 1):
        for message in second(t_s):
            yield (START_UNIX_S + t_s) * 10**6, bytes(message.pack(sender))
            sender.seq = (sender.seq + 1) % 256  # pack alone does not step it


def write_tlog(path: Path, stop_s: int = STOP_S) -> Path:
    """The story as a .tlog."""
    path.write_bytes(b"".join(t_us.to_bytes(8, "big") + frame for t_us, frame in frames(stop_s)))
    return path
