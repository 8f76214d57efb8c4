"""GPS satellites between the nodes of precise orbit files: position and velocity of the antenna, clock, clock's sigma.

Orbits: Lagrange's polynomial of degree 10 in ITRF (3 mm at most between nodes of 15 minutes). Clocks: linear between
neighbouring nodes that both exist, never across a missing one: that would be kilometres. What a clock strays by in
between is a random walk tied at both nodes, and its size is taken from the satellite's own nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hil_sim.errors import DataError
from hil_sim.gnss.antennas import offsets_toward_earth_m
from hil_sim.truth.orbit_files.sp3 import Sp3, read_sp3
from hil_sim.truth.orbit_files.text import to_gps_ns

LIGHT_MPS = 299_792_458.0
NODES = 11
SATELLITES = 32
ORBIT_AND_CLOCK_M = 0.01  # at a node
# satellites' antennas are 0.6 to 2.7 m below their centres of mass; the mean goes into the receiver's clock
UNKNOWN_ANTENNA_M = 0.8


class SatelliteStates(NamedTuple):
    """Satellites at their own instants: r_m (n,3) [m] and v_mps (n,3) [m/s] in ITRF at that instant.

    clock_s (n,): satellite's clock minus GPS time, the periodic relativistic effect of its eccentricity included.
    sigma_m (n,): 1-sigma of clock and orbit, as range. NaN throughout where the files have nothing.
    """

    r_m: np.ndarray
    v_mps: np.ndarray
    clock_s: np.ndarray
    sigma_m: np.ndarray


class PreciseEphemeris:
    """Orbits and clocks of the GPS satellites over consecutive SP3 files.

    antennas: positions are those of the transmitting antenna; otherwise of the centre of mass, as in the files, and the
    sigma is larger.
    """

    def __init__(self, paths: Sequence[Path], antennas: bool = True) -> None:
        """Read and join the files. Raises DataError where they do not follow each other on one grid."""
        if not paths:
            raise DataError(
                "no precise orbit file is named: give SP3 files of the day, the one before and the one after"
            )
        files = [read_sp3(path) for path in paths]
        times = np.concatenate([to_gps_ns(file.moments, file.scale) for file in files])
        r_m = np.concatenate([_of_gps(file, file.r_m) for file in files])
        clock_s = np.concatenate([_of_gps(file, file.clock_s) for file in files])
        times, first = np.unique(times, return_index=True)
        steps = np.diff(times)
        if len(times) < NODES or steps.min() != steps.max():
            raise DataError(
                f"{', '.join(path.name for path in paths)}: their epochs do not form one grid of {NODES} and more; "
                "name files of consecutive days and one interval"
            )
        self.t_ns, self._step_ns = times, int(steps[0])
        self._r_m, self._clock_s = r_m[first], clock_s[first]
        self._walk_m2ps = _random_walk_m2ps(self._clock_s, self._step_ns / 1e9)
        self._offset_m, self._floor_m = np.zeros(SATELLITES), UNKNOWN_ANTENNA_M
        if antennas:
            self._offset_m = offsets_toward_earth_m(int(times[0]), int(times[-1]))
            self._floor_m = ORBIT_AND_CLOCK_M

    def covers(self, t_ns: np.ndarray) -> np.ndarray:
        """(n,) bool: the instants have NODES nodes around them."""
        reach = NODES // 2 * self._step_ns
        return (t_ns >= self.t_ns[0] + reach) & (t_ns < self.t_ns[-1] - reach)

    def clock_walk_m(self, prn: np.ndarray, interval_s: float) -> np.ndarray:
        """1-sigma (n,) [m] of what the clocks of satellites prn (n,) stray from a straight line in a short interval."""
        return np.sqrt(self._walk_m2ps[prn - 1] * interval_s)

    def states(self, prn: np.ndarray, t_ns: np.ndarray) -> SatelliteStates:
        """Satellites prn (n,) at GPS times t_ns (n,) int64."""
        inside = self.covers(t_ns)
        t = np.where(inside, t_ns, self.t_ns[len(self.t_ns) // 2])
        k = prn - 1
        index, rest = np.divmod(t - self.t_ns[0], self._step_ns)
        s = rest / self._step_ns
        nodes = index[:, None] + np.arange(NODES) - NODES // 2
        weight, slope = _lagrange(s + NODES // 2)
        around = self._r_m[nodes, k[:, None]]
        r = np.einsum("nj,njk->nk", weight, around)
        v = np.einsum("nj,njk->nk", slope, around) / (self._step_ns / 1e9)
        clock = self._clock_s[index, k] * (1.0 - s) + self._clock_s[index + 1, k] * s
        # IS-GPS-200 20.3.3.3.3.1: -2 r.v/c^2, the same in any rotating frame; precise clocks do not hold it
        clock = clock - 2.0 * np.einsum("nk,nk->n", r, v) / LIGHT_MPS**2
        # a random walk tied at both nodes (Brownian bridge): q tau (T - tau) / T
        bridge = self._walk_m2ps[k] * s * (1.0 - s) * (self._step_ns / 1e9)
        down = r / np.linalg.norm(r, axis=1, keepdims=True)
        bad = ~inside | np.isnan(clock) | np.isnan(r[:, 0])
        clock = np.where(bad, np.nan, clock)
        return SatelliteStates(
            np.where(bad[:, None], np.nan, r - down * self._offset_m[k][:, None]),
            np.where(bad[:, None], np.nan, v),
            clock,
            np.where(bad, np.nan, np.sqrt(self._floor_m**2 + bridge)),
        )


def _of_gps(file: Sp3, values: np.ndarray) -> np.ndarray:
    """Columns of the GPS satellites 1 to 32 of a file, NaN for those it lacks."""
    if not any(name.startswith("G") for name in file.satellites):
        raise DataError(f"{file.path}: holds no GPS satellite")
    result = np.full((len(file.moments), SATELLITES, *values.shape[2:]), np.nan)
    for column, name in enumerate(file.satellites):
        if name.startswith("G") and 1 <= int(name[1:]) <= SATELLITES:
            result[:, int(name[1:]) - 1] = values[:, column]
    return result


def _random_walk_m2ps(clock_s: np.ndarray, step_s: float) -> np.ndarray:
    """Intensity q of each clock's random walk as range [m2/s]; the median of all for one that has no triple of nodes.

    The error of interpolating a node from its neighbours is a bridge of two steps at its middle: variance q step / 2.
    """
    middle = (clock_s[2:] - 2.0 * clock_s[1:-1] + clock_s[:-2]) / 2.0 * LIGHT_MPS
    count = np.isfinite(middle).sum(axis=0)
    variance = np.nansum(middle**2, axis=0) / np.maximum(count, 1)
    q = 2.0 * variance / step_s
    usual = float(np.median(q[count > 0])) if np.any(count > 0) else 0.0
    return np.where(count > 0, q, usual)


def _lagrange(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights (n, NODES) of nodes 0 .. NODES-1 for value and derivative at x (n,), counted in node spacings."""
    weight, slope = np.ones((len(x), NODES)), np.zeros((len(x), NODES))
    for j in range(NODES):
        for m in range(NODES):
            if m != j:
                slope[:, j] = (slope[:, j] * (x - m) + weight[:, j]) / (j - m)
                weight[:, j] *= (x - m) / (j - m)
    return weight, slope
