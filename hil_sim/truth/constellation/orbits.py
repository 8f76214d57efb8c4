"""Where the satellites of a constellation are: a Walker pattern on circular orbits, or nodes of any source.

Times are seconds since the start of the constellation; positions [m] and velocities [m/s] are inertial.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hil_sim.truth.hermite import HermiteTrack

MU_M3PS2 = 3.986004418e14
GLONASS_SEMI_MAJOR_AXIS_M = 25_508_000.0
GLONASS_INCLINATION_DEG = 64.8
_NS = 1_000_000_000
_BLOCK_S = 60


class Constellation(Protocol):
    """True motion of n satellites."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of each satellite, in order."""

    def states(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,3) and velocities (n,3); NaN for a satellite without a known orbit then."""


@dataclass(frozen=True)
class Walker:
    """Walker pattern i: total/planes/phasing; the first plane holds satellites 1 to total/planes, and so on.

    first_latitude_deg: argument of latitude of satellite 1 at the start. J. Walker, RAE TR 77044 (1977).
    """

    total: int = 24
    planes: int = 3
    phasing: int = 1
    semi_major_axis_m: float = GLONASS_SEMI_MAJOR_AXIS_M
    inclination_deg: float = GLONASS_INCLINATION_DEG
    first_latitude_deg: float = 0.0

    def __post_init__(self) -> None:
        """Raises ValueError for a pattern that does not exist."""
        if self.planes < 1 or self.total < 2 or self.total % self.planes or not 0 <= self.phasing < self.planes:
            raise ValueError(
                f"Walker {self.total}/{self.planes}/{self.phasing}: the planes must hold equal numbers, "
                "and the phasing lie from 0 to planes - 1"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Numbers from 1."""
        return tuple(str(number + 1) for number in range(self.total))

    @property
    def mean_motion_radps(self) -> float:
        """Angular rate of every satellite."""
        return math.sqrt(MU_M3PS2 / self.semi_major_axis_m**3)

    @property
    def plane(self) -> np.ndarray:
        """Plane (n,) of each satellite, from 0."""
        return np.arange(self.total) // (self.total // self.planes)

    def states(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,3) [m] and velocities (n,3) [m/s]."""
        each = self.total // self.planes
        number = np.arange(self.total)
        plane, slot = number // each, number % each
        node = 2.0 * np.pi * plane / self.planes
        u = (
            math.radians(self.first_latitude_deg)
            + 2.0 * np.pi * (slot / each + plane * self.phasing / self.total)
            + self.mean_motion_radps * t_s
        )
        i = math.radians(self.inclination_deg)
        ahead = np.stack((np.cos(node), np.sin(node), np.zeros(self.total)), axis=1)
        beside = np.stack(
            (-np.sin(node) * math.cos(i), np.cos(node) * math.cos(i), np.full(self.total, math.sin(i))), axis=1
        )
        cosine, sine = np.cos(u)[:, None], np.sin(u)[:, None]
        r = self.semi_major_axis_m * (cosine * ahead + sine * beside)
        v = self.semi_major_axis_m * self.mean_motion_radps * (cosine * beside - sine * ahead)
        return r, v


class Tracks:
    """A constellation between nodes: for each satellite a Hermite track whose time is nanoseconds since the start."""

    def __init__(self, names: tuple[str, ...], tracks: list[HermiteTrack]) -> None:
        self.names = names
        self._tracks = tracks
        self._block: tuple[int, np.ndarray, np.ndarray] | None = None  # whole seconds, computed so many at a time

    def states(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,3) and velocities (n,3); NaN outside a satellite's nodes."""
        t_ns = round(t_s * 1e9)
        if t_ns % _NS:
            r, v = self._states(np.array([t_ns], np.int64))
            return r[0], v[0]
        block, place = divmod(t_ns // _NS, _BLOCK_S)
        if self._block is None or self._block[0] != block:
            self._block = (block, *self._states((block * _BLOCK_S + np.arange(_BLOCK_S, dtype=np.int64)) * _NS))
        return self._block[1][place].copy(), self._block[2][place].copy()

    def _states(self, t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (k,n,3) and velocities (k,n,3) at times (k,)."""
        r = np.full((len(t_ns), len(self.names), 3), np.nan)
        v = r.copy()
        for index, track in enumerate(self._tracks):
            known = (track.t_first_ns <= t_ns) & (t_ns <= track.t_last_ns)
            if known.any():
                r[known, index], v[known, index] = track.evaluate(t_ns[known])
        return r, v
