"""The mean of the state over one step, with the process model that the table names."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from flightsw.kernels import force_model, gravity, integrators, orbit_integrators
from flightsw.kernels.registry import kernel
from flightsw.nav import flight_model

_NO_DRAG_CORRECTION = 1.0


class Model(NamedTuple):
    """What the mean needs beside the navigation table: records, handed through as one.

    eop: Earth orientation. forces, field: force table and gravity field, empty unless the flight filter flies.
    scratch: of the force model.
    """

    eop: Any
    forces: Any
    field: Any
    scratch: Any


@kernel
def advance(table, model, t_gps_ns, x, dt_ns, pole, work):
    """x at t_gps_ns, in place, to dt_ns later; False where the Earth orientation that the forces need has ended.

    The flight filter's empirical accelerations act with their mean over the step and decay exactly. Without Earth
    orientation the step is taken with the small model, so that there is a state, but nothing may vouch for it.
    """
    dt_s = dt_ns * 1e-9
    if table.filter_model != flight_model.FLIGHT:
        integrators.advance(table, x, dt_s, pole, work.stages)
        return True
    decay = math.exp(-dt_s / table.empirical_tau_s)
    kept = -math.expm1(-dt_s / table.empirical_tau_s) * table.empirical_tau_s / dt_s
    empirical = work.empirical_rtn
    for i in range(3):
        empirical[i] = kept * x[6 + i]
    ok = orbit_integrators.advance(
        model.forces, model.field, model.eop, t_gps_ns, x[0:6], dt_ns, _NO_DRAG_CORRECTION, empirical, model.scratch
    )
    if not ok:
        for i in range(6):
            work.x_model[i] = x[i]
        for i in range(3):
            work.x_model[6 + i] = 0.0
        integrators.rk4(table, work.x_model, dt_s, pole, work.stages)
        for i in range(6):
            x[i] = work.x_model[i]
    for i in range(3):
        x[6 + i] *= decay
    return ok


@kernel
def beyond_publication(table, model, t_gps_ns, x, pole, work, out):
    """Acceleration at the epoch that the small model of the publication lacks, into `out` [m/s2, GCRF].

    For the paper's filter that is dA; for the flight filter all that its force model has beyond J2.
    """
    for i in range(3):
        out[i] = x[6 + i]
    if table.filter_model != flight_model.FLIGHT:
        return
    r = x[0:3]
    ok = force_model.acceleration(
        model.forces,
        model.field,
        model.eop,
        t_gps_ns,
        r,
        x[3:6],
        _NO_DRAG_CORRECTION,
        x[6:9],
        model.scratch,
        out,
    )
    gravity.acceleration(table, r, pole, work.small_mps2)
    for i in range(3):
        out[i] = out[i] - work.small_mps2[i] if ok else 0.0
