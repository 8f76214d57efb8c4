"""Process model of the flight filter: x = (R, V, a).

R, V in GCRF; a [m/s2], empirical accelerations in RTN, are first-order Gauss-Markov processes: what the force model
lacks, not a stand-in for it. Beside them white accelerations in RTN (state noise compensation). The noise of a step is
exact for its length.
"""

from __future__ import annotations

import math

from flightsw.kernels.linalg import multiply, multiply_transposed, symmetrise
from flightsw.kernels.registry import kernel
from flightsw.records import STATES

PAPER = 0
FLIGHT = 1

# Gauss-Legendre nodes and weights on [0, 1], five points: exact to degree nine, and the kernels below are smooth
# over a step that is short beside the correlation times (Abramowitz and Stegun, table 25.4).
_NODES = (0.046910077030668, 0.230765344947158, 0.5, 0.769234655052842, 0.953089922969332)
_WEIGHTS = (0.118463442528095, 0.239314335249683, 0.284444444444444, 0.239314335249683, 0.118463442528095)


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
def _velocity_response(dt_s, tau_s):
    """Velocity that a decaying acceleration of 1 m/s2 at the start has given after dt."""
    return -tau_s * math.expm1(-dt_s / tau_s)


@kernel
def _position_response(dt_s, tau_s):
    """Position that it has given after dt."""
    return tau_s * (dt_s - _velocity_response(dt_s, tau_s))


@kernel
def _add_noise(noise, direction, state, sigma, tau_s, dt_s):
    """Exact noise of one Gauss-Markov acceleration along `direction` over dt, into `noise`.

    The noise that enters at time dt - s has acted for s; the integral over s is taken numerically.
    """
    density = 2.0 * sigma * sigma / tau_s
    rr = 0.0
    rv = 0.0
    vv = 0.0
    ra = 0.0
    va = 0.0
    aa = 0.0
    for node in range(5):
        s = _NODES[node] * dt_s
        w = _WEIGHTS[node] * dt_s * density
        r = _position_response(s, tau_s)
        v = _velocity_response(s, tau_s)
        a = math.exp(-s / tau_s)
        rr += w * r * r
        rv += w * r * v
        vv += w * v * v
        ra += w * r * a
        va += w * v * a
        aa += w * a * a
    for i in range(3):
        for j in range(3):
            outer = direction[i] * direction[j]
            noise[i, j] += rr * outer
            noise[i, 3 + j] += rv * outer
            noise[3 + i, j] += rv * outer
            noise[3 + i, 3 + j] += vv * outer
        noise[i, state] += ra * direction[i]
        noise[state, i] += ra * direction[i]
        noise[3 + i, state] += va * direction[i]
        noise[state, 3 + i] += va * direction[i]
    noise[state, state] += aa


@kernel
def _add_white(noise, direction, density, dt_s):
    rr = density * dt_s**3 / 3.0
    rv = density * dt_s * dt_s / 2.0
    vv = density * dt_s
    for i in range(3):
        for j in range(3):
            outer = direction[i] * direction[j]
            noise[i, j] += rr * outer
            noise[i, 3 + j] += rv * outer
            noise[3 + i, j] += rv * outer
            noise[3 + i, 3 + j] += vv * outer


@kernel
def transition(table, x, dt_s, work):
    """Jacobian of a step into work.phi and its noise into work.noise.

    Needs work.gradient, the gravity gradient at x.
    """
    phi = work.phi
    g = work.gradient
    basis = work.rtn
    rtn_basis(x, basis)
    half = 0.5 * dt_s * dt_s
    tau = table.empirical_tau_s
    to_r = _position_response(dt_s, tau)
    to_v = _velocity_response(dt_s, tau)
    phi[:, :] = 0.0
    for i in range(3):
        for j in range(3):
            phi[i, j] = half * g[i, j]
            phi[i, 3 + j] = dt_s * half / 3.0 * g[i, j]
            phi[3 + i, j] = dt_s * g[i, j]
            phi[3 + i, 3 + j] = half * g[i, j]
            phi[i, 6 + j] = to_r * basis[i, j]
            phi[3 + i, 6 + j] = to_v * basis[i, j]
    for i in range(3):
        phi[i, i] += 1.0
        phi[i, 3 + i] += dt_s
        phi[3 + i, 3 + i] += 1.0
        phi[6 + i, 6 + i] = math.exp(-dt_s / tau)

    noise = work.noise
    noise[:, :] = 0.0
    for axis in range(3):
        _add_noise(noise, basis[:, axis], 6 + axis, table.empirical_sigma_mps2, tau, dt_s)
    _add_white(noise, basis[:, 0], table.white_radial_m2ps3, dt_s)
    _add_white(noise, basis[:, 1], table.white_along_m2ps3, dt_s)
    _add_white(noise, basis[:, 2], table.white_cross_m2ps3, dt_s)


@kernel
def propagate(p, factor, work, out):
    """out = Phi P Phi' + factor Q with Phi in work.phi and Q in work.noise; `out` may be `p`."""
    multiply(work.phi, p, work.square)
    multiply_transposed(work.square, work.phi, out)
    for i in range(STATES):
        for j in range(STATES):
            out[i, j] += factor * work.noise[i, j]
    symmetrise(out)
