"""Velocity from carrier phase: how far the antenna went since the epoch before, and from that how fast it goes now.

The phase of each satellite has counted the change of its distance to centimetres; its unknown integer drops out of the
difference as long as the loop did not slip (van Graas and Soloviev 2004, Navigation 51). The mean velocity of the
interval is carried to its end by gravity (centre and J2), so no later epoch is needed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hil_sim.gnss.exclusion import Verdict, check
from hil_sim.gnss.least_squares import Fit, geometry, solve_displacements
from hil_sim.gnss.precise_ephemeris import LIGHT_MPS, PreciseEphemeris
from hil_sim.gnss.rinex_obs import Observations
from hil_sim.gnss.single_point import FREE_OF_IONOSPHERE, L1_HZ, L2_HZ, Fixes, Ranges
from hil_sim.truth.earth_rotation import EarthOrientation

PHASE_SIGMA_M = 0.01  # ionosphere-free difference of two epochs: millimetres of phase, tripled, and patterns
LONGEST_S = 31.0
GRAVITY_SIGMA_MPS2 = 1e-5  # of centre and J2 alone, felt over half the interval
SMALLEST_SIGMA_MPS = 1e-3
LARGEST_SIGMA_MPS = 0.5
GM_M3PS2, J2, RADIUS_M = 3.986004415e14, 1.0826359e-3, 6.3781363e6  # EGM2008


class Velocities(NamedTuple):
    """One row an epoch (m,): v (m,3) [m/s] Earth-fixed in ITRF, sigma (m,3) [m/s], good (m,), excluded: satellites."""

    v_itrf_mps: np.ndarray
    sigma_mps: np.ndarray
    good: np.ndarray
    excluded: int


def solve(
    observed: Observations, ranges: Ranges, fixes: Fixes, ephemeris: PreciseEphemeris, orientation: EarthOrientation
) -> Velocities:
    """Velocities at the epochs whose fix, and that before, are good and not too far apart."""
    m, k = fixes.checked.used.shape
    phase = _phase_m(observed)
    if phase is None:
        nothing = np.full((m, 3), np.nan)
        return Velocities(nothing, nothing, np.zeros(m, dtype=bool), 0)
    interval_s = np.diff(fixes.t_gps_ns, prepend=fixes.t_gps_ns[0]) / 1e9
    pair = fixes.good & np.roll(fixes.good, 1) & (interval_s > 0.0) & (interval_s < LONGEST_S)
    before = _row_before(observed)
    there = np.isfinite(ranges.sigma_m) & np.isfinite(phase)
    slipped = observed.slipped["L1"] | observed.slipped["L2"]
    usable = (before >= 0) & there & there[before] & ~slipped & pair[observed.epoch]
    # the distances from the two fixes, less what the satellites' clocks say; the line of sight of the later one serves
    # both, as it turns by 4 mrad and the fixes err by a metre: millimetres
    new, old = np.flatnonzero(usable), before[usable]
    distance, line = _distance(observed, ranges, fixes, new)
    distance_before, _ = _distance(observed, ranges, fixes, old)
    difference = phase[new] - phase[old] - (distance - distance_before)
    sigma = np.hypot(PHASE_SIGMA_M, ephemeris.clock_walk_m(observed.prn[new], float(np.median(interval_s[1:]))))
    table, sigma_table, line_table = np.zeros((m, k)), np.full((m, k), np.inf), np.zeros((m, k, 3))
    at = (observed.epoch[new], fixes.place[new])
    table[at], sigma_table[at], line_table[at] = difference, sigma, line

    def fit(rows: np.ndarray, trial: np.ndarray) -> Fit:
        return solve_displacements(line_table[rows], table[rows], trial)

    checked = check(fit, sigma_table)
    good = pair & (checked.verdict == Verdict.GOOD)
    step_m = fixes.r_itrf_m - np.roll(fixes.r_itrf_m, 1, axis=0) + checked.fit.x[:, :3]
    v = np.full((m, 3), np.nan)
    rows = np.flatnonzero(good)
    v[rows] = _velocity_at_end(
        fixes.t_gps_ns[rows], fixes.t_gps_ns[rows - 1], fixes.r_itrf_m[rows], step_m[rows], orientation
    )
    spread = np.sqrt(np.einsum("mii->mi", checked.fit.covariance_m2[:, :3, :3])) / np.maximum(interval_s, 1e-3)[:, None]
    model = GRAVITY_SIGMA_MPS2 * interval_s[:, None] / 2.0
    sigma_v = np.maximum(np.hypot(spread, model), SMALLEST_SIGMA_MPS)
    good &= (sigma_v < LARGEST_SIGMA_MPS).all(axis=1) & np.isfinite(v).all(axis=1)
    return Velocities(v, np.where(good[:, None], sigma_v, np.nan), good, int(checked.excluded[good].sum()))


def _row_before(observed: Observations) -> np.ndarray:
    """For each row, the row of the same satellite at the epoch before, or -1."""
    key = observed.epoch.astype(np.int64) * 100 + observed.prn
    order = np.argsort(key)
    wanted = key - 100
    place = np.minimum(np.searchsorted(key[order], wanted), len(key) - 1)
    return np.where(key[order][place] == wanted, order[place], -1)


def _phase_m(observed: Observations) -> np.ndarray | None:
    """Ionosphere-free carrier phase as range (n,) [m]; None where the receiver gives none."""
    if not {"L1", "L2"} <= set(observed.values):
        return None
    a, b = FREE_OF_IONOSPHERE
    return LIGHT_MPS * (a * observed.values["L1"] / L1_HZ + b * observed.values["L2"] / L2_HZ)


def _distance(observed: Observations, ranges: Ranges, fixes: Fixes, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a clockless receiver at the fix would measure (n,) [m], and the line of sight (n,3), of rows (n,)."""
    distance, line = geometry(ranges.satellite_m[rows][:, None, :], fixes.r_itrf_m[observed.epoch[rows]])
    return distance[:, 0] - ranges.clock_m[rows], line[:, 0]


