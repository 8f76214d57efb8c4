"""GPS satellites, a receiver in low orbit and what it observes, made in an inertial frame, written as SP3 and RINEX.

Nothing here is shared with the solver: light time is iterated between inertial positions, the Earth's turn shows only
in the files, relativity is the closed form of IS-GPS-200 (F e sqrt(A) sin E).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

C = 299_792_458.0
MU = 3.986005e14
OMEGA = 7.2921151467e-5
F_REL = -4.442807633e-10  # IS-GPS-200 20.3.3.3.3.1 [s/sqrt(m)]
T0_NS = 11_160 * 86_400 * 10**9  # 2010-07-27T00:00:00 GPS
L1_HZ, L2_HZ = 1_575.42e6, 1_227.60e6


def _kepler(a: float, e: float, m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """In the orbit's plane: x, y and the eccentric anomaly."""
    anomaly = m.copy()
    for _ in range(20):
        anomaly = anomaly - (anomaly - e * np.sin(anomaly) - m) / (1.0 - e * np.cos(anomaly))
    return a * (np.cos(anomaly) - e), a * np.sqrt(1.0 - e * e) * np.sin(anomaly), anomaly


@dataclass
class Body:
    """On an ellipse: semi-major axis [m], eccentricity, inclination, node, mean anomaly at T0 [rad]."""

    a: float
    e: float
    i: float
    node: float
    m0: float

    def inertial(self, t_s: np.ndarray) -> np.ndarray:
        """Position (n,3) [m] at seconds since T0."""
        x, y, _ = _kepler(self.a, self.e, self.m0 + np.sqrt(MU / self.a**3) * np.asarray(t_s, float))
        ci, si, cn, sn = np.cos(self.i), np.sin(self.i), np.cos(self.node), np.sin(self.node)
        return np.stack((cn * x - sn * ci * y, sn * x + cn * ci * y, si * y), axis=-1)

    def relativity_s(self, t_s: np.ndarray) -> np.ndarray:
        """Periodic part of its clock [s]."""
        _, _, anomaly = _kepler(self.a, self.e, self.m0 + np.sqrt(MU / self.a**3) * np.asarray(t_s, float))
        return F_REL * self.e * np.sqrt(self.a) * np.sin(anomaly)


