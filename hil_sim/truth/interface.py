"""What a truth is: a satellite's state in GCRF at any instant of its range."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from hil_sim.truth.hermite import HermiteTrack
from hil_sim.truth.high_degrees import DisplacedTrack
from hil_sim.truth.piecewise import PiecewiseTrack

MU_PAPER_M3PS2 = 3.9860044e14  # the paper's value: dA is what central gravity with this mu leaves out


class Truth(Protocol):
    """True motion, from whatever source, in GCRF and GPS time."""

    @property
    def t_first_gps_ns(self) -> int:
        """First instant served [ns]."""

    @property
    def t_last_gps_ns(self) -> int:
        """Last instant served [ns]."""

    def state_gcrf(self, t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """r (n,3) [m] and v (n,3) [m/s] in GCRF; ValueError outside the range."""

    def acceleration_residual(self, t_gps_ns: np.ndarray) -> np.ndarray:
        """True acceleration minus -mu r/r^3 with the paper's mu, (n,3) [m/s2], GCRF."""


class TrackTruth:
    """Truth held as a track of nodes in GCRF; every source ends here."""

    def __init__(self, track: HermiteTrack | PiecewiseTrack | DisplacedTrack, source: str) -> None:
        self.track = track
        self.source = source

    @property
    def t_first_gps_ns(self) -> int:
        """First instant served [ns]."""
        return self.track.t_first_ns

    @property
    def t_last_gps_ns(self) -> int:
        """Last instant served [ns]."""
        return self.track.t_last_ns

    def state_gcrf(self, t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """r (n,3) [m] and v (n,3) [m/s] in GCRF; ValueError outside the range."""
        r_m, v_mps = self.track.evaluate(t_gps_ns)
        return r_m, v_mps

    def acceleration_residual(self, t_gps_ns: np.ndarray) -> np.ndarray:
        """True acceleration minus -mu r/r^3 with the paper's mu, (n,3) [m/s2], GCRF.

        The acceleration is the second derivative of the interpolating polynomial.
        """
        r_m, _, a_mps2 = self.track.evaluate(t_gps_ns, derivatives=2)
        radius = np.linalg.norm(r_m, axis=1, keepdims=True)
        return a_mps2 + MU_PAPER_M3PS2 * r_m / radius**3
