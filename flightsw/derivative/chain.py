"""Kernels of one polynomial chain: transition, noise of its last integrator, prediction, scalar update.

x1' = x2, ..., xn' = w, w white of density q (A. Gelb, Applied Optimal Estimation, 1974, section 4.6); z = x1 + noise.
"""

from __future__ import annotations

from flightsw.derivative.declare import kernel


@kernel
def transition(n, dt_s, phi):
    """phi[i, j] = dt^(j-i) / (j-i)!, for a step of dt_s [s]."""
    for i in range(n):
        value = 1.0
        for j in range(n):
            if j < i:
                phi[i, j] = 0.0
            else:
                if j > i:
                    value *= dt_s / (j - i)
                phi[i, j] = value


@kernel
def driven(n, dt_s, q, noise):
    """Covariance of what white noise of density q in the last integrator does in a step of dt_s [s]."""
    for i in range(n):
        for j in range(n):
            a, b = n - 1 - i, n - 1 - j
            value = q * dt_s / (a + b + 1)
            for k in range(1, a + 1):
                value *= dt_s / k
            for k in range(1, b + 1):
                value *= dt_s / k
            noise[i, j] = value


@kernel
def predict(n, phi, noise, x, p, square):
    """x and p a step on, in place; square: scratch."""
    for i in range(n):
        total = 0.0
        for j in range(i, n):
            total += phi[i, j] * x[j]
        x[i] = total  # reads only what is at or beyond i
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(i, n):
                total += phi[i, k] * p[k, j]
            square[i, j] = total
    for i in range(n):
        for j in range(i + 1):
            total = noise[i, j]
            for k in range(j, n):
                total += square[i, k] * phi[j, k]
            p[i, j] = p[j, i] = total


@kernel
def update(n, z, r, x, p, gain):
    """x and p with a measurement z of variance r, in place; leaves the gain. Returns misfit and its variance.

    Joseph's form would guard a covariance against rounding; with one scalar measurement and symmetric storage the
    short form loses nothing that the tests against exact arithmetic see.
    """
    misfit, variance = z - x[0], p[0, 0] + r
    for i in range(n):
        gain[i] = p[i, 0] / variance
    for i in range(n):
        x[i] += gain[i] * misfit
        for j in range(i + 1):
            p[i, j] -= gain[i] * gain[j] * variance
            p[j, i] = p[i, j]
    return misfit, variance


@kernel
def begin(states, n, z, r, start_sigma, x, p):
    """A chain that knows a position z of variance r and nothing of its derivatives but start_sigma."""
    for i in range(states):
        x[i] = 0.0
        for j in range(states):
            p[i, j] = 0.0
    x[0], p[0, 0] = z, r
    for i in range(1, n):
        p[i, i] = start_sigma[i] * start_sigma[i]
