"""The ionosphere of one frequency, for a receiver inside it: a share of Klobuchar's vertical delay, by elevation.

A receiver in low orbit has part of the electrons below it, and sees what is above as a thin layer: the vertical delay
of the ground, times the share above, times the way through the layer (O. Montenbruck, E. Gill, "Ionospheric correction
for GPS tracking of LEO satellites", Journal of Navigation 55 (2002) 293; they put it just above the satellite, here its
height is the table's). The vertical delay is that of the GPS message (J. A. Klobuchar; IS-GPS-200, 20.3.3.5.2.5). What
the model is wrong by is a share of it, and goes into the sigma of the range.
"""

from __future__ import annotations

import math

from flightsw.gnss.declare import ROOM, entry, kernel
from flightsw.gnss.records import CONSTELLATIONS, EPOCH, GNSS_TABLE, SATELLITES
from flightsw.gnss.solution import LIGHT_MPS
from flightsw.kernels.registry import frozen_records, records

_NIGHT_S, _PEAK_S, _DAY_S = 5e-9, 50_400.0, 86_400.0
_COUNT = 4  # coefficients of each of the two polynomials


@kernel
def _vertical_s(table, t_gps_ns, x, y, z):
    """Delay [s] upwards through all of the ionosphere, at L1, where the direction (x, y, z) of length one points."""
    latitude = math.asin(min(max(z, -1.0), 1.0)) / math.pi  # semicircles
    longitude = math.atan2(y, x) / math.pi
    magnetic = latitude + 0.064 * math.cos((longitude - 1.617) * math.pi)
    amplitude_s, period_s, power = 0.0, 0.0, 1.0
    for k in range(_COUNT):
        amplitude_s += table["iono_alpha"][k] * power
        period_s += table["iono_beta"][k] * power
        power *= magnetic
    amplitude_s, period_s = max(amplitude_s, 0.0), max(period_s, 72_000.0)
    local_s = (t_gps_ns % 86_400_000_000_000) * 1e-9 + 0.5 * _DAY_S * longitude
    local_s -= _DAY_S * math.floor(local_s / _DAY_S)
    angle = 2.0 * math.pi * (local_s - _PEAK_S) / period_s
    if abs(angle) >= 1.57:
        return _NIGHT_S
    square = angle * angle
    return _NIGHT_S + amplitude_s * (1.0 - square / 2.0 + square * square / 24.0)


@kernel
def _correct_row(table, epoch, i, radius_m):
    """Take the delay off range i, and its uncertainty into the sigma; a row that the screen will refuse stays."""
    system = epoch["constellation"][i]
    length, along = 0.0, 0.0
    for a in range(3):
        step = epoch["r_m"][i, a] - epoch["start_m"][a]
        length += step * step
        along += step * epoch["start_m"][a]
    length = math.sqrt(length)
    if system < 0 or system >= CONSTELLATIONS or not (length > 1.0 and math.isfinite(length)):
        return
    sine = max(along / (length * radius_m), 0.0)  # below the horizon the sigma has to say it
    # where the ray meets the layer: so far along it that the distance from the centre is that of the layer
    layer_m = radius_m + table["iono_layer_m"]
    root_m = math.sqrt(radius_m * radius_m * (sine * sine - 1.0) + layer_m * layer_m)
    way_m = root_m - radius_m * sine
    x = (epoch["start_m"][0] + way_m * (epoch["r_m"][i, 0] - epoch["start_m"][0]) / length) / layer_m
    y = (epoch["start_m"][1] + way_m * (epoch["r_m"][i, 1] - epoch["start_m"][1]) / length) / layer_m
    z = (epoch["start_m"][2] + way_m * (epoch["r_m"][i, 2] - epoch["start_m"][2]) / length) / layer_m
    slant = layer_m / root_m * table["iono_dispersion"][system]
    vertical_m = LIGHT_MPS * table["iono_share"] * _vertical_s(table, epoch["t_gps_ns"], x, y, z)
    epoch["range_m"][i] -= slant * vertical_m
    if epoch["sigma_m"][i] > 0.0:  # as it came: what is not positive is refused by its own name
        wrong_m = slant * (table["iono_error"] * vertical_m + table["iono_floor_m"])
        epoch["sigma_m"][i] = math.sqrt(epoch["sigma_m"][i] ** 2 + wrong_m * wrong_m)


def _declare(room):
    @entry(frozen_records(GNSS_TABLE), records(EPOCH))
    def correct_ionosphere(tables, epochs):
        """Correct the ranges of epochs that have a start, seen from there; others stay as they are."""
        table = tables[0]
        if table["iono_share"] > 0.0:
            for k in range(epochs.shape[0]):
                epoch = epochs[k]
                radius_m = math.sqrt(epoch["start_m"][0] ** 2 + epoch["start_m"][1] ** 2 + epoch["start_m"][2] ** 2)
                if epoch["start_known"] != 0 and radius_m > 1e6 and radius_m < 1e8:
                    for i in range(min(max(epoch["count"], 0), SATELLITES)):
                        _correct_row(table, epoch, i, radius_m)
        return room

    return correct_ionosphere


correct_ionosphere = _declare(ROOM)
