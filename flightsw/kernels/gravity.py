"""Onboard gravity: the acceleration and its gradient. The seam for larger force models.

`pole` is the unit vector of the Earth's pole in GCRF. It is not the z axis: precession has moved it by 2.5 mrad
since J2000, which would cost 2.5e-5 m/s2, or 50 m after 2000 s.
"""

from __future__ import annotations

import math

from flightsw.kernels.registry import kernel

CENTRAL = 0
J2 = 1


@kernel
def acceleration(table, r, pole, out):
    """Gravity at r [m, GCRF] into out [m/s2].

    Sources: paper, equation (2); O. Montenbruck and E. Gill, Satellite Orbits, 2000, section 3.2 (J2).
    """
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    r1 = math.sqrt(r2)
    central = -table.mu_m3ps2 / (r2 * r1)
    radial = central
    along_pole = 0.0
    if table.gravity_model == J2:
        s = r[0] * pole[0] + r[1] * pole[1] + r[2] * pole[2]
        c = 1.5 * table.mu_m3ps2 * table.j2 * table.equatorial_radius_m**2 / (r2 * r2 * r1)
        radial += c * (5.0 * s * s / r2 - 1.0)
        along_pole = -2.0 * c * s
    for i in range(3):
        out[i] = radial * r[i] + along_pole * pole[i]


@kernel
def gradient(table, r, pole, out):
    """d(acceleration)/dr at r [m, GCRF] into the 3x3 `out` [1/s2]; symmetric."""
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    r1 = math.sqrt(r2)
    central = table.mu_m3ps2 / (r2 * r2 * r1)
    rr = 3.0 * central
    identity = -central * r2
    rp = 0.0
    pp = 0.0
    if table.gravity_model == J2:
        s = r[0] * pole[0] + r[1] * pole[1] + r[2] * pole[2]
        c = 1.5 * table.mu_m3ps2 * table.j2 * table.equatorial_radius_m**2 / (r2 * r2 * r1)
        identity += c * (5.0 * s * s / r2 - 1.0)
        rr += c * (5.0 - 35.0 * s * s / r2) / r2
        rp = 10.0 * c * s / r2
        pp = -2.0 * c
    for i in range(3):
        for j in range(3):
            out[i, j] = rr * r[i] * r[j] + rp * (r[i] * pole[j] + pole[i] * r[j]) + pp * pole[i] * pole[j]
        out[i, i] += identity
