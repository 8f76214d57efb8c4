"""Announced burns: a constant acceleration between two instants, part of the motion with and without fixes.

A burn is integrated apart from the forces: over a step its displacement is that of a constant acceleration, and what
the gravity gradient makes of it within the step is below 1e-7 of it. A burn that was announced late is caught up.
"""

from __future__ import annotations

import math

from flightsw.icd.enums import BurnFrame, RejectCause
from flightsw.kernels.registry import kernel
from flightsw.records import BURNS

_RTN = int(BurnFrame.RTN)
_GCRF = int(BurnFrame.GCRF)
_LATE = int(RejectCause.BURN_LATE)
_INVALID = int(RejectCause.BURN_INVALID)
_CENTURY_NS = 3_155_760_000_000_000_000

# a burn that has ended is kept while a late fix may go back behind it
KEPT_NS = 60_000_000_000

KNOWN = -1
REFUSED = -2


@kernel
def overlap_s(nav, k, t_gps_ns, dt_s):
    """How long burn k acts within [t, t + dt], and how long the interval goes on after it [s]."""
    start_s = (nav.burn_start_gps_ns[k] - t_gps_ns) * 1e-9
    stop_s = start_s + nav.burn_duration_ns[k] * 1e-9
    begin = max(start_s, 0.0)
    end = min(stop_s, dt_s)
    return max(end - begin, 0.0), dt_s - end


@kernel
def axis_gcrf(nav, k, axis, rtn, out):
    """Unit vector in GCRF of an axis in which burn k is given; `rtn` is the basis of the orbit."""
    for i in range(3):
        if nav.burn_frame[k] == _RTN:
            out[i] = rtn[i, axis]
        else:
            out[i] = 1.0 if i == axis else 0.0


@kernel
def displacement(nav, k, t_gps_ns, dt_s, rtn, rate_radps, axis, dr_m, dv_mps):
    """What burn k adds to r and v [m, m/s, GCRF] over [t, t + dt]; `axis` (3,) is scratch. Adds to dr_m, dv_mps.

    `rtn` is the basis of the orbit at t, which turns at `rate_radps`: a burn in RTN has the axes of its middle.
    """
    acting_s, tail_s = overlap_s(nav, k, t_gps_ns, dt_s)
    if acting_s <= 0.0:
        return
    share = acting_s / (nav.burn_duration_ns[k] * 1e-9)
    turned = rate_radps * (dt_s - tail_s - 0.5 * acting_s) if nav.burn_frame[k] == _RTN else 0.0
    c = math.cos(turned)
    s = math.sin(turned)
    given = nav.burn_dv_mps[k]
    for j in range(3):
        axis_gcrf(nav, k, j, rtn, axis)
        dv = share * given[j]
        if j == 0:
            dv = share * (c * given[0] - s * given[1])
        elif j == 1:
            dv = share * (s * given[0] + c * given[1])
        for i in range(3):
            dv_mps[i] += dv * axis[i]
            dr_m[i] += dv * axis[i] * (0.5 * acting_s + tail_s)


@kernel
def is_active(nav, t_gps_ns, dt_s):
    """Whether an announced burn acts within [t, t + dt]."""
    found = False
    for k in range(BURNS):
        if nav.burn_duration_ns[k] > 0:
            found = found or overlap_s(nav, k, t_gps_ns, dt_s)[0] > 0.0
    return found


@kernel
def apply(nav, t_gps_ns, dt_s, rtn, rate_radps, work, x):
    """Add all burns over [t, t + dt] to x in place; `rtn` is the basis of the orbit at t, which turns at the rate."""
    dr = work.burn_dr_m
    dv = work.burn_dv_mps
    dr[:] = 0.0
    dv[:] = 0.0
    for k in range(BURNS):
        if nav.burn_duration_ns[k] > 0:
            displacement(nav, k, t_gps_ns, dt_s, rtn, rate_radps, work.three, dr, dv)
    for i in range(3):
        x[i] += dr[i]
        x[3 + i] += dv[i]


