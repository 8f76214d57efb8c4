"""What all readers of orbit files share: text of plain and gzipped files, calendar dates, time scales, their result."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import NamedTuple

import erfa
import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError

# what is added to a reading of each scale to give GPS time [ns]; UTC depends on the day. GST, QZSST and IRNSS time are
# kept within a microsecond of GPS time; BDT began 14 s of leap seconds later (SP3-d, Hilla 2016, line 13).
OFFSETS_NS = {
    "GPS": 0,
    "GAL": 0,
    "QZS": 0,
    "IRN": 0,
    "BDT": 14 * gps_time.NS,
    "TAI": -gps_time.TAI_MINUS_GPS_S * gps_time.NS,
    "TT": -gps_time.TT_MINUS_GPS_NS,
}
UTC_SCALES = ("UTC", "GLO")
SCALES = (*OFFSETS_NS, *UTC_SCALES)
_GPS_EPOCH_DAY = date(1980, 1, 6).toordinal()
_ISO = re.compile(r"(\d{4})-(?:(\d{2})-(\d{2})|(\d{3}))T(\d{2}):(\d{2}):(\d{2})(\.\d*)?Z?$")


class Moment(NamedTuple):
    """A calendar reading in its own scale: days since 1980-01-06 and nanoseconds since that day's midnight.

    A leap second is 86400 s and more after midnight, so that no reading of UTC is ambiguous.
    """

    day: int
    within_ns: int


class FileSamples(NamedTuple):
    """What a reader found of one satellite, before times, units and consistency are judged (real_orbit.finish).

    moments: n readings in `scale`. r_m (n, 3). v (n, 3) in the file's unit, which the standard says is
    `standard_unit`; None where the file has no velocities. line (n,): where each sample stands in the file.
    """

    moments: Sequence[Moment]
    scale: str
    r_m: np.ndarray
    v: np.ndarray | None
    standard_unit: str
    frame: str
    satellite: str
    name: str
    kind: str
    line: np.ndarray


def read_text(path: Path) -> str:
    """Text of a plain or gzipped file. Raises DataError, also for a gzipped file that was cut off."""
    try:
        raw = path.read_bytes()
        if raw[:2] == b"\x1f\x8b":
            raw = gzip.decompress(raw)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error}") from None
    except (EOFError, zlib.error) as error:
        raise DataError(f"{path}: its gzip stream is damaged ({error}); fetch it again") from None
    return raw.decode("utf-8", errors="replace")


def moment(year: int, month: int, day: int, hour: int, minute: int, second: str) -> Moment:
    """A calendar reading; `second` as text, so that no nanosecond is lost. ValueError when there is no such moment."""
    return _moment(date(year, month, day), hour, minute, second)


def iso_moment(text: str) -> Moment:
    """A reading such as 2019-01-01T00:00:00.5 or, by day of year, 2019-001T00:00:00.5Z. ValueError if it is none."""
    found = _ISO.match(text.strip())
    if found is None:
        raise ValueError(f"{text.strip()!r} is no moment such as 2019-01-01T00:00:00.000")
    year, month, day, of_year, hour, minute, second, fraction = found.groups()
    if of_year is None:
        on = date(int(year), int(month), int(day))
    else:
        on = date.fromordinal(date(int(year), 1, 1).toordinal() + int(of_year) - 1)
        if on.year != int(year):
            raise ValueError(f"{text.strip()!r}: the year has no day {of_year}")
    return _moment(on, int(hour), int(minute), second + (fraction or ""))


def _moment(on: date, hour: int, minute: int, second: str) -> Moment:
    whole, _, fraction = second.strip().partition(".")
    second_ns = int(whole) * gps_time.NS + round(float(f"0.{fraction or '0'}") * 1e9)
    if not (0 <= hour < 24 and 0 <= minute < 60 and 0 <= second_ns < 61 * gps_time.NS):
        raise ValueError(f"no such time of day as {hour}:{minute}:{second.strip()}")
    return Moment(on.toordinal() - _GPS_EPOCH_DAY, (hour * 3600 + minute * 60) * gps_time.NS + second_ns)


def to_gps_ns(moments: Sequence[Moment], scale: str) -> np.ndarray:
    """GPS time (n,) int64 [ns] of readings in one of SCALES."""
    table = np.array(moments, dtype=np.int64).reshape(-1, 2)
    naive = table[:, 0] * gps_time.DAY_NS + table[:, 1]
    if scale in UTC_SCALES:
        days, which = np.unique(table[:, 0], return_inverse=True)
        offset_s = [_gps_minus_utc_s(int(day)) for day in days]
        return naive + np.array(offset_s, dtype=np.int64)[which] * gps_time.NS
    return naive + OFFSETS_NS[scale]


def _gps_minus_utc_s(day: int) -> int:
    on = date.fromordinal(day + _GPS_EPOCH_DAY)
    return round(float(erfa.dat(on.year, on.month, on.day, 0.0))) - gps_time.TAI_MINUS_GPS_S
