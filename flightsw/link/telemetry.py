"""Record to message: what the ground is told. Every integer is saturated before it is packed."""

from __future__ import annotations

import math

import numpy as np

from flightsw.icd import mavlink as m
from flightsw.icd.alerts import ALERTS
from flightsw.icd.enums import FixType, FlagState, Mode
from flightsw.kernels.geodetic import geodetic
from flightsw.link.mavlink_out import MavlinkOut
from flightsw.link.message_layout import MessageLayout
from flightsw.records import INPUT
from flightsw.records_io import RecordReader
from flightsw.schedule import Member

_ALERT = MessageLayout(m.MAVLink_leonav_alert_message)
_STATUSTEXT = MessageLayout(m.MAVLink_statustext_message)
_NAV_STATE = MessageLayout(m.MAVLink_leonav_nav_state_message)
_INTEGRITY = MessageLayout(m.MAVLink_leonav_integrity_message)
_PROTECTION = MessageLayout(m.MAVLink_leonav_protection_message)
_HEARTBEAT = MessageLayout(m.MAVLink_heartbeat_message)
_SYS_STATUS = MessageLayout(m.MAVLink_sys_status_message)
_SYSTEM_TIME = MessageLayout(m.MAVLink_system_time_message)
_GPS_RAW_INT = MessageLayout(m.MAVLink_gps_raw_int_message)
_ESTIMATOR_STATUS = MessageLayout(m.MAVLink_estimator_status_message)
_INNOVATION = MessageLayout(m.MAVLink_leonav_innovation_message)
_COVARIANCE = MessageLayout(m.MAVLink_leonav_covariance_message)
_TIME_TO_FLAG = MessageLayout(m.MAVLink_leonav_time_to_flag_message)
_COUNTERS = MessageLayout(m.MAVLink_leonav_counters_message)
_TABLE_STATUS = MessageLayout(m.MAVLink_leonav_table_status_message)
_TIMING = MessageLayout(m.MAVLink_leonav_timing_message)
_LINK = MessageLayout(m.MAVLink_leonav_link_message)
_DIALECT_VERSION = int((m.MAVLink.heartbeat_encode.__defaults__ or (0,))[0])  # of leonav.xml
_U16, _U32 = 0xFFFF, 0xFFFFFFFF
_UNKNOWN = 0xFFFF
_FLOAT_MAX = 3.4e38  # beyond it struct packs no float32
_SYSTEM_STATUS = {
    int(Mode.INIT): m.MAV_STATE_CALIBRATING,
    int(Mode.INTEGRATED): m.MAV_STATE_ACTIVE,
    int(Mode.AUTONOMOUS): m.MAV_STATE_ACTIVE,
    int(Mode.FAILED): m.MAV_STATE_CRITICAL,
}
# places of the upper triangle of a 6x6 matrix, row by row
_TRIANGLE = tuple(6 * row + column for row in range(6) for column in range(row, 6))
_GPS, _AHRS, _LOGGING = m.MAV_SYS_STATUS_SENSOR_GPS, m.MAV_SYS_STATUS_AHRS, m.MAV_SYS_STATUS_LOGGING
_PRESENT = _GPS | _AHRS | _LOGGING
_FIX_TYPES = {
    int(FixType.FIX_2D): m.GPS_FIX_TYPE_2D_FIX,
    int(FixType.FIX_3D): m.GPS_FIX_TYPE_3D_FIX,
    int(FixType.POSITION_3D): m.GPS_FIX_TYPE_3D_FIX,
}
_TOLD = RecordReader(np.zeros(1, INPUT)).at
_R, _SIGMA_R, _SIGMA_V = (_TOLD[name] for name in ("fix_r_itrf_m", "fix_sigma_r_m", "fix_sigma_v_mps"))
# An alert's text as STATUSTEXT carries it, made once: nothing is rendered in the tick.
_TEXTS = {int(alert.id): (int(alert.severity), alert.text.encode("ascii")) for alert in ALERTS.values()}


