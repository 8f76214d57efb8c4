"""The grid of epochs that the filter lives on: start, step ahead, look ahead, go back for a late fix."""

from __future__ import annotations

import math

from flightsw.icd.enums import DaSource
from flightsw.integrity import failure_flag
from flightsw.integrity.autonomous import predict_bound_covariance
from flightsw.integrity.bound import axis_bound_m, radius_bound_m
from flightsw.kernels import frames, gravity, linalg
from flightsw.kernels.registry import kernel
from flightsw.nav import (
    clock,
    dynamics,
    flight_filter,
    flight_model,
    flight_start,
    manoeuvre,
    monitor,
    stored_acceleration,
)
from flightsw.nav.filter import predict_covariance, transition
from flightsw.records import HISTORY, MEASUREMENTS

FILTER = int(DaSource.FILTER)
STORED = int(DaSource.STORED)
HELD = int(DaSource.HELD)

# Steps of the grid that one call may take: bounds the work of a tick after a stall. The rest follows in later ticks.
CATCH_UP = 256


@kernel
def is_overdue(nav, table, t_gps_ns):
    """Whether the next fix should have come by this time: from here on the bound follows (17)."""
    return (t_gps_ns - nav.t_fix_gps_ns) * 1e-9 > table.overdue_s


@kernel
def _larger(a, b):
    """The larger of two bounds; NaN where either is, which `max` would drop."""
    return a if a >= b or math.isnan(a) else b


@kernel
def grid_step_ns(nav, table):
    """Length of the next step of the grid: longer in an outage where the table says so, except through a burn."""
    if table.filter_model != flight_model.FLIGHT or table.coast_step_ns <= table.nav_step_ns:
        return table.nav_step_ns
    if (nav.t_gps_ns - nav.t_fix_gps_ns) * 1e-9 <= table.autonomous_after_s:
        return table.nav_step_ns
    if manoeuvre.is_active(nav, nav.t_gps_ns, table.coast_step_ns * 1e-9):
        return table.nav_step_ns
    return table.coast_step_ns


@kernel
def look_ahead(nav, table, work):
    """Covariance one step ahead, and from both ends of the interval its bounds."""
    dt_s = grid_step_ns(nav, table) * 1e-9
    if table.filter_model == flight_model.FLIGHT:
        _look_ahead_flight(nav, table, dt_s, work)
        return
    transition(table, dt_s, nav.gradient_ps2, work)
    predict_covariance(table, nav.row, dt_s * 1e9 / table.nav_step_ns, nav.P, work, nav.P_ahead)
    possible = predict_bound_covariance(table, nav.row, nav.P_bound, work, nav.P_bound_ahead)
    if manoeuvre.is_active(nav, nav.t_gps_ns, dt_s):
        manoeuvre.add_noise(nav, nav.t_gps_ns, dt_s, nav.P_ahead)
        manoeuvre.add_noise(nav, nav.t_gps_ns, dt_s, nav.P_bound_ahead)
    nav.bound_own_m = _larger(axis_bound_m(table, nav.P), axis_bound_m(table, nav.P_ahead))
    nav.bound_own_3d_m = _larger(radius_bound_m(table, nav.P), radius_bound_m(table, nav.P_ahead))
    if possible:
        nav.bound_coast_m = _larger(axis_bound_m(table, nav.P_bound), axis_bound_m(table, nav.P_bound_ahead))
        nav.bound_coast_3d_m = _larger(radius_bound_m(table, nav.P_bound), radius_bound_m(table, nav.P_bound_ahead))
    else:
        nav.bound_coast_m = math.nan
        nav.bound_coast_3d_m = math.nan


