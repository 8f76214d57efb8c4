"""Forces on the satellite's surface: drag of the co-rotating atmosphere, pressure of sunlight outside the shadow."""

from __future__ import annotations

import math

from flightsw.kernels import atmosphere
from flightsw.kernels.registry import kernel

ASTRONOMICAL_UNIT_M = 149597870700.0
SUN_RADIUS_M = 6.957e8  # IAU 2015, resolution B3
EARTH_RADIUS_M = 6378137.0
# total solar irradiance 1361 W/m2 (IAU 2015, resolution B3) by the speed of light
RADIATION_PRESSURE_PA = 1361.0 / 299792458.0
EARTH_ROTATION_RADPS = 7.292115e-5


@kernel
def drag(forces, semiannual, sun, pole, r, v, out):
    """Drag at r, v [m, m/s, GCRF] into out [m/s2] for a scale of one; `pole` is the Earth's axis in GCRF.

    Source: O. Montenbruck and E. Gill, Satellite Orbits, 2000, equations 3.97 and 3.98.
    """
    vx = v[0] - EARTH_ROTATION_RADPS * (pole[1] * r[2] - pole[2] * r[1])
    vy = v[1] - EARTH_ROTATION_RADPS * (pole[2] * r[0] - pole[0] * r[2])
    vz = v[2] - EARTH_ROTATION_RADPS * (pole[0] * r[1] - pole[1] * r[0])
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    rho = atmosphere.density(forces, semiannual, r, sun)
    scale = -0.5 * forces.drag_coefficient * forces.area_to_mass_m2pkg * rho * speed
    out[0] = scale * vx
    out[1] = scale * vy
    out[2] = scale * vz


@kernel
def illumination(r, sun):
    """Share of the Sun's disc that the Earth leaves visible at r: 1 in sunlight, 0 in the umbra [m, geocentric].

    Source: O. Montenbruck and E. Gill, Satellite Orbits, 2000, equations 3.85 to 3.94.
    """
    size = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    dx = sun[0] - r[0]
    dy = sun[1] - r[1]
    dz = sun[2] - r[2]
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    a = math.asin(SUN_RADIUS_M / distance)
    b = math.asin(min(1.0, EARTH_RADIUS_M / size))
    cosine = -(r[0] * dx + r[1] * dy + r[2] * dz) / (size * distance)
    c = math.acos(min(1.0, max(-1.0, cosine)))
    if c >= a + b:
        return 1.0
    if c <= b - a:
        return 0.0
    x = (c * c + a * a - b * b) / (2.0 * c)
    y = math.sqrt(max(0.0, a * a - x * x))
    first = math.acos(min(1.0, max(-1.0, x / a)))
    second = math.acos(min(1.0, max(-1.0, (c - x) / b)))
    return 1.0 - (a * a * first + b * b * second - c * y) / (math.pi * a * a)


@kernel
def add_radiation(forces, r, sun, out):
    """Add the pressure of sunlight at r [m, m/s2, geocentric], away from the Sun. Source: as above, equation 3.75."""
    share = illumination(r, sun)
    if share == 0.0:
        return
    dx = r[0] - sun[0]
    dy = r[1] - sun[1]
    dz = r[2] - sun[2]
    d2 = dx * dx + dy * dy + dz * dz
    scale = share * RADIATION_PRESSURE_PA * forces.radiation_coefficient * forces.area_to_mass_m2pkg
    scale *= ASTRONOMICAL_UNIT_M * ASTRONOMICAL_UNIT_M / (d2 * math.sqrt(d2))
    out[0] += scale * dx
    out[1] += scale * dy
    out[2] += scale * dz
