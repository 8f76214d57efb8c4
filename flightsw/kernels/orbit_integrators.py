"""Steps of the full force model, r and v [m, m/s, GCRF]: classical Runge-Kutta, an eighth-order one, and Nyström's.

All start anew with every step, as a state that fixes correct needs. Measured reasons: docs/adr/0010.
"""

from __future__ import annotations

import math

import numpy as np

from flightsw.kernels.force_model import evaluate, prepare, turn
from flightsw.kernels.registry import F8, I8, VECTOR, entry, frozen_records, kernel, records
from flightsw.records import FIELD, FORCE_TABLE, FORCE_WORK, ORIENTATION, STAGES

RK4 = 0
RK8 = 1
RKN5 = 2

_S = math.sqrt(21.0)
# G. J. Cooper and J. H. Verner, Some explicit Runge-Kutta methods of high order, SIAM J. Numer. Anal. 9 (1972) 389.
RK8_NODES = np.array(
    [0.0, 0.5, 0.5, (7 + _S) / 14, (7 + _S) / 14, 0.5, (7 - _S) / 14, (7 - _S) / 14, 0.5, (7 + _S) / 14, 1.0]
)
RK8_WEIGHTS = np.array([1 / 20, 0, 0, 0, 0, 0, 0, 49 / 180, 16 / 45, 49 / 180, 1 / 20])
_ROWS: list[list[float]] = [
    [],
    [1 / 2],
    [1 / 4, 1 / 4],
    [1 / 7, (-7 - 3 * _S) / 98, (21 + 5 * _S) / 49],
    [(11 + _S) / 84, 0, (18 + 4 * _S) / 63, (21 - _S) / 252],
    [(5 + _S) / 48, 0, (9 + _S) / 36, (-231 + 14 * _S) / 360, (63 - 7 * _S) / 80],
    [(10 - _S) / 42, 0, (-432 + 92 * _S) / 315, (633 - 145 * _S) / 90, (-504 + 115 * _S) / 70, (63 - 13 * _S) / 35],
    [1 / 14, 0, 0, 0, (14 - 3 * _S) / 126, (13 - 3 * _S) / 63, 1 / 9],
    [1 / 32, 0, 0, 0, (91 - 21 * _S) / 576, 11 / 72, (-385 - 75 * _S) / 1152, (63 + 13 * _S) / 128],
    [
        1 / 14,
        0,
        0,
        0,
        1 / 9,
        (-733 - 147 * _S) / 2205,
        (515 + 111 * _S) / 504,
        (-51 - 11 * _S) / 56,
        (132 + 28 * _S) / 245,
    ],
    [
        0,
        0,
        0,
        0,
        (-42 + 7 * _S) / 18,
        (-18 + 28 * _S) / 45,
        (-273 - 53 * _S) / 72,
        (301 + 53 * _S) / 72,
        (28 - 28 * _S) / 45,
        (49 - 7 * _S) / 18,
    ],
]
RK8_MATRIX = np.array([row + [0.0] * (STAGES - len(row)) for row in _ROWS])
RK4_NODES = np.array([0.0, 0.5, 0.5, 1.0])
RK4_WEIGHTS = np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6])
RK4_MATRIX = np.array([[0.0, 0, 0, 0], [0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 1.0, 0]])

# E. J. Nyström, Acta Soc. Sci. Fenn. 50 (1925) 1; from E. Hairer, S. P. Nørsett and G. Wanner, Solving Ordinary
# Differential Equations I, 1993, table II.14.2: four stages, order five where the acceleration has no velocity in it.
RKN5_NODES = np.array([0.0, 0.2, 2 / 3, 1.0])
RKN5_MATRIX = np.array([[0.0, 0, 0, 0], [1 / 50, 0, 0, 0], [-1 / 27, 7 / 27, 0, 0], [3 / 10, -2 / 35, 9 / 35, 0]])
RKN5_POSITION_WEIGHTS = np.array([14.0, 100.0, 54.0, 0.0]) / 336.0
RKN5_VELOCITY_WEIGHTS = np.array([14.0, 125.0, 162.0, 35.0]) / 336.0
# The velocity that drag and relativity see at a stage: exact for an acceleration that is constant, linear, quadratic
# in time, as far as the stages before it can tell.
RKN5_STAGE_VELOCITY = np.array([[0.0, 0, 0, 0], [1 / 5, 0, 0, 0], [-4 / 9, 10 / 9, 0, 0], [1 / 4, 0, 3 / 4, 0]])


