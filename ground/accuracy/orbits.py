"""Real precise orbits as tracks in GCRF, turned there by the flight kernels and the flight Earth-orientation table.

Files are read by the one reader of orbit files, hil_sim.truth.orbit_files; the frames are flight's own.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.kernels import frames
from flightsw.kernels.registry import MATRIX, TIMES, entry, frozen_records, records
from flightsw.records import FORCE_WORK, ORIENTATION
from ground.accuracy.flight_model import aligned
from ground.errors import OperatorError
from ground.tables.earth_orientation import build_earth_orientation
from hil_sim.truth.hermite import HermiteTrack
from hil_sim.truth.orbit_files.read import read_orbit as read_file
from hil_sim.truth.real_orbit import DataError, evenly_spaced


class ReferenceOrbit(NamedTuple):
    """One satellite's published orbit: name, track in GCRF, times (n,) [GPS ns] and states (n, 6) at its samples."""

    name: str
    track: HermiteTrack
    t_gps_ns: np.ndarray
    x: np.ndarray
    orientation: np.ndarray  # the flight Earth-orientation table that the frames came from, (1,) records.ORIENTATION


def read_orbit(
    path: Path,
    finals_path: Path | None = None,
    satellite: str | None = None,
    velocity_unit: str = "auto",
    time_scale: str | None = None,
) -> ReferenceOrbit:
    """The orbit of a file; arguments as in `orbit_files.read.read_orbit`. Raises OperatorError."""
    try:
        found = evenly_spaced(path, read_file(path, satellite, velocity_unit, time_scale))
    except DataError as error:
        raise OperatorError(str(error)) from None
    t = found.t_gps_ns
    orientation = aligned(ORIENTATION, decode(build_earth_orientation(int(t[0]), int(t[-1]), finals_path)).values)
    r, v = found.r_m, found.v_mps
    if found.frame == "ITRF":
        r, v = np.empty_like(r), np.empty_like(v)
        _to_gcrf(orientation, t, found.r_m, found.v_mps, np.zeros(1, FORCE_WORK), r, v)
    track = HermiteTrack(int(t[0]), int(t[1] - t[0]), r, v)
    return ReferenceOrbit(found.name, track, t, np.hstack((r, v)), orientation)


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
