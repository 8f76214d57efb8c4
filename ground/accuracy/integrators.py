"""Integrators of the force model compared: what each errs by and costs, by step. The choice: docs/adr/0010."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from flightsw.kernels.orbit_integrators import RK4, RK4_NODES, RK8, RK8_NODES, RKN5, RKN5_NODES, rk4, rk8, rkn5
from flightsw.kernels.registry import F8, I8, VECTOR, entry, frozen_records, records
from flightsw.records import FIELD, FORCE_TABLE, FORCE_WORK, ORIENTATION
from ground.accuracy.flight_model import FlightModel
from ground.tables.gps_time import NS_PER_S

STEPS_S = (1, 2, 5, 10, 15, 30, 60, 90)
REFERENCE_STEP_S = 5
# name -> (its number in the force table, force evaluations of a step)
CANDIDATES = {"RK4": (RK4, len(RK4_NODES)), "RKN5": (RKN5, len(RKN5_NODES)), "RK8": (RK8, len(RK8_NODES))}


class Measured(NamedTuple):
    """One integrator at one step: largest error over the starts [m], force evaluations and time for an hour."""

    name: str
    step_s: int
    error_m: float
    evaluations_per_hour: int
    us_per_hour: float


@entry(
    I8, frozen_records(FORCE_TABLE), frozen_records(FIELD), frozen_records(ORIENTATION), I8, VECTOR, I8, I8, F8,
    VECTOR, records(FORCE_WORK),
)  # fmt: skip
def _fly(kind, forces, field, eop, t_gps_ns, x, dt_ns, steps, drag_scale, empirical_rtn, work):
    for step in range(steps):
        t = t_gps_ns + step * dt_ns
        if kind == RK4:
            ok = rk4(forces[0], field[0], eop[0], t, x, dt_ns, drag_scale, empirical_rtn, work[0])
        elif kind == RK8:
            ok = rk8(forces[0], field[0], eop[0], t, x, dt_ns, drag_scale, empirical_rtn, work[0])
        else:
            ok = rkn5(forces[0], field[0], eop[0], t, x, dt_ns, drag_scale, empirical_rtn, work[0])
        if not ok:
            return False
    return True


def measure(model: FlightModel, starts: Iterable[tuple[int, np.ndarray]], duration_s: int = 1800) -> list[Measured]:
    """Errors of every candidate and step against RK8 in steps of 5 s, from starts (t [GPS ns], x (6,))."""
    chosen = list(starts)

    def end(kind: int, step_s: int, t_gps_ns: int, x: np.ndarray) -> np.ndarray:
        state = x[:6].copy()
        tables: tuple[Any, ...] = (model.forces, model.field, model.orientation)
        assert _fly(
            kind, *tables, t_gps_ns, state, step_s * NS_PER_S, duration_s // step_s, 1.0, np.zeros(3), model.work
        )
        return state

    reference = [end(RK8, REFERENCE_STEP_S, t, x) for t, x in chosen]
    found = []
    for name, (kind, stages) in CANDIDATES.items():
        for step_s in STEPS_S:
            began = time.perf_counter()
            ends = [end(kind, step_s, t, x) for t, x in chosen]
            spent_s = (time.perf_counter() - began) / len(chosen)
            error = max(float(np.abs(a[:3] - b[:3]).max()) for a, b in zip(ends, reference, strict=True))
            hours = duration_s / 3600.0
            found.append(Measured(name, step_s, error, stages * 3600 // step_s, spent_s * 1e6 / hours))
    return found
