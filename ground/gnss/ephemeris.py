"""Satellites of any constellation between the nodes of a precise orbit file: position, velocity, clock.

Orbits by Lagrange's polynomial of degree 10 in ITRF; clocks linear between neighbouring nodes, never across a missing
one.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np

from ground.errors import OperatorError
from hil_sim.truth.orbit_files.sp3 import DataError, read_sp3
from hil_sim.truth.orbit_files.text import to_gps_ns

LIGHT_MPS = 299_792_458.0
NODES = 11


class Orbits(Protocol):
    """Where satellites are and what their clocks say, from whatever file. floor_m: 1-sigma that they add to a range."""

    floor_m: ClassVar[dict[str, float]]

    def states(self, names: tuple[str, ...], t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (m,k,3) [m] in ITRF and clocks (m,k) [s] of satellites at GPS times t_ns (m,k); NaN: unknown."""
        ...


class Precise:
    """Orbits and clocks of an SP3 file."""

    floor_m: ClassVar[dict[str, float]] = {
        "G": 0.7,
        "R": 1.1,
        "E": 0.5,
    }

    def __init__(self, path: Path) -> None:
        """Read a file. Raises OperatorError where it is none, or not on one grid."""
        try:
            file = read_sp3(path)
            self.t_ns = to_gps_ns(file.moments, file.scale)
        except DataError as error:
            raise OperatorError(str(error)) from error
        steps = np.diff(self.t_ns)
        if len(self.t_ns) < NODES or steps.min() != steps.max():
            raise OperatorError(
                f"{path}: its epochs do not form one grid of {NODES} and more; name a file of a whole day"
            )
        self._step_ns = int(steps[0])
        self._r_m, self._clock_s = file.r_m, file.clock_s
        self._place = {name: k for k, name in enumerate(file.satellites)}

    def states(self, names: tuple[str, ...], t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (m,k,3) [m] in ITRF and clocks (m,k) [s] of satellites at GPS times t_ns (m,k); NaN where unknown.

        Clocks hold the periodic relativistic effect of the eccentricity.
        """
        column = np.array([self._place.get(name, -1) for name in names])
        column = np.broadcast_to(column, t_ns.shape)
        index, rest = np.divmod(t_ns - self.t_ns[0], self._step_ns)
        first = np.clip(index - NODES // 2, 0, len(self.t_ns) - NODES)
        inside = (column >= 0) & (index >= 0) & (index < len(self.t_ns) - 1)
        x = np.where(inside, index - first + rest / self._step_ns, 0.0)
        around = self._r_m[first[..., None] + np.arange(NODES), column[..., None]]
        weight, slope = _lagrange(x)
        r = np.einsum("mkj,mkja->mka", weight, around)
        v = np.einsum("mkj,mkja->mka", slope, around) / (self._step_ns / 1e9)
        before = np.where(inside, index, 0)
        share = rest / self._step_ns
        clock = (1.0 - share) * self._clock_s[before, column] + share * self._clock_s[before + 1, column]
        clock = clock - 2.0 * np.einsum("mka,mka->mk", r, v) / LIGHT_MPS**2
        known = inside & np.isfinite(clock) & np.isfinite(r).all(axis=2)
        return np.where(known[..., None], r, np.nan), np.where(known, clock, np.nan)


def _lagrange(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights (..., NODES) of the nodes 0, 1, ... at x, and their derivatives per node spacing."""
    weight, slope = np.ones((*x.shape, NODES)), np.zeros((*x.shape, NODES))
    for j in range(NODES):
        for m in range(NODES):
            if m != j:
                slope[..., j] = (slope[..., j] * (x - m) + weight[..., j]) / (j - m)
                weight[..., j] *= (x - m) / (j - m)
    return weight, slope
