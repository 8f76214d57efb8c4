"""Process model of the flight filter: what its states do over a step, and the noise that comes with it.

    r, v        GCRF; by the force model
    a           empirical accelerations in RTN: what the force model lacks, not a stand-in for it
    drag        what drag has beyond the model, a share of it: a fast and a slow part
    bias        error of GNSS positions that lasts for minutes, RTN
    periodic    error of GNSS positions with the period of the orbit, RTN: a pair for each axis that turns with it

All but r and v are first-order Gauss-Markov processes. Beside them white accelerations in RTN (state noise
compensation). Noise is exact for the length of the step: it enters as columns, one for each node of a quadrature over
the instants at which it acts, so that the factors of the covariance take it as it is.
"""

from __future__ import annotations

import math

from flightsw.kernels import udu
from flightsw.kernels.registry import kernel
from flightsw.nav import manoeuvre
from flightsw.records import BURNS, DYNAMIC_STATES, NOISE_WIDTH, STATES

PAPER = 0
FLIGHT = 1

AXES = 3
_OMITTED_ALTITUDE_M = 500_000.0  # for which the table gives the sigma of omitted gravity
DRAG = 9
_LEAST_DRAG_SCALE = 0.5  # for the noise of drag, a share of what is estimated: where drag is weak that is anything
BIAS = 11
PERIODIC = 14

# Gauss-Legendre nodes and weights on [0, 1], three points: exact to degree five; responses below are quadratic in
# time as long as a step is short beside the correlation times (Abramowitz and Stegun, table 25.4).
_NODES = (0.1127016653792583, 0.5, 0.8872983346207417)
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
# and two points: exact to degree three, enough for white accelerations
_NODES_WHITE = (0.21132486540518713, 0.7886751345948129)
_WHOLE_BURNS = 2  # records.NOISE_WIDTH has twelve columns for burns: six each, or three each of four


@kernel
def states(table):
    """How many states this table's filter has: the errors of GNSS come last and only where they are modelled."""
    if table.gnss_periodic_sigma_m > 0.0:
        return STATES
    if table.gnss_bias_sigma_m > 0.0:
        return PERIODIC
    return BIAS


@kernel
def rtn_basis(x, out):
    """Columns radial, along-track, cross-track of the orbit at x, unit vectors in GCRF, into the 3x3 `out`."""
    r1 = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    n0 = x[1] * x[5] - x[2] * x[4]
    n1 = x[2] * x[3] - x[0] * x[5]
    n2 = x[0] * x[4] - x[1] * x[3]
    h = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    out[0, 0] = x[0] / r1
    out[1, 0] = x[1] / r1
    out[2, 0] = x[2] / r1
    out[0, 2] = n0 / h
    out[1, 2] = n1 / h
    out[2, 2] = n2 / h
    out[0, 1] = out[1, 2] * out[2, 0] - out[2, 2] * out[1, 0]
    out[1, 1] = out[2, 2] * out[0, 0] - out[0, 2] * out[2, 0]
    out[2, 1] = out[0, 2] * out[1, 0] - out[1, 2] * out[0, 0]


@kernel
def turn_rtn(rtn, angle_rad):
    """The basis of `rtn_basis` so far on along the orbit, in place."""
    c = math.cos(angle_rad)
    s = math.sin(angle_rad)
    for i in range(3):
        radial = rtn[i, 0]
        along = rtn[i, 1]
        rtn[i, 0] = c * radial + s * along
        rtn[i, 1] = c * along - s * radial


