"""Sun and Moon: where they are, how they attract, the tide they raise in the solid Earth.

Positions are the low-precision series of O. Montenbruck and E. Gill, Satellite Orbits, 2000, section 3.3.2, for the
mean equator and equinox of J2000, which is GCRF to 0.02 arcseconds. Measured against the JPL ephemeris DE440: the Sun
within 0.01 degrees, the Moon within 0.08 degrees and 500 km: in low orbit 4e-9 m/s2, below a centimetre after 2000 s.
"""

from __future__ import annotations

import math

from flightsw.kernels.registry import kernel

GM_SUN_M3PS2 = 1.32712440041e20  # DE440
GM_MOON_M3PS2 = 4.902800118e12  # DE440
TIDE_FREE = 0
# IERS Conventions (2010), table 6.3: nominal degree-2 Love numbers of an anelastic Earth, real and imaginary parts
_K20 = 0.30190
_K21 = 0.29830
_K21_IMAGINARY = -0.00144
_K22 = 0.30102
_K22_IMAGINARY = -0.00130
# IERS Conventions (2010), equation 6.14: A0 H0, the permanent part of the tide-raising potential
_PERMANENT_TIDE = 4.4228e-8 * -0.31460

# GPS epoch to J2000.0 TT: 2451545.0 - 2444244.5 days, less TT - GPS = 51.184 s
_J2000_FROM_GPS_EPOCH_S = 7300.5 * 86400.0 - 51.184
_CENTURY_S = 36525.0 * 86400.0
_DEGREE = math.pi / 180.0
_ARCSEC = math.pi / 648000.0
_COS_OBLIQUITY = math.cos(23.43929111 * _DEGREE)
_SIN_OBLIQUITY = math.sin(23.43929111 * _DEGREE)


@kernel
def centuries(t_gps_ns):
    """Julian centuries of Terrestrial Time since J2000.0."""
    return (t_gps_ns * 1e-9 - _J2000_FROM_GPS_EPOCH_S) / _CENTURY_S


@kernel
def _to_equator(longitude, latitude, distance_m, out):
    cb = math.cos(latitude)
    x = cb * math.cos(longitude)
    y = cb * math.sin(longitude)
    z = math.sin(latitude)
    out[0] = distance_m * x
    out[1] = distance_m * (_COS_OBLIQUITY * y - _SIN_OBLIQUITY * z)
    out[2] = distance_m * (_SIN_OBLIQUITY * y + _COS_OBLIQUITY * z)


@kernel
def sun_position(t_gps_ns, out):
    """Geocentric Sun [m, GCRF] into out. Source: Montenbruck and Gill, equations 3.43 to 3.46.

    The motion of the perigee, 0.3233 degrees a century, is added (E. M. Standish, Keplerian Elements for Approximate
    Positions of the Major Planets, JPL): without it the longitude is 0.08 degrees off in 2024.
    """
    t = centuries(t_gps_ns)
    anomaly = (357.5256 + 35999.049 * t) * _DEGREE
    perigee = (282.9400 + 0.3233 * t) * _DEGREE
    longitude = perigee + anomaly + (6892.0 * math.sin(anomaly) + 72.0 * math.sin(2.0 * anomaly)) * _ARCSEC
    distance_m = (149.619 - 2.499 * math.cos(anomaly) - 0.021 * math.cos(2.0 * anomaly)) * 1e9
    _to_equator(longitude, 0.0, distance_m, out)


@kernel
def moon_position(t_gps_ns, out):
    """Geocentric Moon [m, GCRF] into out. Source: Montenbruck and Gill, equations 3.47 to 3.50."""
    t = centuries(t_gps_ns)
    mean = (218.31617 + 481267.88088 * t - 1.3972 * t) * _DEGREE
    l = (134.96292 + 477198.86753 * t) * _DEGREE  # noqa: E741  Brown's letters: l, l', F, D
    lp = (357.52543 + 35999.04944 * t) * _DEGREE
    f = (93.27283 + 483202.01873 * t) * _DEGREE
    d = (297.85027 + 445267.11135 * t) * _DEGREE
    sin = math.sin
    cos = math.cos
    away = (
        22640.0 * sin(l)
        + 769.0 * sin(2.0 * l)
        - 4586.0 * sin(l - 2.0 * d)
        + 2370.0 * sin(2.0 * d)
        - 668.0 * sin(lp)
        - 412.0 * sin(2.0 * f)
        - 212.0 * sin(2.0 * l - 2.0 * d)
        - 206.0 * sin(l + lp - 2.0 * d)
        + 192.0 * sin(l + 2.0 * d)
        - 165.0 * sin(lp - 2.0 * d)
        + 148.0 * sin(l - lp)
        - 125.0 * sin(d)
        - 110.0 * sin(l + lp)
        - 55.0 * sin(2.0 * f - 2.0 * d)
    ) * _ARCSEC
    latitude = (
        18520.0 * sin(f + away + (412.0 * sin(2.0 * f) + 541.0 * sin(lp)) * _ARCSEC)
        - 526.0 * sin(f - 2.0 * d)
        + 44.0 * sin(l + f - 2.0 * d)
        - 31.0 * sin(-l + f - 2.0 * d)
        - 25.0 * sin(-2.0 * l + f)
        - 23.0 * sin(lp + f - 2.0 * d)
        + 21.0 * sin(-l + f)
        + 11.0 * sin(-lp + f - 2.0 * d)
    ) * _ARCSEC
    distance_m = (
        385000.0
        - 20905.0 * cos(l)
        - 3699.0 * cos(2.0 * d - l)
        - 2956.0 * cos(2.0 * d)
        - 570.0 * cos(2.0 * l)
        + 246.0 * cos(2.0 * l - 2.0 * d)
        - 205.0 * cos(lp - 2.0 * d)
        - 171.0 * cos(l + 2.0 * d)
        - 152.0 * cos(l + lp - 2.0 * d)
    ) * 1e3
    _to_equator(mean + away, latitude, distance_m, out)


