"""Real precise orbits as tracks in GCRF, turned there by the flight kernels and the flight Earth-orientation table.

SP3 and GEORB files are read as the simulated world reads them; Sentinel AUX_RESORB and AUX_POEORB files (.EOF) here.
"""

from __future__ import annotations

import gzip
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.kernels import frames
from flightsw.kernels.registry import MATRIX, TIMES, entry, frozen_records, records
from flightsw.records import FORCE_WORK, ORIENTATION
from ground.accuracy.flight_model import aligned
from ground.errors import OperatorError
from ground.tables.earth_orientation import build_earth_orientation
from ground.tables.gps_time import NS_PER_S
from hil_sim.truth.hermite import HermiteTrack
from hil_sim.truth.replayed import DataError, OrbitSamples, read_georb, read_sp3

_TAI_MINUS_GPS_S = 19
_GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)


class RealOrbit(NamedTuple):
    """One satellite's published orbit: name, track in GCRF, times (n,) [GPS ns] and states (n, 6) at its samples."""

    name: str
    track: HermiteTrack
    t_gps_ns: np.ndarray
    x: np.ndarray
    orientation: np.ndarray  # the flight Earth-orientation table that the frames came from, (1,) records.ORIENTATION


def read_orbit(path: Path, finals_path: Path | None = None) -> RealOrbit:
    """The orbit of a file by its name: .sp3, .orb or .EOF, each also gzipped. Raises OperatorError."""
    suffix = path.name.removesuffix(".gz").rpartition(".")[2].lower()
    readers = {"sp3": read_sp3, "orb": read_georb, "eof": read_eof}
    if not path.is_file():
        raise OperatorError(f"{path}: no such orbit file")
    if suffix not in readers:
        raise OperatorError(f"{path}: unknown kind of orbit file; known are .sp3, .orb and .EOF, also with .gz")
    try:
        samples: OrbitSamples = readers[suffix](path)
    except DataError as error:
        raise OperatorError(str(error)) from None
    steps = np.diff(samples.t_gps_ns)
    if len(steps) < 8 or steps.min() != steps.max():
        raise OperatorError(f"{path}: its samples are not evenly spaced; cut out a part without gaps")
    first, last = int(samples.t_gps_ns[0]), int(samples.t_gps_ns[-1])
    orientation = aligned(ORIENTATION, decode(build_earth_orientation(first, last, finals_path)).values)
    r, v = samples.r_m, samples.v_mps
    if samples.frame == "ITRF":
        r, v = np.empty_like(r), np.empty_like(v)
        _to_gcrf(orientation, samples.t_gps_ns, samples.r_m, samples.v_mps, np.zeros(1, FORCE_WORK), r, v)
    track = HermiteTrack(first, int(steps[0]), r, v)
    return RealOrbit(path.name.partition(".")[0], track, samples.t_gps_ns, np.hstack((r, v)), orientation)


def read_eof(path: Path) -> OrbitSamples:
    """Samples of a Sentinel orbit file (Earth-fixed, TAI read from each state vector), ITRF."""
    try:
        raw = path.read_bytes()
        root = ElementTree.fromstring(gzip.decompress(raw) if path.suffix == ".gz" else raw)
        frame = root.findtext(".//Ref_Frame")
        times, states = [], []
        for vector in root.iter("OSV"):
            tai = datetime.fromisoformat((vector.findtext("TAI") or "").removeprefix("TAI=")).replace(tzinfo=UTC)
            since = tai - _GPS_EPOCH
            times.append((since.days * 86400 + since.seconds - _TAI_MINUS_GPS_S) * NS_PER_S + since.microseconds * 1000)
            states.append([float(vector.findtext(name) or "nan") for name in ("X", "Y", "Z", "VX", "VY", "VZ")])
    except (OSError, ElementTree.ParseError, ValueError) as error:
        raise OperatorError(f"{path}: not a Sentinel orbit file: {error}") from None
    if frame != "EARTH_FIXED" or not states or not np.isfinite(states).all():
        raise OperatorError(f"{path}: no Earth-fixed state vectors in it (Ref_Frame {frame})")
    x = np.array(states)
    return OrbitSamples(np.array(times, dtype=np.int64), x[:, :3].copy(), x[:, 3:].copy(), "ITRF")


@entry(
    frozen_records(ORIENTATION),
    TIMES,
    MATRIX,
    MATRIX,
    records(FORCE_WORK),
    MATRIX,
    MATRIX,
)
def _to_gcrf(eop, t_gps_ns, r_itrf_m, v_itrf_mps, work, r_gcrf_m, v_gcrf_mps):
    """Earth-fixed positions and velocities to inertial ones with the flight kernels; outside the table NaN."""
    m = work[0].itrf_from_gcrf
    rate = work[0].itrf_from_gcrf_rate
    for k in range(t_gps_ns.shape[0]):
        if not frames.itrf_from_gcrf(eop[0], t_gps_ns[k], work[0], m, rate):
            r_gcrf_m[k, :] = np.nan
            v_gcrf_mps[k, :] = np.nan
            continue
        for i in range(3):
            r_gcrf_m[k, i] = m[0, i] * r_itrf_m[k, 0] + m[1, i] * r_itrf_m[k, 1] + m[2, i] * r_itrf_m[k, 2]
        # v_itrf = M v_gcrf + M' r_gcrf
        for i in range(3):
            v_gcrf_mps[k, i] = 0.0
            for j in range(3):
                turning = rate[j, 0] * r_gcrf_m[k, 0] + rate[j, 1] * r_gcrf_m[k, 1] + rate[j, 2] * r_gcrf_m[k, 2]
                v_gcrf_mps[k, i] += m[j, i] * (v_itrf_mps[k, j] - turning)
