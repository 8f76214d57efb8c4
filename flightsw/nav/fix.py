"""One fix: into GCRF, gate, update or rejection, one innovation record whether it is used or not."""

from __future__ import annotations

import math

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import MeasurementType, RejectCause
from flightsw.integrity import envelope, failure_flag
from flightsw.kernels import frames
from flightsw.kernels.registry import kernel
from flightsw.nav import antenna, chain, flight_filter, flight_model, stored_acceleration
from flightsw.nav.candidate import offer, offer_position
from flightsw.nav.filter import correct, innovate, is_sound
from flightsw.records import MEASUREMENTS, TYPES

_GATE = int(RejectCause.GATE)
_TIME_STALE = int(RejectCause.TIME_STALE)
_EARTH_ORIENTATION = int(RejectCause.EARTH_ORIENTATION)
_SINGULAR = int(RejectCause.SINGULAR)
_OPERATOR = int(RejectCause.OPERATOR)
_VELOCITY = int(MeasurementType.VELOCITY)
_STARTING = int(RejectCause.STARTING)
_REINITIALISED = 1 << int(AlertId.REINITIALISED)
_INITIALISED = 1 << int(AlertId.INITIALISED)
_DIVERGED = 1 << int(AlertId.DIVERGED)
_FLAG_CLEARED = 1 << int(AlertId.FLAG_CLEARED)

USED = -1


@kernel
def _largest(sigma):
    return max(sigma[0], max(sigma[1], sigma[2]))


@kernel
def row_for(table, inp):
    """Tuning row for the position sigma that a fix claims: the first that serves it, else the last."""
    sigma_m = _largest(inp.fix_sigma_r_m)
    for row in range(table.tuning_rows):
        if sigma_m <= table.tuning_sigma_fix_m[row]:
            return row
    return table.tuning_rows - 1


@kernel
def to_gcrf(table, eop, row, inp, work):
    """The fix as measurement: work.z [m, m/s, GCRF] and its covariance work.R; False outside the EOP table.

    A sigma is the receiver's, but never below the floor of the tuning row.
    """
    m = work.itrf_from_gcrf
    dm = work.itrf_from_gcrf_rate
    if not frames.itrf_from_gcrf(eop, inp.fix_gps_ns, work, m, dm):
        return False
    z = work.z
    for i in range(3):
        z[i] = 0.0
        for j in range(3):
            z[i] += m[j, i] * inp.fix_r_itrf_m[j]
    for i in range(3):
        z[3 + i] = 0.0
        for j in range(3):
            turned = dm[j, 0] * z[0] + dm[j, 1] * z[1] + dm[j, 2] * z[2]
            z[3 + i] += m[j, i] * (inp.fix_v_itrf_mps[j] - turned)
    work.R[:, :] = 0.0
    for k in range(3):
        var_r = max(inp.fix_sigma_r_m[k], table.tuning_sigma_r_floor_m[row]) ** 2
        var_v = max(inp.fix_sigma_v_mps[k], table.tuning_sigma_v_floor_mps[row]) ** 2
        for i in range(3):
            for j in range(3):
                work.R[i, j] += m[k, i] * m[k, j] * var_r
                work.R[3 + i, 3 + j] += m[k, i] * m[k, j] * var_v
    return True


@kernel
def _declare_unreliable(nav, out, event):
    """The state was wrong and is replaced or given up: the flag stays up until fixes have proven the new one."""
    out.events |= event
    if nav.flag != failure_flag.RAISED:
        nav.flag = failure_flag.RAISED
        nav.flag_age_s = (nav.t_seen_gps_ns - nav.t_fix_gps_ns) * 1e-9


@kernel
def _correct_whole(nav, table, inp, work, out):
    """The paper's update: position and velocity as one measurement. Returns its cause."""
    cause = USED
    if not innovate(table, work.x, work.P, work, out):
        cause = _SINGULAR
    elif not (out.nis <= table.gate_nis):
        cause = _GATE
    else:
        correct(work.x, work.P, work, out)
    for kind in range(TYPES):
        out.type_gate[kind] = table.gate_nis
        out.type_cause[kind] = cause
    return cause


@kernel
def _is_sound(table, work):
    if table.filter_model == flight_model.FLIGHT:
        return flight_filter.is_sound(table, work.x, work.UD)
    return is_sound(table, work.x, work.P)


