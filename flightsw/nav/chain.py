"""The grid of epochs that the filter lives on: start, step ahead, look ahead, go back for a late fix."""

from __future__ import annotations

import math

from flightsw.icd.enums import DaSource
from flightsw.integrity import failure_flag
from flightsw.integrity.autonomous import predict_bound_covariance
from flightsw.integrity.bound import axis_bound_m, radius_bound_m
from flightsw.kernels import frames
from flightsw.kernels.registry import kernel
from flightsw.nav import dynamics, flight_model, stored_acceleration
from flightsw.nav.filter import predict_covariance, transition
from flightsw.records import HISTORY, STATES

FILTER = int(DaSource.FILTER)
STORED = int(DaSource.STORED)
HELD = int(DaSource.HELD)


@kernel
def is_overdue(nav, table, t_gps_ns):
    """Whether the next fix should have come by this time: from here on the bound follows (17)."""
    return (t_gps_ns - nav.t_fix_gps_ns) * 1e-9 > table.overdue_s


@kernel
def _larger(a, b):
    """The larger of two bounds; NaN where either is, which `max` would drop."""
    return a if a >= b or math.isnan(a) else b


@kernel
def look_ahead(nav, table, work):
    """Covariances one step ahead, and from both ends of the interval its bounds."""
    transition(table, nav.x, table.nav_step_ns * 1e-9, nav.pole, work)
    predict_covariance(table, nav.row, 1.0, nav.P, work, nav.P_ahead)
    nav.bound_own_m = _larger(axis_bound_m(table, nav.P), axis_bound_m(table, nav.P_ahead))
    nav.bound_own_3d_m = _larger(radius_bound_m(table, nav.P), radius_bound_m(table, nav.P_ahead))
    if predict_bound_covariance(table, nav.row, nav.P_bound, work, nav.P_bound_ahead):
        nav.bound_coast_m = _larger(axis_bound_m(table, nav.P_bound), axis_bound_m(table, nav.P_bound_ahead))
        nav.bound_coast_3d_m = _larger(radius_bound_m(table, nav.P_bound), radius_bound_m(table, nav.P_bound_ahead))
    else:
        nav.bound_coast_m = math.nan
        nav.bound_coast_3d_m = math.nan


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
    if is_overdue(nav, table, nav.t_gps_ns + table.nav_step_ns):
        bound_m = failure_flag.driving(table, nav.bound_coast_m, nav.bound_coast_3d_m)
    else:
        bound_m = failure_flag.driving(table, nav.bound_own_m, nav.bound_own_3d_m)
    failure_flag.evaluate(nav, table, bound_m, (nav.t_gps_ns - nav.t_fix_gps_ns) * 1e-9)


@kernel
def settle(nav, table, model, work):
    """What follows once the newest epoch is in place: pole, bounds, flag."""
    frames.pole_gcrf(model.eop, nav.t_gps_ns, work, nav.pole)
    dynamics.beyond_publication(table, model, nav.t_gps_ns, nav.x, nav.pole, work, nav.beyond_mps2)
    look_ahead(nav, table, work)
    if nav.unmodelled:
        _withhold(nav)
    _judge(nav, table)


@kernel
def start(nav, table, model, t_gps_ns, row, sigma_r_m, sigma_v_mps, work):
    """State and covariance from the fix in work.z: the paper's start, dA = 0."""
    nav.initialised = 1
    nav.t_gps_ns = t_gps_ns
    nav.t_fix_gps_ns = t_gps_ns
    nav.t_evaluated_gps_ns = min(nav.t_evaluated_gps_ns, t_gps_ns - 1)
    nav.P[:, :] = 0.0
    for i in range(3):
        nav.x[i] = work.z[i]
        nav.x[3 + i] = work.z[3 + i]
        nav.x[6 + i] = 0.0
        nav.P[i, i] = sigma_r_m * sigma_r_m
        nav.P[3 + i, 3 + i] = sigma_v_mps * sigma_v_mps
        nav.P[6 + i, 6 + i] = (table.da_max_mps2 / 3.0) ** 2
    if table.filter_model == flight_model.FLIGHT:
        for state in range(6, 9):
            nav.P[state, state] = table.empirical_sigma_mps2**2
    nav.P_bound[:, :] = nav.P
    nav.unmodelled = 0
    nav.history_count = 0
    nav.streak = 0
    nav.mean_nis = 0.0
    nav.candidate_count = 0
    nav.da_source = FILTER
    nav.row = row
    settle(nav, table, model, work)


@kernel
def _remember(nav):
    """Keep the newest epoch in the ring; the oldest one falls out of a full ring."""
    if nav.history_count == HISTORY:
        nav.history_first = (nav.history_first + 1) % HISTORY
        nav.history_count -= 1
    k = (nav.history_first + nav.history_count) % HISTORY
    nav.history_t_gps_ns[k] = nav.t_gps_ns
    nav.history_x[k, :] = nav.x
    nav.history_P[k, :, :] = nav.P
    nav.history_count += 1


@kernel
def advance(nav, table, model, work):
    """One step of the grid without a fix: the mean by the model, the two covariances each by its own rule."""
    _remember(nav)
    if not dynamics.advance(table, model, nav.t_gps_ns, nav.x, table.nav_step_ns, nav.pole, work):
        nav.unmodelled = 1
    nav.P[:, :] = nav.P_ahead
    nav.P_bound[:, :] = nav.P_bound_ahead
    nav.t_gps_ns += table.nav_step_ns
    if is_overdue(nav, table, nav.t_gps_ns) and table.stored_da_use:
        if stored_acceleration.recall(nav, table, nav.x, nav.t_gps_ns, work):
            nav.da_source = STORED
        else:
            nav.da_source = HELD
    settle(nav, table, model, work)


@kernel
def predict_to(nav, table, model, t_gps_ns, work):
    """State and covariance predicted to the time of a fix, into work.x and work.P; the chain is not touched.

    Starts from the newest epoch that is not later than the fix. False where the history does not reach back.
    """
    if t_gps_ns >= nav.t_gps_ns:
        t_ns = nav.t_gps_ns
        work.x[:] = nav.x
        work.P[:, :] = nav.P
    else:
        back = nav.history_count - 1
        while back >= 0 and nav.history_t_gps_ns[(nav.history_first + back) % HISTORY] > t_gps_ns:
            back -= 1
        if back < 0:
            return False
        k = (nav.history_first + back) % HISTORY
        t_ns = nav.history_t_gps_ns[k]
        work.x[:] = nav.history_x[k]
        work.P[:, :] = nav.history_P[k]
    while t_ns < t_gps_ns:
        step_ns = min(table.nav_step_ns, t_gps_ns - t_ns)
        share = step_ns / table.nav_step_ns
        dt_s = step_ns * 1e-9
        transition(table, work.x, dt_s, nav.pole, work)
        predict_covariance(table, nav.row, share, work.P, work, work.P)
        dynamics.advance(table, model, t_ns, work.x, step_ns, nav.pole, work)
        t_ns += step_ns
    return True


@kernel
def commit(nav, table, model, t_gps_ns, row, work):
    """The corrected state in work.x and work.P becomes the newest epoch; both covariances start from it."""
    nav.t_gps_ns = t_gps_ns
    nav.t_fix_gps_ns = t_gps_ns
    for i in range(STATES):
        nav.x[i] = work.x[i]
    nav.P[:, :] = work.P
    nav.P_bound[:, :] = work.P
    nav.unmodelled = 0
    nav.history_count = 0
    nav.da_source = FILTER
    nav.row = row
    settle(nav, table, model, work)
