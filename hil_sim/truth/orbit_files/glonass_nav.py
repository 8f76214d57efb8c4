"""GLONASS broadcast ephemerides, RINEX 2 navigation files: what the satellites say of themselves.

Positions are PZ-90, Earth-fixed, every half hour; between, the equations of motion of the interface document (GLONASS
ICD 5.1, 2008, A.3.1.2) are integrated. Epochs are UTC.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from hil_sim.errors import DataError
from hil_sim.truth.orbit_files.text import moment, read_text, to_gps_ns

_MU_M3PS2 = 3.986004418e14
_RADIUS_M = 6_378_136.0
_J2 = 1.0826257e-3
_SPIN_RADPS = 7.292115e-5
_STEP_S = 30.0
LIGHT_MPS = 299_792_458.0


class Record(NamedTuple):
    """One ephemeris. t_gps_ns: its reference time; state (6,): r [m], v [m/s]; pull (3,) [m/s2] of Sun and Moon.

    bias_s: clock minus system time at the reference time, gamma: its rate; healthy: as flagged.
    """

    slot: int
    t_gps_ns: int
    state: np.ndarray
    pull: np.ndarray
    bias_s: float
    gamma: float
    healthy: bool


def read_glonass_nav(path: Path) -> list[Record]:
    """All records of a file, in order. Raises DataError with file and line."""
    lines = read_text(path).splitlines()
    if not lines or "GLONASS" not in lines[0]:
        raise DataError(f"{path}: not a RINEX 2 GLONASS navigation file: its first line must say GLONASS NAV DATA")
    try:
        at = next(n for n, line in enumerate(lines) if "END OF HEADER" in line) + 1
    except StopIteration:
        raise DataError(f"{path}: has no END OF HEADER") from None
    records = []
    while at < len(lines) and lines[at].strip():
        try:
            head = lines[at]
            year, month, day, hour, minute = (int(word) for word in head[2:17].split())
            reading = moment(2000 + year if year < 80 else 1900 + year, month, day, hour, minute, head[17:22].strip())
            rows = [[_number(lines[at + k][3 + 19 * f : 22 + 19 * f]) for f in range(4)] for k in range(1, 4)]
            x, y, z = rows
            records.append(
                Record(
                    int(head[:2]),
                    int(to_gps_ns((reading,), "UTC")[0]),
                    1e3 * np.array([x[0], y[0], z[0], x[1], y[1], z[1]]),
                    1e3 * np.array([x[2], y[2], z[2]]),
                    _number(head[22:41]),
                    _number(head[41:60]),
                    x[3] == 0.0,
                )
            )
        except (ValueError, IndexError) as error:
            raise DataError(f"{path}:{at + 1}: not a GLONASS navigation record ({error})") from None
        at += 4
    return records


def _number(text: str) -> float:
    return float(text.replace("D", "E").replace("d", "e"))


def _rate(state: np.ndarray, pull: np.ndarray) -> np.ndarray:
    x, y, z, vx, vy, vz = state
    square = x * x + y * y + z * z
    radius = np.sqrt(square)
    central = -_MU_M3PS2 / (square * radius)
    oblate = -1.5 * _J2 * _MU_M3PS2 * _RADIUS_M**2 / (square * square * radius)
    tilt = 5.0 * z * z / square
    ax = central * x + oblate * x * (1.0 - tilt) + _SPIN_RADPS**2 * x + 2.0 * _SPIN_RADPS * vy + pull[0]
    ay = central * y + oblate * y * (1.0 - tilt) + _SPIN_RADPS**2 * y - 2.0 * _SPIN_RADPS * vx + pull[1]
    az = central * z + oblate * z * (3.0 - tilt) + pull[2]
    return np.array([vx, vy, vz, ax, ay, az])


def propagate(record: Record, t_gps_ns: int) -> np.ndarray:
    """State (6,) [m, m/s], Earth-fixed, at a time near the record's."""
    left_s = (t_gps_ns - record.t_gps_ns) / 1e9
    state = record.state.copy()
    while left_s != 0.0:
        h = float(np.clip(left_s, -_STEP_S, _STEP_S))
        k1 = _rate(state, record.pull)
        k2 = _rate(state + 0.5 * h * k1, record.pull)
        k3 = _rate(state + 0.5 * h * k2, record.pull)
        k4 = _rate(state + h * k3, record.pull)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        left_s -= h
    return state


def carried(state: np.ndarray, pull: np.ndarray, left_s: np.ndarray) -> np.ndarray:
    """States (6,m), each so long left_s (m,) after records with state (6,m) and pull (3,m); as many steps for all."""
    steps = max(1, int(np.ceil(np.abs(left_s).max(initial=0.0) / _STEP_S)))
    h = left_s / steps
    for _ in range(steps):
        k1 = _rate(state, pull)
        k2 = _rate(state + 0.5 * h * k1, pull)
        k3 = _rate(state + 0.5 * h * k2, pull)
        k4 = _rate(state + h * k3, pull)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def clock_m(record: Record, t_gps_ns: int) -> float:
    """Satellite clock minus system time, as range [m]."""
    return LIGHT_MPS * (record.bias_s + record.gamma * (t_gps_ns - record.t_gps_ns) / 1e9)
