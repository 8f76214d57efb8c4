"""A fix in the flight filter: lever arm, position, velocity, the monitor of slow faults."""

from __future__ import annotations

import math

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import MeasurementType, RejectCause
from flightsw.kernels import udu
from flightsw.kernels.registry import kernel
from flightsw.nav import antenna, flight_model, manoeuvre, measurement, monitor
from flightsw.records import MEASUREMENTS, TYPES

_POSITION = int(MeasurementType.POSITION)
_VELOCITY = int(MeasurementType.VELOCITY)
_STARTING = int(RejectCause.STARTING)
_GATE = int(RejectCause.GATE)
_OPERATOR = int(RejectCause.OPERATOR)
_SLOW_FAULT = 1 << int(AlertId.SLOW_FAULT)
_MANOEUVRE = 1 << int(AlertId.MANOEUVRE_DETECTED)

# sigma of a fault's size by what has been found of it, beside that of the estimate; a manoeuvre found early may be a
# part of what goes on
_OPENING_EARLY = 3.0
_OPENING = 0.4
_EARLY_S = 30.0
_COURSE = 0.3

ACTED = _SLOW_FAULT | _MANOEUVRE  # events that change the state, even where the fix itself was refused
USED = measurement.USED
ABSENT = measurement.ABSENT