@kernel
def _look_ahead_flight(nav, table, dt_s, work):
    """The flight filter has one covariance, with and without fixes: process noise is physical, nothing is updated."""
    flight_model.set_transition(table, nav.x, dt_s, nav.drag_mps2, nav.gradient_ps2, work)
    flight_model.predict(nav, table, nav.t_gps_ns, nav.UD, dt_s, nav.drag_mps2, work, nav.UD_ahead)
    end_gps_ns = nav.t_gps_ns + round(dt_s * 1e9)
    now_s2 = clock.phase_variance_s2(nav, table, nav.t_gps_ns)
    then_s2 = clock.phase_variance_s2(nav, table, end_gps_ns)
    flight_filter.published_covariance(nav, table, end_gps_ns, nav.UD_ahead, nav.x, then_s2, work)
    axis_m = axis_bound_m(table, work.P_rv)
    radius_m = radius_bound_m(table, work.P_rv)
    flight_filter.published_covariance(nav, table, nav.t_gps_ns, nav.UD, nav.x, now_s2, work)
    axis_m = _larger(axis_bound_m(table, work.P_rv), axis_m)
    radius_m = _larger(radius_bound_m(table, work.P_rv), radius_m)
    # Every fix draws the error anew: in a revolution the bound is put to the test far more often than in an outage.
    own_m = table.fixes_margin * axis_m
    own_3d_m = table.fixes_margin * radius_m
    if nav.t_gps_ns == nav.t_fix_gps_ns:
        nav.bound_fix_m[0] = own_m
        nav.bound_fix_m[1] = own_3d_m
    nav.bound_own_m = own_m + nav.monitor_doubt_m
    nav.bound_own_3d_m = own_3d_m + nav.monitor_doubt_m
    nav.bound_coast_m = _larger(axis_m, nav.bound_fix_m[0]) + nav.monitor_doubt_m
    nav.bound_coast_3d_m = _larger(radius_m, nav.bound_fix_m[1]) + nav.monitor_doubt_m
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            nav.covariance[i, j] = work.P_rv[i, j]


@kernel
def _withhold(nav):
    """No bound for a state that a step without its force model has made: the flag says STALE."""
    nav.bound_own_m = math.nan
    nav.bound_own_3d_m = math.nan
    nav.bound_coast_m = math.nan
    nav.bound_coast_3d_m = math.nan


@kernel
def _judge(nav, table):
    """Let the flag see the bound of this interval, once, in the order of time."""
    if nav.t_gps_ns <= nav.t_evaluated_gps_ns:
        return
    nav.t_evaluated_gps_ns = nav.t_gps_ns
    if is_overdue(nav, table, nav.t_gps_ns + grid_step_ns(nav, table)):
        bound_m = failure_flag.driving(table, nav.bound_coast_m, nav.bound_coast_3d_m)
    else:
        bound_m = failure_flag.driving(table, nav.bound_own_m, nav.bound_own_3d_m)
    failure_flag.evaluate(nav, table, bound_m, (nav.t_gps_ns - nav.t_fix_gps_ns) * 1e-9)


@kernel
def settle(nav, table, model, work):
    """What follows once the newest epoch is in place: pole, bounds, flag."""
    frames.pole_gcrf(model.eop, nav.t_gps_ns, work, nav.pole)
    dynamics.observe_forces(nav, table, model, grid_step_ns(nav, table) * 1e-9, work)
    look_ahead(nav, table, work)
    if nav.unmodelled:
        _withhold(nav)
    _judge(nav, table)


@kernel
def start(nav, table, model, t_gps_ns, row, sigma_r_m, sigma_v_mps, arc_s, work):
    """State and covariance from the fix in work.z: the paper's start, dA = 0.

    arc_s: of the positions that the velocity is from; 0 if it was measured.
    """
    nav.x[:] = 0.0
    for i in range(MEASUREMENTS):
        nav.x[i] = work.z[i]
    if table.filter_model == flight_model.FLIGHT:
        flight_start.start(table, nav.x, sigma_r_m, sigma_v_mps, arc_s, work, nav.UD)
    else:
        nav.P[:, :] = 0.0
        for i in range(3):
            nav.P[i, i] = sigma_r_m * sigma_r_m
            nav.P[3 + i, 3 + i] = sigma_v_mps * sigma_v_mps
            nav.P[6 + i, 6 + i] = (table.da_max_mps2 / 3.0) ** 2
        linalg.copy_matrix(nav.P, nav.P_bound)
    _begin(nav, table, model, t_gps_ns, t_gps_ns, row, work)


@kernel
def start_aside(nav, table, model, t_gps_ns, t_fix_gps_ns, work):
    """State and covariance of the flight filter from work.x, work.UD, which no fix has made: its age is given."""
    linalg.copy_vector(work.x, nav.x)
    linalg.copy_matrix(work.UD, nav.UD)
    nav.bound_fix_m[:] = 0.0
    _begin(nav, table, model, t_gps_ns, t_fix_gps_ns, table.tuning_rows - 1, work)


