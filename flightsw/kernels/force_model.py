"""The force model that flies beside the paper's: high-degree gravity, Sun, Moon, tides, drag, sunlight, relativity.

`prepare` finds what hardly moves within a step (Sun, Moon, tide), `turn` the Earth's rotation of an instant, and
`evaluate` sums the forces; integrators call them in that order (kernels/orbit_integrators.py). `acceleration` is all
three at one instant. Every one answers False, and its results mean nothing, outside the Earth-orientation table.
"""

from __future__ import annotations

import math

from flightsw.kernels import atmosphere, bodies, frames, spherical_harmonics, surface_forces
from flightsw.kernels.registry import F8, I8, VECTOR, entry, frozen_records, kernel, records
from flightsw.records import FIELD, FORCE_TABLE, FORCE_WORK, ORIENTATION

_LIGHT_MPS = 299792458.0


@kernel
def turn(eop, t_gps_ns, work):
    """The Earth's rotation at t into work; False outside the table."""
    return frames.itrf_from_gcrf(eop, t_gps_ns, work, work.itrf_from_gcrf, work.itrf_from_gcrf_rate)


@kernel
def _to_itrf(work, vector, out):
    m = work.itrf_from_gcrf
    for i in range(3):
        out[i] = m[i, 0] * vector[0] + m[i, 1] * vector[1] + m[i, 2] * vector[2]


@kernel
def prepare(forces, field, eop, t_gps_ns, work):
    """Sun, Moon, tide and season at t, for the evaluations of a step around t; False outside the table.

    Over a step of a minute the Moon moves by 2e-4 of its distance: taken at the middle of the step, the error of its
    attraction changes sign there and stays below 1e-10 m/s2.
    """
    bodies.sun_position(t_gps_ns, work.sun_m)
    bodies.moon_position(t_gps_ns, work.moon_m)
    work.semiannual = atmosphere.semiannual_phase(bodies.centuries(t_gps_ns))
    work.tide[:, :] = 0.0
    if forces.solid_tides == 0:
        return True
    if not turn(eop, t_gps_ns, work):
        return False
    form = work.product
    form[:, :] = 0.0
    _to_itrf(work, work.sun_m, work.body)
    bodies.add_tide(field, bodies.GM_SUN_M3PS2, work.body, form)
    _to_itrf(work, work.moon_m, work.body)
    bodies.add_tide(field, bodies.GM_MOON_M3PS2, work.body, form)
    bodies.subtract_permanent_tide(field, form)
    m = work.itrf_from_gcrf
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                for p in range(3):
                    total += m[k, i] * form[k, p] * m[p, j]
            work.tide[i, j] = total
    return True


@kernel
def evaluate(forces, field, r, v, drag_scale, empirical_rtn, work, out):
    """Acceleration at r, v [m, m/s, GCRF] into out [m/s2], at the instant of `turn`, around that of `prepare`.

    drag_scale: factor on drag. empirical_rtn (3,): what the model lacks [m/s2], along radius, track, orbit normal.
    Called with slices, of records' fields too: to numba these are other types, and all below would be compiled twice.
    """
    _to_itrf(work, r, work.r_itrf)
    spherical_harmonics.acceleration(field, work.r_itrf, work, work.a_itrf)
    m = work.itrf_from_gcrf
    a = work.a_itrf
    for i in range(3):
        out[i] = m[0, i] * a[0] + m[1, i] * a[1] + m[2, i] * a[2]
    if forces.sun == 1:
        bodies.add_third_body(bodies.GM_SUN_M3PS2, r, work.sun_m, out)
    if forces.moon == 1:
        bodies.add_third_body(bodies.GM_MOON_M3PS2, r, work.moon_m, out)
    if forces.solid_tides == 1:
        bodies.add_tidal_acceleration(field, work.tide, r, out)
    if forces.relativity == 1:
        add_relativity(field.gm_m3ps2, r, v, out)
    if forces.area_to_mass_m2pkg > 0.0:
        drag = work.drag_mps2
        surface_forces.drag(forces, work.semiannual, work.sun_m, m[2], r, v, drag)
        for i in range(3):
            out[i] += drag_scale * drag[i]
        surface_forces.add_radiation(forces, r, work.sun_m, out)
    add_rtn(r, v, empirical_rtn, out)


@kernel
def acceleration(forces, field, eop, t_gps_ns, r, v, drag_scale, empirical_rtn, work, out):
    """All forces at one instant: r, v [m, m/s, GCRF] to out [m/s2]; False outside the Earth-orientation table."""
    if not prepare(forces, field, eop, t_gps_ns, work):
        return False
    if not turn(eop, t_gps_ns, work):
        return False
    evaluate(forces, field, r[:], v[:], drag_scale, empirical_rtn[:], work, out[:])
    return True


@kernel
def gradient(field, r, work, out):
    """d(acceleration)/dr of gravity at r [m, GCRF] into the 3x3 `out` [1/s2, GCRF], at the instant of `turn`."""
    _to_itrf(work, r, work.r_itrf)
    g = work.gradient_itrf
    spherical_harmonics.gradient(field, work.r_itrf, work, g)
    m = work.itrf_from_gcrf
    half = work.product
    for i in range(3):
        for j in range(3):
            half[i, j] = g[i, 0] * m[0, j] + g[i, 1] * m[1, j] + g[i, 2] * m[2, j]
    for i in range(3):
        for j in range(3):
            out[i, j] = m[0, i] * half[0, j] + m[1, i] * half[1, j] + m[2, i] * half[2, j]


@kernel
def add_relativity(gm_m3ps2, r, v, out):
    """Add the Schwarzschild term. Source: IERS Conventions (2010), equation 10.12, first part, beta = gamma = 1."""
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    v2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    rv = r[0] * v[0] + r[1] * v[1] + r[2] * v[2]
    size = math.sqrt(r2)
    scale = gm_m3ps2 / (_LIGHT_MPS * _LIGHT_MPS * r2 * size)
    for i in range(3):
        out[i] += scale * ((4.0 * gm_m3ps2 / size - v2) * r[i] + 4.0 * rv * v[i])


@kernel
def add_rtn(r, v, vector_rtn, out):
    """Add a vector given along radius, track and orbit normal to one in the frame of r and v."""
    hx = r[1] * v[2] - r[2] * v[1]
    hy = r[2] * v[0] - r[0] * v[2]
    hz = r[0] * v[1] - r[1] * v[0]
    size = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    momentum = math.sqrt(hx * hx + hy * hy + hz * hz)
    radial = vector_rtn[0] / size
    along = vector_rtn[1] / (size * momentum)
    normal = vector_rtn[2] / momentum
    out[0] += radial * r[0] + along * (hy * r[2] - hz * r[1]) + normal * hx
    out[1] += radial * r[1] + along * (hz * r[0] - hx * r[2]) + normal * hy
    out[2] += radial * r[2] + along * (hx * r[1] - hy * r[0]) + normal * hz


@entry(
    frozen_records(FORCE_TABLE),
    frozen_records(FIELD),
    frozen_records(ORIENTATION),
    I8,
    VECTOR,
    VECTOR,
    F8,
    VECTOR,
    records(FORCE_WORK),
    VECTOR,
)
def acceleration_at(forces, field, eop, t_gps_ns, r, v, drag_scale, empirical_rtn, work, out):
    """`acceleration` as Python calls it: tables, field and work as arrays of one record."""
    return acceleration(forces[0], field[0], eop[0], t_gps_ns, r, v, drag_scale, empirical_rtn, work[0], out)
