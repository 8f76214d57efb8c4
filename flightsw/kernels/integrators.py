"""One step of the equations of motion, dR = V, dV = g(R) + dA, with dA constant over the step."""

from __future__ import annotations

from flightsw.kernels.gravity import acceleration
from flightsw.kernels.registry import kernel

EULER = 0
RK4 = 1


@kernel
def euler(table, x, dt_s, pole, work):
    """Explicit Euler, the paper's equation (3): x [m, m/s, m/s2] in place; `work` holds at least (1, 3)."""
    a = work[0]
    acceleration(table, x[0:3], pole, a)
    for i in range(3):
        x[i] += dt_s * x[3 + i]
        x[3 + i] += dt_s * (a[i] + x[6 + i])


@kernel
def rk4(table, x, dt_s, pole, work):
    """Classical Runge-Kutta of fourth order: x [m, m/s, m/s2] in place; `work` holds at least (6, 3)."""
    r = work[0]
    v = work[1]
    a = work[2]
    sum_v = work[3]
    sum_a = work[4]
    for i in range(3):
        r[i] = x[i]
        v[i] = x[3 + i]
        sum_v[i] = 0.0
        sum_a[i] = 0.0
    for stage in range(4):
        acceleration(table, r, pole, a)
        weight = 1.0 if stage == 0 or stage == 3 else 2.0
        ahead = dt_s if stage == 2 else 0.5 * dt_s
        for i in range(3):
            a[i] += x[6 + i]
            sum_v[i] += weight * v[i]
            sum_a[i] += weight * a[i]
            r[i] = x[i] + ahead * v[i]
            v[i] = x[3 + i] + ahead * a[i]
    for i in range(3):
        x[i] += dt_s / 6.0 * sum_v[i]
        x[3 + i] += dt_s / 6.0 * sum_a[i]


@kernel
def advance(table, x, dt_s, pole, work):
    """One step with the integrator that the table names."""
    if table.integrator == RK4:
        rk4(table, x, dt_s, pole, work)
    else:
        euler(table, x, dt_s, pole, work)
