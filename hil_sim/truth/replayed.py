"""Truth replayed from a file of a real precise orbit, of any format that `orbit_files` knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.hermite import NODES_EACH_SIDE, HermiteTrack
from hil_sim.truth.interface import TrackTruth
from hil_sim.truth.orbit_files.read import read_orbit
from hil_sim.truth.real_orbit import RealOrbit, evenly_spaced


def load_truth(
    path: Path,
    t_first_gps_ns: int,
    t_last_gps_ns: int,
    satellite: str | None = None,
    velocity_unit: str = "auto",
    time_scale: str | None = None,
    finals_path: Path | None = None,
) -> TrackTruth:
    """Truth over [t_first, t_last] from an orbit file; arguments as in `read_orbit`. Raises DataError.

    finals_path: the finals2000A file that Earth-fixed orbits are turned with; None takes the packaged one.
    """
    orbit = read_orbit(path, satellite, velocity_unit, time_scale)
    t = orbit.t_gps_ns
    if t[0] > t_first_gps_ns or t[-1] < t_last_gps_ns:
        has = f"{gps_time.to_calendar(int(t[0]))} to {gps_time.to_calendar(int(t[-1]))}"
        needs = f"{gps_time.to_calendar(t_first_gps_ns)} to {gps_time.to_calendar(t_last_gps_ns)}"
        raise DataError(
            f"{path}: covers {has} GPS, the run needs {needs}; set time.start and time.duration_s inside it"
        )
    low = max(int(np.searchsorted(t, t_first_gps_ns, side="right")) - 1 - NODES_EACH_SIDE, 0)
    high = int(np.searchsorted(t, t_last_gps_ns)) + 1 + NODES_EACH_SIDE
    part = orbit._replace(t_gps_ns=t[low:high], r_m=orbit.r_m[low:high], v_mps=orbit.v_mps[low:high])
    source = f"{path.name} ({orbit.frame}, velocities {orbit.velocity}, to {orbit.mismatch_mps:.1g} m/s)"
    return TrackTruth(to_track(path, evenly_spaced(path, part), finals_path), source)


def to_track(path: Path, orbit: RealOrbit, finals_path: Path | None = None) -> HermiteTrack:
    """Track in GCRF of an evenly spaced orbit. Raises DataError."""
    t, r_m, v_mps = orbit.t_gps_ns, orbit.r_m, orbit.v_mps
    if len(t) < 2 * NODES_EACH_SIDE:
        raise DataError(f"{path}: {len(t)} samples are too few to interpolate between")
    if orbit.frame == "ITRF":
        r_m, v_mps = EarthOrientation(int(t[0]), int(t[-1]), finals_path).to_gcrf(t, r_m, v_mps)
    return HermiteTrack(int(t[0]), int(t[1] - t[0]), r_m, v_mps)
