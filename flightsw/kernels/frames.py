"""GCRF and ITRF from the Earth-orientation table: the IAU 2006/2000A CIO-based transformation.

Source: IERS Conventions (2010), chapter 5: [ITRS] = W' R3(ERA) Q' [GCRS], equations 5.1 to 5.15.
The table holds the slow quantities at equidistant nodes; flight interpolates them with four points.
"""

from __future__ import annotations

import math

from flightsw.kernels.linalg import multiply
from flightsw.kernels.registry import kernel

_DAY_NS = 86_400_000_000_000
# Days from J2000.0 (JD 2451545.0) to the GPS epoch (JD 2444244.5).
_GPS_EPOCH_FROM_J2000_DAYS = 2444244.5 - 2451545.0
# IERS Conventions (2010), equation 5.15: ERA in turns.
_ERA_AT_J2000_TURNS = 0.7790572732640
_ERA_RATE_EXCESS = 0.00273781191135448
# IERS Conventions (2010), section 5.5.2: s' = -47 microarcseconds per century.
_S_PRIME_RAD_PER_DAY = -47e-6 / 36525.0 * math.pi / 648000.0
_TWO_PI = 2.0 * math.pi

X, Y, S, XP, YP, UT1 = range(6)


@kernel
def covers(eop, t_gps_ns):
    """Whether the table can be interpolated at this time with a node on each outer side."""
    first = eop.t0_gps_ns + eop.step_ns
    last = eop.t0_gps_ns + (eop.count - 2) * eop.step_ns
    return first <= t_gps_ns and t_gps_ns < last


@kernel
def interpolate(eop, t_gps_ns, value, rate):
    """Cubic Lagrange value and rate [per s] of the six quantities; the time must be covered."""
    step_s = eop.step_ns * 1e-9
    index = (t_gps_ns - eop.t0_gps_ns) // eop.step_ns
    u = (t_gps_ns - eop.t0_gps_ns - index * eop.step_ns) / eop.step_ns
    w0 = -u * (u - 1.0) * (u - 2.0) / 6.0
    w1 = (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0
    w2 = -(u + 1.0) * u * (u - 2.0) / 2.0
    w3 = (u + 1.0) * u * (u - 1.0) / 6.0
    d0 = -(3.0 * u * u - 6.0 * u + 2.0) / 6.0
    d1 = (3.0 * u * u - 4.0 * u - 1.0) / 2.0
    d2 = -(3.0 * u * u - 2.0 * u - 2.0) / 2.0
    d3 = (3.0 * u * u - 1.0) / 6.0
    nodes = eop.nodes
    for i in range(6):
        p0 = nodes[index - 1, i]
        p1 = nodes[index, i]
        p2 = nodes[index + 1, i]
        p3 = nodes[index + 2, i]
        value[i] = w0 * p0 + w1 * p1 + w2 * p2 + w3 * p3
        rate[i] = (d0 * p0 + d1 * p1 + d2 * p2 + d3 * p3) / step_s


@kernel
def pole_gcrf(eop, t_gps_ns, work, out):
    """Unit vector of the celestial intermediate pole in GCRF; False, and `out` untouched, outside the table."""
    if not covers(eop, t_gps_ns):
        return False
    value = work.orientation
    rate = work.orientation_rate
    interpolate(eop, t_gps_ns, value, rate)
    out[0] = value[X]
    out[1] = value[Y]
    out[2] = math.sqrt(1.0 - value[X] * value[X] - value[Y] * value[Y])
    return True


@kernel
def itrf_from_gcrf(eop, t_gps_ns, work, matrix, matrix_rate):
    """The rotation GCRF to ITRF (3x3) and its time derivative [1/s]; False outside the table.

    r_itrf = matrix r_gcrf and v_itrf = matrix v_gcrf + matrix_rate r_gcrf. The derivative holds the Earth's
    rotation with its irregularity about the true pole, and the motion of that pole in GCRF.
    """
    if not covers(eop, t_gps_ns):
        return False
    value = work.orientation
    rate = work.orientation_rate
    interpolate(eop, t_gps_ns, value, rate)

    x = value[X]
    y = value[Y]
    a = 1.0 / (1.0 + math.sqrt(1.0 - x * x - y * y))
    cirs = work.cirs
    cirs_rate = work.cirs_rate
    cirs_rate[:, :] = 0.0
    cirs[0, 0] = 1.0 - a * x * x
    cirs[0, 1] = -a * x * y
    cirs[0, 2] = -x
    cirs[1, 0] = -a * x * y
    cirs[1, 1] = 1.0 - a * y * y
    cirs[1, 2] = -y
    cirs[2, 0] = x
    cirs[2, 1] = y
    cirs[2, 2] = 1.0 - a * (x * x + y * y)
    cirs_rate[0, 2] = -rate[X]
    cirs_rate[1, 2] = -rate[Y]
    cirs_rate[2, 0] = rate[X]
    cirs_rate[2, 1] = rate[Y]

    whole_days = t_gps_ns // _DAY_NS
    day = (t_gps_ns - whole_days * _DAY_NS) / _DAY_NS + value[UT1] / 86400.0
    days = whole_days + _GPS_EPOCH_FROM_J2000_DAYS + day
    # The whole turns are left out before they cost digits: days are whole plus one half here.
    turns = _ERA_AT_J2000_TURNS + _ERA_RATE_EXCESS * days + day - 0.5
    # R3(-s) of Q' and R3(ERA) turn about the same axis.
    angle = _TWO_PI * (turns - math.floor(turns)) - value[S]
    angle_rate = _TWO_PI * (1.0 + _ERA_RATE_EXCESS) * (1.0 + rate[UT1]) / 86400.0 - rate[S]
    c = math.cos(angle)
    s = math.sin(angle)
    spin = work.spin
    spin[:, :] = 0.0
    spin[0, 0] = c
    spin[0, 1] = s
    spin[1, 0] = -s
    spin[1, 1] = c
    spin[2, 2] = 1.0
    spin_rate = work.spin_rate
    spin_rate[:, :] = 0.0
    spin_rate[0, 0] = -s * angle_rate
    spin_rate[0, 1] = c * angle_rate
    spin_rate[1, 0] = -c * angle_rate
    spin_rate[1, 1] = -s * angle_rate

    # W' = R1(-yp) R2(-xp) R3(s')
    sp = _S_PRIME_RAD_PER_DAY * days
    cx = math.cos(value[XP])
    sx = math.sin(value[XP])
    cy = math.cos(value[YP])
    sy = math.sin(value[YP])
    cs = math.cos(sp)
    ss = math.sin(sp)
    wobble = work.wobble
    wobble[0, 0] = cx * cs
    wobble[0, 1] = cx * ss
    wobble[0, 2] = sx
    wobble[1, 0] = sy * sx * cs - cy * ss
    wobble[1, 1] = sy * sx * ss + cy * cs
    wobble[1, 2] = -sy * cx
    wobble[2, 0] = -cy * sx * cs - sy * ss
    wobble[2, 1] = -cy * sx * ss + sy * cs
    wobble[2, 2] = cy * cx

    first = work.product
    second = work.product_rate
    multiply(wobble, spin, first)
    multiply(first, cirs, matrix)
    multiply(first, cirs_rate, second)
    multiply(wobble, spin_rate, first)
    multiply(first, cirs, matrix_rate)
    for i in range(3):
        for j in range(3):
            matrix_rate[i, j] += second[i, j]
    return True
