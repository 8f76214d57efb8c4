"""Fixes of a real receiver: each epoch solved from its own ionosphere-free pseudoranges with precise orbits and clocks.

What is corrected: light time, the Earth's turn in flight, satellite clocks with their relativistic part, places of the
transmitting antennas. What is not: the receiver's own antenna (fixes are those of its phase centre), Shapiro's delay
(2 cm), antenna patterns. Above 400 km there is no troposphere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hil_sim.errors import DataError
from hil_sim.gnss.exclusion import Checked, Verdict, check
from hil_sim.gnss.least_squares import Fit, solve_positions
from hil_sim.gnss.precise_ephemeris import LIGHT_MPS, PreciseEphemeris
from hil_sim.gnss.rinex_obs import Observations

L1_HZ, L2_HZ = 1_575.42e6, 1_227.60e6
FREE_OF_IONOSPHERE = (L1_HZ**2 / (L1_HZ**2 - L2_HZ**2), -(L2_HZ**2) / (L1_HZ**2 - L2_HZ**2))
LARGEST_SIGMA_M = 30.0  # per axis: a fix worse than that is none
# one-sigma of an ionosphere-free pseudorange [m] by the strength of L2 [V/V], from code minus carrier of GRACE-B on
# 2010-07-27 (31942 values, no orbit in it): 1.4 m at 7, 0.76 at 21, 0.35 at 62, 0.17 at 200, 0.13 above 320
_NOISE_FLOOR_M, _NOISE_SLOPE_M, _NOISE_OFFSET = 0.1, 16.0, 5.0
NOISE_WITHOUT_STRENGTH_M = 1.0


class Ranges(NamedTuple):
    """Rows as in Observations (n,): which are usable, ranges and satellites at transmission.

    range_m: ionosphere-free pseudorange plus clock_m, the satellite's; sigma_m: its 1-sigma, inf where not usable;
    satellite_m (n,3): ITRF at transmission. without_clock, without_range: rows lost because the files have no clock, or
    the receiver no second frequency.
    """

    range_m: np.ndarray
    sigma_m: np.ndarray
    satellite_m: np.ndarray
    clock_m: np.ndarray
    without_clock: int
    without_range: int


class Fixes(NamedTuple):
    """One row an epoch (m,). t_gps_ns: the true instant, receiver's stamp less its clock error. r_itrf_m: antenna.

    r_itrf_m (m,3) [m], covariance_m2 (m,3,3). clock_m: receiver's clock error as range. verdict: of exclusion.Verdict;
    a row of any but GOOD and UNCHECKED, or of too large a sigma, is not `good`. satellites: used ones. place (n,): of
    each observation row in the tables (m,k) of `checked`.
    """

    t_gps_ns: np.ndarray
    r_itrf_m: np.ndarray
    covariance_m2: np.ndarray
    clock_m: np.ndarray
    verdict: np.ndarray
    good: np.ndarray
    satellites: np.ndarray
    place: np.ndarray
    checked: Checked

    @property
    def sigma_m(self) -> np.ndarray:
        """1-sigma per axis of ITRF (m,3) [m]."""
        return np.sqrt(np.einsum("mii->mi", self.covariance_m2))


def corrected_ranges(observed: Observations, ephemeris: PreciseEphemeris) -> Ranges:
    """Ranges that need no more than geometry and the receiver's clock. Raises DataError where a code is missing."""
    lacking = [code for code in ("P1", "P2") if code not in observed.values]
    if lacking:
        raise DataError(f"{observed.path}: no {' and no '.join(lacking)}: needed are pseudoranges P1 and P2")
    a, b = FREE_OF_IONOSPHERE
    pseudorange = a * observed.values["P1"] + b * observed.values["P2"]
    measured = np.isfinite(pseudorange)
    stamp = observed.t_ns[observed.epoch]
    # the satellite's own clock at transmission; then GPS time at transmission by that clock's error
    by_satellite = stamp - np.rint(np.where(measured, pseudorange, 2e7) / LIGHT_MPS * 1e9).astype(np.int64)
    clock_s = np.nan_to_num(ephemeris.states(observed.prn, by_satellite).clock_s)
    states = ephemeris.states(observed.prn, by_satellite - np.rint(clock_s * 1e9).astype(np.int64))
    known = np.isfinite(states.clock_s)
    if not known.any():
        raise DataError(f"{observed.path}: no satellite clock for any of its observations; name SP3 files of its days")
    sigma = np.hypot(pseudorange_sigma_m(observed.values.get("S2"), len(stamp)), states.sigma_m)
    return Ranges(
        pseudorange + LIGHT_MPS * states.clock_s,
        np.where(measured & known, sigma, np.inf),
        states.r_m,
        LIGHT_MPS * states.clock_s,
        int(np.count_nonzero(measured & ~known)),
        int(np.count_nonzero(~measured)),
    )


def pseudorange_sigma_m(strength: np.ndarray | None, count: int) -> np.ndarray:
    """1-sigma of ionosphere-free pseudoranges (count,) [m] by signal strength on L2 [V/V], None or NaN if unknown."""
    if strength is None:
        return np.full(count, NOISE_WITHOUT_STRENGTH_M)
    model = _NOISE_FLOOR_M + _NOISE_SLOPE_M / (np.maximum(np.nan_to_num(strength), 0.0) + _NOISE_OFFSET)
    return np.where(np.isfinite(strength), model, NOISE_WITHOUT_STRENGTH_M)


def solve(observed: Observations, ranges: Ranges) -> Fixes:
    """A fix of every epoch, tested and with faulty satellites left out."""
    place = _places(observed.epoch)
    shape = (len(observed.t_ns), int(place.max()) + 1)
    at = (observed.epoch, place)
    range_m, sigma_m, satellite_m = np.zeros(shape), np.full(shape, np.inf), np.zeros((*shape, 3))
    range_m[at], sigma_m[at] = np.nan_to_num(ranges.range_m), ranges.sigma_m
    satellite_m[at] = np.nan_to_num(ranges.satellite_m)

    def fit(rows: np.ndarray, sigma: np.ndarray) -> Fit:
        return solve_positions(satellite_m[rows], range_m[rows], sigma)

    checked = check(fit, sigma_m)
    x, covariance = checked.fit.x, checked.fit.covariance_m2[:, :3, :3]
    late_ns = np.rint(np.nan_to_num(x[:, 3]) / LIGHT_MPS * 1e9).astype(np.int64)
    sigma = np.sqrt(np.einsum("mii->mi", covariance))
    good = np.isin(checked.verdict, (Verdict.GOOD, Verdict.UNCHECKED)) & (sigma < LARGEST_SIGMA_M).all(axis=1)
    return Fixes(
        observed.t_ns - late_ns,
        x[:, :3],
        covariance,
        x[:, 3],
        checked.verdict,
        good,
        checked.used.sum(axis=1),
        place,
        checked,
    )


def _places(epoch: np.ndarray) -> np.ndarray:
    """For each row, which one of its epoch it is; epochs in order."""
    first = np.searchsorted(epoch, epoch, side="left")
    return np.arange(len(epoch)) - first
