"""One fix: into GCRF, gate, update or rejection, one innovation record whether it is used or not."""

from __future__ import annotations

import math

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import RejectCause
from flightsw.integrity import failure_flag
from flightsw.kernels import frames
from flightsw.kernels.registry import kernel
from flightsw.nav import chain, stored_acceleration
from flightsw.nav.candidate import offer
from flightsw.nav.filter import correct, innovate, is_sound
from flightsw.records import MEASUREMENTS

_GATE = int(RejectCause.GATE)
_TIME_STALE = int(RejectCause.TIME_STALE)
_EARTH_ORIENTATION = int(RejectCause.EARTH_ORIENTATION)
_SINGULAR = int(RejectCause.SINGULAR)
_REINITIALISED = 1 << int(AlertId.REINITIALISED)
_INITIALISED = 1 << int(AlertId.INITIALISED)
_DIVERGED = 1 << int(AlertId.DIVERGED)
_FLAG_CLEARED = 1 << int(AlertId.FLAG_CLEARED)

USED = -1


@kernel
def row_for(table, inp):
    """Tuning row for the position sigma that a fix claims: the first that serves it, else the last."""
    sigma_m = max(inp.fix_sigma_r_m[0], max(inp.fix_sigma_r_m[1], inp.fix_sigma_r_m[2]))
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
        if offer(nav, table, t_gps_ns, sigma_r_m, sigma_v_mps, work) >= table.init_fixes:
            chain.start(nav, table, model, t_gps_ns, row, sigma_r_m, sigma_v_mps, work)
            out.events |= _INITIALISED
        return USED

    if not chain.predict_to(nav, table, model, t_gps_ns, work):
        return _TIME_STALE
    if not innovate(table, work.x, work.P, work, out):
        nav.initialised = 0
        _declare_unreliable(nav, out, _DIVERGED)
        return _SINGULAR
    if not (out.nis <= table.gate_nis):
        nav.streak = 0
        if offer(nav, table, t_gps_ns, sigma_r_m, sigma_v_mps, work) >= table.reinit_fixes:
            _declare_unreliable(nav, out, _REINITIALISED)
            chain.start(nav, table, model, t_gps_ns, row, sigma_r_m, sigma_v_mps, work)
        return _GATE

    correct(work.x, work.P, work, out)
    if not is_sound(table, work.x, work.P):
        nav.initialised = 0
        _declare_unreliable(nav, out, _DIVERGED)
        return _SINGULAR
    nav.fixes_accepted += 1
    nav.streak += 1
    nav.candidate_count = 0
    nis_per_dof = out.nis / MEASUREMENTS
    nav.mean_nis += (nis_per_dof - nav.mean_nis) / min(nav.streak, table.clear_fixes)
    chain.commit(nav, table, model, t_gps_ns, row, work)
    if table.stored_da_use and nav.streak >= table.stored_da_after_fixes:
        stored_acceleration.store(nav, table, nav.x, t_gps_ns, work)
    bound_m = failure_flag.driving(table, nav.bound_own_m, nav.bound_own_3d_m)
    if math.isfinite(bound_m) and failure_flag.clear_if_recovered(nav, table, bound_m):
        out.events |= _FLAG_CLEARED
    return USED