@kernel
def _offer(nav, table, inp, sigma_r_m, sigma_v_mps, wanted, work):
    """Whether this fix completes a row that agrees, from which a state may start; the state is then in work.z."""
    if inp.fix_has_velocity:
        return offer(nav, table, inp.fix_gps_ns, sigma_r_m, sigma_v_mps, work) >= wanted
    return offer_position(nav, table, inp.fix_gps_ns, sigma_r_m, work)


@kernel
def _start(nav, table, model, row, inp, sigma_r_m, sigma_v_mps, work):
    arc_s = 0.0
    if not inp.fix_has_velocity:
        arc_s = table.position_arc_s
        sigma_v_mps = math.sqrt(2.0) * sigma_r_m / arc_s
    chain.start(nav, table, model, inp.fix_gps_ns, row, sigma_r_m, sigma_v_mps, arc_s, work)


@kernel
def process(nav, table, model, inp, work, out):
    """Take a fix that passed its checks. Returns USED or the RejectCause; a rejected fix changes no state."""
    row = row_for(table, inp)
    if not to_gcrf(table, model.eop, row, inp, work):
        return _EARTH_ORIENTATION
    t_gps_ns = inp.fix_gps_ns
    nav.t_seen_gps_ns = t_gps_ns
    sigma_r_m = 0.0
    sigma_v_mps = 0.0
    for i in range(3):
        sigma_r_m = max(sigma_r_m, max(inp.fix_sigma_r_m[i], table.tuning_sigma_r_floor_m[row]))
        sigma_v_mps = max(sigma_v_mps, max(inp.fix_sigma_v_mps[i], table.tuning_sigma_v_floor_mps[row]))

    if not nav.initialised:
        frames.pole_gcrf(model.eop, t_gps_ns, work, nav.pole)
        if _offer(nav, table, inp, sigma_r_m, sigma_v_mps, table.init_fixes, work):
            if table.filter_model == flight_model.FLIGHT:
                antenna.to_centre_of_mass(nav, table, t_gps_ns, work.z, work)
            _start(nav, table, model, row, inp, sigma_r_m, sigma_v_mps, work)
            out.events |= _INITIALISED
        return USED

    if not chain.predict_to(nav, table, model, t_gps_ns, work):
        return _TIME_STALE
    flying = table.filter_model == flight_model.FLIGHT
    if flying:
        cause = flight_filter.correct(nav, table, row, inp, work, out)
    else:
        cause = _correct_whole(nav, table, inp, work, out)
    if cause == _SINGULAR or not _is_sound(table, work):
        nav.initialised = 0
        _declare_unreliable(nav, out, _DIVERGED)
        return _SINGULAR
    if cause != USED:
        velocity_alone = cause == _OPERATOR and out.type_cause[_VELOCITY] == USED
        if velocity_alone or out.events & flight_filter.ACTED:
            chain.commit_aside(nav, table, model, t_gps_ns, work)
        if cause != _STARTING:
            nav.streak = 0
        if cause == _GATE and _offer(nav, table, inp, sigma_r_m, sigma_v_mps, table.reinit_fixes, work):
            _declare_unreliable(nav, out, _REINITIALISED)
            envelope.note_contradiction(nav, table)
            _start(nav, table, model, row, inp, sigma_r_m, sigma_v_mps, work)
        return cause
    nav.fixes_accepted += 1
    nav.streak += 1
    nav.monitor_fixes += 1
    nav.candidate_count = 0
    nav.arc_count = 0
    nis_per_dof = out.nis / (flight_filter.degrees_of_freedom(out) if flying else MEASUREMENTS)
    nav.mean_nis += (nis_per_dof - nav.mean_nis) / min(nav.streak, table.clear_fixes)
    chain.commit(nav, table, model, t_gps_ns, row, work)
    tested = out.type_cause[_VELOCITY] == USED or out.type_cause[_VELOCITY] == _GATE
    envelope.note_fix(
        nav, table, t_gps_ns, _largest(inp.fix_sigma_r_m), _largest(inp.fix_sigma_v_mps) if tested else 0.0
    )
    if table.stored_da_use and nav.streak >= table.stored_da_after_fixes:
        stored_acceleration.store(nav, table, nav.x, t_gps_ns, work)
    bound_m = failure_flag.driving(table, nav.bound_own_m, nav.bound_own_3d_m)
    if math.isfinite(bound_m) and failure_flag.clear_if_recovered(nav, table, bound_m):
        out.events |= _FLAG_CLEARED
    if flying and out.type_cause[_VELOCITY] == _GATE:
        nav.streak = 1  # half a fix refused begins the proof anew; positions go on
    return USED
