"""The mean of the state over one step, with the process model that the table names."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from flightsw.kernels import force_model, gravity, integrators, orbit_integrators
from flightsw.kernels.registry import kernel
from flightsw.nav import flight_model, manoeuvre


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
def advance(nav, table, model, t_gps_ns, x, dt_ns, pole, work):
    """x at t_gps_ns, in place, to dt_ns later; False where the Earth orientation that the forces need has ended.

    The flight filter's other states act with their mean over the step and decay exactly. Without Earth orientation
    the step is taken with the small model, so that there is a state, but nothing may vouch for it. Announced burns
    are added to either model.
    """
    dt_s = dt_ns * 1e-9
    burning = manoeuvre.is_active(nav, t_gps_ns, dt_s)
    rate_radps = 0.0
    if burning:
        flight_model.rtn_basis(x, work.burn_rtn)
        rate_radps = flight_model.orbital_rate_radps(x)
    ok = True
    if table.filter_model != flight_model.FLIGHT:
        integrators.advance(table, x, dt_s, pole, work.stages)
    else:
        ok = _advance_flight(table, model, t_gps_ns, x, dt_ns, pole, work)
    if burning:
        manoeuvre.apply(nav, t_gps_ns, dt_s, work.burn_rtn, rate_radps, work, x)
    return ok


@kernel
def _mean(dt_s, tau_s):
    """Mean over dt of exp(-t / tau)."""
    return -math.expm1(-dt_s / tau_s) * tau_s / dt_s


@kernel
def _advance_split(table, model, t_gps_ns, x, dt_ns, drag_scale, empirical, pole, work):
    """One step by Runge-Kutta on the small model; what the forces have beyond it is that of the middle of the step.

    One evaluation of the forces instead of four. The middle takes a term of angular frequency w for 1 - (w dt)^2 / 24
    of itself: at 1 s 3e-4 of gravity's degree 70, less than any model knows it. False, and x untouched, outside the
    Earth-orientation table.
    """
    half_ns = dt_ns // 2
    y = work.x_model
    for i in range(6):
        y[i] = x[i]
    for i in range(3):
        y[6 + i] = 0.0
    integrators.rk4(table, y, half_ns * 1e-9, pole, work.stages)
    beyond = work.three
    if not force_model.acceleration(
        model.forces,
        model.field,
        model.eop,
        t_gps_ns + half_ns,
        y[0:3],
        y[3:6],
        drag_scale,
        empirical,
        model.scratch,
        beyond,
    ):
        return False
    gravity.acceleration(table, y[0:3], pole, work.small_mps2)
    for i in range(6):
        y[i] = x[i]
    for i in range(3):
        y[6 + i] = beyond[i] - work.small_mps2[i]
        work.split_beyond_mps2[i] = y[6 + i]
        work.split_drag_mps2[i] = model.scratch.drag_mps2[i]
    work.split = 1
    integrators.rk4(table, y, dt_ns * 1e-9, pole, work.stages)
    for i in range(6):
        x[i] = y[i]
    return True


@kernel
def _advance_flight(table, model, t_gps_ns, x, dt_ns, pole, work):
    dt_s = dt_ns * 1e-9
    kept = _mean(dt_s, table.empirical_tau_s)
    empirical = work.empirical_rtn
    for i in range(3):
        empirical[i] = kept * x[6 + i]
    drag_scale = 1.0 + _mean(dt_s, table.drag_tau_s) * x[9] + _mean(dt_s, table.drag_slow_tau_s) * x[10]
    flight_model.set_decays(table, x, dt_s, work)
    work.split = 0
    if dt_s <= table.split_step_max_s:
        ok = _advance_split(table, model, t_gps_ns, x, dt_ns, drag_scale, empirical, pole, work)
    else:
        ok = orbit_integrators.advance(
            model.forces, model.field, model.eop, t_gps_ns, x[0:6], dt_ns, drag_scale, empirical, model.scratch
        )
    if not ok:
        for i in range(6):
            work.x_model[i] = x[i]
        for i in range(3):
            work.x_model[6 + i] = 0.0
        integrators.rk4(table, work.x_model, dt_s, pole, work.stages)
        for i in range(6):
            x[i] = work.x_model[i]
    flight_model.carry_others(work, x)
    return ok


@kernel
def middle_of_step(table, x, dt_s, out):
    """Position half a step on, to the second order, into out (3,): where the gradient of a step is taken.

    Taken at its beginning, the gradient feeds the covariance with energy: in three revolutions 2 % of a large bound by
    steps of 1 s, 18 % by steps of 10 s.
    """
    half_s = 0.5 * dt_s
    r2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    fall = 1.0 - 0.5 * half_s * half_s * table.mu_m3ps2 / (r2 * math.sqrt(r2))
    for i in range(3):
        out[i] = fall * x[i] + half_s * x[3 + i]


@kernel
def observe_forces(nav, table, model, dt_s, work):
    """What the forces are at the newest epoch, for a step of dt_s: nav.beyond_mps2, nav.drag_mps2, nav.gradient_ps2.

    `beyond` is the acceleration that the small model of the publication lacks: the paper's dA; for the flight filter
    all that its force model has beyond J2. Where a short step has just led here its forces serve: those half a step
    ago displace what is published by less than a micrometre.
    """
    x = nav.x
    if table.filter_model != flight_model.FLIGHT:
        gravity.gradient(table, x[0:3], nav.pole, nav.gradient_ps2)
        for i in range(3):
            nav.beyond_mps2[i] = x[6 + i]
            nav.drag_mps2[i] = 0.0
        return
    middle = work.three
    middle_of_step(table, x, dt_s, middle)
    if not _forces_at_epoch(nav, table, model, work):
        gravity.gradient(table, middle, nav.pole, nav.gradient_ps2)
        return
    if model.forces.area_to_mass_m2pkg == 0.0:
        for i in range(3):
            nav.drag_mps2[i] = 0.0
    if model.forces.gradient_degree > 2:
        force_model.gradient(model.field, middle, model.scratch, nav.gradient_ps2)
    else:
        gravity.gradient(table, middle, nav.pole, nav.gradient_ps2)


@kernel
def _forces_at_epoch(nav, table, model, work):
    """nav.beyond_mps2 and nav.drag_mps2 of the flight filter; False, and both zero, where the forces have ended."""
    x = nav.x
    if work.split == 1:
        work.split = 0
        for i in range(3):
            nav.beyond_mps2[i] = work.split_beyond_mps2[i]
            nav.drag_mps2[i] = work.split_drag_mps2[i]
        return True
    ok = force_model.acceleration(
        model.forces,
        model.field,
        model.eop,
        nav.t_gps_ns,
        x[0:3],
        x[3:6],
        1.0 + x[9] + x[10],
        x[6:9],
        model.scratch,
        nav.beyond_mps2,
    )
    gravity.acceleration(table, x[0:3], nav.pole, work.small_mps2)
    for i in range(3):
        nav.beyond_mps2[i] = nav.beyond_mps2[i] - work.small_mps2[i] if ok else 0.0
        nav.drag_mps2[i] = model.scratch.drag_mps2[i] if ok else 0.0
    return ok
