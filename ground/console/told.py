"""What flight tells, message by message, as values."""

from __future__ import annotations

from typing import NamedTuple


class Integrity(NamedTuple):
    """LEONAV_INTEGRITY as received; ages in seconds at the moment of sending."""

    t_gps_ns: int
    bound_m: float
    limit_m: float
    bound_3d_m: float
    fix_age_s: float
    outage_age_s: float
    flag_age_s: float
    alerts: int
    table_crc32: int
    accepted_streak: int
    mode: int
    flag_state: int
    verdict: int
    driver: int
    certificate: int
    stored_da_coverage_pct: int
    da_source: int
    uncovered: int = 0

    @property
    def driving_bound_m(self) -> float:
        """The bound that flight compares with the limit."""
        return self.bound_3d_m if self.driver == 1 else self.bound_m


class Protection(NamedTuple):
    """LEONAV_PROTECTION: protection level and alert limit of each axis [m]."""

    t_gps_ns: int
    level_m: tuple[float, ...]
    limit_m: tuple[float, ...]
    level_3d_m: float
    level_rtn_m: tuple[float, ...]
    driver: int


class NavState(NamedTuple):
    """LEONAV_NAV_STATE: geocentric distance [m] and speed [m/s] stand for the vectors on the screen."""

    t_gps_ns: int
    radius_m: float
    speed_mps: float
    validity: int
    r_gcrf_m: tuple[float, ...] = ()
    v_gcrf_mps: tuple[float, ...] = ()


class Counters(NamedTuple):
    """LEONAV_COUNTERS."""

    tick: int
    received: int
    accepted: int
    slips: int
    journal_dropped: int
    rejected: tuple[int, ...]


class Innovation(NamedTuple):
    """LEONAV_INNOVATION: what the last fix looked like to the filter; flight repeats it until the next fix."""

    t_gps_ns: int
    nis: float
    gate: float
    mean_nis: float
    used: int
    cause: int


class TimeToFlag(NamedTuple):
    """LEONAV_TIME_TO_FLAG: how long the state may still be trusted without GNSS."""

    t_gps_ns: int
    time_to_flag_s: float
    prediction_age_s: float
    governing: int
    in_outage: int


class LinkStatus(NamedTuple):
    """LEONAV_LINK: the link as flight sees it."""

    event_sequence: int
    accepted: int
    lost: int
    refused: tuple[int, ...]
    alerts_open: int
    bench: int
    armed: int
    table_staged: int


class Timing(NamedTuple):
    """LEONAV_TIMING of one member of flight's tick or slack; microseconds."""

    place: int
    members: int
    name: str
    runs: int
    over_budget: int
    slips: int
    budget_us: float
    p50_us: float
    p99_us: float
    p999_us: float
    longest_us: float
    histogram: tuple[int, ...]


class Table(NamedTuple):
    """LEONAV_TABLE_STATUS of the navigation table."""

    crc32: int
    set_name: str
    certificate: int
