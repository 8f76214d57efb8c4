"""A bench for the flight filter's process model: one state, one table, burns as put; no orbit, no fixes."""

from __future__ import annotations

from typing import Any

import numpy as np
from flight_bench import NS, T0_GPS_NS, record

from flightsw.icd.enums import BurnFrame
from flightsw.icd.table_schema import NAVIGATION
from flightsw.kernels import udu
from flightsw.nav import flight_model
from flightsw.records import NAV, STATES, TABLE, WORK

R_M = np.array([4.1e6, -3.9e6, 3.7e6])
V_MPS = np.array([5.1e3, 5.2e3, -0.9e3])
X = np.concatenate([R_M, V_MPS, np.zeros(14)])
DRAG_MPS2 = np.array([-3e-7, -4e-7, 2e-7])  # of scale one
NO_GRADIENT = np.zeros((3, 3))
PROCESS = {
    "empirical_sigma_mps2": 5e-8,
    "empirical_tau_s": 600.0,
    "drag_sigma": 0.4,
    "drag_tau_s": 5000.0,
    "drag_slow_sigma": 0.3,
    "drag_slow_tau_s": 86400.0,
    "white_radial_m2ps3": 1e-14,
    "white_along_m2ps3": 4e-14,
    "white_cross_m2ps3": 9e-14,
    "gnss_bias_sigma_m": 3.0,
    "gnss_bias_tau_s": 300.0,
    "gnss_periodic_sigma_m": 2.0,
    "gnss_periodic_tau_s": 1e5,
}


def gradient() -> np.ndarray:
    r = np.linalg.norm(R_M)
    return 3.986004415e14 / r**5 * (3.0 * np.outer(R_M, R_M) - r * r * np.eye(3))


def rtn() -> np.ndarray:
    radial = R_M / np.linalg.norm(R_M)
    cross = np.cross(R_M, V_MPS)
    cross /= np.linalg.norm(cross)
    return np.column_stack([radial, np.cross(cross, radial), cross])


def rate_radps() -> float:
    return float(np.linalg.norm(np.cross(R_M, V_MPS)) / (R_M @ R_M))


class Bench:
    """Records of a filter without an orbit: one state, one table, burns as put."""

    def __init__(self, **fields: float) -> None:
        arrays = np.zeros(1, TABLE), np.zeros(1, WORK), np.zeros(1, NAV)
        for field in NAVIGATION.fields:
            if field.default is not None:
                arrays[0][field.name] = field.default
        for name, value in {**PROCESS, **fields}.items():
            arrays[0][name] = value
        arrays[1].view(np.float64)[:] = np.nan  # what is not set may not be read
        arrays[1]["W"] = 0.0
        self.table, self.work, self.nav = (record(array) for array in arrays)

    def burn(self, slot: int, start_s: float, duration_s: float, sigma: Any, frame: int = BurnFrame.GCRF) -> None:
        """An announced burn, seconds from T0."""
        self.nav.burn_start_gps_ns[slot] = T0_GPS_NS + round(start_s * NS)
        self.nav.burn_duration_ns[slot] = round(duration_s * NS)
        self.nav.burn_sigma_mps[slot] = sigma
        self.nav.burn_frame[slot] = frame

    def predict(self, ud: np.ndarray, dt_s: float, g: np.ndarray = NO_GRADIENT, at_s: float = 0.0) -> np.ndarray:
        """Factors after a step of dt from `at_s`."""
        out = np.full((STATES, STATES), np.nan)
        flight_model.set_transition(self.table, X, dt_s, DRAG_MPS2, g, self.work)
        t_gps_ns = T0_GPS_NS + round(at_s * NS)
        flight_model.predict(self.nav, self.table, t_gps_ns, ud, dt_s, DRAG_MPS2, self.work, out)
        return out

    def noise(self, dt_s: float, g: np.ndarray = NO_GRADIENT, at_s: float = 0.0) -> np.ndarray:
        """Covariance (n, n) that a step adds to a state known without error."""
        return whole(self.predict(np.zeros((STATES, STATES)), dt_s, g, at_s), flight_model.states(self.table))


def whole(ud: np.ndarray, n: int = STATES) -> np.ndarray:
    p = np.full((n, n), np.nan)
    udu.covariance(ud, n, n, p)
    return p


def difference(got: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference of two covariances in units of the sigmas it belongs to."""
    sigma = np.sqrt(np.diag(expected))
    return float(np.abs((got - expected) / np.outer(sigma, sigma)).max())