def _u16(value: float) -> int:
    return _U16 if not value < _U16 else max(0, int(value))


def _u32(value: float) -> int:
    return _U32 if not value < _U32 else max(0, int(value))


def _largest(values: tuple[float, ...]) -> float:
    """NaN where one of them is."""
    return math.nan if any(map(math.isnan, values)) else max(values)


class Telemetry:
    """Flight's messages. `downlink` calls each method at its rate. `at`: places in the output record."""

    __slots__ = ("_geodetic", "_geodetic_in", "_out", "_table", "at")

    def __init__(
        self,
        out: MavlinkOut,
        reader: RecordReader,
        table_crc32: int,
        schema_hash: int,
        set_name: bytes,
        certificate: int,
    ) -> None:
        self._out = out
        self.at = reader.at
        self._table = (table_crc32, schema_hash, set_name, certificate)
        self._geodetic_in = np.zeros(3)
        self._geodetic = np.zeros(3)

    def name_table(self, crc32: int, schema_hash: int, set_name: bytes, certificate: int) -> None:
        """From now on this navigation table is named."""
        self._table = (crc32, schema_hash, set_name, certificate)

    def alert(self, sequence: int, t_gps_ns: int, alert_id: int, active: int, value: float) -> None:
        """LEONAV_ALERT and, when it begins, its text for any ground station."""
        severity, text = _TEXTS[alert_id]
        self._out.send(_ALERT, t_gps_ns, _u32(sequence), value, alert_id, severity, active)
        if active:
            self._out.send(_STATUSTEXT, severity, text, 0, 0)

    def alert_again(self, sequence: int, t_gps_ns: int, alert_id: int, active: int, value: float) -> None:
        """LEONAV_ALERT of an event that has been told before."""
        severity, _ = _TEXTS[alert_id]
        self._out.send(_ALERT, t_gps_ns, _u32(sequence), value, alert_id, severity, active)

    def nav_state(self, out: tuple[float, ...], validity: int) -> None:
        """LEONAV_NAV_STATE."""
        at = self.at
        r, v = at["r_gcrf_m"], at["v_gcrf_mps"]
        self._out.send(
            _NAV_STATE,
            int(out[at["t_gps_ns"]]),
            *out[r : r + 3],
            *out[v : v + 3],
            int(out[at["mode"]]),
            validity,
            int(out[at["flag"]]),
        )

    def integrity(self, out: tuple[float, ...], alerts: int, verdict: int) -> None:
        """LEONAV_INTEGRITY."""
        at = self.at
        crc32, _schema, _name, certificate = self._table
        self._out.send(
            _INTEGRITY,
            int(out[at["t_gps_ns"]]),
            out[at["bound_m"]],
            out[at["limit_m"]],
            out[at["bound_3d_m"]],
            out[at["fix_age_s"]],
            out[at["outage_age_s"]],
            out[at["flag_age_s"]],
            alerts,
            crc32,
            _u16(out[at["streak"]]),
            int(out[at["mode"]]),
            int(out[at["flag"]]),
            verdict,
            int(out[at["driver"]]),
            certificate,
            int(out[at["da_coverage_pct"]]),
            int(out[at["da_source"]]),
            int(out[at["uncovered"]]),
        )

    def protection(self, out: tuple[float, ...], levels: list[list[float]]) -> None:
        """LEONAV_PROTECTION. levels: [m], in GCRF and along the orbit."""
        at = self.at
        gcrf_m, rtn_m = levels
        limit_m = out[at["limit_m"]]
        self._out.send(
            _PROTECTION,
            int(out[at["t_gps_ns"]]),
            *gcrf_m,
            *(limit_m, limit_m, limit_m),
            out[at["bound_3d_m"]],
            *(min(level_m, _FLOAT_MAX) for level_m in rtn_m),  # NaN stays NaN
            int(out[at["driver"]]),
        )

    def heartbeat(self, out: tuple[float, ...], armed: bool) -> None:
        """HEARTBEAT: armed is the failure flag."""
        at = self.at
        mode, flag = int(out[at["mode"]]), int(out[at["flag"]])
        healthy = flag == FlagState.CLEAR or mode == Mode.INIT
        self._out.send(
            _HEARTBEAT,
            m.MAV_TYPE_SPACECRAFT_ORBITER,
            m.MAV_AUTOPILOT_GENERIC,
            m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (m.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0),
            mode,
            _SYSTEM_STATUS[mode] if healthy else m.MAV_STATE_CRITICAL,
            _DIALECT_VERSION,
        )

    def sys_status(self, out: tuple[float, ...], rejected: int, logging: bool, bus: bool) -> None:
        """SYS_STATUS. Health: GPS, fixes are accepted; AHRS, the state may be used; LOGGING, the journal is whole.

        errors_comm: everything that was refused; errors_count1: 1 while the sensor bus is off.
        """
        at = self.at
        initialised = int(out[at["mode"]]) != Mode.INIT
        correcting = initialised and out[at["outage_age_s"]] == 0.0
        usable = initialised and int(out[at["flag"]]) == FlagState.CLEAR
        health = (_GPS if correcting else 0) | (_AHRS if usable else 0) | (_LOGGING if logging else 0)
        self._out.send(
            _SYS_STATUS,
            _PRESENT,
            _PRESENT,
            health,
            0,
            _UNKNOWN,
            -1,
            -1,
            0,
            _u16(rejected),
            0 if bus else 1,
            0,
            0,
            0,
            0,
            0,
            0,
        )

    def system_time(self, unix_ns: int, boot_ns: int) -> None:
        """SYSTEM_TIME."""
        self._out.send(_SYSTEM_TIME, unix_ns // 1000, (boot_ns // 1_000_000) & _U32)

    def gps_raw(self, fix: tuple[float, ...], told: tuple[float, ...], unix_ns: int) -> None:
        """GPS_RAW_INT of the last fix. told: the input record of the step that took it."""
        if fix[self.at["fix_gps_ns"]] == 0:
            return
        self._geodetic_in[:] = told[_R : _R + 3]
        geodetic(self._geodetic_in, self._geodetic)
        latitude, longitude, height_m = self._geodetic.tolist()
        usable = math.isfinite(latitude) and math.isfinite(longitude) and abs(height_m) < 2e6
        sigma_r_m = _largest(told[_SIGMA_R : _SIGMA_R + 3])
        sigma_v_mps = _largest(told[_SIGMA_V : _SIGMA_V + 3])
        self._out.send(
            _GPS_RAW_INT,
            unix_ns // 1000,
            _FIX_TYPES.get(int(told[_TOLD["fix_type"]]), m.GPS_FIX_TYPE_NO_FIX),
            int(math.degrees(latitude) * 1e7) if usable else 0,
            int(math.degrees(longitude) * 1e7) if usable else 0,
            int(height_m * 1e3) if usable else 0,
            _UNKNOWN,
            _UNKNOWN,
            _UNKNOWN,  # orbital speed does not fit into centimetres per second of 16 bits
            _UNKNOWN,
            int(told[_TOLD["fix_satellites"]]) & 0xFF,
            0,  # height above the ellipsoid is told above
            _u32(sigma_r_m * 1e3),
            _u32(sigma_r_m * 1e3),
            _u32(sigma_v_mps * 1e3),
            0,
            0,
        )

    def estimator(self, fix: tuple[float, ...], unix_ns: int) -> None:
        """ESTIMATOR_STATUS. `fix`: the output record of the step that took the last fix."""
        at = self.at
        if fix[at["fix_gps_ns"]] == 0:
            return
        ratio = math.sqrt(fix[at["nis"]] / fix[at["gate"]]) if fix[at["gate"]] > 0.0 else 0.0
        sigma = at["innovation_sigma"]
        used = int(fix[at["fix_used"]])
        self._out.send(
            _ESTIMATOR_STATUS,
            unix_ns // 1000,
            (m.ESTIMATOR_POS_HORIZ_ABS | m.ESTIMATOR_POS_VERT_ABS | m.ESTIMATOR_VELOCITY_HORIZ) if used else 0,
            ratio,
            ratio,
            ratio,
            0.0,
            0.0,
            0.0,
            fix[sigma],
            fix[sigma + 2],
        )

    def innovation(self, fix: tuple[float, ...]) -> None:
        """LEONAV_INNOVATION of the last fix."""
        at = self.at
        if fix[at["fix_gps_ns"]] == 0:
            return
        innovation, sigma = at["innovation"], at["innovation_sigma"]
        used = int(fix[at["fix_used"]])
        cause = int(fix[at["fix_cause"]])
        self._out.send(
            _INNOVATION,
            int(fix[at["fix_gps_ns"]]),
            *fix[innovation : innovation + 6],
            *fix[sigma : sigma + 6],
            fix[at["nis"]],
            fix[at["gate"]],
            fix[at["mean_nis"]],
            used,
            cause if cause >= 0 else 0xFF,
            *fix[at["type_nis"] : at["type_nis"] + 2],
            *fix[at["type_gate"] : at["type_gate"] + 2],
            *(int(value) & 0xFF for value in fix[at["type_cause"] : at["type_cause"] + 2]),
            fix[at["monitor_statistic"]],
            int(fix[at["monitor_kind"]]) & 0xFF,
            fix[at["drag_scale"]],
        )

    def covariance(self, out: tuple[float, ...]) -> None:
        """LEONAV_COVARIANCE: with it the ground has the NEES of any state it knows the truth of."""
        at = self.at
        first = at["covariance"]
        self._out.send(
            _COVARIANCE, int(out[at["t_gps_ns"]]), *(out[first + place] for place in _TRIANGLE), out[at["sigma_time_s"]]
        )

    def time_to_flag(self, t_gps_ns: int, left_s: float, age_s: float, governing: int, lost: int) -> None:
        """LEONAV_TIME_TO_FLAG."""
        self._out.send(_TIME_TO_FLAG, t_gps_ns, left_s, age_s, governing, lost)

    def counters(
        self, tick: int, received: int, accepted: int, slips: int, journal_dropped: int, rejected: list[int]
    ) -> None:
        """LEONAV_COUNTERS: what was refused, by cause."""
        self._out.send(
            _COUNTERS,
            tick,
            _u32(received),
            _u32(accepted),
            _u32(slips),
            _u32(journal_dropped),
            *map(_u32, rejected),
        )

    def table_status(self, kind: int) -> None:
        """LEONAV_TABLE_STATUS of the navigation table in force."""
        crc32, schema_hash, set_name, certificate = self._table
        self._out.send(_TABLE_STATUS, crc32, schema_hash, set_name, kind, certificate)

    def timing(self, t_gps_ns: int, place: tuple[int, int], member: Member, slips: int) -> None:
        """LEONAV_TIMING. place: index of the member, and how many there are."""
        p50_us, p99_us, p999_us = (member.percentile_ns(percent) / 1e3 for percent in (50.0, 99.0, 99.9))
        self._out.send(
            _TIMING,
            t_gps_ns,
            _u32(member.runs),
            _u32(member.over_budget),
            _u32(slips),
            member.budget_us,
            p50_us,
            p99_us,
            p999_us,
            member.longest_ns / 1e3,
            *map(_u32, member.octaves()),
            member.name.encode("ascii")[:16],
            *place,
        )

    def link(
        self,
        event_sequence: int,
        accepted: int,
        lost: int,
        refused: list[int],
        alerts_open: int,
        state: tuple[int, int, int],
    ) -> None:
        """LEONAV_LINK. state: bench profile, flag armed, table staged."""
        self._out.send(
            _LINK, _u32(event_sequence), _u32(accepted), _u32(lost), *map(_u32, refused), alerts_open, *state
        )