@kernel
def orbital_rate_radps(x):
    """Rate of the argument of latitude, h / r^2 [rad/s]."""
    n0 = x[1] * x[5] - x[2] * x[4]
    n1 = x[2] * x[3] - x[0] * x[5]
    n2 = x[0] * x[4] - x[1] * x[3]
    return math.sqrt(n0 * n0 + n1 * n1 + n2 * n2) / (x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@kernel
def _velocity_response(dt_s, tau_s):
    """Velocity that a decaying acceleration of 1 m/s2 at the start has given after dt."""
    return -tau_s * math.expm1(-dt_s / tau_s)


@kernel
def _position_response(dt_s, tau_s):
    """Position that it has given after dt."""
    x = dt_s / tau_s
    if x < 1e-3:  # the difference below would lose its digits
        return dt_s * dt_s * (0.5 - x / 6.0 + x * x / 24.0)
    return tau_s * (dt_s - _velocity_response(dt_s, tau_s))


@kernel
def empirical_sigma_mps2(table, x):
    """Steady sigma of the empirical accelerations at x: the table's, and what the gravity field leaves out.

    That is strongest at the degree where the field ends, and fades with the radius as a field of this degree does.
    """
    omitted = table.omitted_gravity_sigma_mps2
    if omitted == 0.0:
        return table.empirical_sigma_mps2
    r2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    ratio2 = (table.equatorial_radius_m + _OMITTED_ALTITUDE_M) ** 2 / r2
    omitted2 = omitted * omitted * ratio2 ** (table.omitted_gravity_degree + 2.0)
    return math.sqrt(table.empirical_sigma_mps2**2 + omitted2)


@kernel
def set_motion(dt_s, gradient, work):
    """How r and v follow from r and v after dt, into the first six columns of work.motion."""
    motion = work.motion
    half = 0.5 * dt_s * dt_s
    for i in range(3):
        for j in range(3):
            g = gradient[i, j]
            motion[i, j] = half * g
            motion[i, 3 + j] = dt_s * half / 3.0 * g
            motion[3 + i, j] = dt_s * g
            motion[3 + i, 3 + j] = half * g
        motion[i, i] += 1.0
        motion[i, 3 + i] += dt_s
        motion[3 + i, 3 + i] += 1.0


@kernel
def set_transition(table, x, dt_s, drag_mps2, gradient, work):
    """How r and v follow from the states before, into work.motion, and the decays of the others.

    Also the steady sigma of the empirical accelerations and the scale of drag, which drive their noise in `predict`.
    """
    motion = work.motion
    work.drag_scale = max(1.0 + x[DRAG] + x[DRAG + 1], _LEAST_DRAG_SCALE)
    work.empirical_sigma_mps2 = empirical_sigma_mps2(table, x)
    basis = work.rtn
    rtn_basis(x, basis)
    set_motion(dt_s, gradient, work)
    to_r = _position_response(dt_s, table.empirical_tau_s)
    to_v = _velocity_response(dt_s, table.empirical_tau_s)
    for i in range(3):
        for j in range(3):
            motion[i, 6 + j] = to_r * basis[i, j]
            motion[3 + i, 6 + j] = to_v * basis[i, j]
        motion[i, DRAG] = _position_response(dt_s, table.drag_tau_s) * drag_mps2[i]
        motion[3 + i, DRAG] = _velocity_response(dt_s, table.drag_tau_s) * drag_mps2[i]
        motion[i, DRAG + 1] = _position_response(dt_s, table.drag_slow_tau_s) * drag_mps2[i]
        motion[3 + i, DRAG + 1] = _velocity_response(dt_s, table.drag_slow_tau_s) * drag_mps2[i]
    set_decays(table, x, dt_s, work)


@kernel
def set_decays(table, x, dt_s, work):
    """How the states beside r and v change over a step, into work.decay, work.turn_cos, work.turn_sin."""
    decay = work.decay
    empirical = math.exp(-dt_s / table.empirical_tau_s)
    bias = math.exp(-dt_s / table.gnss_bias_tau_s)
    for i in range(AXES):
        decay[6 + i] = empirical
        decay[BIAS + i] = bias
    decay[DRAG] = math.exp(-dt_s / table.drag_tau_s)
    decay[DRAG + 1] = math.exp(-dt_s / table.drag_slow_tau_s)
    periodic = math.exp(-dt_s / table.gnss_periodic_tau_s)
    turned = dt_s * orbital_rate_radps(x)
    work.turn_cos = periodic * math.cos(turned)
    work.turn_sin = periodic * math.sin(turned)


@kernel
def carry_others(work, x):
    """The states beside r and v over the step of `set_decays`, in place."""
    for i in range(6, PERIODIC):
        x[i] *= work.decay[i]
    for axis in range(AXES):
        c = x[PERIODIC + 2 * axis]
        s = x[PERIODIC + 2 * axis + 1]
        x[PERIODIC + 2 * axis] = work.turn_cos * c + work.turn_sin * s
        x[PERIODIC + 2 * axis + 1] = work.turn_cos * s - work.turn_sin * c


@kernel
def _add_markov(work, at, d0, d1, d2, state, sigma, tau_s, dt_s):
    """Three columns: noise of a Gauss-Markov acceleration along (d0, d1, d2), held in `state`. Returns the next."""
    density = 2.0 * sigma * sigma / tau_s
    for node in range(3):
        s = _NODES[node] * dt_s  # it has acted for s
        r = _position_response(s, tau_s)
        v = _velocity_response(s, tau_s)
        w = work.W
        w[0, at] = r * d0
        w[1, at] = r * d1
        w[2, at] = r * d2
        w[3, at] = v * d0
        w[4, at] = v * d1
        w[5, at] = v * d2
        w[state, at] = math.exp(-s / tau_s)
        work.q[at] = _WEIGHTS[node] * dt_s * density
        at += 1
    return at


@kernel
def _add_kick(work, at, d0, d1, d2, variance, reach_s):
    """A column: a change of velocity along (d0, d1, d2) that has moved the satellite for reach_s. Returns the next."""
    w = work.W
    w[0, at] = reach_s * d0
    w[1, at] = reach_s * d1
    w[2, at] = reach_s * d2
    w[3, at] = d0
    w[4, at] = d1
    w[5, at] = d2
    work.q[at] = variance
    return at + 1


@kernel
def _add_white(work, at, d0, d1, d2, density, dt_s, tail_s):
    """Two columns: white acceleration over dt, followed by tail_s without it. Returns the next column."""
    for node in range(2):
        at = _add_kick(work, at, d0, d1, d2, 0.5 * dt_s * density, tail_s + _NODES_WHITE[node] * dt_s)
    return at


@kernel
def _add_burns(nav, t_gps_ns, dt_s, work, at):
    """Uncertainty of announced burns that act within the step, as white acceleration of the same final variance.

    There is room for the columns of two: where more of them act at once, each is a kick in the middle of its time.
    """
    active = 0
    for k in range(BURNS):
        if nav.burn_duration_ns[k] > 0 and manoeuvre.overlap_s(nav, k, t_gps_ns, dt_s)[0] > 0.0:
            active += 1
    for k in range(BURNS):
        if nav.burn_duration_ns[k] == 0:
            continue
        acting_s, tail_s = manoeuvre.overlap_s(nav, k, t_gps_ns, dt_s)
        if acting_s <= 0.0:
            continue
        share = 1.0 / (nav.burn_duration_ns[k] * 1e-9)
        for axis in range(AXES):
            d = work.three
            manoeuvre.axis_gcrf(nav, k, axis, work.rtn, d)
            density = nav.burn_sigma_mps[k, axis] ** 2 * share
            if active <= _WHOLE_BURNS:
                at = _add_white(work, at, d[0], d[1], d[2], density, acting_s, tail_s)
            else:
                at = _add_kick(work, at, d[0], d[1], d[2], density * acting_s, tail_s + 0.5 * acting_s)
    return at


@kernel
def _drag_steps(nav, table, t_gps_ns, dt_s):
    """Whether drag may have changed in this step: what takes GNSS away, safe mode above all, turns the satellite too.

    Once in an outage, at an age that leaves short gaps out; nothing but time decides, so that a step taken again from
    an earlier epoch says the same.
    """
    lost_ns = nav.t_fix_gps_ns + round(table.drag_step_after_s * 1e9)
    return table.drag_step_sigma > 0.0 and t_gps_ns <= lost_ns and lost_ns < t_gps_ns + round(dt_s * 1e9)


@kernel
def predict(nav, table, t_gps_ns, ud, dt_s, drag_mps2, work, out):
    """Factors of the covariance over the step of `set_transition`, from `ud` into `out` (which may be `ud`)."""
    n = states(table)
    w = work.W
    q = work.q
    w[0:n, :] = 0.0
    q[:] = 0.0
    for k in range(n):
        q[k] = ud[k, k]
    # transition times U; the first eleven states mix, the others stand alone or in pairs
    motion = work.motion
    for i in range(6):
        row = w[i]
        for j in range(DYNAMIC_STATES):
            m = motion[i, j]
            row[j] += m
            for k in range(j + 1, n):
                row[k] += m * ud[j, k]
    for i in range(6, min(n, PERIODIC)):
        w[i, i] = work.decay[i]
        for k in range(i + 1, n):
            w[i, k] = work.decay[i] * ud[i, k]
    if n > PERIODIC:
        for axis in range(AXES):
            c = PERIODIC + 2 * axis
            w[c, c] = work.turn_cos
            w[c, c + 1] = work.turn_cos * ud[c, c + 1] + work.turn_sin
            w[c + 1, c] = -work.turn_sin
            w[c + 1, c + 1] = work.turn_cos - work.turn_sin * ud[c, c + 1]
            for k in range(c + 2, n):
                w[c, k] = work.turn_cos * ud[c, k] + work.turn_sin * ud[c + 1, k]
                w[c + 1, k] = work.turn_cos * ud[c + 1, k] - work.turn_sin * ud[c, k]

    at = n
    basis = work.rtn
    for axis in range(AXES):
        at = _add_markov(
            work,
            at,
            basis[0, axis],
            basis[1, axis],
            basis[2, axis],
            6 + axis,
            work.empirical_sigma_mps2,
            table.empirical_tau_s,
            dt_s,
        )
    d0 = drag_mps2[0]
    d1 = drag_mps2[1]
    d2 = drag_mps2[2]
    at = _add_markov(work, at, d0, d1, d2, DRAG, work.drag_scale * table.drag_sigma, table.drag_tau_s, dt_s)
    slow_sigma = work.drag_scale * table.drag_slow_sigma
    at = _add_markov(work, at, d0, d1, d2, DRAG + 1, slow_sigma, table.drag_slow_tau_s, dt_s)
    if _drag_steps(nav, table, t_gps_ns, dt_s):
        w[DRAG + 1, at] = 1.0
        q[at] = (table.drag_step_sigma * work.drag_scale) ** 2
        at += 1
    for axis in range(AXES):
        density = table.white_radial_m2ps3
        if axis == 1:
            density = table.white_along_m2ps3
        elif axis == 2:
            density = table.white_cross_m2ps3
        if density > 0.0:
            at = _add_white(work, at, basis[0, axis], basis[1, axis], basis[2, axis], density, dt_s, 0.0)
    if n > BIAS:
        drive = table.gnss_bias_sigma_m**2 * -math.expm1(-2.0 * dt_s / table.gnss_bias_tau_s)
        for axis in range(AXES):
            w[BIAS + axis, at] = 1.0
            q[at] = drive
            at += 1
    if n > PERIODIC:
        drive = table.gnss_periodic_sigma_m**2 * -math.expm1(-2.0 * dt_s / table.gnss_periodic_tau_s)
        for state in range(PERIODIC, STATES):
            w[state, at] = 1.0
            q[at] = drive
            at += 1
    at = _add_burns(nav, t_gps_ns, dt_s, work, at)
    udu.orthogonalise(w, q, n, min((at + 3) // 4 * 4, NOISE_WIDTH), work.scaled, out)
