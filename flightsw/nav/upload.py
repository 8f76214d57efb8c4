"""A state from the ground: checked, carried to now, and taken as a start or, where there is a state, as a correction.

It is a measurement of position and velocity with a covariance of its own. It proves nothing about GNSS: the age of the
last fix runs on, and what was certified holds again only after fixes. Carried through the same forces as the state it
is held against, it shares their errors; over the minutes that an upload may be old these are small beside its own.
"""

from __future__ import annotations

import math

from flightsw.icd.enums import RejectCause, StateFrame
from flightsw.kernels import frames, gravity, udu
from flightsw.kernels.linalg import cholesky, solve_lower
from flightsw.kernels.registry import kernel
from flightsw.nav import chain, dynamics, flight_filter, flight_model, monitor
from flightsw.records import MEASUREMENTS

_NOT_FINITE = int(RejectCause.NOT_FINITE)
_OUT_OF_RANGE = int(RejectCause.OUT_OF_RANGE)
_SIGMA = int(RejectCause.SIGMA)
_TIME_STALE = int(RejectCause.TIME_STALE)
_TIME_FUTURE = int(RejectCause.TIME_FUTURE)
_GATE = int(RejectCause.GATE)
_EARTH_ORIENTATION = int(RejectCause.EARTH_ORIENTATION)
_SINGULAR = int(RejectCause.SINGULAR)
_UPLOAD_INVALID = int(RejectCause.UPLOAD_INVALID)
_GCRF = int(StateFrame.GCRF)
_ITRF = int(StateFrame.ITRF)

USED = -1
_LONGEST_NS = 86_400_000_000_000  # beyond it differences of times are not even formed


@kernel
def _check(table, inp, work):
    """USED, or why it cannot be taken: finite, in orbit, a covariance, of a quality that fixes may have too."""
    r2 = 0.0
    v2 = 0.0
    for i in range(3):
        r2 += inp.upload_x[i] * inp.upload_x[i]
        v2 += inp.upload_x[3 + i] * inp.upload_x[3 + i]
    p = inp.upload_covariance
    for i in range(MEASUREMENTS):
        if not math.isfinite(inp.upload_x[i]):
            return _NOT_FINITE
        for j in range(MEASUREMENTS):
            if not math.isfinite(p[i, j]):
                return _NOT_FINITE
    if r2 < table.radius_min_m**2 or r2 > table.radius_max_m**2 or v2 > table.speed_max_mps**2:
        return _OUT_OF_RANGE
    for i in range(3):
        if not (p[i, i] > 0.0 and p[3 + i, 3 + i] > 0.0):
            return _SIGMA
        if p[i, i] > table.sigma_r_max_m**2 or p[3 + i, 3 + i] > table.sigma_v_max_mps**2:
            return _SIGMA
    # of correlations, so that metres and metres per second count alike
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            work.innovation_p[i, j] = p[i, j] / math.sqrt(p[i, i] * p[j, j])
            if abs(p[i, j] - p[j, i]) > 1e-6 * math.sqrt(p[i, i] * p[j, j]):
                return _UPLOAD_INVALID
    if not cholesky(work.innovation_p, work.lower):
        return _UPLOAD_INVALID
    return USED