@kernel
def add_third_body(gm_m3ps2, r, body, out):
    """Add the attraction of a body at `body` on a satellite at r, less that on the Earth [m, m/s2, geocentric].

    The difference of two nearly equal terms is taken in Battin's form, which loses no digits. Source: R. H. Battin,
    An Introduction to the Mathematics and Methods of Astrodynamics, 1999, section 8.6, equations 8.60 to 8.62.
    """
    s2 = body[0] * body[0] + body[1] * body[1] + body[2] * body[2]
    q = 0.0
    d2 = 0.0
    for i in range(3):
        q += r[i] * (r[i] - 2.0 * body[i])
        d2 += (r[i] - body[i]) * (r[i] - body[i])
    q /= s2
    f = q * (3.0 + q * (3.0 + q)) / (1.0 + (1.0 + q) * math.sqrt(1.0 + q))
    scale = -gm_m3ps2 / (d2 * math.sqrt(d2))
    for i in range(3):
        out[i] += scale * (r[i] + f * body[i])


@kernel
def add_tide(field, gm_m3ps2, body_itrf, out):
    """Add the tide that a body at `body_itrf` [m] raises: the quadratic form of its potential, 3x3, ITRF.

    Source: IERS Conventions (2010), equation 6.6, step 1, degree 2: changes of C20 to S22 by the Love numbers.
    """
    distance = math.sqrt(body_itrf[0] ** 2 + body_itrf[1] ** 2 + body_itrf[2] ** 2)
    x = body_itrf[0] / distance
    y = body_itrf[1] / distance
    z = body_itrf[2] / distance
    strength = gm_m3ps2 / field.gm_m3ps2 * (field.radius_m / distance) ** 3 / 5.0
    p20 = strength * math.sqrt(5.0) * 0.5 * (3.0 * z * z - 1.0)
    p21_c = strength * math.sqrt(15.0) * z * x  # times cosine and sine of the longitude
    p21_s = strength * math.sqrt(15.0) * z * y
    p22_c = strength * math.sqrt(15.0) * 0.5 * (x * x - y * y)
    p22_s = strength * math.sqrt(15.0) * x * y
    _add_form(
        _K20 * p20,
        _K21 * p21_c + _K21_IMAGINARY * p21_s,
        _K21 * p21_s - _K21_IMAGINARY * p21_c,
        _K22 * p22_c + _K22_IMAGINARY * p22_s,
        _K22 * p22_s - _K22_IMAGINARY * p22_c,
        out,
    )


@kernel
def subtract_permanent_tide(field, out):
    """Take the permanent part off the form where the field already holds it (zero-tide C20).

    Source: IERS Conventions (2010), equations 6.13 and 6.14. Left in, it would count twice: 4.2e-9 in C20.
    """
    if field.tide_system != TIDE_FREE:
        _add_form(-_PERMANENT_TIDE * _K20, 0.0, 0.0, 0.0, 0.0, out)


@kernel
def _add_form(c20, c21, s21, c22, s22, out):
    """Add r' Q r = r^2 (sum of normalised C, S times P_2m) as the symmetric matrix Q."""
    zonal = 0.5 * math.sqrt(5.0) * c20
    half = 0.5 * math.sqrt(15.0)
    out[0, 0] += half * c22 - zonal
    out[1, 1] -= half * c22 + zonal
    out[2, 2] += 2.0 * zonal
    out[0, 1] += half * s22
    out[1, 0] += half * s22
    out[0, 2] += half * c21
    out[2, 0] += half * c21
    out[1, 2] += half * s21
    out[2, 1] += half * s21


@kernel
def add_tidal_acceleration(field, form, r, out):
    """Add the gradient of GM R^2 (r' Q r) / r^5 at r, in whatever frame r and the form Q are given [m, m/s2]."""
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    value = 0.0
    for i in range(3):
        for j in range(3):
            value += r[i] * form[i, j] * r[j]
    scale = field.gm_m3ps2 * field.radius_m * field.radius_m / (r2 * r2 * math.sqrt(r2))
    for i in range(3):
        along = form[i, 0] * r[0] + form[i, 1] * r[1] + form[i, 2] * r[2]
        out[i] += scale * (2.0 * along - 5.0 * value / r2 * r[i])
