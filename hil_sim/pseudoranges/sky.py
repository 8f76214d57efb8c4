"""Satellites of navigation constellations: nominal Walker patterns, or the precise orbits of an SP3 file.

All in GCRF, so that a range is the distance between two places of one inertial frame; flight works in the turning
Earth's axes and turns them back. Nothing is shared.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from hil_sim.gnss.precise_ephemeris import LIGHT_MPS, SATELLITES, PreciseEphemeris
from hil_sim.gps_time import NS
from hil_sim.pseudorange_schema import SYSTEMS
from hil_sim.truth.constellation.orbits import Walker
from hil_sim.truth.earth_rotation import EarthOrientation

# Nominal patterns: GPS of IS-GPS-200's 24 slots as 24/6/2, GLONASS ICD 5.1 24/3/1, Galileo OS SIS ICD 24/3/1,
# BeiDou MEO 24/3/1 (BDS-SIS-ICD)
WALKERS: dict[str, Walker] = {
    "gps": Walker(24, 6, 2, 26_559_700.0, 55.0),
    "glonass": Walker(24, 3, 1, 25_508_000.0, 64.8, 10.0),
    "galileo": Walker(24, 3, 1, 29_599_800.0, 56.0, 20.0),
    "beidou": Walker(24, 3, 1, 27_906_100.0, 55.0, 30.0),
}
_CLOCK_SPREAD_S, _CLOCK_DRIFT = 1e-4, 1e-11


class Sky(Protocol):
    """Satellites s in an order of their own: `system` (s,), number in its constellation `number` (s,).

    `r_gcrf_m` at instants (n,s) int64 [ns]: (n,s,3), NaN where there is none. `state`: of satellites (m,) at instants
    (m,), r and v in GCRF (m,3). `clock_m`: clock less its constellation's time, as range.
    """

    system: np.ndarray
    number: np.ndarray

    def r_gcrf_m(self, t_gps_ns: np.ndarray) -> np.ndarray: ...

    def state_itrf(self, satellite: np.ndarray, t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...

    def clock_m(self, satellite: np.ndarray, t_gps_ns: np.ndarray) -> np.ndarray: ...


class WalkerSky:
    """Nominal patterns on circular orbits, with clocks drawn once: an offset and a drift each."""

    def __init__(
        self, names: Sequence[str], t_start_gps_ns: int, orientation: EarthOrientation, stream: np.random.Generator
    ) -> None:
        self._t_start_ns = t_start_gps_ns
        self._orientation = orientation
        walkers = [WALKERS[name] for name in names]
        self.system = np.concatenate([np.full(w.total, SYSTEMS.index(n)) for n, w in zip(names, walkers, strict=True)])
        self.number = np.concatenate([np.arange(1, w.total + 1) for w in walkers])
        starts = [w.states(0.0) for w in walkers]
        r, v = (np.concatenate([start[k] for start in starts]) for k in (0, 1))
        self._radius_m = np.linalg.norm(r, axis=1)
        self._speed_mps = np.linalg.norm(v, axis=1)
        self._ahead, self._beside = r / self._radius_m[:, None], v / self._speed_mps[:, None]
        self._rate_radps = self._speed_mps / self._radius_m
        n = len(self.number)
        self._clock_s = stream.uniform(-_CLOCK_SPREAD_S, _CLOCK_SPREAD_S, n)
        self._drift = _CLOCK_DRIFT * stream.standard_normal(n)

    def r_gcrf_m(self, t_gps_ns: np.ndarray) -> np.ndarray:
        """(n,s,3) at instants (n,s)."""
        u = self._rate_radps * ((t_gps_ns - self._t_start_ns) / NS)
        around = np.cos(u)[..., None] * self._ahead + np.sin(u)[..., None] * self._beside
        return self._radius_m[:, None] * around

    def state_itrf(self, satellite: np.ndarray, t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """r (m,3) [m] and v (m,3) [m/s] in ITRF of satellites (m,) at instants (m,)."""
        u = (self._rate_radps[satellite] * ((t_gps_ns - self._t_start_ns) / NS))[:, None]
        ahead, beside = self._ahead[satellite], self._beside[satellite]
        r = self._radius_m[satellite, None] * (np.cos(u) * ahead + np.sin(u) * beside)
        v = self._speed_mps[satellite, None] * (np.cos(u) * beside - np.sin(u) * ahead)
        return self._orientation.to_itrf(t_gps_ns, r, v)

    def clock_m(self, satellite: np.ndarray, t_gps_ns: np.ndarray) -> np.ndarray:
        """Clock as range [m], of satellites at instants of the same shape."""
        age_s = (t_gps_ns - self._t_start_ns) / NS
        return LIGHT_MPS * (self._clock_s[satellite] + self._drift[satellite] * age_s)


class PreciseSky:
    """GPS satellites of SP3 files, with their clocks; one without an orbit or a clock at an instant is not there.

    antennas: places are those of the antennas, not of the centres of mass.
    """

    def __init__(self, paths: Sequence[Path], orientation: EarthOrientation, antennas: bool = False) -> None:
        self._ephemeris = PreciseEphemeris(paths, antennas)
        self._orientation = orientation
        self.number = np.arange(1, SATELLITES + 1)
        self.system = np.zeros(SATELLITES, np.int64)

    def r_gcrf_m(self, t_gps_ns: np.ndarray) -> np.ndarray:
        """(n,s,3) at instants (n,s)."""
        flat = t_gps_ns.ravel()
        prn = np.broadcast_to(self.number, t_gps_ns.shape).ravel()
        r = self._ephemeris.states(prn, flat).r_m
        found, _ = self._orientation.to_gcrf(flat, r, np.zeros_like(r))
        return found.reshape(*t_gps_ns.shape, 3)

    def state_itrf(self, satellite: np.ndarray, t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """r (m,3) [m] and v (m,3) [m/s] in ITRF of satellites (m,) at instants (m,)."""
        states = self._ephemeris.states(self.number[satellite], t_gps_ns)
        return states.r_m, states.v_mps

    def clock_m(self, satellite: np.ndarray, t_gps_ns: np.ndarray) -> np.ndarray:
        """Clock as range [m], of satellites at instants of the same shape."""
        states = self._ephemeris.states(self.number[satellite].ravel(), t_gps_ns.ravel())
        return (LIGHT_MPS * states.clock_s).reshape(t_gps_ns.shape)