@kernel
def widen(table, ud, c, position, velocity, variance, work):
    """Add variance * a a' to the covariance, a with `position` and `velocity` (GCRF component c) in r and v."""
    n = flight_model.states(table)
    _load(ud, n, work)
    work.W[c, n] = position
    work.W[3 + c, n] = velocity
    work.q[n] = variance
    udu.orthogonalise(work.W, work.q, n, (n + 4) // 4 * 4, work.scaled, ud)


@kernel
def widen_by_burn(nav, table, slot, passed_s, ud, work):
    """Add to `ud` the uncertainty of the part of a burn that had passed when it was announced; work.burn_rtn is set."""
    share = passed_s / (nav.burn_duration_ns[slot] * 1e-9)
    acting_s = min(passed_s, nav.burn_duration_ns[slot] * 1e-9)
    reach_s = passed_s - 0.5 * acting_s
    n = flight_model.states(table)
    _load(ud, n, work)
    for j in range(3):
        manoeuvre.axis_gcrf(nav, slot, j, work.burn_rtn, work.three)
        for i in range(3):
            work.W[i, n + j] = reach_s * work.three[i]
            work.W[3 + i, n + j] = work.three[i]
        work.q[n + j] = min(share, 1.0) * nav.burn_sigma_mps[slot, j] ** 2
    udu.orthogonalise(work.W, work.q, n, (n + 6) // 4 * 4, work.scaled, ud)


@kernel
def _load(ud, n, work):
    """The factors themselves as columns of work.W, for columns to be added."""
    work.W[0:n, :] = 0.0
    work.q[:] = 0.0
    for k in range(n):
        work.q[k] = ud[k, k]
        work.W[k, k] = 1.0
        for i in range(k):
            work.W[i, k] = ud[i, k]


@kernel
def is_sound(table, x, ud):
    """Whether the state is finite and in orbit, and the factors are those of a covariance."""
    n = flight_model.states(table)
    for i in range(n):
        if not (abs(x[i]) < 1e300) or not (ud[i, i] >= 0.0 and ud[i, i] < 1e300):
            return False
        for j in range(i + 1, n):
            if not (abs(ud[i, j]) < 1e300):
                return False
    r2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    return r2 > table.radius_min_m**2 and r2 < table.radius_max_m**2


@kernel
def _take_sigmas(table, row, inp, kind, work):
    for axis in range(3):
        if kind == _POSITION:
            work.sigma[axis] = max(inp.fix_sigma_r_m[axis], table.tuning_sigma_r_floor_m[row])
        else:
            work.sigma[axis] = max(inp.fix_sigma_v_mps[axis], table.tuning_sigma_v_floor_mps[row])


@kernel
def _test(nav, table, row, inp, kind, gate, work, out):
    """Evaluate and judge one type into the record; returns its cause."""
    _take_sigmas(table, row, inp, kind, work)
    nis = measurement.evaluate(table, kind, work.x, work.UD, work, out)
    if math.isfinite(nis):
        measurement.keep_weight(kind, work)
    cause = measurement.judge(nav, table, kind, nis, gate)
    out.type_nis[kind] = nis
    out.type_gate[kind] = gate
    out.type_cause[kind] = cause
    return cause


@kernel
def _may_return(nav, table, kind, work):
    """An excluded type is watched; once it fits the state again it is let back in."""
    if monitor.watch_excluded(nav, table, kind, work):
        nav.excluded[kind] = 0
        monitor.forget(nav)


@kernel
def correct(nav, table, row, inp, work, out):
    """Correct work.x, work.UD at the time of the fix in work.z. Returns the cause of its position.

    A velocity goes with its position: where the gate or the monitor refuses the one, the receiver is not trusted for
    the other. Where the operator leaves positions out, velocities serve alone.
    """
    antenna.to_centre_of_mass(nav, table, inp.fix_gps_ns, work.x, work)
    starting = nav.streak == 0 and nav.fixes_accepted > 0
    gate = table.gate_start_nis if starting else table.gate_continue_nis
    out.gate = gate
    for kind in range(TYPES):
        out.type_cause[kind] = ABSENT
        out.type_nis[kind] = math.nan
        out.type_gate[kind] = gate

    alone = measurement.is_inhibited(nav, table, _POSITION)
    cause = measurement.ABSENT
    used_position = False
    work.mean_gain[:, :] = 0.0
    if not alone:
        cause = _test(nav, table, row, inp, _POSITION, gate, work, out)
        if nav.excluded[_POSITION]:
            _may_return(nav, table, _POSITION, work)
        if cause == USED and starting:
            nav.start_count += 1
            if nav.start_count < table.start_fixes:
                cause = _STARTING
                out.type_cause[_POSITION] = cause
        elif cause == _GATE:
            nav.start_count = 0
        if cause == USED:
            used_position = True
            measurement.correct(table, _POSITION, work.x, work.UD, work)
            nav.start_count = 0
        alone = cause == _OPERATOR
    else:
        cause = _OPERATOR
        out.type_cause[_POSITION] = cause

    if inp.fix_has_velocity and not measurement.is_inhibited(nav, table, _VELOCITY):
        velocity = _test(nav, table, row, inp, _VELOCITY, gate, work, out)
        if nav.excluded[_VELOCITY]:
            _may_return(nav, table, _VELOCITY, work)
        if velocity == USED and not used_position and not alone:
            velocity = cause
            out.type_cause[_VELOCITY] = cause
        if velocity == USED:
            measurement.correct(table, _VELOCITY, work.x, work.UD, work)
    out.nis = _total(out.type_nis[_POSITION], out.type_nis[_VELOCITY])
    if monitor.is_watching(nav, table):
        _watch(nav, table, inp, work, out)
    return cause


@kernel
def _total(position, velocity):
    """NIS of what was tested."""
    if math.isnan(position):
        return velocity
    return position if math.isnan(velocity) else position + velocity


@kernel
def degrees_of_freedom(out):
    """Of out.nis."""
    total = 0.0
    for kind in range(TYPES):
        if not math.isnan(out.type_nis[kind]):
            total += 3.0
    return total


@kernel
def _watch(nav, table, inp, work, out):
    """Let the monitor see the innovations; act on what it finds."""
    position = out.type_nis[_POSITION] if monitor.counts(nav, _POSITION, out.type_cause[_POSITION]) else math.nan
    velocity = out.type_nis[_VELOCITY] if monitor.counts(nav, _VELOCITY, out.type_cause[_VELOCITY]) else math.nan
    if math.isnan(position) and math.isnan(velocity):
        return
    slot = monitor.observe(nav, table, inp.fix_gps_ns, position, velocity, work)
    out.monitor_statistic = nav.monitor_statistic
    out.monitor_kind = nav.monitor_kind
    if slot == monitor.NOTHING:
        return
    adopt(nav, table, inp.fix_gps_ns, slot, work, out)
    monitor.forget(nav)


@kernel
def adopt(nav, table, t_gps_ns, slot, work, out):
    """Act in work.x, work.UD on a fault of nav.monitor_kind with onset `slot`: correct by it, as far as it is known.

    A manoeuvre is what the state lacks; of a receiver's fault it has what it absorbed, and the receiver is excluded.
    """
    kind = nav.monitor_kind
    sigma = monitor.fault_size(nav, slot, work)
    age_s = (t_gps_ns - nav.monitor_t_gps_ns[slot]) * 1e-9
    share_r = -nav.monitor_absorbed[slot, kind, 0]
    share_v = -nav.monitor_absorbed[slot, kind, 1]
    opening = _OPENING
    if kind == monitor.MANOEUVRE:
        out.events |= _MANOEUVRE
        nav.monitor_pause = table.monitor_pause_fixes
        share_r += age_s
        share_v += 1.0
        if age_s < _EARLY_S:
            opening = _OPENING_EARLY
    else:
        out.events |= _SLOW_FAULT
        excluded = _VELOCITY if kind == monitor.VELOCITY_BIAS else _POSITION
        nav.excluded[excluded] = 1
        nav.monitor_good[excluded] = 0
        nav.monitor_sum[excluded, :] = 0.0
    # Where the gate refuses positions the state is off by what they say, however late the onset: left out, the next
    # position would be taken for a velocity.
    refused2 = 0.0
    if out.type_cause[_POSITION] == _GATE:
        for i in range(3):
            refused2 += work.innovation_type[_POSITION, i] ** 2
    found2 = 0.0
    for i in range(3):
        size = work.residual[i]
        found2 += size * size
        work.x[i] += share_r * size
        work.x[3 + i] += share_v * size
    for c in range(3):
        widen(table, work.UD, c, share_r, share_v, opening * opening * found2 + sigma * sigma, work)
        if kind == monitor.MANOEUVRE:  # its course since the onset is not known
            widen(table, work.UD, c, share_r, 0.0, _COURSE * _COURSE * found2, work)
        if kind == monitor.MANOEUVRE and refused2 > 0.0:
            widen(table, work.UD, c, 1.0, 0.0, refused2, work)


@kernel
def published_covariance(nav, table, t_gps_ns, ud, x, time_variance_s2, work):
    """Covariance of the published (r, v) at t into work.P_rv: of the state x, of the stamp, of the antenna.

    A state that belongs to another instant than its stamp says is displaced along the orbit: by v in position, by the
    acceleration, of which a sphere gives all that counts, in velocity.
    """
    p = work.P_rv
    udu.covariance(ud, flight_model.states(table), MEASUREMENTS, p)
    rate = work.column  # of (r, v)
    r2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    for i in range(3):
        rate[i] = x[3 + i]
        rate[3 + i] = -table.mu_m3ps2 / (r2 * math.sqrt(r2)) * x[i]
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            p[i, j] += time_variance_s2 * rate[i] * rate[j]
    lever = antenna.sigma_m(nav, table, t_gps_ns) ** 2
    for i in range(3):
        p[i, i] += lever
