"""Fixes that agree with each other: how navigation starts, and starts anew when it is the state that is wrong."""

from __future__ import annotations

import math

from flightsw.kernels.integrators import rk4
from flightsw.kernels.registry import kernel
from flightsw.records import STATES

_SHOTS = 16
_CLOSE_MPS = 1e-7
_ARC_STEP_S = 10.0


@kernel
def offer(nav, table, t_gps_ns, sigma_r_m, sigma_v_mps, work):
    """Count the fix in work.z into the row of fixes that agree under the onboard dynamics; returns the count.

    Two fixes agree when the older one, carried to the time of the newer, differs by no more than
    `agreement_sigmas` of the difference in every component. The carried one has grown by its velocity sigma.
    """
    dt_s = (t_gps_ns - nav.candidate_t_gps_ns) * 1e-9
    agrees = nav.candidate_count > 0 and dt_s > 0.0 and dt_s <= table.agreement_gap_max_s
    if agrees:
        x = work.x_candidate
        for i in range(STATES):
            x[i] = nav.candidate_x[i]
        rk4(table, x, dt_s, nav.pole, work.stages)
        old_r = math.hypot(nav.candidate_sigma_r_m, dt_s * nav.candidate_sigma_v_mps)
        limit_r = table.agreement_sigmas * math.hypot(sigma_r_m, old_r)
        limit_v = table.agreement_sigmas * math.hypot(sigma_v_mps, nav.candidate_sigma_v_mps)
        for i in range(3):
            if not (abs(work.z[i] - x[i]) <= limit_r) or not (abs(work.z[3 + i] - x[3 + i]) <= limit_v):
                agrees = False
    nav.candidate_count = nav.candidate_count + 1 if agrees else 1
    nav.candidate_t_gps_ns = t_gps_ns
    for i in range(6):
        nav.candidate_x[i] = work.z[i]
    for i in range(6, STATES):
        nav.candidate_x[i] = 0.0
    nav.candidate_sigma_r_m = sigma_r_m
    nav.candidate_sigma_v_mps = sigma_v_mps
    return nav.candidate_count


@kernel
def _arc_state(nav, table, t_gps_ns, work):
    """State at t whose arc meets the first of the kept positions and the one in work.z, into work.x_candidate.

    The velocity at the first one is found by shooting: the miss by its flight time is the next correction, which
    converges by a factor of about (omega dt)^2 / 3 a turn: in four over a minute, in a dozen over ten. Leaves the miss
    of the position between in work.three.
    """
    dt_s = (t_gps_ns - nav.arc_t_gps_ns[0]) * 1e-9
    between_s = (nav.arc_t_gps_ns[1] - nav.arc_t_gps_ns[0]) * 1e-9
    x = work.x_candidate
    v = work.momentum
    for i in range(3):
        v[i] = (work.z[i] - nav.arc_r_m[0, i]) / dt_s
    for _ in range(_SHOTS):
        _fly_arc(nav, table, v, between_s, work)
        for i in range(3):
            work.three[i] = nav.arc_r_m[1, i] - x[i]
        _fly_on(nav, table, dt_s - between_s, work)
        largest = 0.0
        for i in range(3):
            missed = (work.z[i] - x[i]) / dt_s
            v[i] += missed
            largest = max(largest, abs(missed))
        if not (largest > _CLOSE_MPS):
            break


@kernel
def _fly_arc(nav, table, v, dt_s, work):
    x = work.x_candidate
    x[:] = 0.0
    for i in range(3):
        x[i] = nav.arc_r_m[0, i]
        x[3 + i] = v[i]
    _fly_on(nav, table, dt_s, work)


@kernel
def _fly_on(nav, table, dt_s, work):
    steps = int(dt_s / _ARC_STEP_S) + 1
    for _ in range(steps):
        rk4(table, work.x_candidate, dt_s / steps, nav.pole, work.stages)


@kernel
def _bent_m(table, arc_s, rest_s):
    """Sigma [m] of a lasting error against the chord of an arc, rest_s before its end: a Brownian bridge."""
    density = 2.0 * table.gnss_bias_sigma_m**2 / table.gnss_bias_tau_s
    return math.sqrt(density * rest_s * (arc_s - rest_s) / arc_s)


@kernel
def offer_position(nav, table, t_gps_ns, sigma_r_m, work):
    """Take the position in work.z, which has no velocity, into an arc of three that a state can start from.

    The first, one from the middle and the last of `position_arc_s` define it: two of them the velocity, the third
    checks it. True when they agree: the velocity at t is then in work.z[3:6].
    """
    first_age_s = (t_gps_ns - nav.arc_t_gps_ns[0]) * 1e-9
    last_age_s = first_age_s if nav.arc_count < 2 else (t_gps_ns - nav.arc_t_gps_ns[1]) * 1e-9
    too_old = first_age_s > 3.0 * table.position_arc_s or last_age_s > 2.0 * table.position_arc_s
    if nav.arc_count == 0 or first_age_s <= 0.0 or too_old:
        nav.arc_count = 1
        nav.arc_t_gps_ns[0] = t_gps_ns
        for i in range(3):
            nav.arc_r_m[0, i] = work.z[i]
        return False
    if nav.arc_count == 1:
        if first_age_s >= 0.4 * table.position_arc_s:
            nav.arc_count = 2
            nav.arc_t_gps_ns[1] = t_gps_ns
            for i in range(3):
                nav.arc_r_m[1, i] = work.z[i]
        return False
    if first_age_s < table.position_arc_s:
        return False
    _arc_state(nav, table, t_gps_ns, work)
    nav.arc_count = 0
    # the middle one against the line through the two others: each counts, the outer ones by half and less
    limit = 1.3 * table.agreement_sigmas * sigma_r_m
    if table.gnss_bias_sigma_m > 0.0:
        limit = math.hypot(limit, table.agreement_sigmas * _bent_m(table, first_age_s, last_age_s))
    for i in range(3):
        if not (abs(work.three[i]) <= limit):
            return False
    for i in range(3):
        work.z[3 + i] = work.x_candidate[3 + i]
    return True
