"""An ensemble of outages whole: for every arc the mean by Euler with J2, and (17) along it, sixteen arcs side by side.

What tuning tries rows on has its gradients from flight (`outages.py`); here nothing is flown before, so that other
orbits cost no more than covariances do. The speed of this is what `ground timing` tells of kernels in lanes.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from flightsw.kernels.registry import F8, I8, MATRIX, VECTOR, types
from ground.tuning.lanes_step import LANES, SIZE, STATES, move, transit_euler, update
from ground.tuning.wide import SOURCES, entry, scratch, wide

_BLOCKS = types.Array(types.float64, 3, "C")
_SHARES = 8  # of a thread


def _declare(sources):
    @entry(MATRIX, _BLOCKS, VECTOR, F8, F8, F8, VECTOR, I8, MATRIX, MATRIX, _BLOCKS)
    def _fly(x0, p0, pole, mu, j2_m2, dt_s, row, epochs, work, x_out, p_out):
        """See `fly`. work (4, SIZE): scratch. Leaves states (L, 9) and covariances (L, 9, 9) after the last epoch."""
        wide()
        lanes = x0.shape[0]
        p, m, x, g = work[0], work[1], work[2], work[3]
        r_m2, v_m2ps2 = row[3] * row[3], row[4] * row[4]
        for first in range(0, lanes, LANES):
            here = min(LANES, lanes - first)
            for k in range(LANES):
                source = first + min(k, here - 1)  # lanes to spare do as the last arc does
                for i in range(STATES):
                    x[i * LANES + k] = x0[source, i]
                    for j in range(i, STATES):
                        p[(STATES * i + j) * LANES + k] = p0[source, i, j]
            for _ in range(epochs):
                move(x, g, pole, mu, j2_m2, dt_s)
                transit_euler(p, m, g, dt_s)
                update(p, m, row[0], row[1], row[2], r_m2, v_m2ps2)
            for k in range(here):
                for i in range(STATES):
                    x_out[first + k, i] = x[i * LANES + k]
                    for j in range(i, STATES):
                        p_out[first + k, i, j] = p[(STATES * i + j) * LANES + k]
                        p_out[first + k, j, i] = p[(STATES * i + j) * LANES + k]
        return sources != 0

    return _fly


_fly = _declare(SOURCES)


class Field(NamedTuple):
    """Gravity: mu [m3/s2], J2, the radius it belongs to [m], unit vector of the pole (3,) in GCRF."""

    mu_m3ps2: float
    j2: float
    radius_m: float
    pole: np.ndarray


def fly(
    x0: np.ndarray, p0: np.ndarray, field: Field, row: np.ndarray, epochs: int, dt_s: float = 1.0, threads: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """States (L, 9) [m, m/s, m/s2] and covariances (L, 9, 9) after so many steps without a fix.

    x0 (L, 9), p0 (L, 9, 9) at the last fix; row (5,) of (17), in the order of recursion.PARAMETERS. Threads share the
    arcs in whole groups of lanes, several shares each, so that one that is held up does not keep the others waiting;
    the kernel holds no lock.
    """
    x0, p0 = np.ascontiguousarray(x0, float), np.ascontiguousarray(p0, float)
    row, pole = np.ascontiguousarray(row, float), np.ascontiguousarray(field.pole, float)
    x_out, p_out = np.empty_like(x0), np.empty_like(p0)
    j2_m2 = field.j2 * field.radius_m * field.radius_m
    shares = 1 if threads == 1 else _SHARES * threads
    each = LANES * math.ceil(len(x0) / (LANES * shares))

    def share(first: int) -> None:
        part = slice(first, first + each)
        work = scratch(4, SIZE)
        _fly(x0[part], p0[part], pole, field.mu_m3ps2, j2_m2, dt_s, row, epochs, work, x_out[part], p_out[part])

    starts = range(0, len(x0), each)
    if threads == 1:
        for first in starts:
            share(first)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(share, starts))
    return x_out, p_out
