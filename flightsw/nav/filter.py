"""The nine-state extended Kalman filter of the paper, equations (2) to (10), x = (R, V, dA) in GCRF."""

from __future__ import annotations

from flightsw.kernels import integrators
from flightsw.kernels.linalg import (
    cholesky,
    multiply,
    multiply_transposed,
    solve_lower,
    solve_lower_transposed,
    symmetrise,
)
from flightsw.kernels.registry import kernel
from flightsw.records import MEASUREMENTS, PAPER_STATES


@kernel
def transition(table, x, dt_s, g, work):
    """Jacobian of one step of length dt_s at x into work.phi, with g the gradient of gravity there.

    With Euler it is the paper's Phi, exactly the derivative of (3). With RK4 it is the exponential of the
    Jacobian to second order: what it leaves out, G tau^3 / 6, is below 5e-7 s for a step of 1 s.
    """
    phi = work.phi
    phi[:, :] = 0.0
    second_order = 0.5 * dt_s * dt_s if table.integrator == integrators.RK4 else 0.0
    for i in range(3):
        for j in range(3):
            phi[i, j] = second_order * g[i, j]
            phi[3 + i, j] = dt_s * g[i, j]
            phi[3 + i, 3 + j] = second_order * g[i, j]
    for i in range(3):
        phi[i, i] += 1.0
        phi[i, 3 + i] = dt_s
        phi[i, 6 + i] = second_order
        phi[3 + i, 3 + i] += 1.0
        phi[3 + i, 6 + i] = dt_s
        phi[6 + i, 6 + i] = 1.0


@kernel
def propagate(p, q_r, q_v, q_a, work, out):
    """out = Phi P Phi' + Q with Phi in work.phi and a diagonal Q; `out` may be `p`."""
    multiply(work.phi, p, work.square)
    multiply_transposed(work.square, work.phi, out)
    for i in range(3):
        out[i, i] += q_r
        out[3 + i, 3 + i] += q_v
        out[6 + i, 6 + i] += q_a
    symmetrise(out)


@kernel
def predict_covariance(table, row, share, p, work, out):
    """Equation (7) over `share` of a step with the noise of a tuning row; `out` may be `p`."""
    propagate(
        p,
        share * table.tuning_q_r_m2[row],
        share * table.tuning_q_v_m2ps2[row],
        share * table.tuning_q_a_m2ps4[row],
        work,
        out,
    )


@kernel
def gain(p, r, work):
    """Kalman gain (8) into work.gain from covariance `p` (9x9) and noise `r` (6x6); False if not definite.

    Leaves the Cholesky factor of the innovation covariance in work.lower.
    """
    s = work.innovation_p
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            s[i, j] = p[i, j] + r[i, j]
    if not cholesky(s, work.lower):
        return False
    for state in range(PAPER_STATES):
        row = work.gain[state]
        for j in range(MEASUREMENTS):
            row[j] = p[state, j]
        solve_lower(work.lower, row, row)
        solve_lower_transposed(work.lower, row, row)
    return True


@kernel
def joseph(p, r, work, out):
    """out = (I - K H) P (I - K H)' + K R K', with K in work.gain; `out` may be `p`.

    Equal to (10) for the optimal gain, but symmetric and positive for any rounding of it.
    """
    form = work.gain_form
    k = work.gain
    for i in range(PAPER_STATES):
        for j in range(PAPER_STATES):
            form[i, j] = 1.0 if i == j else 0.0
        for j in range(MEASUREMENTS):
            form[i, j] -= k[i, j]
    multiply(form, p, work.square)
    multiply(k, r, work.gain_noise)
    multiply_transposed(work.square, form, out)
    for i in range(PAPER_STATES):
        for j in range(PAPER_STATES):
            total = 0.0
            for m in range(MEASUREMENTS):
                total += work.gain_noise[i, m] * k[j, m]
            out[i, j] += total
    symmetrise(out)


@kernel
def innovate(table, x, p, work, out):
    """Innovation of the fix in work.z, work.R against x and p into the output record.

    Fills out.innovation, out.innovation_sigma, out.nis and work.gain; False if the innovation covariance is not
    positive definite, in which case the fix cannot be used.
    """
    ok = gain(p, work.R, work)
    for i in range(MEASUREMENTS):
        out.innovation[i] = work.z[i] - x[i]
        out.innovation_sigma[i] = work.innovation_p[i, i] ** 0.5
    out.gate = table.gate_nis
    if not ok:
        return False
    solve_lower(work.lower, out.innovation, work.column)
    nis = 0.0
    for i in range(MEASUREMENTS):
        nis += work.column[i] * work.column[i]
    out.nis = nis
    return True


@kernel
def correct(x, p, work, out):
    """Equations (9) and (10): x and p in place, from work.gain and out.innovation."""
    for i in range(PAPER_STATES):
        for j in range(MEASUREMENTS):
            x[i] += work.gain[i, j] * out.innovation[j]
    joseph(p, work.R, work, p)


@kernel
def is_sound(table, x, p):
    """Whether state and covariance are finite, variances positive and correlations possible."""
    for i in range(PAPER_STATES):
        if not (abs(x[i]) < 1e300):
            return False
        for j in range(PAPER_STATES):
            if not (abs(p[i, j]) < 1e300):
                return False
        if not (p[i, i] > 0.0):
            return False
    for i in range(PAPER_STATES):
        for j in range(i):
            if p[i, j] * p[i, j] > p[i, i] * p[j, j] * (1.0 + table.correlation_excess):
                return False
    return True
