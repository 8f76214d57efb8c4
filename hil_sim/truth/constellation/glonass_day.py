"""A real day of GLONASS: precise orbits as truth, the broadcast messages of the same day as what satellites say.

Both are Earth-fixed and are turned into one non-rotating frame by the Earth's rate alone: what the pole does is the
same for both and drops out of ranges. PZ-90.02 and IGS05 differ by 0.4 m, the same for all satellites, which no range
shows.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hil_sim.errors import DataError
from hil_sim.truth.constellation.orbits import Tracks
from hil_sim.truth.hermite import HermiteTrack
from hil_sim.truth.local_frames import rtn_axes
from hil_sim.truth.orbit_files.glonass_nav import LIGHT_MPS, Record, clock_m, propagate, read_glonass_nav
from hil_sim.truth.orbit_files.sp3 import read_sp3
from hil_sim.truth.orbit_files.text import to_gps_ns

_SPIN_RADPS = 7.292115e-5
_NODES = 11
_GRID_S = 60
_REACH_S = 900  # of a broadcast record, to either side
_NS = 1_000_000_000


@dataclass(frozen=True)
class GlonassDay:
    """Truth and broadcast errors on one grid.

    names: slots as R03. t0_gps_ns: start; orbits: its true motion. errors_m (n,k,4): radial, along, cross, clock,
    broadcast minus true, at k instants of `grid_s`; issue (n,k): number of the record in force, -1 none; healthy (n,k).
    """

    names: tuple[str, ...]
    t0_gps_ns: int
    orbits: Tracks
    grid_s: np.ndarray
    errors_m: np.ndarray
    issue: np.ndarray
    healthy: np.ndarray

    def at(self, t_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Errors (n,4) [m], issues (n,) and health (n,) at a time; errors are NaN where there is no record or truth."""
        step = self.grid_s[1] - self.grid_s[0]
        k = min(max(int(t_s // step), 0), len(self.grid_s) - 2)
        share = (t_s - self.grid_s[k]) / step
        same = self.issue[:, k] == self.issue[:, k + 1]
        ahead = np.where(same[:, None], self.errors_m[:, k + 1], self.errors_m[:, k])
        return (1.0 - share) * self.errors_m[:, k] + share * ahead, self.issue[:, k], self.healthy[:, k]


def read_day(precise: Path, broadcast: Path) -> GlonassDay:
    """The day of a precise and a broadcast file. Raises DataError where they have nothing in common."""
    file = read_sp3(precise)
    nodes_ns = to_gps_ns(file.moments, file.scale)
    records = read_glonass_nav(broadcast)
    names = tuple(name for name in file.satellites if name[0] == "R" and any(r.slot == int(name[1:]) for r in records))
    if len(names) < 2 or len(nodes_ns) < _NODES:
        raise DataError(f"{precise}, {broadcast}: no two GLONASS satellites are in both; name files of one day")
    t0_ns = int(nodes_ns[0])
    grid_s = np.arange(0, int((nodes_ns[-1] - t0_ns) // _NS) + 1, _GRID_S).astype(float)
    tracks, errors, issues, health = [], [], [], []
    for name in names:
        column = file.satellites.index(name)
        r, v = _inertial(grid_s, *_interpolated(nodes_ns, t0_ns, file.r_m[:, column], grid_s))
        tracks.append(HermiteTrack(0, _GRID_S * _NS, r, v))
        nodes_s = (nodes_ns - t0_ns) / _NS
        known = np.isfinite(file.clock_s[:, column])
        clock = np.full(len(grid_s), np.nan)
        if known.sum() > 1:
            clock = LIGHT_MPS * np.interp(grid_s, nodes_s[known], file.clock_s[known, column])
        mine = [record for record in records if record.slot == int(name[1:])]
        one = _errors(mine, t0_ns, grid_s, r, v, clock)
        errors.append(one[0])
        issues.append(one[1])
        health.append(one[2])
    found = np.array(errors)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of instants without any record
        # system times differ by a common offset, and so do the reference points along the radius (antenna and centre
        # of mass): the first is nothing a range shows, the second is known to who ranges
        found[:, :, 3] -= np.nanmedian(found[:, :, 3], axis=0)[None, :]
        found[:, :, 0] -= np.nanmedian(found[:, :, 0])
    return GlonassDay(names, t0_ns, Tracks(names, tracks), grid_s, found, np.array(issues), np.array(health))


def _interpolated(nodes_ns: np.ndarray, t0_ns: int, r_m: np.ndarray, at_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity (k,3), Earth-fixed, by Lagrange's polynomial of degree 10; NaN where nodes are missing."""
    step_s = (nodes_ns[1] - nodes_ns[0]) / _NS
    place = at_s / step_s
    first = np.clip(np.floor(place).astype(int) - _NODES // 2, 0, len(nodes_ns) - _NODES)
    x = place - first
    weight, slope = np.ones((len(x), _NODES)), np.zeros((len(x), _NODES))
    for j in range(_NODES):
        for m in range(_NODES):
            if m != j:
                slope[:, j] = (slope[:, j] * (x - m) + weight[:, j]) / (j - m)
                weight[:, j] *= (x - m) / (j - m)
    around = r_m[first[:, None] + np.arange(_NODES)]
    return np.einsum("nj,njk->nk", weight, around), np.einsum("nj,njk->nk", slope, around) / step_s


def _inertial(t_s: np.ndarray, r_m: np.ndarray, v_mps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Earth-fixed states turned into the frame that is Earth-fixed at t = 0 and does not rotate."""
    cosine, sine = np.cos(_SPIN_RADPS * t_s), np.sin(_SPIN_RADPS * t_s)
    moved = v_mps + _SPIN_RADPS * np.stack((-r_m[:, 1], r_m[:, 0], np.zeros(len(r_m))), axis=1)

    def turn(a: np.ndarray) -> np.ndarray:
        return np.stack((cosine * a[:, 0] - sine * a[:, 1], sine * a[:, 0] + cosine * a[:, 1], a[:, 2]), axis=1)

    return turn(r_m), turn(moved)


def _errors(
    records: list[Record], t0_ns: int, grid_s: np.ndarray, r: np.ndarray, v: np.ndarray, clock: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors (k,4), number of the record in force (k,) and its health (k,) on the grid."""
    errors = np.full((len(grid_s), 4), np.nan)
    issue, healthy = np.full(len(grid_s), -1), np.zeros(len(grid_s), bool)
    axes = rtn_axes(r, v)
    reference_s = np.array([(record.t_gps_ns - t0_ns) / _NS for record in records])
    nearest = np.argmin(np.abs(grid_s[:, None] - reference_s[None, :]), axis=1)
    for number, record in enumerate(records):
        at = np.flatnonzero((nearest == number) & (np.abs(grid_s - reference_s[number]) <= _REACH_S))
        for k in at:
            state = propagate(record, t0_ns + round(grid_s[k] * 1e9))
            position, _ = _inertial(grid_s[k : k + 1], state[None, :3], state[None, 3:])
            errors[k, :3] = axes[k] @ (position[0] - r[k])
            errors[k, 3] = clock_m(record, t0_ns + round(grid_s[k] * 1e9)) - clock[k]
            issue[k], healthy[k] = number, record.healthy
    return errors, issue, healthy
