"""From what a receiver and its satellites say to an epoch: each satellite where it was when its signal left it.

A satellite's place at a reference time is carried to the time of emission by one step of Runge-Kutta in the turning
Earth's axes under central gravity and J2, as GLONASS has its users do (ICD GLONASS 5.1, appendix 3, A.3.1.2; Sun and
Moon, 2 mm in 30 s, are left out). The time of emission is the receiver's time less the pseudorange, whatever the error
of that clock: it is in both.
"""

from __future__ import annotations

import math

from flightsw.gnss.declare import ROOM, entry, kernel
from flightsw.gnss.records import CONSTELLATIONS, EPHEMERIDES, EPOCH, GNSS_TABLE, RAW, SATELLITES
from flightsw.gnss.solution import LIGHT_MPS
from flightsw.kernels.registry import frozen_records, records

_MU_M3PS2 = 3.986004418e14  # IERS Conventions 2010, table 1.1
_J2 = 1.0826359e-3
_RADIUS_M = 6_378_136.6
_LONGEST_M = 1e8  # of a pseudorange: beyond it the time of emission means nothing


@kernel
def _acceleration(rate, x, y, z, vx, vy):
    """Of a free body, seen from the turning Earth [m/s2]."""
    r2 = x * x + y * y + z * z
    central = -_MU_M3PS2 / (r2 * math.sqrt(r2))
    flat = 1.5 * _J2 * _RADIUS_M * _RADIUS_M / r2
    tilt = 5.0 * z * z / r2
    across = central * (1.0 + flat * (1.0 - tilt))
    ax = across * x + rate * rate * x + 2.0 * rate * vy
    ay = across * y + rate * rate * y - 2.0 * rate * vx
    az = central * (1.0 + flat * (3.0 - tilt)) * z
    return ax, ay, az


@kernel
def _carry(rate, r, v, dt_s, out):
    """Position out (3) [m] a time dt_s [s] after r and v: classical Runge-Kutta, one step."""
    h, half = dt_s, 0.5 * dt_s
    x, y, z = r[0], r[1], r[2]
    u1, v1, w1 = v[0], v[1], v[2]
    a1, b1, c1 = _acceleration(rate, x, y, z, u1, v1)
    u2, v2, w2 = u1 + half * a1, v1 + half * b1, w1 + half * c1
    a2, b2, c2 = _acceleration(rate, x + half * u1, y + half * v1, z + half * w1, u2, v2)
    u3, v3, w3 = u1 + half * a2, v1 + half * b2, w1 + half * c2
    a3, b3, c3 = _acceleration(rate, x + half * u2, y + half * v2, z + half * w2, u3, v3)
    u4, v4, w4 = u1 + h * a3, v1 + h * b3, w1 + h * c3
    out[0] = x + h / 6.0 * (u1 + 2.0 * u2 + 2.0 * u3 + u4)
    out[1] = y + h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
    out[2] = z + h / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4)


@kernel
def _place(table, raw, known, epoch, i):
    """Fill row i of the epoch; a satellite without a usable place is put at the centre of the Earth."""
    system, number = raw["constellation"][i], raw["satellite"][i]
    epoch["satellite"][i], epoch["constellation"][i] = number, system
    epoch["range_m"][i], epoch["sigma_m"][i] = raw["range_m"][i], raw["sigma_m"][i]
    for a in range(3):
        epoch["r_m"][i, a] = 0.0
    if system < 0 or system >= CONSTELLATIONS or number < 1 or number > SATELLITES:
        return
    j = number - 1
    extra = table["signal_sigma_m"][system]
    if extra > 0.0 and raw["sigma_m"][i] > 0.0:
        epoch["sigma_m"][i] = math.sqrt(raw["sigma_m"][i] ** 2 + extra * extra)
    range_m, clock_m = raw["range_m"][i], known["clock_m"][system, j]
    if known["known"][system, j] == 0 or not (abs(range_m) < _LONGEST_M) or not math.isfinite(clock_m):
        return
    oldest_ns = 1e9 * table["ephemeris_age_max_s"]
    # compared as real numbers first, so that no garbage time can overflow
    if not (abs(float(raw["t_gps_ns"]) - float(known["t_ref_gps_ns"][system, j])) <= oldest_ns):
        return
    dt_s = (raw["t_gps_ns"] - known["t_ref_gps_ns"][system, j]) * 1e-9 - (range_m + clock_m) / LIGHT_MPS
    clock_m += known["clock_drift_mps"][system, j] * dt_s
    epoch["range_m"][i] = range_m + clock_m
    _carry(table["earth_rate_radps"], known["r_m"][system, j], known["v_mps"][system, j], dt_s, epoch["r_m"][i])


def _declare(room):
    @entry(frozen_records(GNSS_TABLE), records(RAW), records(EPHEMERIDES), records(EPOCH))
    def place_satellites(tables, raws, ephemerides, epochs):
        """Fill the epochs of an array from as many raw ones. The start of a solution is not touched."""
        table, known = tables[0], ephemerides[0]
        for k in range(epochs.shape[0]):
            raw, epoch = raws[k], epochs[k]
            epoch["t_gps_ns"] = raw["t_gps_ns"]
            epoch["count"] = raw["count"]
            for i in range(min(max(raw["count"], 0), SATELLITES)):
                _place(table, raw, known, epoch, i)
        return room

    return place_satellites


place_satellites = _declare(ROOM)
