"""Satellites as they broadcast themselves: GPS and Galileo by Kepler's elements, GLONASS by its equations of motion.

Of several ephemerides the healthy one nearest in time is taken, up to an age by constellation. Places are those of the
antennas in the constellation's own frame, which is ITRF to centimetres.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar

import numpy as np

from ground.gnss.rinex_nav import Ephemeris, read_ephemerides
from hil_sim.truth.orbit_files.glonass_nav import carried

LIGHT_MPS = 299_792_458.0
# IS-GPS-200, table 20-IV, and Galileo OS SIS ICD 2.1, table 60
_MU_M3PS2 = {"G": 3.986005e14, "E": 3.986004418e14}
_EARTH_RATE_RADPS = 7.2921151467e-5
# twice the spacing of regular uploads: GPS two hours, Galileo ten minutes but for pauses, GLONASS half an hour
OLDEST_S = {"G": 7_200.0, "E": 7_200.0, "R": 1_800.0}
_F_NAV = 2  # bit of Galileo's data source: clock for E1 and E5a
_KEPLER_ROUNDS = 12


class Broadcast:
    """Orbits and clocks of navigation files; of a satellite that is in several, all records."""

    # what orbits and clocks add to a range, 1-sigma [m]: O. Montenbruck et al., GPS Solutions 22 (2018) 100
    floor_m: ClassVar[dict[str, float]] = {"G": 1.0, "R": 2.2, "E": 0.7}

    def __init__(self, paths: Iterable[Path]) -> None:
        """Read files. Raises OperatorError where one is none."""
        records: dict[str, dict[tuple[int, int], Ephemeris]] = defaultdict(dict)
        for path in paths:
            for one in read_ephemerides(path):
                if one.healthy:
                    source = int(one.values[20]) & _F_NAV if one.name[0] == "E" else 0
                    records[one.name][one.reference_gps_ns, source] = one
        self._records = {name: _chosen(found) for name, found in records.items()}

    def states(self, names: tuple[str, ...], t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (m,k,3) [m] Earth-fixed and clocks (m,k) [s] of satellites at GPS times t_ns (m,k); NaN: unknown.

        Clocks are those of ionosphere-free ranges and hold the periodic relativistic effect of the eccentricity.
        """
        r, clock = np.full((*t_ns.shape, 3), np.nan), np.full(t_ns.shape, np.nan)
        for column, name in enumerate(names):
            if name in self._records:
                r[:, column], clock[:, column] = _states(self._records[name], t_ns[:, column])
        return r, clock


def _chosen(found: dict[tuple[int, int], Ephemeris]) -> list[Ephemeris]:
    """In order of time; of Galileo's two messages of one time that whose clock is for E1 and E5a."""
    at = {time: one for (time, _), one in sorted(found.items())}
    return [at[time] for time in sorted(at)]


def _states(records: list[Ephemeris], t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of one satellite at times (m,): r (m,3) [m], clock (m,) [s]."""
    system = records[0].name[0]
    reference = np.array([one.reference_gps_ns for one in records])
    after = np.clip(np.searchsorted(reference, t_ns), 1, max(len(records) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(records) - 1)
    nearest = np.where(np.abs(t_ns - reference[before]) <= np.abs(reference[after] - t_ns), before, after)
    values = np.array([one.values for one in records])[nearest].T
    clock_ns = np.array([one.clock_gps_ns for one in records])[nearest]
    since_s = (t_ns - clock_ns) / 1e9
    orbit_s = (t_ns - reference[nearest]) / 1e9
    if system == "R":
        state = carried(1e3 * values[[3, 7, 11, 4, 8, 12]], 1e3 * values[[5, 9, 13]], orbit_s)
        r, clock = state[:3].T, values[0] + values[1] * since_s
    else:
        r, relativity_s = kepler(values, orbit_s, _MU_M3PS2[system])
        clock = values[0] + since_s * (values[1] + since_s * values[2]) + relativity_s
        if system == "E":  # the other message's clock is for E1 and E5b (Galileo OS SIS ICD 2.1, 5.1.5)
            other = (values[20].astype(int) & _F_NAV) == 0
            clock = clock + np.where(other, values[25] - values[26], 0.0)
    known = np.abs(orbit_s) <= OLDEST_S[system]
    return np.where(known[:, None], r, np.nan), np.where(known, clock, np.nan)


def kepler(values: np.ndarray, t_s: np.ndarray, mu_m3ps2: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (m,3) [m] and the clock's relativistic part (m,) [s] a time (m,) after toe (IS-GPS-200, table 20-IV).

    values (20 or more, m): the numbers of the records in RINEX's order.
    """
    crs, delta_n, m0, cuc, e, cus, root_a, toe, cic, node, cis, i0, crc, perigee, node_rate, i_rate = values[4:20]
    a = root_a * root_a
    mean = m0 + (np.sqrt(mu_m3ps2 / a**3) + delta_n) * t_s
    eccentric = mean
    for _ in range(_KEPLER_ROUNDS):
        eccentric = eccentric - (eccentric - e * np.sin(eccentric) - mean) / (1.0 - e * np.cos(eccentric))
    true = np.arctan2(np.sqrt(1.0 - e * e) * np.sin(eccentric), np.cos(eccentric) - e)
    phase = true + perigee
    s2, c2 = np.sin(2.0 * phase), np.cos(2.0 * phase)
    u = phase + cus * s2 + cuc * c2
    radius = a * (1.0 - e * np.cos(eccentric)) + crs * s2 + crc * c2
    inclination = i0 + i_rate * t_s + cis * s2 + cic * c2
    longitude = node + (node_rate - _EARTH_RATE_RADPS) * t_s - _EARTH_RATE_RADPS * toe
    x, y = radius * np.cos(u), radius * np.sin(u)
    cl, sl, ci = np.cos(longitude), np.sin(longitude), np.cos(inclination)
    r = np.stack((x * cl - y * ci * sl, x * sl + y * ci * cl, y * np.sin(inclination)), axis=1)
    return r, -2.0 * math.sqrt(mu_m3ps2) / LIGHT_MPS**2 * e * root_a * np.sin(eccentric)
