"""Geodetic coordinates on WGS 84, for the standard messages that ask for them."""

from __future__ import annotations

import math

from flightsw.kernels.registry import VECTOR, entry

# WGS 84: NGA.STND.0036, table 3.1.
SEMI_MAJOR_AXIS_M = 6378137.0
_FLATTENING = 1.0 / 298.257223563
_E2 = _FLATTENING * (2.0 - _FLATTENING)
_B = SEMI_MAJOR_AXIS_M * (1.0 - _FLATTENING)
_SECOND_E2 = _E2 / (1.0 - _E2)


@entry(VECTOR, VECTOR)
def geodetic(r_itrf_m, out):
    """Latitude [rad], longitude [rad], height [m] of a point outside the Earth's core, into `out` (3,).

    Source: B. R. Bowring, Survey Review 23 (1976) 323, iterated once: below 1e-9 m to 10,000 km of height.
    """
    x, y, z = r_itrf_m[0], r_itrf_m[1], r_itrf_m[2]
    p = math.hypot(x, y)
    beta = math.atan2(z * SEMI_MAJOR_AXIS_M, p * _B)
    latitude = 0.0
    for _ in range(2):
        s = math.sin(beta)
        c = math.cos(beta)
        latitude = math.atan2(z + _SECOND_E2 * _B * s**3, p - _E2 * SEMI_MAJOR_AXIS_M * c**3)
        beta = math.atan2((1.0 - _FLATTENING) * math.sin(latitude), math.cos(latitude))
    s = math.sin(latitude)
    n = SEMI_MAJOR_AXIS_M / math.sqrt(1.0 - _E2 * s * s)
    out[0] = latitude
    out[1] = math.atan2(y, x)
    # This form has no division by cos(latitude): it holds at the poles.
    out[2] = p * math.cos(latitude) + z * s - SEMI_MAJOR_AXIS_M * SEMI_MAJOR_AXIS_M / n
