"""Truth from files of real precise orbits: SP3 (IGS format, version c or d) and GEORB .orb text.

Both formats hide traps that this module checks instead of trusting: the time scale is read from the header
(TAI, GPS, UTC or TT), the velocity unit of SP3 (dm/s by the standard, m/s in some files) is found by
differentiating the positions, the frame of GEORB is read from its header.
"""

from __future__ import annotations

import gzip
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.hermite import NODES_EACH_SIDE, HermiteTrack
from hil_sim.truth.interface import TrackTruth

SP3_MISSING_KM = 0.0
VELOCITY_TOLERANCE_MPS = 1.0  # units differ by a factor of ten: kilometres per second
GEORB_JITTER_NS = 2_000  # time stamps are rounded to about 0.2 microseconds
_SCALES_NS = {"GPS": 0, "TAI": -gps_time.TAI_MINUS_GPS_S * gps_time.NS, "TT": -gps_time.TT_MINUS_GPS_NS}


class OrbitSamples(NamedTuple):
    """Samples of one satellite: GPS times (n,) [ns], r (n,3) [m], v (n,3) [m/s], frame 'ITRF' or 'GCRF'."""

    t_gps_ns: np.ndarray
    r_m: np.ndarray
    v_mps: np.ndarray
    frame: str


def load_sp3(
    path: Path,
    t_first_gps_ns: int,
    t_last_gps_ns: int,
    satellite: str | None = None,
    velocity_unit: str = "auto",
    finals_path: Path | None = None,
) -> TrackTruth:
    """Truth over [t_first, t_last] from an SP3 file with velocities; DataError when it does not serve."""
    return _truth(read_sp3(path, satellite, velocity_unit), path, t_first_gps_ns, t_last_gps_ns, finals_path)


def load_georb(path: Path, t_first_gps_ns: int, t_last_gps_ns: int, finals_path: Path | None = None) -> TrackTruth:
    """Truth over [t_first, t_last] from a GEORB orbit file, inertial or Earth-fixed."""
    return _truth(read_georb(path), path, t_first_gps_ns, t_last_gps_ns, finals_path)


def read_sp3(path: Path, satellite: str | None = None, velocity_unit: str = "auto") -> OrbitSamples:
    """Positions and velocities of one satellite of an SP3 file, ITRF.

    satellite: identifier such as 'L74'; None if the file holds one only.
    velocity_unit: 'dm/s' (the standard), 'm/s', or 'auto' to find out from the positions.
    """
    scale, epoch_ns = "", 0
    times: list[int] = []
    positions: list[tuple[float, ...]] = []
    velocities: list[tuple[float, ...]] = []
    seen: set[str] = set()
    for number, line in enumerate(_lines(path), start=1):
        try:
            if line.startswith("%c") and not scale:
                scale = line[9:12].strip()
            elif line.startswith("*"):
                epoch_ns = _sp3_epoch_ns(line)
            elif line[:1] in "PV" and len(line) > 45 and number > 2:
                name = line[1:4].strip()
                seen.add(name)
                if satellite is not None and name != satellite:
                    continue
                vector = (float(line[4:18]), float(line[18:32]), float(line[32:46]))
                if line[0] == "P":
                    times.append(epoch_ns)
                    positions.append(vector)
                else:
                    velocities.append(vector)
        except ValueError as error:
            raise DataError(f"{path}: line {number}: not SP3: {error}") from None
    if satellite is None and len(seen) > 1:
        raise DataError(f"{path}: holds {len(seen)} satellites; name one in orbit.satellite: {', '.join(sorted(seen))}")
    if not times:
        raise DataError(f"{path}: no satellite {satellite!r}; it holds {', '.join(sorted(seen)) or 'none'}")
    if len(velocities) != len(positions):
        raise DataError(f"{path}: has no velocity for every position; choose an SP3 file with V records")
    t_gps_ns = np.array(times, dtype=np.int64)
    if scale in _SCALES_NS:
        t_gps_ns += _SCALES_NS[scale]
    elif scale == "UTC":
        t_gps_ns += gps_time.leap_seconds(int(t_gps_ns[0])) * gps_time.NS
    else:
        raise DataError(f"{path}: time scale {scale!r} in the %c record; known are GPS, TAI, TT, UTC")
    r_m = np.array(positions) * 1e3
    good = np.any(r_m != SP3_MISSING_KM, axis=1)
    r_m, t_gps_ns = r_m[good], t_gps_ns[good]
    v_file = np.array(velocities)[good]
    return OrbitSamples(t_gps_ns, r_m, v_file * _velocity_scale(path, t_gps_ns, r_m, v_file, velocity_unit), "ITRF")