@kernel
def _to_gcrf(eop, inp, work):
    """State and covariance into work.z and work.R in GCRF; False outside the Earth-orientation table."""
    p = inp.upload_covariance
    if inp.upload_frame == _GCRF:
        for i in range(MEASUREMENTS):
            work.z[i] = inp.upload_x[i]
            for j in range(MEASUREMENTS):
                work.R[i, j] = 0.5 * (p[i, j] + p[j, i])
        return True
    m = work.itrf_from_gcrf
    dm = work.itrf_from_gcrf_rate
    if not frames.itrf_from_gcrf(eop, inp.upload_gps_ns, work, m, dm):
        return False
    # (r, v) in GCRF = J (r, v) in ITRF: r = M' ri, v = M' (vi - dM r)
    jacobian = work.innovation_p
    for i in range(3):
        for j in range(3):
            jacobian[i, j] = m[j, i]
            jacobian[i, 3 + j] = 0.0
            jacobian[3 + i, 3 + j] = m[j, i]
            total = 0.0
            for k in range(3):
                for q in range(3):
                    total -= m[k, i] * dm[k, q] * m[j, q]
            jacobian[3 + i, j] = total
    half = work.R_pseudo
    for i in range(MEASUREMENTS):
        work.z[i] = 0.0
        for j in range(MEASUREMENTS):
            work.z[i] += jacobian[i, j] * inp.upload_x[j]
            total = 0.0
            for k in range(MEASUREMENTS):
                total += jacobian[i, k] * 0.5 * (p[k, j] + p[j, k])
            half[i, j] = total
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            total = 0.0
            for k in range(MEASUREMENTS):
                total += half[i, k] * jacobian[j, k]
            work.R[i, j] = total
    return True


@kernel
def _load(nav, table, work):
    """work.z and work.R as a whole state into work.x and work.UD, all else as at a start; False: no covariance."""
    n = flight_model.states(table)
    work.x[:] = 0.0
    for i in range(MEASUREMENTS):
        work.x[i] = work.z[i]
    if nav.initialised:  # the best that is known of drag
        work.x[9] = nav.x[9]
        work.x[10] = nav.x[10]
    p = work.P_start
    p[:, :] = 0.0
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            p[i, j] = work.R[i, j]
    for i in range(3):
        p[6 + i, 6 + i] = flight_model.empirical_sigma_mps2(table, work.x) ** 2
    p[9, 9] = table.drag_sigma**2
    p[10, 10] = table.drag_slow_sigma**2
    for i in range(11, n):
        p[i, i] = (table.gnss_bias_sigma_m if i < 14 else table.gnss_periodic_sigma_m) ** 2
    return udu.factorise(p, n, work.UD)


@kernel
def _carry(nav, table, model, t_from_ns, t_to_ns, work):
    """work.x and work.UD from the one time to the other; False where Earth orientation ends."""
    step_ns = max(table.coast_step_ns, table.nav_step_ns)
    t_ns = t_from_ns
    while t_ns < t_to_ns:
        dt_ns = min(step_ns, t_to_ns - t_ns)
        dt_s = dt_ns * 1e-9
        dynamics.middle_of_step(table, work.x, dt_s, work.three)
        gravity.gradient(table, work.three, nav.pole, work.gradient)
        flight_model.set_transition(table, work.x, dt_s, nav.drag_mps2, work.gradient, work)
        flight_model.predict(nav, table, t_ns, work.UD, dt_s, nav.drag_mps2, work, work.UD)
        if not dynamics.advance(nav, table, model, t_ns, work.x, dt_ns, nav.pole, work):
            return False
        t_ns += dt_ns
    return True


@kernel
def _correct(table, work):
    """Update of work.x and work.UD by the state in work.z with covariance work.R, six scalars that are independent.

    With R = U D U' the rows of U^-1 make them so. work.column holds the innovation.
    """
    n = flight_model.states(table)
    factors = work.R_pseudo
    udu.factorise(work.R, MEASUREMENTS, factors)
    rows = work.innovation_p  # U^-1
    for c in range(MEASUREMENTS):
        for i in range(MEASUREMENTS - 1, -1, -1):
            total = 1.0 if i == c else 0.0
            for j in range(i + 1, MEASUREMENTS):
                total -= factors[i, j] * rows[j, c]
            rows[i, c] = total
    dx = work.correction
    dx[:] = 0.0
    h = work.H[0]
    for i in range(MEASUREMENTS):
        h[:] = 0.0
        rest = 0.0
        for j in range(i, MEASUREMENTS):
            h[j] = rows[i, j]
            rest += rows[i, j] * (work.column[j] - dx[j])
        udu.correct(work.UD, n, h, factors[i, i], work.f[0], work.gain_one)
        for j in range(n):
            dx[j] += work.gain_one[j] * rest
    for j in range(n):
        work.x[j] += dx[j]