@kernel
def add_noise(nav, t_gps_ns, dt_s, p):
    """Uncertainty of the burns over [t, t + dt] on r and v, into the whole matrix p of the paper's filter.

    The largest of a burn's sigmas serves all axes: the matrix is that of a filter whose noise is diagonal.
    """
    for k in range(BURNS):
        if nav.burn_duration_ns[k] == 0:
            continue
        acting_s, tail_s = overlap_s(nav, k, t_gps_ns, dt_s)
        if acting_s <= 0.0:
            continue
        largest = max(nav.burn_sigma_mps[k, 0], max(nav.burn_sigma_mps[k, 1], nav.burn_sigma_mps[k, 2]))
        variance = largest * largest * acting_s / (nav.burn_duration_ns[k] * 1e-9)
        reach_s = acting_s + tail_s
        for i in range(3):
            p[i, i] += variance * reach_s * reach_s
            p[3 + i, 3 + i] += variance


@kernel
def forget_past(nav, t_gps_ns):
    """Free the burns that ended before t."""
    for k in range(BURNS):
        if nav.burn_duration_ns[k] > 0 and nav.burn_start_gps_ns[k] + nav.burn_duration_ns[k] < t_gps_ns:
            nav.burn_duration_ns[k] = 0


@kernel
def _is_valid(table, inp):
    duration = inp.burn_duration_ns
    if not (duration > 0 and duration <= table.burn_duration_max_s * 1e9):
        return False
    if not (inp.burn_start_gps_ns > 0 and inp.burn_start_gps_ns < _CENTURY_NS):
        return False
    if inp.burn_frame != _RTN and inp.burn_frame != _GCRF:
        return False
    for i in range(3):
        if not (abs(inp.burn_dv_mps[i]) <= table.burn_dv_max_mps):
            return False
        if not (inp.burn_sigma_mps[i] >= 0.0 and inp.burn_sigma_mps[i] <= table.burn_dv_max_mps):
            return False
    return True


@kernel
def _is_same(nav, k, inp):
    same = (
        nav.burn_id[k] == inp.burn_id
        and nav.burn_frame[k] == inp.burn_frame
        and nav.burn_start_gps_ns[k] == inp.burn_start_gps_ns
        and nav.burn_duration_ns[k] == inp.burn_duration_ns
    )
    for i in range(3):
        same = same and nav.burn_dv_mps[k, i] == inp.burn_dv_mps[i]
        same = same and nav.burn_sigma_mps[k, i] == inp.burn_sigma_mps[i]
    return same


@kernel
def announce(nav, table, inp, t_now_gps_ns):
    """Take an announcement into the list. Returns its slot, KNOWN, or below that REFUSED - RejectCause.

    The same burn_id before its start replaces what was announced; repeated word for word it changes nothing.
    """
    if not _is_valid(table, inp):
        return REFUSED - _INVALID
    for k in range(BURNS):
        if nav.burn_duration_ns[k] > 0 and _is_same(nav, k, inp):
            return KNOWN
    if inp.burn_start_gps_ns < t_now_gps_ns - int(table.burn_late_max_s * 1e9):
        return REFUSED - _LATE
    if inp.burn_start_gps_ns > t_now_gps_ns + int(table.burn_ahead_max_s * 1e9):
        return REFUSED - _INVALID
    forget_past(nav, (nav.t_gps_ns if nav.initialised else t_now_gps_ns) - KEPT_NS)
    slot = -1
    for k in range(BURNS):
        if nav.burn_duration_ns[k] > 0 and nav.burn_id[k] == inp.burn_id:
            if nav.burn_start_gps_ns[k] <= t_now_gps_ns:
                return REFUSED - _INVALID  # it has begun: what has been integrated is not taken back
            slot = k
            break
        if slot < 0 and nav.burn_duration_ns[k] == 0:
            slot = k
    if slot < 0:
        return REFUSED - _INVALID
    nav.burn_id[slot] = inp.burn_id
    nav.burn_frame[slot] = inp.burn_frame
    nav.burn_start_gps_ns[slot] = inp.burn_start_gps_ns
    nav.burn_duration_ns[slot] = inp.burn_duration_ns
    for i in range(3):
        nav.burn_dv_mps[slot, i] = inp.burn_dv_mps[i]
        nav.burn_sigma_mps[slot, i] = inp.burn_sigma_mps[i]
    return slot
