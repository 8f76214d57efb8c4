"""When will the flag rise? The bound carried ahead of time, as it will grow without fixes, until it crosses the limit.

While fixes come the answer is what would happen if GNSS were lost now. A prediction runs through many ticks, a bounded
number of steps in each; its result stays, with its age, until the next one is complete. The bound oscillates twice a
revolution, so it is the first crossing that counts, not an extrapolation.

The motion ahead is that of the table's filter. The flight filter takes gravity to a low degree there and steps of ten
seconds: what that changes in the covariance is far below what the flag can tell.
"""

from __future__ import annotations

import math

from flightsw.icd.enums import FlagState, Governing
from flightsw.integrity import envelope
from flightsw.integrity.autonomous import predict_bound_covariance
from flightsw.integrity.bound import axis_bound_m, radius_bound_m
from flightsw.integrity.failure_flag import driving
from flightsw.kernels import gravity, linalg
from flightsw.kernels.registry import I8, entry, frozen_records, kernel, records
from flightsw.nav import clock, dynamics, flight_filter, flight_model, manoeuvre
from flightsw.nav.dynamics import Model
from flightsw.nav.filter import transition
from flightsw.records import AHEAD, FIELD, FORCE_TABLE, FORCE_WORK, NAV, ORIENTATION, TABLE, WORK

_RAISED = int(FlagState.RAISED)
_BOUND = int(Governing.BOUND)
_EARTH_ORIENTATION = int(Governing.EARTH_ORIENTATION)
_CERTIFIED_AGE = int(Governing.CERTIFIED_AGE)
_HORIZON = int(Governing.HORIZON)
_NOT_READY = int(Governing.NOT_READY)
_FLAG = int(Governing.FLAG)


@kernel
def _begin(nav, table, ahead, t_now_gps_ns):
    """Start a prediction from the newest epoch."""
    ahead.running = 1
    ahead.started_gps_ns = t_now_gps_ns
    ahead.t_gps_ns = nav.t_gps_ns
    linalg.copy_vector(nav.x, ahead.x)
    if table.filter_model == flight_model.FLIGHT:
        linalg.copy_matrix(nav.UD, ahead.UD)
    else:
        linalg.copy_matrix(nav.P_bound, ahead.P)
    ahead.bound_m = math.nan
    linalg.copy_vector(nav.drag_mps2, ahead.drag_mps2)


@kernel
def _finish(ahead, t_flag_gps_ns, governing):
    ahead.running = 0
    ahead.valid = 1
    ahead.t_flag_gps_ns = t_flag_gps_ns
    ahead.governing = governing
    ahead.t_result_gps_ns = ahead.started_gps_ns


@kernel
def _step_flight(nav, table, model, ahead, dt_ns, work):
    """One step of mean and factors; the bound at its end, or NaN where the force model has ended."""
    dt_s = dt_ns * 1e-9
    dynamics.middle_of_step(table, ahead.x, dt_s, work.three)
    gravity.gradient(table, work.three, nav.pole, work.gradient)
    flight_model.set_transition(table, ahead.x, dt_s, ahead.drag_mps2, work.gradient, work)
    flight_model.predict(nav, table, ahead.t_gps_ns, ahead.UD, dt_s, ahead.drag_mps2, work, ahead.UD)
    if not dynamics.advance(nav, table, model, ahead.t_gps_ns, ahead.x, dt_ns, nav.pole, work):
        return math.nan
    for i in range(3):
        ahead.drag_mps2[i] = model.scratch.drag_mps2[i] if model.forces.area_to_mass_m2pkg > 0.0 else 0.0
    t_gps_ns = ahead.t_gps_ns + dt_ns
    variance_s2 = clock.phase_variance_s2(nav, table, t_gps_ns)
    flight_filter.published_covariance(nav, table, t_gps_ns, ahead.UD, ahead.x, variance_s2, work)
    return driving(table, axis_bound_m(table, work.P_rv), radius_bound_m(table, work.P_rv))