def to_earth_fixed(t_s: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Inertial to a frame that turns about z with the Earth; the two agree at T0."""
    c, s = np.cos(OMEGA * t_s), np.sin(OMEGA * t_s)
    return np.stack((c * r[..., 0] + s * r[..., 1], c * r[..., 1] - s * r[..., 0], r[..., 2]), axis=-1)


@dataclass
class World:
    """24 satellites in six planes, a receiver at 480 km. `antenna_m`: transmitting antennas below the centres."""

    antenna_m: np.ndarray = field(default_factory=lambda: np.zeros(33))
    receiver: Body = field(default_factory=lambda: Body(6.86e6, 0.002, 1.55, 0.3, 0.1))
    clock_s: float = 3e-7

    def __post_init__(self) -> None:
        self.satellites = {
            1 + k: Body(2.656e7, 0.004 + 0.0006 * k, 0.96, np.pi / 3 * (k % 6), 2 * np.pi * (k // 6 / 4 + k % 6 / 24))
            for k in range(24)
        }
        self.offset_s = {prn: 1e-4 * np.sin(prn) for prn in self.satellites}
        self.drift = {prn: 2e-12 * np.cos(prn) for prn in self.satellites}

    def satellite_clock_s(self, prn: int, t_s: np.ndarray) -> np.ndarray:
        """Its whole error: what a file of precise clocks says, and the relativistic part that it leaves out."""
        return self.offset_s[prn] + self.drift[prn] * t_s + self.satellites[prn].relativity_s(t_s)

    def receiver_earth_fixed(self, t_s: np.ndarray) -> np.ndarray:
        """Position of the receiver (n,3) [m]."""
        return to_earth_fixed(t_s, self.receiver.inertial(t_s))

    def observe(self, stamps_s: np.ndarray) -> dict[int, np.ndarray]:
        """PRN -> pseudorange (n,) [m] at the receiver's stamps, NaN below its horizon; no ionosphere."""
        t = stamps_s - self.clock_s
        here = self.receiver.inertial(t)
        found = {}
        for prn, satellite in self.satellites.items():
            tau = np.full(len(t), 0.07)
            for _ in range(6):
                there = satellite.inertial(t - tau)
                there = there * (1.0 - self.antenna_m[prn] / np.linalg.norm(there, axis=1, keepdims=True))
                tau = np.linalg.norm(there - here, axis=1) / C
            up = np.einsum("ni,ni->n", there - here, here) / np.linalg.norm(here, axis=1) / (C * tau)
            pseudorange = C * (tau + self.clock_s - self.satellite_clock_s(prn, t - tau))
            found[prn] = np.where(up > np.sin(np.radians(3.0)), pseudorange, np.nan)
        return found

    def write_sp3(self, path: Path, hours: tuple[float, float] = (-4.0, 6.0), missing: tuple[int, ...] = ()) -> Path:
        """Orbits and clocks every 15 minutes; `missing`: satellites whose clock is gone at T0 + 30 min."""
        lines = ["#cP2010  7 26 20  0  0.00000000      41 ORBIT IGS05 FIT TEST", "%c G  cc GPS ccc cccc"]
        for t_s in np.arange(hours[0] * 3600, hours[1] * 3600 + 1, 900.0):
            moment = datetime(2010, 7, 27) + timedelta(seconds=float(t_s))
            lines.append(f"*  {moment:%Y %m %d %H %M} {moment.second:11.8f}")
            for prn, satellite in self.satellites.items():
                r = to_earth_fixed(np.array([t_s]), satellite.inertial(np.array([t_s])))[0] / 1e3
                clock = (self.offset_s[prn] + self.drift[prn] * t_s) * 1e6
                clock = 999999.999999 if prn in missing and t_s == 1800.0 else clock
                lines.append(f"PG{prn:02d}" + "".join(f"{x:14.6f}" for x in r) + f"{clock:14.6f}")
        path.write_text("\n".join([*lines, "EOF"]) + "\n")
        return path


def rinex_header(codes: list[str]) -> list[str]:
    """Lines of a RINEX 2 header, labels in their columns."""

    def line(text: str, label: str) -> str:
        return f"{text:<60}{label}"

    return [
        line("     2.11           OBSERVATION DATA    G (GPS)", "RINEX VERSION / TYPE"),
        line(f"{len(codes):6d}" + "".join(f"{code:>6}" for code in codes), "# / TYPES OF OBSERV"),
        line("  2010     7    27     0     0    0.0000000     GPS", "TIME OF FIRST OBS"),
        line("", "END OF HEADER"),
    ]


def write_rinex(
    path: Path, stamps_s: np.ndarray, ranges: dict[int, np.ndarray], strength: float = 400.0, slips: tuple = ()
) -> Path:
    """P1, P2 alike (no ionosphere), phases with an integer each, strengths. slips: (stamp index, prn) that jump."""
    codes = ["L1", "L2", "P1", "P2", "S1", "S2"]
    lines = rinex_header(codes)
    for k, t_s in enumerate(stamps_s):
        moment = datetime(2010, 7, 27) + timedelta(seconds=float(t_s))
        seen = [prn for prn, values in ranges.items() if np.isfinite(values[k])]
        names = "".join(f"G{prn:2d}" for prn in seen)
        lines.append(f" {moment:%y %m %d %H %M} {moment.second:10.7f}  0{len(seen):3d}{names[:36]}")
        lines += [" " * 32 + names[start : start + 36] for start in range(36, len(names), 36)]
        for prn in seen:
            p = ranges[prn][k]
            jumped = sum(1 for index, who in slips if who == prn and index <= k)
            lock = 1 if (k, prn) in slips else 0
            phases = [p * f / C + 1000.0 * prn + 7.0 * jumped for f in (L1_HZ, L2_HZ)]
            fields = [f"{x:14.3f}{lock}8" for x in phases] + [f"{p:14.3f} 8"] * 2 + [f"{strength:14.3f}  "] * 2
            lines += ["".join(fields[:5]), "".join(fields[5:])]
    path.write_text("\n".join(lines) + "\n")
    return path
