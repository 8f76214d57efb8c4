"""Geodetic coordinates against a fixed-point iteration with 40 digits, and against erfa.gc2gd (WGS 84)."""

from __future__ import annotations

import erfa
import numpy as np
from mpmath import mp, mpf

from flightsw.kernels.geodetic import geodetic

WGS84 = 1


def exact(r, start):
    """Latitude and height as mpmath numbers: tan(lat) = (z + e2 N sin(lat)) / p iterated to 40 digits."""
    a, f = mpf(6378137), 1 / mpf("298.257223563")
    e2 = f * (2 - f)
    p, z, latitude = mp.sqrt(mpf(r[0]) ** 2 + mpf(r[1]) ** 2), mpf(r[2]), mpf(start)
    for _ in range(25):
        latitude = mp.atan2(z + e2 * a / mp.sqrt(1 - e2 * mp.sin(latitude) ** 2) * mp.sin(latitude), p)
    sine = mp.sin(latitude)
    return latitude, p * mp.cos(latitude) + z * sine - a * mp.sqrt(1 - e2 * sine**2)


def test_nanometres_from_the_ground_to_ten_thousand_kilometres_and_at_the_poles():
    """The method is good below 1e-9 m of arc; a height of 1e7 m is known to a few of its last digits."""
    rng = np.random.default_rng(1)
    latitudes = np.concatenate((np.arcsin(rng.uniform(-1, 1, 100)), [0.0, 1e-9, -1e-9, np.pi / 2, -np.pi / 2, 1.5707]))
    out = np.zeros(3)
    for index, latitude in enumerate(latitudes):
        longitude, height = rng.uniform(-np.pi, np.pi), (0.0, 5e5, 2e6, 1e7)[index % 4]
        r = erfa.gd2gc(WGS84, longitude, latitude, height)
        geodetic(r, out)
        with mp.workdps(40):
            expected, above = exact(r, latitude)
            assert abs(mpf(float(out[0])) - expected) * 6378137 < 3e-9
            assert abs(mpf(float(out[2])) - above) < 1e-8
        longitude_erfa, latitude_erfa, height_erfa = erfa.gc2gd(WGS84, r)
        assert (
            abs(out[0] - latitude_erfa) * 6.4e6 < 2e-4
        )  # the error of erfa itself: 1.5e-5 m at 1000 km of height, 1e-4 at 10,000
        assert abs(out[2] - height_erfa) < 1e-8
        if np.hypot(r[0], r[1]) > 1.0:
            assert abs(np.remainder(out[1] - longitude_erfa + np.pi, 2 * np.pi) - np.pi) < 1e-14