def _velocity_at_end(
    t_end_ns: np.ndarray,
    t_start_ns: np.ndarray,
    r_end_m: np.ndarray,
    step_m: np.ndarray,
    orientation: EarthOrientation,
) -> np.ndarray:
    """Earth-fixed velocity (m,3) at the end of an interval in which the antenna went step_m from r_end_m - step_m.

    Newton on the inertial velocity, with the motion back to the start by gravity as the map.
    """
    zero = np.zeros_like(r_end_m)
    end, _ = orientation.to_gcrf(t_end_ns, r_end_m, zero)
    start, _ = orientation.to_gcrf(t_start_ns, r_end_m - step_m, zero)
    interval_s = ((t_end_ns - t_start_ns) / 1e9)[:, None]
    v = (end - start) / interval_s
    for _ in range(4):
        v = v + (_back(end, v, interval_s) - start) / interval_s
    return orientation.to_itrf(t_end_ns, end, v)[1]


def _back(r_m: np.ndarray, v_mps: np.ndarray, interval_s: np.ndarray) -> np.ndarray:
    """Position (m,3) an interval earlier under gravity, one step of RK4: below a micrometre in ten seconds."""
    h = -interval_s
    k1, l1 = v_mps, _gravity(r_m)
    k2, l2 = v_mps + 0.5 * h * l1, _gravity(r_m + 0.5 * h * k1)
    k3, l3 = v_mps + 0.5 * h * l2, _gravity(r_m + 0.5 * h * k2)
    k4 = v_mps + h * l3
    return r_m + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def _gravity(r_m: np.ndarray) -> np.ndarray:
    """Acceleration (m,3) [m/s2] of centre and J2, GCRF with the pole taken along z (Vallado 2013, eq. 8-35)."""
    radius = np.linalg.norm(r_m, axis=1, keepdims=True)
    z2 = (r_m[:, 2:] / radius) ** 2
    factor = 1.5 * J2 * (RADIUS_M / radius) ** 2
    shape = np.concatenate((1.0 - 5.0 * z2, 1.0 - 5.0 * z2, 3.0 - 5.0 * z2), axis=1)
    return -GM_M3PS2 * r_m / radius**3 * (1.0 + factor * shape)