@kernel
def _explicit(nodes, matrix, weights, forces, field, eop, t_gps_ns, x, dt_ns, drag_scale, empirical_rtn, work):
    """One explicit Runge-Kutta step of int64 dt_ns; False, and x untouched, outside the Earth-orientation table."""
    dt_s = dt_ns * 1e-9
    if not prepare(forces, field, eop, t_gps_ns + dt_ns // 2, work):
        return False
    r = work.r
    v = work.v
    for stage in range(nodes.shape[0]):
        for i in range(3):
            r[i] = 0.0
            v[i] = 0.0
        for earlier in range(stage):
            factor = matrix[stage, earlier]
            if factor != 0.0:
                for i in range(3):
                    r[i] += factor * work.stage_v[earlier, i]
                    v[i] += factor * work.stage_a[earlier, i]
        for i in range(3):
            r[i] = x[i] + dt_s * r[i]
            v[i] = x[3 + i] + dt_s * v[i]
            work.stage_v[stage, i] = v[i]
        moved = stage == 0 or nodes[stage] != nodes[stage - 1]
        if moved and not turn(eop, t_gps_ns + round(nodes[stage] * dt_ns), work):
            return False
        evaluate(forces, field, r[:], v[:], drag_scale, empirical_rtn[:], work, work.stage_a[stage])
    for i in range(3):
        r[i] = 0.0
        v[i] = 0.0
        for stage in range(nodes.shape[0]):
            r[i] += weights[stage] * work.stage_v[stage, i]
            v[i] += weights[stage] * work.stage_a[stage, i]
        x[i] += dt_s * r[i]
        x[3 + i] += dt_s * v[i]
    return True


@kernel
def rk4(forces, field, eop, t_gps_ns, x, dt_ns, drag_scale, empirical_rtn, work):
    """Classical Runge-Kutta of fourth order, one step of x = (r, v) in place; False outside the table."""
    return _explicit(
        RK4_NODES, RK4_MATRIX, RK4_WEIGHTS, forces, field, eop, t_gps_ns, x, dt_ns, drag_scale, empirical_rtn, work
    )


@kernel
def rk8(forces, field, eop, t_gps_ns, x, dt_ns, drag_scale, empirical_rtn, work):
    """Cooper and Verner's Runge-Kutta of eighth order with 11 stages, one step in place; False outside the table."""
    return _explicit(
        RK8_NODES, RK8_MATRIX, RK8_WEIGHTS, forces, field, eop, t_gps_ns, x, dt_ns, drag_scale, empirical_rtn, work
    )


@kernel
def rkn5(forces, field, eop, t_gps_ns, x, dt_ns, drag_scale, empirical_rtn, work):
    """Nyström's method of fifth order with 4 stages, one step in place; False, and x untouched, outside the table."""
    dt_s = dt_ns * 1e-9
    if not prepare(forces, field, eop, t_gps_ns + dt_ns // 2, work):
        return False
    a = work.stage_a
    for stage in range(4):
        for i in range(3):
            r = 0.0
            v = 0.0
            for earlier in range(stage):
                r += RKN5_MATRIX[stage, earlier] * a[earlier, i]
                v += RKN5_STAGE_VELOCITY[stage, earlier] * a[earlier, i]
            work.r[i] = x[i] + dt_s * (RKN5_NODES[stage] * x[3 + i] + dt_s * r)
            work.v[i] = x[3 + i] + dt_s * v
        if not turn(eop, t_gps_ns + round(RKN5_NODES[stage] * dt_ns), work):
            return False
        evaluate(forces, field, work.r[:], work.v[:], drag_scale, empirical_rtn[:], work, a[stage])
    for i in range(3):
        r = 0.0
        v = 0.0
        for stage in range(4):
            r += RKN5_POSITION_WEIGHTS[stage] * a[stage, i]
            v += RKN5_VELOCITY_WEIGHTS[stage] * a[stage, i]
        x[i] += dt_s * (x[3 + i] + dt_s * r)
        x[3 + i] += dt_s * v
    return True


@kernel
def advance(forces, field, eop, t_gps_ns, x, dt_ns, drag_scale, empirical_rtn, work):
    """Carry x = (r, v) [m, m/s, GCRF] from t over dt_ns of either sign, in equal steps no longer than the table's.

    The integrator is the table's. False outside the Earth-orientation table: x is then at the last step that worked.
    """
    length_ns = abs(dt_ns)
    steps = max(1, (length_ns + forces.step_max_ns - 1) // forces.step_max_ns)
    done_ns = 0
    for step in range(1, steps + 1):
        # whole nanoseconds that add up to dt_ns
        until_ns = dt_ns * step // steps
        part_ns = until_ns - done_ns
        if forces.integrator == RKN5:
            ok = rkn5(forces, field, eop, t_gps_ns + done_ns, x, part_ns, drag_scale, empirical_rtn, work)
        elif forces.integrator == RK8:
            ok = rk8(forces, field, eop, t_gps_ns + done_ns, x, part_ns, drag_scale, empirical_rtn, work)
        else:
            ok = rk4(forces, field, eop, t_gps_ns + done_ns, x, part_ns, drag_scale, empirical_rtn, work)
        if not ok:
            return False
        done_ns = until_ns
    return True


@entry(
    frozen_records(FORCE_TABLE),
    frozen_records(FIELD),
    frozen_records(ORIENTATION),
    I8,
    VECTOR,
    I8,
    F8,
    VECTOR,
    records(FORCE_WORK),
)
def propagate(forces, field, eop, t_gps_ns, x, dt_ns, drag_scale, empirical_rtn, work):
    """`advance` as Python calls it: tables, field and work as arrays of one record."""
    return advance(forces[0], field[0], eop[0], t_gps_ns, x, dt_ns, drag_scale, empirical_rtn, work[0])