@kernel
def _hold_against(nav, table, work, out):
    """USED where the state in work.x, work.UD and that in work.z, work.R agree, and are one now; else the cause."""
    p = work.P_rv
    udu.covariance(work.UD, flight_model.states(table), MEASUREMENTS, p)
    s = work.innovation_p
    for i in range(MEASUREMENTS):
        work.column[i] = work.z[i] - work.x[i]
        for j in range(MEASUREMENTS):
            s[i, j] = p[i, j] + work.R[i, j]
    if not cholesky(s, work.lower):
        return _SINGULAR
    whitened = work.gain_one[0:MEASUREMENTS]
    solve_lower(work.lower, work.column, whitened)
    nis = 0.0
    for i in range(MEASUREMENTS):
        nis += whitened[i] ** 2
    out.upload_nis = nis
    if not (nis <= table.gate_nis):
        return _GATE
    _correct(table, work)
    return USED if flight_filter.is_sound(table, work.x, work.UD) else _SINGULAR


@kernel
def take(nav, table, model, inp, t_now_ns, work, out):
    """USED or the RejectCause, which changes no state. The clock must be valid; t_now_ns: onboard time now."""
    if table.filter_model != flight_model.FLIGHT or (inp.upload_frame != _GCRF and inp.upload_frame != _ITRF):
        return _UPLOAD_INVALID
    if inp.upload_gps_ns > t_now_ns:
        return _TIME_FUTURE
    if inp.upload_gps_ns < t_now_ns - _LONGEST_NS:
        return _TIME_STALE
    step_ns = max(table.coast_step_ns, table.nav_step_ns)
    if t_now_ns - inp.upload_gps_ns > chain.CATCH_UP * step_ns:
        return _TIME_STALE
    if nav.initialised and t_now_ns - nav.t_gps_ns > chain.CATCH_UP * table.nav_step_ns:
        return _TIME_STALE  # the state itself has to catch up first
    cause = _check(table, inp, work)
    if cause != USED:
        return cause
    if not _to_gcrf(model.eop, inp, work):
        return _EARTH_ORIENTATION
    if not nav.initialised:
        frames.pole_gcrf(model.eop, inp.upload_gps_ns, work, nav.pole)
        nav.drag_mps2[:] = 0.0
    t_ns = t_now_ns
    if nav.initialised:
        t_ns = max(inp.upload_gps_ns, nav.t_gps_ns)
    if not _load(nav, table, work):
        return _UPLOAD_INVALID
    if not _carry(nav, table, model, inp.upload_gps_ns, t_ns, work):
        return _EARTH_ORIENTATION
    if not flight_filter.is_sound(table, work.x, work.UD):
        return _OUT_OF_RANGE
    out.upload_nis = math.nan
    if not nav.initialised:
        # as of a fix that is too old to be one: what is known begins without GNSS
        t_fix_ns = min(inp.upload_gps_ns, t_now_ns - round((table.autonomous_after_s + 1.0) * 1e9))
        chain.start_aside(nav, table, model, t_ns, t_fix_ns, work)
        return USED
    for i in range(MEASUREMENTS):
        work.z[i] = work.x[i]
    udu.covariance(work.UD, flight_model.states(table), MEASUREMENTS, work.R)
    if not chain.predict_to(nav, table, model, t_ns, work):
        return _TIME_STALE
    cause = _hold_against(nav, table, work, out)
    if cause == USED:
        monitor.forget(nav)
        nav.bound_fix_m[:] = 0.0  # of a state that is no more
        chain.commit_aside(nav, table, model, t_ns, work)
        nav.t_start_gps_ns = t_ns  # what was proven before says nothing of it
    return cause
