"""GPS time in words: int64 nanoseconds since 1980-01-06T00:00:00 GPS, without leap seconds."""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta

NS_PER_S = 1_000_000_000
NS_PER_DAY = 86_400 * NS_PER_S
GPS_EPOCH_MJD = 44244
GPS_EPOCH_UNIX_NS = 315_964_800 * NS_PER_S
GPS_MINUS_UTC_NS = 18 * NS_PER_S  # since 2017-01-01; of the time of day of an operator's machine, no more is asked

# The calendar is used as a count of days only: the zone says nothing about leap seconds here.
_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)


def format_gps(t_gps_ns: int) -> str:
    """Calendar reading of the GPS clock, to the second: '2018-12-30 00:00:00 GPS'."""
    try:
        instant = _EPOCH + timedelta(seconds=t_gps_ns // NS_PER_S)
    except OverflowError:
        return f"{t_gps_ns} ns GPS"
    return f"{instant:%Y-%m-%d %H:%M:%S} GPS"


def calendar_day(text: str) -> date:
    """A day given as YYYY-MM-DD; ValueError when it is none, or lies before GPS time."""
    day = date.fromisoformat(text)
    if day < _EPOCH.date():
        raise ValueError(text)
    return day


def gps_of_day(day: date) -> int:
    """GPS time [ns] at which the GPS clock begins a calendar day."""
    return (day - _EPOCH.date()).days * NS_PER_DAY


def day_of_gps(t_gps_ns: int) -> date:
    """The calendar day of the GPS clock at a GPS time [ns]."""
    return (_EPOCH + timedelta(days=t_gps_ns // NS_PER_DAY)).date()
