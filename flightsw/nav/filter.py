"""The nine-state extended Kalman filter of the paper, equations (2) to (10), x = (R, V, dA) in GCRF."""

from __future__ import annotations

import math

from flightsw.kernels import integrators
from flightsw.kernels.registry import kernel
from flightsw.records import MEASUREMENTS, PAPER_STATES


@kernel
def transition(table, dt_s, g, work):
    """Jacobian of one step of length dt_s, with g the gradient of gravity at its beginning, in the blocks that it has:

        1 + s G    tau      s                                                       tau G  in work.phi_pull,
        tau G      1 + s G  tau     with s = tau^2 / 2 for RK4, 0 for Euler;        tau    in work.phi_step_s,
        0          0        1                                                       s      in work.phi_square_s2

    With Euler it is the paper's Phi, exactly the derivative of (3). With RK4 it is the exponential of the
    Jacobian to second order: what it leaves out, G tau^3 / 6, is below 5e-7 s for a step of 1 s.
    """
    work.phi_step_s = dt_s
    work.phi_square_s2 = 0.5 * dt_s * dt_s if table.integrator == integrators.RK4 else 0.0
    for i in range(3):
        for j in range(3):
            work.phi_pull[i, j] = dt_s * g[i, j]


@kernel
def propagate(p, q_r, q_v, q_a, work, out):
    """out = Phi P Phi' + Q with the blocks of `transition` and a diagonal Q; `out` may be `p`, which is symmetric."""
    pull, m = work.phi_pull, work.square
    dt_s, second_order = work.phi_step_s, work.phi_square_s2
    half_s = 0.5 * dt_s
    for i in range(3):  # m = Phi P, but for its last three rows: those of P
        g0, g1, g2 = pull[i, 0], pull[i, 1], pull[i, 2]
        for j in range(PAPER_STATES):
            m[i, j] = p[i, j] + dt_s * p[3 + i, j]
            m[3 + i, j] = p[3 + i, j] + dt_s * p[6 + i, j] + (g0 * p[0, j] + g1 * p[1, j] + g2 * p[2, j])
    if second_order > 0.0:
        for i in range(3):
            g0, g1, g2 = half_s * pull[i, 0], half_s * pull[i, 1], half_s * pull[i, 2]
            for j in range(PAPER_STATES):
                m[i, j] += second_order * p[6 + i, j] + (g0 * p[0, j] + g1 * p[1, j] + g2 * p[2, j])
                m[3 + i, j] += g0 * p[3, j] + g1 * p[4, j] + g2 * p[5, j]
    for i in range(3):
        for j in range(3):
            out[6 + i, 6 + j] = p[6 + i, 6 + j]
    for j in range(3):  # out = m Phi', from the diagonal on
        g0, g1, g2 = pull[j, 0], pull[j, 1], pull[j, 2]
        for i in range(3):
            out[i, j] = m[i, j] + dt_s * m[i, 3 + j]
            out[i, 6 + j] = m[i, 6 + j]
            out[3 + i, 6 + j] = m[3 + i, 6 + j]
        for i in range(6):
            out[i, 3 + j] = m[i, 3 + j] + dt_s * m[i, 6 + j] + (g0 * m[i, 0] + g1 * m[i, 1] + g2 * m[i, 2])
    if second_order > 0.0:
        for j in range(3):
            g0, g1, g2 = half_s * pull[j, 0], half_s * pull[j, 1], half_s * pull[j, 2]
            for i in range(3):
                out[i, j] += second_order * m[i, 6 + j] + (g0 * m[i, 0] + g1 * m[i, 1] + g2 * m[i, 2])
            for i in range(6):
                out[i, 3 + j] += g0 * m[i, 3] + g1 * m[i, 4] + g2 * m[i, 5]
    for i in range(3):
        out[i, i] += q_r
        out[3 + i, 3 + i] += q_v
        out[6 + i, 6 + i] += q_a
    _mirror(out)


@kernel
def _mirror(a):
    """What is above the diagonal below it as well; of the two blocks that are computed whole, the mean of both."""
    for i in range(3):
        for j in range(i):
            for block in range(0, MEASUREMENTS, 3):
                mean = 0.5 * (a[block + i, block + j] + a[block + j, block + i])
                a[block + i, block + j] = mean
                a[block + j, block + i] = mean
        for j in range(3):
            a[3 + i, j] = a[j, 3 + i]
            a[6 + i, j] = a[j, 6 + i]
            a[6 + i, 3 + j] = a[3 + j, 6 + i]


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
    """The gain (8) from covariance `p` and noise `r` (6x6), transposed (6x9) into work.gain; False if not definite.

    Leaves the variances of the innovation in work.innovation_variance, the factors L and 1 / D of its covariance in
    work.lower and work.weight_d.
    """
    if not _factorise(p, r, work.innovation_variance, work.lower, work.weight_d):
        return False
    _substitute(work.lower, work.weight_d, p, work.gain)
    return True


