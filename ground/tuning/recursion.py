"""Equation (17) for many outages at once: covariances in lanes, one candidate row at a time, seconds for a search.

The state error of an outage does not depend on the settings of (17). Errors, and the gradient of gravity that the
transition takes at each epoch, are flown once (`outages.py`); here nothing but covariances move. Flight's own kernel
does one outage at a time and six measurements together; this one takes the six pseudo-measurements one after the other
(their noise is diagonal, so the result is the same) and has sixteen outages side by side, innermost, where the
processor does several at once (lanes_step.py). A test holds it against flight's kernel; every row found is flown in
the end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flightsw.kernels.registry import I8, MATRIX, TIMES, VECTOR, types
from ground.tuning.lanes_step import LANES, SIZE, STATES, transit_euler, transit_runge_kutta, update
from ground.tuning.wide import SOURCES, entry, scratch, wide

PARAMETERS = ("q_r_m2", "q_v_m2ps2", "q_a_m2ps4", "s_r_m", "s_v_mps")
_YY, _ZZ = (STATES + 1) * LANES, (2 * STATES + 2) * LANES  # of the position's variances
_BLOCKS = types.Array(types.float64, 3, "C")


def _declare(sources):
    @entry(_BLOCKS, _BLOCKS, MATRIX, TIMES, VECTOR, VECTOR, I8, MATRIX, MATRIX, MATRIX, TIMES)
    def _carry(p0, gradient_ps2, error_m, last, row, settings, allowed, work, bound_m, found, broken):
        """See `carry`. True if every outage stayed within what is allowed; else the rest is not computed.

        settings: dt [s], 1 for Runge-Kutta, k_axis, margin, limit [m]. work (3, SIZE): scratch.
        found (3, L): bound at the last epoch, largest error / bound, epoch at which the bound crosses the limit.
        """
        wide()
        dt_s, second_order, k_axis = settings[0], settings[1] > 0.0, settings[2]
        margin, limit_m = settings[3], settings[4]
        r_m2, v_m2ps2 = row[3] * row[3], row[4] * row[4]
        lanes, trace = p0.shape[0], bound_m.shape[0] > 0
        p, m = work[0], work[1]
        g, before = work[2, : 6 * LANES], work[2, 6 * LANES : 7 * LANES]
        bound, ratios = work[2, 7 * LANES : 8 * LANES], work[2, 8 * LANES : 9 * LANES]
        g[:] = 0.0
        for first in range(0, lanes, LANES):
            here = min(LANES, lanes - first)
            longest = 0
            for k in range(LANES):
                source = first + min(k, here - 1)  # lanes to spare begin like the last outage
                if last[source] > longest:
                    longest = last[source]
                for i in range(STATES):
                    for j in range(i, STATES):
                        p[(STATES * i + j) * LANES + k] = p0[source, i, j]
                before[k] = k_axis * math.sqrt(max(p0[source, 0, 0], max(p0[source, 1, 1], p0[source, 2, 2])))
            for epoch in range(longest):
                for i in range(6):
                    for k in range(here):
                        g[i * LANES + k] = gradient_ps2[epoch, i, first + k]
                if second_order:
                    transit_runge_kutta(p, m, g, dt_s)
                else:
                    transit_euler(p, m, g, dt_s)
                update(p, m, row[0], row[1], row[2], r_m2, v_m2ps2)
                for k in range(LANES):
                    bound[k] = k_axis * math.sqrt(max(p[k], max(p[_YY + k], p[_ZZ + k])))
                for k in range(here):
                    ratios[k] = error_m[epoch + 1, first + k] / bound[k]
                for k in range(here):
                    lane = first + k
                    if epoch + 1 > last[lane]:
                        continue
                    s_m, ratio = bound[k], ratios[k]
                    if trace:
                        bound_m[epoch + 1, lane] = s_m
                    if s_m > limit_m and not (found[2, lane] >= 0.0):
                        share = (limit_m - before[k]) / (s_m - before[k])
                        found[2, lane] = epoch + share if before[k] <= limit_m else 0.0
                    before[k] = s_m
                    if not (ratio <= found[1, lane]):  # NaN stays
                        found[1, lane] = ratio
                    if not (margin * ratio <= 1.0):
                        broken[lane] += 1
                        if broken[lane] > allowed:
                            return False
                    if epoch + 1 == last[lane]:
                        found[0, lane] = s_m
        return sources != 0

    return _carry


_carry = _declare(SOURCES)


class Outages(NamedTuple):
    """Outages of L lanes and N seconds, flown once, that candidates are tried on.

    p0 (L, 9, 9): covariance at the last fix; gradient_ps2 (N, 6, L): of gravity at each epoch; error_m (N + 1, L): the
    largest axis at each epoch; dt_s: step of the grid; runge_kutta: whether Phi has second-order terms; k_axis of (12).
    """

    p0: np.ndarray
    gradient_ps2: np.ndarray
    error_m: np.ndarray
    dt_s: float
    runge_kutta: bool
    k_axis: float

    def of(self, lanes: np.ndarray) -> Outages:
        """Some of the lanes."""
        return self._replace(
            p0=np.ascontiguousarray(self.p0[lanes]),
            gradient_ps2=np.ascontiguousarray(self.gradient_ps2[:, :, lanes]),
            error_m=np.ascontiguousarray(self.error_m[:, lanes]),
        )

    def crossing(self, limit_m: float) -> np.ndarray:
        """First epoch (L,) int at which the error has reached the limit: T of (18); -1 where it never does."""
        reached = self.error_m >= limit_m
        return np.where(reached.any(axis=0), reached.argmax(axis=0), -1).astype(np.int64)


class Carried(NamedTuple):
    """What a row does to each outage (L,), and whether (22) held as often as wanted; if not, the rest is not computed.

    at_last_m: bound at the last epoch; worst: largest error / bound; flag_s: when the bound crosses the limit, NaN
    where it does not; broken: epochs at which the bound, without the margin's share, was too small.
    """

    holds: bool
    at_last_m: np.ndarray
    worst: np.ndarray
    flag_s: np.ndarray
    broken: np.ndarray


_NO_TRACE = np.empty((0, 0))


def carry(
    outages: Outages, last: np.ndarray, row: np.ndarray, limit_m: float, margin: float = 1.0, allowed: int = 0
) -> Carried:
    """Try a row (5,) of (17), in the order of PARAMETERS, until epoch `last` (L,) of each outage.

    margin: (22) is asked for s >= margin e. allowed: epochs of an outage at which it may be broken.
    """
    return _call(outages, last, row, limit_m, margin, allowed, _NO_TRACE)


def trace(outages: Outages, row: np.ndarray) -> np.ndarray:
    """The bound s (N + 1, L) [m] at every epoch, whatever the errors; that of the first one is the covariance's own."""
    epochs, lanes = outages.error_m.shape
    bound = np.full((epochs, lanes), np.nan)
    bound[0] = outages.k_axis * np.sqrt(np.einsum("nii->ni", outages.p0)[:, :3].max(axis=1))
    _call(outages, np.full(lanes, epochs - 1, np.int64), row, np.inf, 1.0, epochs, bound)
    return bound


def _call(
    outages: Outages, last: np.ndarray, row: np.ndarray, limit_m: float, margin: float, allowed: int, bound: np.ndarray
) -> Carried:
    found, broken = np.full((3, len(last)), np.nan), np.zeros(len(last), np.int64)
    found[1] = 0.0
    settings = np.array([outages.dt_s, float(outages.runge_kutta), outages.k_axis, margin, limit_m])
    work = scratch(3, SIZE)
    row = np.ascontiguousarray(row, float)
    p0, gradient, error = outages.p0, outages.gradient_ps2, outages.error_m
    holds = _carry(p0, gradient, error, last, row, settings, allowed, work, bound, found, broken)
    return Carried(bool(holds), found[0], found[1], found[2] * outages.dt_s, broken)
