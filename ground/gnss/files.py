"""Epochs of a real receiver made ready for the flight test: satellites at transmission, delays, sigmas.

What is corrected: satellite clocks with their relativistic part, flight time, troposphere (Saastamoinen's zenith delay
of a standard atmosphere, Black and Eisner's mapping). What is not: antennas of satellites and receiver, tides; their
means go into the clocks of the constellations, the rest is in the sigmas.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flightsw.gnss.records import EPOCH, SATELLITES
from ground.errors import OperatorError
from ground.gnss.ephemeris import LIGHT_MPS, Orbits
from ground.gnss.rinex import LETTERS, Observed

MASK_DEG = 10.0
# 1-sigma of an ionosphere-free code range at the zenith [m]
CODE_M = {"G": 0.55, "R": 1.1, "E": 0.35}
_NEAR_EARTH_M = 9_000.0  # above this height there is no troposphere


class Ready(NamedTuple):
    """Epochs (m,) of EPOCH; name (m,64): index into the names of what was observed, -1 where a row is empty."""

    epochs: np.ndarray
    name: np.ndarray


def prepare(observed: Observed, orbits: Orbits, place_m: np.ndarray) -> Ready:
    """Epochs with all that is known; place_m (m,3) or (3,): where the receiver is, to some 100 m, for the delays."""
    range_m = observed.range_m
    there = np.isfinite(range_m)
    stamp = observed.t_gps_ns[:, None]
    sent = stamp - np.rint(np.where(there, range_m, 2.3e7) / LIGHT_MPS * 1e9).astype(np.int64)
    _, clock = orbits.states(observed.names, sent)
    r, clock = orbits.states(observed.names, sent - np.rint(np.nan_to_num(clock) * 1e9).astype(np.int64))
    up, height = _vertical(np.broadcast_to(place_m, (len(stamp), 3)))
    line = r - np.broadcast_to(place_m, (len(stamp), 3))[:, None, :]
    sine = np.einsum("mka,ma->mk", line, up) / np.linalg.norm(line, axis=2)
    usable = there & np.isfinite(clock) & (np.nan_to_num(sine, nan=-1.0) > math.sin(math.radians(MASK_DEG)))
    if not usable.any():
        raise OperatorError("no observation has an orbit at its time: name orbits of the day of the observations")
    corrected = range_m + LIGHT_MPS * clock - troposphere_m(height[:, None], sine)
    letters = [name[0] for name in observed.names]
    code = np.array([CODE_M[letter] for letter in letters])
    floor = np.array([orbits.floor_m[letter] for letter in letters])
    sigma = np.hypot(floor, code / np.maximum(sine, 0.1))
    order = np.argsort(~usable, axis=1, kind="stable")[:, :SATELLITES]
    rows = np.arange(len(stamp))[:, None]
    wide = order.shape[1]
    epochs = np.zeros(len(stamp), EPOCH)
    epochs["t_gps_ns"] = observed.t_gps_ns
    epochs["count"] = np.minimum(usable.sum(axis=1), SATELLITES)
    epochs["constellation"][:, :wide] = np.array([LETTERS[letter] for letter in letters])[order]
    epochs["satellite"][:, :wide] = np.array([int(name[1:]) for name in observed.names])[order]
    filled = usable[rows, order]
    for field, values in (("range_m", corrected), ("sigma_m", sigma)):
        epochs[field][:, :wide] = np.where(filled, values[rows, order], 0.0)
    epochs["r_m"][:, :wide] = np.where(filled[..., None], r[rows, order], 0.0)
    name = np.full((len(stamp), SATELLITES), -1)
    name[:, :wide] = np.where(filled, order, -1)
    return Ready(epochs, name)


def _vertical(place_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors up (m,3) and heights above the ellipsoid (m,) [m], WGS 84; good to metres near the ground."""
    normal = place_m * np.array([1.0, 1.0, 1.0 / (1.0 - 6.69437999014e-3)])
    up = normal / np.linalg.norm(normal, axis=1)[:, None]
    foot = np.sqrt(1.0 / np.sum((place_m / np.array([6_378_137.0, 6_378_137.0, 6_356_752.3142])) ** 2, axis=1))
    return up, np.linalg.norm(place_m, axis=1) * (1.0 - foot)


def troposphere_m(height_m: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Delay [m] at a height, by the sine of the elevation; none above the troposphere."""
    h = np.clip(height_m, 0.0, _NEAR_EARTH_M)
    temperature = 288.15 - 0.0065 * h
    pressure = 1_013.25 * (temperature / 288.15) ** 5.2559
    vapour = 0.5 * 6.11 * 10.0 ** (7.5 * (temperature - 273.15) / (temperature - 35.85))
    zenith = 0.002277 * (pressure + (1_255.0 / temperature + 0.05) * vapour)
    mapping = 1.001 / np.sqrt(0.002001 + np.clip(sine, 0.05, 1.0) ** 2)
    return np.where(height_m < _NEAR_EARTH_M, zenith * mapping, 0.0)