@kernel
def _begin(nav, table, model, t_gps_ns, t_fix_gps_ns, row, work):
    """What a new state forgets of the one before."""
    nav.initialised = 1
    work.split = 0
    nav.t_gps_ns = t_gps_ns
    nav.t_fix_gps_ns = t_fix_gps_ns
    nav.t_start_gps_ns = t_gps_ns
    nav.t_evaluated_gps_ns = min(nav.t_evaluated_gps_ns, t_gps_ns - 1)
    nav.excluded[:] = 0
    nav.start_count = 0
    nav.monitor_fixes = 0
    nav.monitor_pause = 0
    nav.gate_run[:] = 0
    monitor.forget(nav)
    nav.unmodelled = 0
    nav.history_count = 0
    nav.streak = 0
    nav.mean_nis = 0.0
    nav.candidate_count = 0
    nav.da_source = FILTER
    nav.row = row
    settle(nav, table, model, work)


@kernel
def _remember(nav, table):
    """Keep the newest epoch in the ring; the oldest one falls out of a full ring."""
    if nav.history_count == HISTORY:
        nav.history_first = (nav.history_first + 1) % HISTORY
        nav.history_count -= 1
    k = (nav.history_first + nav.history_count) % HISTORY
    nav.history_t_gps_ns[k] = nav.t_gps_ns
    linalg.copy_vector(nav.x, nav.history_x[k])
    if table.filter_model == flight_model.FLIGHT:
        linalg.copy_matrix(nav.UD, nav.history_UD[k])
    else:
        linalg.copy_matrix(nav.P, nav.history_P[k])
    nav.history_count += 1


@kernel
def advance(nav, table, model, work):
    """One step of the grid without a fix: the mean by the model, the two covariances each by its own rule."""
    _remember(nav, table)
    step_ns = grid_step_ns(nav, table)
    if not dynamics.advance(nav, table, model, nav.t_gps_ns, nav.x, step_ns, nav.pole, work):
        nav.unmodelled = 1
    if table.filter_model == flight_model.FLIGHT:
        linalg.copy_matrix(nav.UD_ahead, nav.UD)
    else:
        linalg.copy_matrix(nav.P_ahead, nav.P)
        linalg.copy_matrix(nav.P_bound_ahead, nav.P_bound)
    nav.t_gps_ns += step_ns
    if is_overdue(nav, table, nav.t_gps_ns) and table.stored_da_use:
        if stored_acceleration.recall(nav, table, nav.x, nav.t_gps_ns, work):
            nav.da_source = STORED
        else:
            nav.da_source = HELD
    settle(nav, table, model, work)


@kernel
def catch_up(nav, table, model, slot, work):
    """A burn that had begun when it was announced: bring the newest epoch and all before it up to it."""
    start_gps_ns = nav.burn_start_gps_ns[slot]
    passed_s = (nav.t_gps_ns - start_gps_ns) * 1e-9
    rate_radps = flight_model.orbital_rate_radps(nav.x)
    flight_model.rtn_basis(nav.x, work.burn_rtn)
    flight_model.turn_rtn(work.burn_rtn, -rate_radps * passed_s)  # as it was when the burn began
    if passed_s > 0.0 and table.filter_model != flight_model.FLIGHT:
        manoeuvre.add_noise(nav, start_gps_ns, passed_s, nav.P_bound)
    _catch_up_epoch(nav, table, slot, nav.t_gps_ns, rate_radps, nav.x, nav.P, nav.UD, work)
    for back in range(nav.history_count):
        k = (nav.history_first + back) % HISTORY
        t_gps_ns = nav.history_t_gps_ns[k]
        x = nav.history_x[k]
        _catch_up_epoch(nav, table, slot, t_gps_ns, rate_radps, x, nav.history_P[k], nav.history_UD[k], work)
    work.split = 0
    settle(nav, table, model, work)