def read_georb(path: Path) -> OrbitSamples:
    """Samples of a GEORB file: Terrestrial Time, header names the frame (ICRF is taken as GCRF)."""
    frame = scale = ""
    rows = []
    in_header = True
    for number, line in enumerate(_lines(path), start=1):
        if in_header:
            key, _, value = (part.strip() for part in line.partition(":"))
            if key == "Reference Frame":
                frame = value
            elif key == "Time scale":
                scale = value
            in_header = not line.startswith("end_of_header")
            continue
        words = line.split()
        try:
            rows.append((int(words[0]), *map(float, words[1:8])))
        except (ValueError, IndexError):
            raise DataError(f"{path}: line {number}: not GEORB: MJD, seconds, position, velocity") from None
    if scale != "Terrestrial Time" or frame not in ("ICRF", "ITRF") or not rows:
        raise DataError(f"{path}: not a GEORB orbit in ICRF or ITRF and Terrestrial Time")
    table = np.array(rows)
    day_ns = (table[:, 0].astype(np.int64) - gps_time.GPS_EPOCH_MJD) * gps_time.DAY_NS
    stamped_ns = np.rint(table[:, 1] * 1e9).astype(np.int64)
    # the orbit was integrated on a grid of whole milliseconds; 0.2 microseconds of rounding are 1.5 mm
    grid_ns = (stamped_ns + 500_000) // 1_000_000 * 1_000_000
    if np.abs(stamped_ns - grid_ns).max() > GEORB_JITTER_NS:
        raise DataError(f"{path}: time stamps off the millisecond grid by more than {GEORB_JITTER_NS} ns")
    t_gps_ns = day_ns + grid_ns + _SCALES_NS["TT"]
    return OrbitSamples(t_gps_ns, table[:, 2:5], table[:, 5:8], "GCRF" if frame == "ICRF" else "ITRF")


def to_track(samples: OrbitSamples, path: Path, orientation: EarthOrientation | None) -> HermiteTrack:
    """Equidistant track in GCRF; DataError on gaps. `orientation` is needed for Earth-fixed samples."""
    steps = np.diff(samples.t_gps_ns)
    if len(steps) < 2 * NODES_EACH_SIDE or steps.min() != steps.max() or steps[0] <= 0:
        at = int(np.argmax(steps != steps[0])) if len(steps) else 0
        raise DataError(
            f"{path}: samples are not equidistant near {gps_time.to_calendar(int(samples.t_gps_ns[at]))} GPS; "
            "choose a span without gaps"
        )
    r_m, v_mps = samples.r_m, samples.v_mps
    if samples.frame == "ITRF":
        assert orientation is not None
        r_m, v_mps = orientation.to_gcrf(samples.t_gps_ns, r_m, v_mps)
    return HermiteTrack(int(samples.t_gps_ns[0]), int(steps[0]), r_m, v_mps)


def _truth(
    samples: OrbitSamples, path: Path, t_first_gps_ns: int, t_last_gps_ns: int, finals_path: Path | None
) -> TrackTruth:
    t = samples.t_gps_ns
    if t[0] > t_first_gps_ns or t[-1] < t_last_gps_ns:
        has = f"{gps_time.to_calendar(int(t[0]))} to {gps_time.to_calendar(int(t[-1]))}"
        needs = f"{gps_time.to_calendar(t_first_gps_ns)} to {gps_time.to_calendar(t_last_gps_ns)}"
        raise DataError(
            f"{path}: covers {has} GPS, the run needs {needs}; set time.start and time.duration_s inside it"
        )
    low = max(int(np.searchsorted(t, t_first_gps_ns, side="right")) - 1 - NODES_EACH_SIDE, 0)
    high = int(np.searchsorted(t, t_last_gps_ns)) + 1 + NODES_EACH_SIDE
    part = OrbitSamples(t[low:high], samples.r_m[low:high], samples.v_mps[low:high], samples.frame)
    orientation = None
    if part.frame == "ITRF":
        orientation = EarthOrientation(int(part.t_gps_ns[0]), int(part.t_gps_ns[-1]), finals_path)
    return TrackTruth(to_track(part, path, orientation), f"{path.name} ({samples.frame})")


def _velocity_scale(path: Path, t_gps_ns: np.ndarray, r_m: np.ndarray, v_file: np.ndarray, velocity_unit: str) -> float:
    units = {"dm/s": 0.1, "m/s": 1.0}
    if velocity_unit != "auto":
        return units[velocity_unit]
    steps_s = (t_gps_ns[2:] - t_gps_ns[:-2]) / 1e9
    slope = (r_m[2:] - r_m[:-2]) / steps_s[:, None]
    speed, in_file = (np.median(np.linalg.norm(x, axis=1)) for x in (slope, v_file[1:-1]))
    fits = [unit for unit, scale in units.items() if abs(in_file * scale / speed - 1.0) < 0.2]
    if len(fits) != 1:
        raise DataError(
            f"{path}: velocities of {in_file:.6g} match positions moving at {speed:.6g} m/s neither in dm/s nor "
            "in m/s; set orbit.velocity_unit if the file is known to be right"
        )
    return units[fits[0]]


def _sp3_epoch_ns(line: str) -> int:
    year, month, day, hour, minute = (int(word) for word in line[1:].split()[:5])
    seconds_ns = round(float(line[1:].split()[5]) * 1e9)
    midnight = gps_time.from_calendar(datetime(year, month, day), "gps")
    return midnight + (hour * 3600 + minute * 60) * gps_time.NS + seconds_ns


def _lines(path: Path) -> list[str]:
    opener = gzip.open if path.suffix == ".gz" else open
    try:
        with opener(path, "rt", encoding="ascii", errors="replace") as text:
            return text.read().splitlines()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error}") from None