@kernel
def _step_paper(nav, table, model, ahead, dt_ns, work):
    """One step of the paper's mean and of (17)."""
    dt_s = dt_ns * 1e-9
    gravity.gradient(table, ahead.x[0:3], nav.pole, work.gradient)
    transition(table, dt_s, work.gradient, work)
    if not predict_bound_covariance(table, nav.row, ahead.P, work, ahead.P):
        return math.nan
    if manoeuvre.is_active(nav, ahead.t_gps_ns, dt_s):
        manoeuvre.add_noise(nav, ahead.t_gps_ns, dt_s, ahead.P)
    dynamics.advance(nav, table, model, ahead.t_gps_ns, ahead.x, dt_ns, nav.pole, work)
    return driving(table, axis_bound_m(table, ahead.P), radius_bound_m(table, ahead.P))


@kernel
def _go_on(nav, table, model, ahead, work, steps):
    flying = table.filter_model == flight_model.FLIGHT
    dt_ns = table.ahead_step_ns if flying else table.nav_step_ns
    for _ in range(steps):
        if (ahead.t_gps_ns - nav.t_fix_gps_ns) * 1e-9 > table.ahead_horizon_s:
            _finish(ahead, ahead.t_gps_ns, _HORIZON)
            return
        if envelope.outlived(nav, table, ahead.t_gps_ns):
            age_ns = round(table.envelope_certified_age_s * 1e9)
            _finish(ahead, nav.t_fix_gps_ns + age_ns, _CERTIFIED_AGE)
            return
        if flying:
            bound_m = _step_flight(nav, table, model, ahead, dt_ns, work)
        else:
            bound_m = _step_paper(nav, table, model, ahead, dt_ns, work)
        if not math.isfinite(bound_m):
            _finish(ahead, ahead.t_gps_ns, _EARTH_ORIENTATION)
            return
        if bound_m > table.limit_m:
            share = 0.0
            if ahead.bound_m < table.limit_m:
                share = (table.limit_m - ahead.bound_m) / (bound_m - ahead.bound_m)
            _finish(ahead, ahead.t_gps_ns + round(share * dt_ns), _BOUND)
            return
        ahead.bound_m = bound_m
        ahead.t_gps_ns += dt_ns


@entry(
    records(NAV),
    frozen_records(TABLE),
    frozen_records(ORIENTATION),
    frozen_records(FORCE_TABLE),
    frozen_records(FIELD),
    records(WORK),
    records(FORCE_WORK),
    records(AHEAD),
    I8,
    I8,
)
def look_ahead(
    nav_record,
    table_record,
    orientation_record,
    forces_record,
    field_record,
    work_record,
    scratch_record,
    ahead_record,
    counter_now_ns,
    steps,
):
    """At most so many steps of a prediction. Arrays of one record each; the gravity field is one of low degree.

    Changes nothing but the record AHEAD and scratch. A prediction is begun when the last one is older than the table's
    refresh time, or does not hold any more: a fix has come after one made in an outage, or GNSS has been lost since.
    """
    nav = nav_record[0]
    table = table_record[0]
    ahead = ahead_record[0]
    if table.ahead_refresh_s == 0.0:
        ahead.valid = 0
        return
    if not nav.initialised or not nav.clock_valid or nav.fixes_accepted == 0:
        ahead.valid = 0
        ahead.running = 0
        ahead.governing = _NOT_READY
        return
    if nav.flag == _RAISED:
        ahead.running = 0
        ahead.valid = 1
        ahead.governing = _FLAG
        ahead.t_flag_gps_ns = nav.t_gps_ns
        ahead.t_result_gps_ns = nav.t_gps_ns
        return
    if ahead.governing == _FLAG:
        ahead.valid = 0
    now_gps_ns = clock.gps_at(nav, counter_now_ns)
    work = work_record[0]
    model = Model(orientation_record[0], forces_record[0], field_record[0], scratch_record[0])
    if not ahead.running:
        age_s = (now_gps_ns - ahead.t_result_gps_ns) * 1e-9
        if ahead.valid and age_s < table.ahead_refresh_s:
            return
        _begin(nav, table, ahead, now_gps_ns)
    _go_on(nav, table, model, ahead, work, steps)
