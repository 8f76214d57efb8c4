"""A receiver's recorded observations as fixes, ready to be sent: from files to time, position, velocity and sigmas."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hil_sim.errors import DataError
from hil_sim.gnss import carrier_velocity, single_point
from hil_sim.gnss.exclusion import Verdict
from hil_sim.gnss.precise_ephemeris import PreciseEphemeris
from hil_sim.gnss.rinex_obs import read_observations
from hil_sim.truth.earth_rotation import EarthOrientation


class Recording(NamedTuple):
    """Good fixes (m,) of a recording, at the phase centre of the antenna.

    t_gps_ns: true instants. r_itrf_m, sigma_r_m (m,3) [m]; covariance_m2 (m,3,3). v_itrf_mps, sigma_v_mps (m,3) [m/s],
    NaN where `has_velocity` is False. satellites (m,). epochs: recorded ones. counts: what became of epochs and
    observations, in words.
    """

    t_gps_ns: np.ndarray
    r_itrf_m: np.ndarray
    sigma_r_m: np.ndarray
    covariance_m2: np.ndarray
    v_itrf_mps: np.ndarray
    sigma_v_mps: np.ndarray
    has_velocity: np.ndarray
    satellites: np.ndarray
    epochs: int
    counts: dict[str, int]


def solve_recording(
    observations: Path, ephemeris: Sequence[Path], antennas: bool = True, finals_path: Path | None = None
) -> Recording:
    """Fixes of a RINEX observation file with precise orbits and clocks (SP3). Raises DataError.

    antennas: with the satellites' antennas in place; without, for what a simpler solution is worth. Twelve hours of
    10 s epochs take about a second; the last few recordings are remembered, as a study flies one many times.
    """
    paths = (observations, *ephemeris, *(() if finals_path is None else (finals_path,)))
    for path in paths:
        if not path.is_file():
            raise DataError(f"{path}: no such file")
    state = tuple((path.stat().st_mtime_ns, path.stat().st_size) for path in paths)
    return _solve(observations, tuple(ephemeris), antennas, finals_path, state)


@lru_cache(maxsize=4)
def _solve(
    observations: Path,
    ephemeris_paths: tuple[Path, ...],
    antennas: bool,
    finals_path: Path | None,
    state: tuple[tuple[int, int], ...],
) -> Recording:
    del state  # of the files: a changed one is read anew
    observed = read_observations(observations)
    ephemeris = PreciseEphemeris(ephemeris_paths, antennas)
    ranges = single_point.corrected_ranges(observed, ephemeris)
    fixes = single_point.solve(observed, ranges)
    if not fixes.good.any():
        raise DataError(f"{observations}: no epoch of {len(fixes.good)} gives a fix; name SP3 files of its days")
    orientation = EarthOrientation(int(observed.t_ns[0]), int(observed.t_ns[-1]), finals_path)
    velocities = carrier_velocity.solve(observed, ranges, fixes, ephemeris, orientation)
    good = fixes.good
    named = {verdict: int(np.count_nonzero(fixes.verdict == verdict)) for verdict in Verdict}
    counts = {
        "epochs": len(good),
        "fixes": int(good.sum()),
        "fixes that nothing could contradict": named[Verdict.UNCHECKED],
        "epochs with too few satellites": named[Verdict.TOO_FEW],
        "epochs that contradict themselves": named[Verdict.INCONSISTENT],
        "epochs with an excluded satellite": int(fixes.checked.excluded.any(axis=1).sum()),
        "observations": len(observed.prn),
        "observations without satellite clock": ranges.without_clock,
        "observations without second frequency": ranges.without_range,
        "observations excluded": int(fixes.checked.excluded.sum()),
        "velocities": int(velocities.good.sum()),
        "phases excluded": velocities.excluded,
    }
    fields = (
        fixes.t_gps_ns[good],
        fixes.r_itrf_m[good],
        fixes.sigma_m[good],
        fixes.covariance_m2[good],
        velocities.v_itrf_mps[good],
        velocities.sigma_mps[good],
        velocities.good[good],
        fixes.satellites[good],
    )
    for field in fields:
        field.flags.writeable = False
    return Recording(*fields, len(good), counts)
