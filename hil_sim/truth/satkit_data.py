"""Data for satkit, offline and verified.

satkit-data carries ephemeris and space weather but no finals2000A.all; astropy-iers-data carries that. Without it
satkit would silently rotate the Earth with zero Earth orientation (17-75 m), so its loaded table is compared
with our own reading of the same file before anything is computed. satkit keeps both tables once per process:
Earth orientation is fixed with the first use, space weather is loaded anew for every truth, under one lock.
"""

from __future__ import annotations

import csv
import hashlib
import io
import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import date, timedelta
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError
from hil_sim.truth.earth_rotation import packaged_finals, read_finals

FINALS_NAME = "finals2000A.all"
SPACE_WEATHER_NAME = "SW-All.csv"
SOLAR_MEAN_DAYS = 81  # the density model takes 81-day means: the fixed table reaches as far
QUIET_AP = 4
QUIET_KP_TENTHS = 10
F107_RANGE = (60.0, 400.0)
_EOP_TOLERANCE = 1e-6  # seconds and arcseconds

_lock = threading.RLock()
_finals_in_use: Path | None = None


@contextmanager
def session(
    t_first_gps_ns: int,
    t_last_gps_ns: int,
    fixed_f107: float | None = None,
    finals_path: Path | None = None,
    space_weather_path: Path | None = None,
) -> Iterator[ModuleType]:
    """satkit, ready for this span, for as long as the context lasts (one user at a time).

    fixed_f107: solar flux used instead of data. Raises DataError when a table does not cover the span.
    """
    with _lock:
        satkit = _import_satkit(finals_path if finals_path is not None else packaged_finals())
        _check_earth_orientation(satkit, t_first_gps_ns, t_last_gps_ns)
        if fixed_f107 is None:
            _load_space_weather(satkit, t_first_gps_ns, t_last_gps_ns, space_weather_path)
        else:
            satkit.spaceweather.init_from_bytes(fixed_space_weather(fixed_f107, t_first_gps_ns, t_last_gps_ns))
        yield satkit


def satkit_time(satkit: ModuleType, t_gps_ns: int) -> Any:
    """satkit instant of a GPS time of whole microseconds."""
    week, rest_ns = divmod(int(t_gps_ns), gps_time.WEEK_NS)
    return satkit.time.from_gps_week_and_second(week, rest_ns / 1e9)


def fixed_space_weather(f107: float, t_first_gps_ns: int, t_last_gps_ns: int) -> bytes:
    """CelesTrak-style space weather with one solar flux on every day, quiet geomagnetic field (Ap 4)."""
    if not F107_RANGE[0] <= f107 <= F107_RANGE[1]:
        raise DataError(
            f"truth.solar: F10.7 of {f107:g} lies outside {F107_RANGE[0]:g} to {F107_RANGE[1]:g}; "
            "70 is solar minimum, 200 maximum"
        )
    header = (
        "DATE,BSRN,ND,KP1,KP2,KP3,KP4,KP5,KP6,KP7,KP8,KP_SUM,AP1,AP2,AP3,AP4,AP5,AP6,AP7,AP8,AP_AVG,CP,C9,ISN,"
        "F10.7_OBS,F10.7_ADJ,F10.7_DATA_TYPE,F10.7_OBS_CENTER81,F10.7_OBS_LAST81,F10.7_ADJ_CENTER81,F10.7_ADJ_LAST81"
    )
    day: date = gps_time.to_calendar(t_first_gps_ns).date() - timedelta(days=SOLAR_MEAN_DAYS)
    last = gps_time.to_calendar(t_last_gps_ns).date() + timedelta(days=SOLAR_MEAN_DAYS)
    kp = ",".join([str(QUIET_KP_TENTHS)] * 8 + [str(8 * QUIET_KP_TENTHS)])
    ap = ",".join([str(QUIET_AP)] * 9)
    lines = [header]
    while day <= last:
        flux = f"{f107:.1f}"
        lines.append(f"{day},2529,1,{kp},{ap},0.2,1,0,{flux},{flux},OBS,{flux},{flux},{flux},{flux}")
        day += timedelta(days=1)
    return ("\n".join(lines) + "\n").encode("ascii")


def _import_satkit(finals_path: Path) -> ModuleType:
    """Import satkit with its search path set; once per process."""
    global _finals_in_use
    resolved = finals_path.resolve()
    if _finals_in_use is not None and _finals_in_use != resolved:
        raise DataError(
            f"{finals_path}: this process already uses {_finals_in_use}; one process can use one Earth orientation "
            "file, start another for this one"
        )
    # SATKIT_DATA is searched first: nothing the user has elsewhere may step in front of the verified file.
    os.environ["SATKIT_DATA"] = str(_folder_of_finals(resolved))
    os.environ["SATKIT_OFFLINE"] = "1"
    try:
        import satkit
        import satkit_data
    except ImportError as error:
        raise DataError(f"{error.name} is not installed; the simulator needs: pip install 'leonav[sim]'") from None
    satkit.utils.set_offline(True)
    if _finals_in_use is None:
        satkit.utils.add_search_dir(str(_packaged_data(satkit_data)))
        _finals_in_use = resolved
    return satkit


