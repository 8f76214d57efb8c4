"""The Earth orientation table: what flight needs to turn between ITRF and GCRF, as nodes to interpolate.

Nodes hold the celestial intermediate pole X, Y and the CIO locator s (IAU 2006/2000A, ERFA xys06a, with the
observed offsets dX, dY of the IERS), polar motion xp, yp [rad] and UT1 - GPS [s], every six hours. Diurnal
and semi-diurnal tides in polar motion and UT1 (below 0.4 mas and 0.03 ms, some centimetres in low orbit) are
left out: nodes six hours apart could not carry them.

Source of the observations: finals2000A of the IERS (Bulletin A columns, which run on into the prediction).
UT1 - GPS has no leap seconds, so nothing jumps in it.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import erfa
import numpy as np

from flightsw.icd.table_file import encode
from flightsw.icd.table_schema import EARTH_ORIENTATION, MAX_EARTH_ORIENTATION_NODES
from ground.errors import OperatorError
from ground.tables.gps_time import GPS_EPOCH_MJD, NS_PER_DAY, NS_PER_S, format_gps

STEP_NS = 6 * 3600 * NS_PER_S
# Four-point interpolation between nodes i and i + 1 reads i - 1 to i + 2; one more on each side lets flight
# run a little beyond the span that was asked for.
MARGIN_NODES = 2

_TAI_MINUS_GPS_S = 19.0  # IS-GPS-200: GPS time was set to UTC at its epoch, when TAI - UTC was 19 s
_TT_MINUS_GPS_S = 51.184
_ARCSEC = np.pi / (180.0 * 3600.0)


class Observations(NamedTuple):
    """Daily IERS values at 0 h UTC, ascending. All arrays have shape (n,)."""

    path: Path
    t_gps_ns: np.ndarray  # int64
    xp_rad: np.ndarray
    yp_rad: np.ndarray
    ut1_minus_gps_s: np.ndarray
    dx_rad: np.ndarray
    dy_rad: np.ndarray


def build_earth_orientation(t_start_gps_ns: int, t_stop_gps_ns: int, finals_path: str | Path | None = None) -> bytes:
    """Binary table of kind "earth_orientation" for a span of GPS time [ns].

    The header's validity is where four-point interpolation has its nodes; it covers the span and up to one
    step (6 h) more on each side. Raises OperatorError when the IERS data do not cover the span.
    """
    if t_stop_gps_ns < t_start_gps_ns:
        raise OperatorError(
            f"Earth orientation: span ends ({format_gps(t_stop_gps_ns)}) before it begins "
            f"({format_gps(t_start_gps_ns)}); swap them"
        )
    first = t_start_gps_ns // STEP_NS - MARGIN_NODES
    last = -(-t_stop_gps_ns // STEP_NS) + MARGIN_NODES
    if first < 0:
        raise OperatorError(f"Earth orientation: {format_gps(t_start_gps_ns)} lies before GPS time; start later")
    count = last - first + 1
    if count > MAX_EARTH_ORIENTATION_NODES:
        days = (MAX_EARTH_ORIENTATION_NODES - 2 * MARGIN_NODES - 1) * STEP_NS / NS_PER_DAY
        raise OperatorError(
            f"Earth orientation: the span needs {count} nodes, a table holds {MAX_EARTH_ORIENTATION_NODES}; "
            f"ask for at most {days:g} days"
        )
    t_nodes_gps_ns = np.arange(first, last + 1, dtype=np.int64) * STEP_NS
    values = np.zeros(1, EARTH_ORIENTATION.dtype)
    record = values[0]
    record["t0_gps_ns"] = t_nodes_gps_ns[0]
    record["step_ns"] = STEP_NS
    record["count"] = count
    record["nodes"][:count] = evaluate(read_finals(finals_path), t_nodes_gps_ns)
    return encode(
        EARTH_ORIENTATION.name,
        "iers",
        values,
        valid_from_gps_ns=int(t_nodes_gps_ns[1]),
        valid_to_gps_ns=int(t_nodes_gps_ns[-2]),
    )


def evaluate(observations: Observations, t_gps_ns: np.ndarray) -> np.ndarray:
    """X, Y, s, xp, yp [rad], UT1 - GPS [s] at GPS times (n,) int64 ns: shape (n, 6).

    Raises OperatorError outside the observations.
    """
    daily = np.column_stack(observations[2:])
    xp, yp, ut1_minus_gps, dx, dy = _lagrange(observations, daily, t_gps_ns).T
    # ERFA takes a two-part Julian date: whole days and fraction keep the nanoseconds
    days, rest = np.divmod(t_gps_ns, NS_PER_DAY)
    tt_fraction = (rest / NS_PER_S + _TT_MINUS_GPS_S) / 86400.0
    x, y, s = erfa.xys06a(erfa.DJM0 + GPS_EPOCH_MJD + days, tt_fraction)
    # s contains -XY/2, so it follows the observed pole (IERS Conventions 2010, eq. 5.8)
    s_of_pole = s + x * y / 2.0
    x, y = x + dx, y + dy
    return np.column_stack((x, y, s_of_pole - x * y / 2.0, xp, yp, ut1_minus_gps))


def read_finals(finals_path: str | Path | None = None) -> Observations:
    """Observations and predictions from a finals2000A file, by default the one of astropy-iers-data."""
    if finals_path is None:
        import astropy_iers_data

        finals_path = astropy_iers_data.IERS_A_FILE
    path = Path(finals_path)
    try:
        state = path.stat()
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read as an IERS finals2000A file: {error}") from error
    return _read_finals(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=2)  # a campaign makes hundreds of tables from one file; a changed file is read anew
def _read_finals(path: Path, modified_ns: int, size: int) -> Observations:
    del modified_ns, size
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise OperatorError(f"{path}: cannot be read as an IERS finals2000A file: {error}") from error
    # columns as in ReadMe.finals2000A, counted from zero
    columns = (slice(7, 15), slice(18, 27), slice(37, 46), slice(58, 68), slice(97, 106), slice(116, 125))
    rows = []
    for number, line in enumerate(lines, start=1):
        cells = [line[column].strip() for column in columns]
        if not all(cells):  # the far prediction has no pole offsets, the end of the file nothing at all
            continue
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError as error:
            raise OperatorError(f"{path}: line {number}: {error}; get finals2000A.all from the IERS anew") from None
    if len(rows) < 4:
        raise OperatorError(f"{path}: no Earth orientation in it; name an IERS finals2000A file")
    table = np.array(rows)
    mjd = table[:, 0]
    if np.any(np.diff(mjd) <= 0.0) or np.any(mjd != np.floor(mjd)):
        raise OperatorError(f"{path}: days do not ascend; get finals2000A.all from the IERS anew")
    tai_minus_utc = _tai_minus_utc_s(mjd)
    utc_minus_gps_ns = np.rint((_TAI_MINUS_GPS_S - tai_minus_utc) * NS_PER_S).astype(np.int64)
    t_gps_ns = (mjd.astype(np.int64) - GPS_EPOCH_MJD) * NS_PER_DAY - utc_minus_gps_ns
    ut1_minus_gps = table[:, 3] + (_TAI_MINUS_GPS_S - tai_minus_utc)
    jump = np.abs(np.diff(ut1_minus_gps)) > 0.5 * np.diff(mjd)
    if np.any(jump):
        raise OperatorError(
            f"{path}: UT1 jumps at MJD {mjd[1:][jump][0]:.0f}: a leap second that pyerfa does not know; update pyerfa"
        )
    mas = 1e-3 * _ARCSEC
    return Observations(
        path,
        t_gps_ns,
        table[:, 1] * _ARCSEC,
        table[:, 2] * _ARCSEC,
        ut1_minus_gps,
        table[:, 4] * mas,
        table[:, 5] * mas,
    )


def _tai_minus_utc_s(mjd_utc: np.ndarray) -> np.ndarray:
    year, month, day, _ = erfa.jd2cal(erfa.DJM0, mjd_utc)
    return erfa.dat(year, month, day, 0.0)


def _lagrange(observations: Observations, daily: np.ndarray, t_gps_ns: np.ndarray) -> np.ndarray:
    """Four-point Lagrange interpolation of daily rows (n, m), as the IERS recommends: shape (len(t), m)."""
    t_days_gps_ns = observations.t_gps_ns
    right = np.searchsorted(t_days_gps_ns, t_gps_ns, side="right")
    low = right - 2
    bad = (low < 0) | (low + 3 >= len(t_days_gps_ns))
    inside = np.clip(low, 0, len(t_days_gps_ns) - 4)
    # days missing between the four (an extract) count as not covered
    bad |= t_days_gps_ns[inside + 3] - t_days_gps_ns[inside] > 3.5 * NS_PER_DAY
    if np.any(bad):
        first, last = format_gps(int(t_gps_ns[0])), format_gps(int(t_gps_ns[-1]))
        raise OperatorError(
            f"{observations.path}: does not cover {format_gps(int(t_gps_ns[bad][0]))} (wanted with margin: "
            f"{first} to {last}; file: {format_gps(int(t_days_gps_ns[0]))} to "
            f"{format_gps(int(t_days_gps_ns[-1]))}, gaps not counted); update astropy-iers-data or name a "
            "newer finals2000A file"
        )
    out = np.zeros((len(t_gps_ns), daily.shape[1]))
    for i in range(4):
        weight = np.ones(len(t_gps_ns))
        for j in range(4):
            if i != j:
                weight *= (t_gps_ns - t_days_gps_ns[low + j]) / (t_days_gps_ns[low + i] - t_days_gps_ns[low + j])
        out += weight[:, None] * daily[low + i]
    return out
