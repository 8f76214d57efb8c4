"""From ephemerides and measured ranges to residuals of links and their sensitivities.

A link is measured by one satellite, the receiver, of the signal of another, the sender. Ephemerides are positions and
velocities in an inertial frame at one epoch, and clocks as range. The residual is computed minus measured: with the
errors e (radial, along-track, cross-track, clock) of what the two satellites broadcast it is

    residual = h_receiver e_receiver + h_sender e_sender + noise,   h_receiver = (u R, u T, u N, 1), h_sender = -(...)

where u is the unit vector from sender to receiver, both at the instant of reception, and R, T, N are each satellite's
own axes. The signal itself comes from where the sender was, some 1e-5 rad beside: a millimetre for an error of 100 m. A
two-way range, the mean of both directions at one instant of reception, does not know the clocks: its fourth sensitivity
is zero.
"""

from __future__ import annotations

import math

from flightsw.crosslink.declare import kernel

LIGHT_MPS = 299_792_458.0
_MU_M3PS2 = 3.986004418e14


@kernel
def axes(r, v, out):
    """Rows of `out` (3,3): radial, along-track, cross-track unit vectors of a satellite at r [m] with v [m/s].

    False where they are not defined. CCSDS 500.0-G-4, RTN.
    """
    radius = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    n0 = r[1] * v[2] - r[2] * v[1]
    n1 = r[2] * v[0] - r[0] * v[2]
    n2 = r[0] * v[1] - r[1] * v[0]
    momentum = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if not (radius > 0.0) or not (momentum > 0.0) or radius == math.inf or momentum == math.inf:
        return False
    for i in range(3):
        out[0, i] = r[i] / radius
    out[2, 0] = n0 / momentum
    out[2, 1] = n1 / momentum
    out[2, 2] = n2 / momentum
    out[1, 0] = out[2, 1] * out[0, 2] - out[2, 2] * out[0, 1]
    out[1, 1] = out[2, 2] * out[0, 0] - out[2, 0] * out[0, 2]
    out[1, 2] = out[2, 0] * out[0, 1] - out[2, 1] * out[0, 0]
    return True


@kernel
def position_at(r, v, dt_s, out):
    """Position [m] dt_s later than (r, v), to the second order: within a flight time better than 0.1 mm."""
    square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    pull = _MU_M3PS2 / (square * math.sqrt(square))
    for i in range(3):
        out[i] = r[i] + dt_s * v[i] - 0.5 * dt_s * dt_s * pull * r[i]


@kernel
def line(r_receiver, r_sender, direction):
    """Unit vector from sender to receiver, zero where both say to be at one place.

    The other way it is the same to the last bit, but for the sign.
    """
    square = 0.0
    for i in range(3):
        direction[i] = r_receiver[i] - r_sender[i]
        square += direction[i] * direction[i]
    if square > 0.0:
        length = math.sqrt(square)
        for i in range(3):
            direction[i] /= length


@kernel
def flight_distance(r_receiver, r_sender, v_sender, work, direction):
    """Distance [m] from where the sender was when it sent to the receiver now; `direction` (3) is scratch.

    Positions and velocities of one epoch, that of reception; two iterations of the flight time.
    """
    tau_s = 0.0
    distance = 0.0
    for _ in range(3):
        position_at(r_sender, v_sender, -tau_s, work)
        square = 0.0
        for i in range(3):
            direction[i] = r_receiver[i] - work[i]
            square += direction[i] * direction[i]
        distance = math.sqrt(square)
        tau_s = distance / LIGHT_MPS
    return distance


@kernel
def sensitivity(direction, axes_of, sign, two_way, out):
    """out (4): of a link's residual to radial, along-track, cross-track [m] and clock [m] errors of one end."""
    for k in range(3):
        out[k] = sign * (direction[0] * axes_of[k, 0] + direction[1] * axes_of[k, 1] + direction[2] * axes_of[k, 2])
    out[3] = 0.0 if two_way else sign


@kernel
def link_residual(r, v, clock_m, axes_of, receiver, sender, range_m, two_way, work, direction, h):
    """Residual [m] of one link, computed minus measured; fills h (2,4): sensitivities to receiver and sender.

    r, v (n,3) [m, m/s] and clock_m (n) as broadcast, all at the instant of reception; axes_of (n,3,3).
    A one-way range holds the receiver's clock minus the sender's.
    """
    distance = 0.0
    if two_way:  # mean of both directions: their flight times do not cancel where the range changes
        distance = flight_distance(r[sender], r[receiver], v[receiver], work, direction)
    forward = flight_distance(r[receiver], r[sender], v[sender], work, direction)
    distance = 0.5 * (distance + forward) if two_way else forward
    line(r[receiver], r[sender], direction)
    sensitivity(direction, axes_of[receiver], 1.0, two_way, h[0])
    sensitivity(direction, axes_of[sender], -1.0, two_way, h[1])
    clocks = 0.0 if two_way else clock_m[receiver] - clock_m[sender]
    return distance + clocks - range_m