@kernel
def _factorise(p, r, variance, lower, inverse):
    """L and 1 / D of S = H P H' + R = L D L', S_ii into `variance`; False where S is not positive definite or finite.

    A division for each row and no root: they wait for one another, and are what a small factorisation costs.
    """
    for i in range(MEASUREMENTS):
        variance[i] = p[i, i] + r[i, i]
    for i in range(MEASUREMENTS):
        total = variance[i]
        for j in range(i):
            row = p[i, j] + r[i, j]
            for k in range(j):
                row -= lower[i, k] * lower[j, k]
            lower[i, j] = row
        for j in range(i):
            share = lower[i, j] * inverse[j]
            total -= lower[i, j] * share
            lower[i, j] = share
        if not (total > 0.0) or total == math.inf:  # NaN fails the first comparison
            return False
        inverse[i] = 1.0 / total
    return True


@kernel
def _substitute(lower, inverse, p, k):
    """k (6x9): L D L' k = the first six rows of p. Written out, so that the compiler does several columns at once."""
    l10, l20, l30, l40, l50 = lower[1, 0], lower[2, 0], lower[3, 0], lower[4, 0], lower[5, 0]
    l21, l31, l41, l51 = lower[2, 1], lower[3, 1], lower[4, 1], lower[5, 1]
    l32, l42, l52 = lower[3, 2], lower[4, 2], lower[5, 2]
    l43, l53, l54 = lower[4, 3], lower[5, 3], lower[5, 4]
    d0, d1, d2, d3, d4, d5 = inverse[0], inverse[1], inverse[2], inverse[3], inverse[4], inverse[5]
    for j in range(PAPER_STATES):
        y0 = p[0, j]
        y1 = p[1, j] - l10 * y0
        y2 = p[2, j] - l20 * y0 - l21 * y1
        y3 = p[3, j] - l30 * y0 - l31 * y1 - l32 * y2
        y4 = p[4, j] - l40 * y0 - l41 * y1 - l42 * y2 - l43 * y3
        y5 = p[5, j] - l50 * y0 - l51 * y1 - l52 * y2 - l53 * y3 - l54 * y4
        y5 = d5 * y5
        y4 = d4 * y4 - l54 * y5
        y3 = d3 * y3 - l53 * y5 - l43 * y4
        y2 = d2 * y2 - l52 * y5 - l42 * y4 - l32 * y3
        y1 = d1 * y1 - l51 * y5 - l41 * y4 - l31 * y3 - l21 * y2
        y0 = d0 * y0 - l50 * y5 - l40 * y4 - l30 * y3 - l20 * y2 - l10 * y1
        k[0, j], k[1, j], k[2, j], k[3, j], k[4, j], k[5, j] = y0, y1, y2, y3, y4, y5


@kernel
def condition(p, r, work, out):
    """out = (I - K H) P, equation (10), with K' in work.gain; `out` may be `p`. Noise `r` of r and v apart.

    What is measured takes the form R S^-1 H P, which has no difference of nearly equal numbers in it: it stays positive
    where (10) as printed would not, with a gain near one. Symmetric to the last bit.
    """
    k = work.gain
    for i in range(3):
        for j in range(3):
            total = p[6 + i, 6 + j]
            for m in range(MEASUREMENTS):
                total -= k[m, 6 + i] * p[m, 6 + j]
            out[6 + i, 6 + j] = total
    for i in range(3):
        r0, r1, r2 = r[i, 0], r[i, 1], r[i, 2]
        for j in range(PAPER_STATES):
            out[i, j] = r0 * k[0, j] + r1 * k[1, j] + r2 * k[2, j]
        r0, r1, r2 = r[3 + i, 3], r[3 + i, 4], r[3 + i, 5]
        for j in range(3, PAPER_STATES):
            out[3 + i, j] = r0 * k[3, j] + r1 * k[4, j] + r2 * k[5, j]
    for i in range(3):
        for j in range(i):
            mean = 0.5 * (out[6 + i, 6 + j] + out[6 + j, 6 + i])
            out[6 + i, 6 + j] = mean
            out[6 + j, 6 + i] = mean
    _mirror(out)


@kernel
def innovate(table, x, p, work, out):
    """Innovation of the fix in work.z, work.R against x and p into the output record.

    Fills out.innovation, out.innovation_sigma, out.nis and work.gain; False if the innovation covariance is not
    positive definite, in which case the fix cannot be used.
    """
    ok = gain(p, work.R, work)
    for i in range(MEASUREMENTS):
        out.innovation[i] = work.z[i] - x[i]
        out.innovation_sigma[i] = math.sqrt(max(work.innovation_variance[i], 0.0))
    out.gate = table.gate_nis
    if not ok:
        return False
    nis = 0.0
    for i in range(MEASUREMENTS):
        total = out.innovation[i]
        for m in range(i):
            total -= work.lower[i, m] * work.column[m]
        work.column[i] = total
        nis += total * total * work.weight_d[i]
    out.nis = nis
    return True


@kernel
def correct(x, p, work, out):
    """Equations (9) and (10): x and p in place, from work.gain and out.innovation."""
    for m in range(MEASUREMENTS):
        for i in range(PAPER_STATES):
            x[i] += work.gain[m, i] * out.innovation[m]
    condition(p, work.R, work, p)


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