@kernel
def _catch_up_epoch(nav, table, slot, t_gps_ns, rate_radps, x, p, ud, work):
    """Add what has passed of the burn to the state and covariance of an epoch; work.burn_rtn is that of its start."""
    start_gps_ns = nav.burn_start_gps_ns[slot]
    passed_s = (t_gps_ns - start_gps_ns) * 1e-9
    if passed_s <= 0.0:
        return
    dr = work.burn_dr_m
    dv = work.burn_dv_mps
    dr[:] = 0.0
    dv[:] = 0.0
    manoeuvre.displacement(nav, slot, start_gps_ns, passed_s, work.burn_rtn, rate_radps, work.three, dr, dv)
    for i in range(3):
        x[i] += dr[i]
        x[3 + i] += dv[i]
    if table.filter_model == flight_model.FLIGHT:
        flight_filter.widen_by_burn(nav, table, slot, passed_s, ud, work)
    else:
        manoeuvre.add_noise(nav, start_gps_ns, passed_s, p)


@kernel
def predict_to(nav, table, model, t_gps_ns, work):
    """State and covariance predicted to the time of a fix, into work.x, work.P or work.UD; the chain is not touched.

    Starts from the newest epoch that is not later than the fix. False where the history does not reach back, or the
    chain has so much to catch up that this call cannot.
    """
    flying = table.filter_model == flight_model.FLIGHT
    work.split = 0
    if t_gps_ns - nav.t_gps_ns > CATCH_UP * table.nav_step_ns:
        return False
    if t_gps_ns >= nav.t_gps_ns:
        t_ns = nav.t_gps_ns
        linalg.copy_vector(nav.x, work.x)
        if flying:
            linalg.copy_matrix(nav.UD, work.UD)
        else:
            linalg.copy_matrix(nav.P, work.P)
    else:
        back = nav.history_count - 1
        while back >= 0 and nav.history_t_gps_ns[(nav.history_first + back) % HISTORY] > t_gps_ns:
            back -= 1
        if back < 0:
            return False
        k = (nav.history_first + back) % HISTORY
        t_ns = nav.history_t_gps_ns[k]
        linalg.copy_vector(nav.history_x[k], work.x)
        if flying:
            linalg.copy_matrix(nav.history_UD[k], work.UD)
        else:
            linalg.copy_matrix(nav.history_P[k], work.P)
    while t_ns < t_gps_ns:
        step_ns = min(table.nav_step_ns, t_gps_ns - t_ns)
        dt_s = step_ns * 1e-9
        if flying:
            flight_model.set_transition(table, work.x, dt_s, nav.drag_mps2, nav.gradient_ps2, work)
            flight_model.predict(nav, table, t_ns, work.UD, dt_s, nav.drag_mps2, work, work.UD)
        else:
            gravity.gradient(table, work.x[0:3], nav.pole, work.gradient)
            transition(table, dt_s, work.gradient, work)
            predict_covariance(table, nav.row, step_ns / table.nav_step_ns, work.P, work, work.P)
            if manoeuvre.is_active(nav, t_ns, dt_s):
                manoeuvre.add_noise(nav, t_ns, dt_s, work.P)
        dynamics.advance(nav, table, model, t_ns, work.x, step_ns, nav.pole, work)
        t_ns += step_ns
    return True


@kernel
def commit_aside(nav, table, model, t_gps_ns, work):
    """As `commit` where no position was used: the state is another, the age of the last fix runs on."""
    work.split = 0
    _commit(nav, table, model, t_gps_ns, nav.t_fix_gps_ns, nav.row, work)


@kernel
def commit(nav, table, model, t_gps_ns, row, work):
    """The corrected state in work.x and work.P or work.UD becomes the newest epoch; all covariances start from it."""
    _commit(nav, table, model, t_gps_ns, t_gps_ns, row, work)


@kernel
def _commit(nav, table, model, t_gps_ns, t_fix_gps_ns, row, work):
    nav.t_gps_ns = t_gps_ns
    nav.t_fix_gps_ns = t_fix_gps_ns  # before the step ahead is looked at: its length depends on it
    linalg.copy_vector(work.x, nav.x)
    if table.filter_model == flight_model.FLIGHT:
        linalg.copy_matrix(work.UD, nav.UD)
    else:
        linalg.copy_matrix(work.P, nav.P)
        linalg.copy_matrix(work.P, nav.P_bound)
    manoeuvre.forget_past(nav, t_gps_ns - manoeuvre.KEPT_NS)
    nav.unmodelled = 0
    nav.history_count = 0
    nav.da_source = FILTER
    nav.row = row
    settle(nav, table, model, work)
