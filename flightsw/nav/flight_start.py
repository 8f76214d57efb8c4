"""The covariance that the flight filter starts with: of a state taken from fixes, all other states unknown."""

from __future__ import annotations

import math

from flightsw.kernels import udu
from flightsw.kernels.registry import kernel
from flightsw.nav import flight_model
from flightsw.nav.flight_model import AXES, BIAS, DRAG, PERIODIC


@kernel
def start(table, x, sigma_r_m, sigma_v_mps, arc_s, work, ud):
    """Factors of the covariance of a state that was just taken from one fix, all other states unknown.

    What the fix's position has of lasting GNSS errors is at once an error of r and a state of its own. arc_s: of the
    positions that the velocity was taken from, 0 if it was measured; what such an error has changed within the arc is
    an error of v too, and sigma_v_mps does not hold it.
    """
    n = flight_model.states(table)
    p = work.P_start
    p[:, :] = 0.0
    for i in range(AXES):
        p[i, i] = sigma_r_m * sigma_r_m
        p[3 + i, 3 + i] = sigma_v_mps * sigma_v_mps
        p[6 + i, 6 + i] = flight_model.empirical_sigma_mps2(table, x) ** 2
    p[DRAG, DRAG] = table.drag_sigma**2
    p[DRAG + 1, DRAG + 1] = table.drag_slow_sigma**2
    flight_model.rtn_basis(x, work.rtn)
    if n > BIAS:
        variance = table.gnss_bias_sigma_m**2
        for j in range(AXES):
            p[BIAS + j, BIAS + j] = variance
            for i in range(AXES):
                _relate(p, i, BIAS + j, -work.rtn[i, j] * variance)
            p[j, j] += variance
        if arc_s > 0.0:
            _vary_in_arc(table, arc_s, work, p)
    if n > PERIODIC:
        variance = table.gnss_periodic_sigma_m**2
        for j in range(AXES):
            state = PERIODIC + 2 * j
            p[state, state] = variance
            p[state + 1, state + 1] = variance
            for i in range(AXES):
                _relate(p, i, state, -work.rtn[i, j] * variance)
            p[j, j] += variance
    return udu.factorise(p, n, ud)


@kernel
def _vary_in_arc(table, arc_s, work, p):
    """Error of a velocity (b(t) - b(t - arc)) / arc by the lasting errors b; r and the states b have b(t), too."""
    fresh = -(table.gnss_bias_sigma_m**2) * math.expm1(-arc_s / table.gnss_bias_tau_s)
    for j in range(AXES):
        p[3 + j, 3 + j] += 2.0 * fresh / (arc_s * arc_s)
        _relate(p, j, 3 + j, fresh / arc_s)
        for i in range(AXES):
            _relate(p, 3 + i, BIAS + j, -work.rtn[i, j] * fresh / arc_s)


@kernel
def _relate(p, i, j, value):
    p[i, j] = value
    p[j, i] = value
