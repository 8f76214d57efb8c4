"""Measurements of the flight filter: position and velocity of a fix, each tested, edited and recorded on its own.

Innovations are processed one scalar at a time along the receiver's ITRF axes, in which its errors are independent;
the record is in GCRF.
"""

from __future__ import annotations

import math

from flightsw.icd.enums import EditMode, MeasurementType, RejectCause
from flightsw.kernels import udu
from flightsw.kernels.linalg import cholesky, solve_lower, solve_lower_transposed
from flightsw.kernels.registry import kernel
from flightsw.nav.flight_model import rtn_basis, states

POSITION = int(MeasurementType.POSITION)
VELOCITY = int(MeasurementType.VELOCITY)
_AUTO = int(EditMode.AUTO)
_ACCEPT = int(EditMode.ACCEPT)
_REJECT = int(EditMode.REJECT)
_INHIBIT = int(EditMode.INHIBIT)
_GATE = int(RejectCause.GATE)
_OPERATOR = int(RejectCause.OPERATOR)
_SLOW_FAULT = int(RejectCause.SLOW_FAULT)
_SINGULAR = int(RejectCause.SINGULAR)
_BIAS = 11
_PERIODIC = 14

USED = -1
ABSENT = -2


@kernel
def editing(nav, table, kind):
    """EditMode in force for a type: that of the last command, else the table's."""
    if nav.edit_ordered[kind] > 0:
        return nav.edit_ordered[kind] - 1
    return table.edit_position if kind == POSITION else table.edit_velocity


@kernel
def _set_rows(table, kind, n, x, work):
    """Rows of H along the ITRF axes into work.H: a position is r with the lasting errors of GNSS on top."""
    m = work.itrf_from_gcrf
    h = work.H
    h[:, :] = 0.0
    for axis in range(3):
        for i in range(3):
            h[axis, 3 * kind + i] = m[axis, i]
    if kind == POSITION and n > _BIAS:
        rtn_basis(x, work.rtn)
        for axis in range(3):
            for j in range(3):
                along = 0.0
                for i in range(3):
                    along += m[axis, i] * work.rtn[i, j]
                h[axis, _BIAS + j] = along
                if n > _PERIODIC:
                    h[axis, _PERIODIC + 2 * j] = along


@kernel
def evaluate(table, kind, x, ud, work, out):
    """Innovation of work.z (GCRF) against x and the factors, into work.residual (ITRF axes), work.S and the record.

    work.sigma (3,) holds the receiver's sigmas along ITRF axes. Returns the NIS, NaN where S is not positive definite.
    """
    n = states(table)
    _set_rows(table, kind, n, x, work)
    m = work.itrf_from_gcrf
    gcrf = work.innovation_type[kind]
    for axis in range(3):
        predicted = 0.0
        for i in range(n):
            predicted += work.H[axis, i] * x[i]
        measured = 0.0
        for i in range(3):
            measured += m[axis, i] * work.z[3 * kind + i]
        work.residual[axis] = measured - predicted
        udu.project(ud, n, work.H[axis], work.f[axis])
    s = work.S
    for a in range(3):
        for b in range(a, 3):
            total = 0.0
            for j in range(n):
                total += work.f[a, j] * ud[j, j] * work.f[b, j]
            s[a, b] = total
            s[b, a] = total
        s[a, a] += work.sigma[a] ** 2
    for i in range(3):
        gcrf[i] = 0.0
        variance = 0.0
        for a in range(3):
            gcrf[i] += m[a, i] * work.residual[a]
            for b in range(3):
                variance += m[a, i] * s[a, b] * m[b, i]
        out.innovation[3 * kind + i] = gcrf[i]
        out.innovation_sigma[3 * kind + i] = math.sqrt(variance)
    if not cholesky(s, work.S_lower):
        return math.nan
    solve_lower(work.S_lower, work.residual, work.column[0:3])
    nis = 0.0
    for a in range(3):
        nis += work.column[a] ** 2
    return nis


@kernel
def keep_weight(kind, work):
    """S^-1 in GCRF into work.weight_type[kind], for the monitor of slow faults; from the factor of `evaluate`."""
    m = work.itrf_from_gcrf
    weight = work.weight
    for a in range(3):
        for b in range(3):
            weight[a, b] = 1.0 if a == b else 0.0
        solve_lower(work.S_lower, weight[a], weight[a])
        solve_lower_transposed(work.S_lower, weight[a], weight[a])
    out = work.weight_type[kind]
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(3):
                for b in range(3):
                    total += m[a, i] * weight[a, b] * m[b, j]
            out[i, j] = total


@kernel
def judge(nav, table, kind, nis, gate):
    """USED or the RejectCause of a tested measurement: operator first, then the monitor, then the gate."""
    mode = editing(nav, table, kind)
    if not math.isfinite(nis):
        return _SINGULAR
    if mode in (_REJECT, _INHIBIT):
        return _OPERATOR
    if mode == _ACCEPT:
        return USED
    if nav.excluded[kind]:
        return _SLOW_FAULT
    return USED if nis <= gate else _GATE


@kernel
def is_inhibited(nav, table, kind):
    """Whether a type is not even to be tested."""
    return editing(nav, table, kind) == _INHIBIT


@kernel
def correct(table, kind, x, ud, work):
    """Update x and the factors in place by the measurement of the last `evaluate`; fills work.mean_gain.

    Where the state's variance dominates, a share of it is added to R (underweighting: W. M. Lear, JSC-20688, 1985):
    the covariance then shrinks more slowly than the error may, whatever a large correction leaves out.
    """
    n = states(table)
    dx = work.correction
    dx[:] = 0.0
    trace = 0.0
    for axis in range(3):
        trace += work.S[axis, axis] - work.sigma[axis] ** 2
    underweight = table.underweight if trace > table.underweight_above_m**2 else 0.0
    work.mean_gain[kind, 0] = 0.0
    work.mean_gain[kind, 1] = 0.0
    for axis in range(3):
        h = work.H[axis]
        variance = work.sigma[axis] ** 2
        if underweight > 0.0:
            udu.project(ud, n, h, work.f[axis])
            for j in range(n):
                variance += underweight * ud[j, j] * work.f[axis, j] ** 2
        udu.correct(ud, n, h, variance, work.f[axis], work.gain_one)
        rest = work.residual[axis]
        for j in range(n):
            rest -= h[j] * dx[j]
        for j in range(n):
            dx[j] += work.gain_one[j] * rest
        for i in range(3):
            work.mean_gain[kind, 0] += h[3 * kind + i] * work.gain_one[i] / 3.0
            work.mean_gain[kind, 1] += h[3 * kind + i] * work.gain_one[3 + i] / 3.0
    for j in range(n):
        x[j] += dx[j]
