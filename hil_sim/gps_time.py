"""GPS time as int64 nanoseconds since 1980-01-06T00:00:00 GPS, and its way to UTC, TAI, TT and UT1 dates.

TAI = GPS + 19 s and TT = GPS + 51.184 s exactly; UTC = GPS minus the leap seconds since 1980.
"""

from __future__ import annotations

from datetime import datetime, timedelta

import erfa
import numpy as np

NS = 1_000_000_000
DAY_NS = 86_400 * NS
TAI_MINUS_GPS_S = 19
TT_MINUS_GPS_NS = 51_184_000_000
GPS_EPOCH = datetime(1980, 1, 6)
GPS_EPOCH_JD = 2_444_244.5
GPS_EPOCH_MJD = 44_244
UNIX_TO_GPS_EPOCH_S = 315_964_800  # Unix time of the GPS epoch
WEEK_NS = 7 * DAY_NS

SCALES = ("gps", "utc", "tai")


def tai_minus_utc_s(moment: datetime) -> int:
    """TAI - UTC [s] at a UTC calendar moment (IERS Bulletin C, as carried by ERFA)."""
    fraction = (moment.hour * 3600 + moment.minute * 60 + moment.second) / 86400.0
    return round(float(erfa.dat(moment.year, moment.month, moment.day, fraction)))


def from_calendar(moment: datetime, scale: str) -> int:
    """GPS time [ns] of a naive calendar moment read in `scale` ('gps', 'utc' or 'tai')."""
    since = moment - GPS_EPOCH
    calendar_ns = (since.days * 86_400 + since.seconds) * NS + since.microseconds * 1000
    if scale == "gps":
        return calendar_ns
    if scale == "tai":
        return calendar_ns - TAI_MINUS_GPS_S * NS
    if scale == "utc":
        return calendar_ns + (tai_minus_utc_s(moment) - TAI_MINUS_GPS_S) * NS
    raise ValueError(f"unknown time scale {scale!r}: one of {', '.join(SCALES)}")


def to_calendar(t_gps_ns: int) -> datetime:
    """Calendar moment in the GPS scale, to the microsecond."""
    return GPS_EPOCH + timedelta(microseconds=int(t_gps_ns) // 1000)


def leap_seconds(t_gps_ns: int) -> int:
    """GPS - UTC [s] at a GPS time (18 since 2017)."""
    calendar = to_calendar(t_gps_ns)
    guess = tai_minus_utc_s(calendar) - TAI_MINUS_GPS_S
    return tai_minus_utc_s(calendar - timedelta(seconds=guess)) - TAI_MINUS_GPS_S


def to_unix_ns(t_gps_ns: int) -> int:
    """Unix time (UTC) [ns]; it repeats during a leap second, as Unix time does."""
    return int(t_gps_ns) + (UNIX_TO_GPS_EPOCH_S - leap_seconds(t_gps_ns)) * NS


def tt_two_part(t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two-part Julian date in TT, each (n,): whole days (x.5) and the fraction [days], ~1e-16 days."""
    days, rest = np.divmod(np.asarray(t_gps_ns, dtype=np.int64) + TT_MINUS_GPS_NS, DAY_NS)
    return GPS_EPOCH_JD + days, rest / DAY_NS
