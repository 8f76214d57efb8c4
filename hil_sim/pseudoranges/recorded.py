"""Recorded pseudoranges of a real receiver as the world's: what it measured, at the instants that its own fixes give.

Ranges are free of the ionosphere (P1, P2); sigmas are those of hil_sim/gnss/single_point. Nothing is left out that the
receiver gave: satellites without a clock in the precise files, and outliers, are for flight to deal with.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hil_sim.errors import DataError
from hil_sim.gnss import single_point
from hil_sim.gnss.precise_ephemeris import SATELLITES, PreciseEphemeris
from hil_sim.gnss.rinex_obs import read_observations
from hil_sim.pseudoranges.receiver import RawSeries
from hil_sim.scenario_schema import Outage
from hil_sim.sensors.gnss_receiver import in_outage, latch
from hil_sim.sensors.oscillator import Oscillator
from hil_sim.truth.interface import Truth

_ABOVE, _BELOW = 0.5 * np.pi, -0.5 * np.pi


def measure(
    observations: Path,
    orbits: Sequence[Path],
    antennas: bool,
    truth: Truth,
    oscillator: Oscillator,
    outages: tuple[Outage, ...],
    t_start_gps_ns: int,
    t_last_gps_ns: int,
    jitter_ns: float,
    stream: np.random.Generator,
) -> RawSeries:
    """All recorded epochs of the run. Raises DataError where there is none.

    elevation_rad: -pi/2 where the receiver had no such satellite, pi/2 where either place is not known.
    """
    observed = read_observations(observations)
    ranges = single_point.corrected_ranges(observed, PreciseEphemeris(orbits, antennas))
    fixes = single_point.solve(observed, ranges)
    # where an epoch has no fix its instant is told by those about it: the clock of the receiver drifts slowly
    good = np.flatnonzero(fixes.good)
    if not len(good):
        raise DataError(f"{observations}: no epoch gives a fix; name SP3 files of its days")
    late_ns = np.interp(observed.t_ns, observed.t_ns[good], (observed.t_ns - fixes.t_gps_ns)[good])
    t_true = np.where(fixes.good, fixes.t_gps_ns, observed.t_ns - np.rint(late_ns).astype(np.int64))
    inside = (t_true >= t_start_gps_ns) & (t_true <= t_last_gps_ns)
    if not inside.any():
        raise DataError(f"{observations}: no epoch in the run; set time.start and time.duration_s inside it")
    a, b = single_point.FREE_OF_IONOSPHERE
    pseudorange = a * observed.values["P1"] + b * observed.values["P2"]
    sigma = single_point.pseudorange_sigma_m(observed.values.get("S2"), len(pseudorange))
    sigma = np.where(np.isfinite(ranges.sigma_m), ranges.sigma_m, sigma)
    shape = (len(observed.t_ns), SATELLITES)
    at = (observed.epoch, observed.prn - 1)
    range_m, sigma_m, seen = np.zeros(shape), np.ones(shape), np.zeros(shape, bool)
    range_m[at], sigma_m[at], seen[at] = pseudorange, sigma, np.isfinite(pseudorange)
    height = np.where(seen, _ABOVE, _BELOW)
    rise = _elevation(ranges.satellite_m, np.where(fixes.good[:, None], fixes.r_itrf_m, np.nan)[observed.epoch])
    height[at] = np.where(seen[at] & np.isfinite(rise), rise, height[at])
    t_true, t, seen = t_true[inside], observed.t_ns[inside], seen[inside]
    n = len(t)
    system = np.zeros(SATELLITES, np.int64)
    return RawSeries(
        t_true_gps_ns=t_true,
        t_gps_ns=t,
        t_counter_ns=latch(oscillator, t_true, jitter_ns, stream),
        sent=~in_outage(t_true, outages, t_start_gps_ns),
        seen=seen,
        range_m=range_m[inside],
        sigma_m=sigma_m[inside],
        elevation_rad=height[inside],
        system=system,
        number=np.arange(1, SATELLITES + 1),
        repeats=np.ones((n, SATELLITES), np.int64),
        system_sent=np.zeros((n, SATELLITES), np.int64),
        usable=np.ones((n, SATELLITES), bool),
        healthy=np.ones((n, SATELLITES), bool),
        r_true_gcrf_m=truth.state_gcrf(t_true)[0],
    )


def _elevation(satellite_m: np.ndarray, receiver_m: np.ndarray) -> np.ndarray:
    """Elevations (n,) [rad] above the local horizontal, of places (n,3) from places (n,3); NaN where one is none."""
    line = satellite_m - receiver_m
    length = np.linalg.norm(line, axis=1) * np.linalg.norm(receiver_m, axis=1)
    return np.asarray(np.arcsin(np.clip(np.einsum("na,na->n", line, receiver_m) / length, -1.0, 1.0)))
