"""The flight force model with its tables, ready to be called from Python: built by the ground, loaded as in flight."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.kernels.force_model import acceleration_at
from flightsw.kernels.orbit_integrators import propagate
from flightsw.kernels.spherical_harmonics import load_field
from flightsw.records import FIELD, FORCE_TABLE, FORCE_WORK, GRAVITY_TABLE
from ground.errors import OperatorError
from ground.tables.forces import build_forces
from ground.tables.gravity_field import build_gravity_field


def aligned(dtype: np.dtype, payload: np.ndarray) -> np.ndarray:
    """A table's payload (1,) as the aligned, read-only record that kernels read."""
    image = np.zeros(1, dtype)
    for name in payload.dtype.names or ():
        image[name] = payload[name]
    image.flags.writeable = False
    return image


class FlightModel:
    """Gravity field, force table, Earth orientation and scratch. gravity: an ICGEM file; None takes ITU_GRACE16."""

    def __init__(
        self,
        orientation: np.ndarray,
        gravity: Path | None = None,
        settings: Mapping[str, Any] | None = None,
        day: date | None = None,
    ) -> None:
        self.orientation = orientation
        self.work = np.zeros(1, FORCE_WORK)
        self.field = np.zeros(1, FIELD)
        self.forces = aligned(FORCE_TABLE, decode(build_forces(settings, day=day)).values)
        degree = int(self.forces["degree"][0])
        self._source = decode(build_gravity_field(gravity, degree))
        self.gravity_name = self._source.set_name
        if not load_field(aligned(GRAVITY_TABLE, self._source.values), self.forces, self.field):
            raise OperatorError(f"{self.gravity_name}: does not hold degree {degree}")
        self.field.flags.writeable = False

    def acceleration(
        self, t_gps_ns: int, x: np.ndarray, drag_scale: float = 1.0, empirical_rtn: np.ndarray | None = None
    ) -> np.ndarray:
        """Acceleration (3,) [m/s2, GCRF] at x (6,) [m, m/s, GCRF]."""
        out = np.zeros(3)
        extra = np.zeros(3) if empirical_rtn is None else empirical_rtn
        r, v = x[:3].copy(), x[3:6].copy()
        if not acceleration_at(
            self.forces, self.field, self.orientation, t_gps_ns, r, v, drag_scale, extra, self.work, out
        ):
            raise OperatorError("outside the Earth-orientation table")
        return out

    def propagate(self, t_gps_ns: int, x: np.ndarray, duration_ns: int) -> np.ndarray:
        """State (6,) after duration_ns, of either sign, from x (6,) [m, m/s, GCRF] at t."""
        state = np.array(x[:6], dtype=np.float64)
        if not propagate(
            self.forces, self.field, self.orientation, t_gps_ns, state, duration_ns, 1.0, np.zeros(3), self.work
        ):
            raise OperatorError("outside the Earth-orientation table")
        return state