def _packaged_data(satkit_data: ModuleType) -> Path:
    assert satkit_data.__file__ is not None
    return Path(satkit_data.__file__).parent / "data"


def _folder_of_finals(finals_path: Path) -> Path:
    """A folder in which the file is called as satkit wants it; a copy keyed by content when it is not."""
    if finals_path.name == FINALS_NAME:
        return finals_path.parent
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "leonav" / "earth_orientation"
    try:
        digest = hashlib.sha256(finals_path.read_bytes()).hexdigest()[:16]
        target = base / digest / FINALS_NAME
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            partial = target.with_suffix(f".{os.getpid()}")
            shutil.copyfile(finals_path, partial)
            partial.replace(target)
    except OSError as error:
        raise DataError(f"{finals_path}: cannot be used for Earth orientation: {error}") from None
    return target.parent


def _check_earth_orientation(satkit: ModuleType, t_first_gps_ns: int, t_last_gps_ns: int) -> None:
    """satkit must hold the values of the file, not zeros, at both ends of the span."""
    assert _finals_in_use is not None
    rows = read_finals(_finals_in_use)
    for t_gps_ns in (t_first_gps_ns, t_last_gps_ns):
        instant = satkit_time(satkit, t_gps_ns)
        status = satkit.frametransform.eop_status(instant)
        if status not in ("observed", "predicted"):
            raise DataError(
                f"{_finals_in_use}: Earth orientation {status} at {gps_time.to_calendar(t_gps_ns)} GPS; give "
                "truth.earth_orientation_file a finals2000A.all that covers the run, or move time.start"
            )
        utc_ns = t_gps_ns - gps_time.leap_seconds(t_gps_ns) * gps_time.NS
        mjd = gps_time.GPS_EPOCH_MJD + utc_ns / gps_time.DAY_NS
        xp, yp = (np.interp(mjd, rows[:, 0], rows[:, k]) for k in (1, 2))
        loaded = satkit.frametransform.earth_orientation_params(instant)
        if abs(loaded[1] - xp) > _EOP_TOLERANCE or abs(loaded[2] - yp) > _EOP_TOLERANCE:
            raise DataError(
                f"{_finals_in_use}: satkit has polar motion {loaded[1]:.6f} {loaded[2]:.6f} arcsec where the file says "
                f"{xp:.6f} {yp:.6f}; satkit was used in this process before with other data, start a fresh one"
            )


def _load_space_weather(satkit: ModuleType, t_first_gps_ns: int, t_last_gps_ns: int, path: Path | None) -> None:
    if path is None:
        import satkit_data

        path = _packaged_data(satkit_data) / SPACE_WEATHER_NAME
    try:
        state = path.stat()
        lines = _weather_lines(path, state.st_mtime_ns, state.st_size)
    except OSError as error:
        raise DataError(f"{path}: space weather cannot be read: {error.strerror}") from None
    first = gps_time.to_calendar(t_first_gps_ns).date() - timedelta(days=3)
    last = gps_time.to_calendar(t_last_gps_ns).date()
    part = _daily_rows(path, lines, first, last)
    try:
        satkit.spaceweather.init_from_bytes(part)
    except RuntimeError as error:
        raise DataError(f"{path}: satkit refuses this space weather: {error}") from None


@lru_cache(maxsize=2)  # a campaign builds hundreds of truths from one file; a changed file is read anew
def _weather_lines(path: Path, modified_ns: int, size: int) -> tuple[str, ...]:
    del modified_ns, size
    return tuple(path.read_bytes().decode("ascii", errors="replace").splitlines())


def _daily_rows(path: Path, text: tuple[str, ...], first: date, last: date) -> bytes:
    """The measured or daily-predicted rows of the span with their header; monthly predictions do not count."""
    try:
        columns = next(csv.reader(io.StringIO(text[0])))
        kind = columns.index("F10.7_DATA_TYPE")
    except (IndexError, ValueError, StopIteration):
        raise DataError(f"{path}: not a CelesTrak SW-All.csv file") from None
    since, until = first.isoformat(), last.isoformat()
    rows = [line for line in text[1:] if since <= line[:10] <= until]
    days = [line[:10] for line in rows if line.split(",")[kind] in ("OBS", "OBS-P", "INT", "PRD")]
    if len(days) < (last - first).days + 1:
        raise DataError(
            f'{path}: no daily space weather for {first} to {last}; set truth.solar = "fixed:150" (a chosen F10.7) '
            "or truth.space_weather_file"
        )
    return ("\n".join([text[0], *rows]) + "\n").encode("ascii")
