"""Lever arm: a receiver measures its antenna's phase centre, the filter's state is the centre of mass.

Body axes when nadir-pointing: z to the Earth, y against the orbit's angular momentum, x completes (forward). The
attitude comes from the bus where the table says so and while it is fresh; else the satellite is taken to point down.
"""

from __future__ import annotations

import math

from flightsw.icd.enums import RejectCause
from flightsw.kernels.registry import kernel
from flightsw.nav.flight_model import orbital_rate_radps, rtn_basis

_INVALID = int(RejectCause.ATTITUDE_INVALID)
_BUS = 1
TAKEN = -1


@kernel
def take_attitude(nav, table, inp, t_now_gps_ns):
    """Keep an attitude from the bus. Returns TAKEN or the RejectCause."""
    size = 0.0
    for i in range(4):
        size += inp.attitude_q[i] * inp.attitude_q[i]
    if not (abs(size - 1.0) <= 1e-3):  # float32 on the bus; NaN fails
        return _INVALID
    if not (inp.attitude_sigma_rad >= 0.0 and inp.attitude_sigma_rad <= math.pi):
        return _INVALID
    if inp.attitude_gps_ns <= nav.attitude_gps_ns:
        return _INVALID
    # a time far ahead would lock out all that follow; compared so that no difference can overflow
    if inp.attitude_gps_ns > t_now_gps_ns + int(table.attitude_max_age_s * 1e9):
        return _INVALID
    scale = 1.0 / math.sqrt(size)
    for i in range(4):
        nav.attitude_q[i] = scale * inp.attitude_q[i]
    nav.attitude_gps_ns = inp.attitude_gps_ns
    nav.attitude_sigma_rad = inp.attitude_sigma_rad
    return TAKEN


@kernel
def _is_fresh(nav, table, t_gps_ns):
    return (
        table.attitude_source == _BUS
        and nav.attitude_gps_ns > 0
        and abs(t_gps_ns - nav.attitude_gps_ns) <= table.attitude_max_age_s * 1e9
    )


@kernel
def _arm_m(table):
    return math.sqrt(table.lever_x_m**2 + table.lever_y_m**2 + table.lever_z_m**2)


@kernel
def sigma_m(nav, table, t_gps_ns):
    """1-sigma of each axis of the lever arm in GCRF: its own, and what the attitude's error makes of it."""
    attitude = nav.attitude_sigma_rad if _is_fresh(nav, table, t_gps_ns) else table.attitude_sigma_rad
    return math.hypot(table.lever_sigma_m, attitude * _arm_m(table))


@kernel
def offset(nav, table, t_gps_ns, x, work, dr_m, dv_mps):
    """Antenna minus centre of mass at the state x, into dr_m [m] and dv_mps [m/s], GCRF.

    The body turns with the orbit: dv = omega x dr, omega the orbital rate about the orbit normal.
    """
    for i in range(3):
        dr_m[i] = 0.0
        dv_mps[i] = 0.0
    if _arm_m(table) == 0.0:
        return
    rtn_basis(x, work.rtn)
    basis = work.rtn
    if _is_fresh(nav, table, t_gps_ns):
        # r_gcrf = q r_body q*
        w = nav.attitude_q[0]
        a = nav.attitude_q[1]
        b = nav.attitude_q[2]
        c = nav.attitude_q[3]
        lx = table.lever_x_m
        ly = table.lever_y_m
        lz = table.lever_z_m
        tx = 2.0 * (b * lz - c * ly)
        ty = 2.0 * (c * lx - a * lz)
        tz = 2.0 * (a * ly - b * lx)
        dr_m[0] = lx + w * tx + b * tz - c * ty
        dr_m[1] = ly + w * ty + c * tx - a * tz
        dr_m[2] = lz + w * tz + a * ty - b * tx
    else:
        for i in range(3):
            dr_m[i] = table.lever_x_m * basis[i, 1] - table.lever_y_m * basis[i, 2] - table.lever_z_m * basis[i, 0]
    rate = orbital_rate_radps(x)
    n0 = rate * basis[0, 2]
    n1 = rate * basis[1, 2]
    n2 = rate * basis[2, 2]
    dv_mps[0] = n1 * dr_m[2] - n2 * dr_m[1]
    dv_mps[1] = n2 * dr_m[0] - n0 * dr_m[2]
    dv_mps[2] = n0 * dr_m[1] - n1 * dr_m[0]


@kernel
def to_centre_of_mass(nav, table, t_gps_ns, x, work):
    """The fix in work.z [m, m/s, GCRF], measured at the antenna, as one of the centre of mass; x gives the orbit."""
    if _arm_m(table) == 0.0:
        return
    offset(nav, table, t_gps_ns, x, work, work.lever_m, work.three)
    for i in range(3):
        work.z[i] -= work.lever_m[i]
        work.z[3 + i] -= work.three[i]
