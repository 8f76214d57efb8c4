"""Which message goes down in which tick: a table of streams, by default at the rates of the navigation table.

A stream is due when the tick's number less its offset is a multiple of its interval. State, integrity and protection
levels go out in one tick; each other one in the tick with the fewest others, so that none bears what a second holds.
SET_MESSAGE_INTERVAL and the parameters change intervals; HEARTBEAT and LEONAV_INTEGRITY cannot be switched off, because
silence must not look like health.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from flightsw.icd import mavlink as m
from flightsw.link.telemetry import Telemetry
from flightsw.schedule import Schedule

NEVER = 0
ALWAYS_ON = (m.MAVLINK_MSG_ID_HEARTBEAT, m.MAVLINK_MSG_ID_LEONAV_INTEGRITY)
_SLOWEST_ALWAYS_ON_US = 1_000_000
_SLOWEST_US = 3_600_000_000
_SPREAD_TICKS = 100


class Prediction(NamedTuple):
    """Time to flag as it was last told on the bus."""

    t_gps_ns: int = 0
    left_s: float = float("nan")
    age_s: float = float("nan")
    governing: int = 0
    lost: int = 0


class Told(Protocol):
    """What the loop offers to be told; values of the present tick."""

    out: tuple[float, ...]
    alerts: int
    verdict: int
    validity: int
    armed: bool
    tick: int
    slips: int
    counter_ns: int
    counter_start_ns: int
    prediction: Prediction
    memory: Any
    receiver: Any
    journal: Any
    port: Any
    schedule: Schedule

    def fix(self) -> tuple[float, ...]:
        """The output record of the step that took the last fix."""
        ...

    def fix_told(self) -> tuple[float, ...]:
        """The input record of that step."""
        ...

    def unix_ns(self) -> int:
        """Log time of the tick."""
        ...

    def rejections(self) -> int:
        """All rejections since start."""
        ...

    def rejected_by_cause(self) -> list[int]:
        """Rejections by RejectCause."""
        ...


class _Stream:
    __slots__ = ("default_ticks", "group", "interval_ticks", "message_id", "offset", "send")

    def __init__(self, message_id: int, group: str, offset: int, default_ticks: int, send: Callable[[], None]) -> None:
        self.message_id = message_id
        self.group = group
        self.offset = offset
        self.default_ticks = self.interval_ticks = default_ticks
        self.send = send


class Downlink:
    """The streams. `rates`: ticks between messages of the groups nav, status, counters, table."""

    __slots__ = ("_by_id", "_kind", "_member", "_period_ns", "_streams", "_telemetry", "_told")

    def __init__(self, telemetry: Telemetry, told: Told, rates: dict[str, int], kind: int, period_ns: int) -> None:
        self._telemetry = telemetry
        self._told = told
        self._kind = kind
        self._period_ns = period_ns
        self._member = 0  # whose timing is told next
        senders: tuple[tuple[int, str, Callable[[], None]], ...] = (
            (m.MAVLINK_MSG_ID_LEONAV_NAV_STATE, "nav", self._nav_state),
            (m.MAVLINK_MSG_ID_LEONAV_INTEGRITY, "nav", self._integrity),
            (m.MAVLINK_MSG_ID_LEONAV_PROTECTION, "nav", self._protection),
            (m.MAVLINK_MSG_ID_HEARTBEAT, "status", self._heartbeat),
            (m.MAVLINK_MSG_ID_SYS_STATUS, "status", self._sys_status),
            (m.MAVLINK_MSG_ID_SYSTEM_TIME, "status", self._system_time),
            (m.MAVLINK_MSG_ID_GPS_RAW_INT, "status", self._gps_raw),
            (m.MAVLINK_MSG_ID_ESTIMATOR_STATUS, "status", self._estimator),
            (m.MAVLINK_MSG_ID_LEONAV_INNOVATION, "status", self._innovation),
            (m.MAVLINK_MSG_ID_LEONAV_COVARIANCE, "status", self._covariance),
            (m.MAVLINK_MSG_ID_LEONAV_COUNTERS, "counters", self._counters),
            (m.MAVLINK_MSG_ID_LEONAV_TABLE_STATUS, "table", self.table_status),
            (m.MAVLINK_MSG_ID_LEONAV_TIME_TO_FLAG, "status", self._time_to_flag),
        )
        self._streams: list[_Stream] = []
        self._by_id: dict[int, _Stream] = {}
        for message_id, group, send in senders:
            self._add(message_id, group, rates[group], send)

    def add(self, message_id: int, group: str, send: Callable[[], None]) -> None:
        """One more message, at the rate of a group, after those there are."""
        like = next(stream for stream in self._streams if stream.group == group)
        self._add(message_id, group, like.default_ticks, send)

    def _add(self, message_id: int, group: str, ticks: int, send: Callable[[], None]) -> None:
        offset = 0 if group == "nav" else self._emptiest(ticks)
        stream = _Stream(message_id, group, offset, ticks, send)
        self._streams.append(stream)
        self._by_id[message_id] = stream

    def _emptiest(self, ticks: int) -> int:
        """The first tick of an interval, or of its beginning, in which fewest of the streams there are go out."""
        others = [(stream.offset, math.gcd(ticks, stream.default_ticks)) for stream in self._streams]
        loads = [
            sum((tick - offset) % often == 0 for offset, often in others) for tick in range(min(ticks, _SPREAD_TICKS))
        ]
        return loads.index(min(loads)) if loads else 0

    def fix(self) -> tuple[float, ...]:
        """The output record of the step that took the last fix, for functions beside navigation."""
        return self._told.fix()

    def run(self) -> None:
        """Send what is due in this tick."""
        tick = self._told.tick
        for stream in self._streams:
            if stream.interval_ticks and (tick - stream.offset) % stream.interval_ticks == 0:
                stream.send()

    def set_interval(self, message_id: int, interval_us: float) -> bool:
        """Microseconds between messages; 0 default, -1 never. False where that is refused."""
        stream = self._by_id.get(message_id)
        if stream is None or not -1.0 <= interval_us <= _SLOWEST_US:
            return False
        if message_id in ALWAYS_ON and not 0.0 <= interval_us <= _SLOWEST_ALWAYS_ON_US:
            return False
        if interval_us == 0.0:
            stream.interval_ticks = stream.default_ticks
        elif interval_us < 0.0:
            stream.interval_ticks = NEVER
        else:
            stream.interval_ticks = max(1, round(interval_us * 1000.0 / self._period_ns))
        return True

    def interval_us(self, message_id: int) -> int:
        """Microseconds between messages; -1 never, 0 a message that flight does not stream."""
        stream = self._by_id.get(message_id)
        if stream is None:
            return 0
        return stream.interval_ticks * self._period_ns // 1000 if stream.interval_ticks else -1

    def send_once(self, message_id: int) -> bool:
        """Send one message now; False where flight has none of that kind."""
        stream = self._by_id.get(message_id)
        if stream is None:
            return False
        stream.send()
        return True

    # -- what is sent

    def _nav_state(self) -> None:
        self._telemetry.nav_state(self._told.out, self._told.validity)

    def _integrity(self) -> None:
        self._telemetry.integrity(self._told.out, self._told.alerts, self._told.verdict)

    def _protection(self) -> None:
        out, at = self._told.out, self._telemetry.at
        levels = self._told.memory.protect(out[at["bound_m"]], int(out[at["t_gps_ns"]]))
        self._telemetry.protection(out, levels.tolist())

    def _heartbeat(self) -> None:
        self._telemetry.heartbeat(self._told.out, self._told.armed)

    def _sys_status(self) -> None:
        told = self._told
        self._telemetry.sys_status(told.out, told.rejections(), told.journal.dropped == 0, not told.port.is_off)

    def _system_time(self) -> None:
        told = self._told
        self._telemetry.system_time(told.unix_ns(), told.counter_ns - told.counter_start_ns)

    def _gps_raw(self) -> None:
        self._telemetry.gps_raw(self._told.fix(), self._told.fix_told(), self._told.unix_ns())

    def _estimator(self) -> None:
        self._telemetry.estimator(self._told.fix(), self._told.unix_ns())

    def _innovation(self) -> None:
        self._telemetry.innovation(self._told.fix())

    def _covariance(self) -> None:
        self._telemetry.covariance(self._told.out)

    def _counters(self) -> None:
        told = self._told
        self._telemetry.counters(
            told.tick,
            told.receiver.received,
            told.receiver.accepted,
            told.slips,
            told.journal.dropped,
            told.rejected_by_cause(),
        )

    def table_status(self) -> None:
        """LEONAV_TABLE_STATUS of the table in force."""
        self._telemetry.table_status(self._kind)

    def timing(self) -> None:
        """LEONAV_TIMING of one member; they take turns. Never the same twice, so no part of what a replay compares."""
        told = self._told
        members = told.schedule.everyone()
        index = self._member % len(members)
        self._member = index + 1
        t_gps_ns = int(told.out[self._telemetry.at["t_gps_ns"]])
        self._telemetry.timing(t_gps_ns, (index, len(members)), members[index], told.slips)

    def _time_to_flag(self) -> None:
        self._telemetry.time_to_flag(*self._told.prediction)
