"""A real orbit, whatever file it came from: one satellite's samples in GPS time, SI units and a frame of two.

Files are not believed: time must run forward, positions must be those of an orbit, and velocities must be what the
positions say when they are differentiated. That finds wrong units, wrong frames and broken lines of every format.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError
from hil_sim.truth.hermite import NODES_EACH_SIDE, interpolate_uneven
from hil_sim.truth.orbit_files.text import FileSamples, to_gps_ns

__all__ = ["DataError", "RealOrbit", "differentiate", "evenly_spaced", "finish"]

UNITS_MPS = {"m/s": 1.0, "dm/s": 0.1, "km/s": 1e3}
DERIVE = "derive"
VELOCITY_UNITS = ("auto", *UNITS_MPS, DERIVE)
SAME_SPEED = 0.2  # relative; units differ by ten and more
# velocity against differentiated position: precise orbits agree to 1e-5 to 5e-4 in the median, 6e-3 at most
MEDIAN_MPS = 1.0
CONTRADICTION_MPS, CONTRADICTION_MEDIANS = 0.05, 30.0
RADIUS_M = (6.4e6, 5.0e7)
HOLE_S = 120.0  # interpolation over so much errs by less than a centimetre (2 to 7 mm on real orbits)
GRID_S = 60.0
STENCIL = 9  # samples that a derivative is taken from


class RealOrbit(NamedTuple):
    """One satellite's samples: GPS times (n,) [ns], rising; r (n,3) [m]; v (n,3) [m/s]; frame 'ITRF' or 'GCRF'.

    velocity: where the velocities came from, in words. mismatch_mps: the median of what they differ by from the
    differentiated positions; of derived ones, what a shorter stencil differs by, an upper limit of their error.
    """

    t_gps_ns: np.ndarray
    r_m: np.ndarray
    v_mps: np.ndarray
    frame: str
    satellite: str
    name: str
    velocity: str
    mismatch_mps: float


def finish(path: Path, found: FileSamples, velocity_unit: str = "auto") -> RealOrbit:
    """Judge what a reader found and give it in SI units. velocity_unit: one of VELOCITY_UNITS. Raises DataError.

    Samples of which fewer than STENCIL lie between two holes cannot be judged and are left out.
    """
    if velocity_unit not in VELOCITY_UNITS:
        raise DataError(f"{path}: velocity unit {velocity_unit!r}: one of {', '.join(VELOCITY_UNITS)}")
    t = to_gps_ns(found.moments, found.scale)
    _check_order(path, t, found.line)
    _check_positions(path, found)
    slope = differentiate(t, found.r_m)
    good = np.isfinite(slope[:, 0])
    if not good.any():
        raise DataError(f"{path}: fewer than {STENCIL} samples in a row; choose a longer file")
    t, r_m, slope, line = t[good], found.r_m[good], slope[good], found.line[good]
    if found.v is None or velocity_unit == DERIVE:
        error = np.abs(slope - differentiate(t, r_m, STENCIL - 2)).max(axis=1)
        words, v_mps, mismatch = "derived from the positions", slope, float(np.median(error))
    else:
        v_file = found.v[good]
        unit = _unit(path, v_file, slope) if velocity_unit == "auto" else velocity_unit
        v_mps = v_file * UNITS_MPS[unit]
        words = f"of the file, in {unit}"
        if unit != found.standard_unit:
            words += f" though {found.kind} says {found.standard_unit}"
        mismatch = _mismatch(path, line, v_mps, slope)
    return RealOrbit(t, r_m, v_mps, found.frame, found.satellite, found.name, words, mismatch)


def differentiate(t_ns: np.ndarray, x: np.ndarray, stencil: int = STENCIL) -> np.ndarray:
    """dx/dt (n, 3) at the samples, per second, from `stencil` samples around each (Lagrange's polynomial).

    NaN where fewer lie in a row without a hole (a step of more than 2.5 usual ones). Weights by the barycentric form
    (Berrut and Trefethen 2004, eq. 9.3), any spacing. On precise orbits of 60 s: 1e-5 m/s in the median, 6e-4 at the
    ends, where the samples lie on one side.
    """
    result = np.full(x.shape, np.nan)
    if len(t_ns) < stencil:
        return result
    steps = np.diff(t_ns)
    edges = [0, *(np.flatnonzero(steps > 2.5 * np.median(steps)) + 1).tolist(), len(t_ns)]
    for low, high in pairwise(edges):
        n = high - low
        if n < stencil:
            continue
        first = np.clip(np.arange(n) - stencil // 2, 0, n - stencil)
        window = low + first[:, None] + np.arange(stencil)
        own = np.arange(n) - first
        s = (t_ns[window] - t_ns[low:high, None]) / 1e9
        apart = s[:, :, None] - s[:, None, :]
        apart[:, np.arange(stencil), np.arange(stencil)] = 1.0
        w = 1.0 / apart.prod(axis=2)
        rows = np.arange(n)
        to_own = -s
        to_own[rows, own] = 1.0
        weight = w / w[rows, own][:, None] / to_own
        weight[rows, own] = 0.0
        weight[rows, own] = -weight.sum(axis=1)
        # differences, not positions: what is common to all must not lose digits
        result[low:high] = np.einsum("nj,njk->nk", weight, x[window] - x[low:high, None, :])
    return result


def evenly_spaced(path: Path, orbit: RealOrbit) -> RealOrbit:
    """The same orbit on an even grid: as it is, or interpolated over holes of HOLE_S at most. Raises DataError."""
    t = orbit.t_gps_ns
    steps = np.diff(t)
    if len(steps) < 2 * NODES_EACH_SIDE:
        raise DataError(f"{path}: {len(t)} samples are too few; {2 * NODES_EACH_SIDE + 1} are the least")
    if steps.min() == steps.max():
        return orbit
    widest = int(np.argmax(steps))
    if steps[widest] > HOLE_S * gps_time.NS:
        raise DataError(
            f"{path}: no samples for {steps[widest] / 1e9:.0f} s after {gps_time.to_calendar(int(t[widest]))} GPS; "
            "choose a span without gaps"
        )
    step = int(min(np.median(steps), GRID_S * gps_time.NS))
    grid = np.arange(t[0], t[-1] + 1, step, dtype=np.int64)
    r, v = interpolate_uneven(t, orbit.r_m, orbit.v_mps, grid)
    return orbit._replace(t_gps_ns=grid, r_m=r, v_mps=v)


def _check_order(path: Path, t: np.ndarray, line: np.ndarray) -> None:
    back = np.flatnonzero(np.diff(t) <= 0)
    if len(back):
        raise DataError(
            f"{path}: line {line[back[0] + 1]}: its time is not after that of line {line[back[0]]}; "
            "sort the file by time and remove repeated epochs"
        )


def _check_positions(path: Path, found: FileSamples) -> None:
    radius = np.linalg.norm(found.r_m, axis=1)
    low, high = RADIUS_M
    bad = ~((radius > low) & (radius < high))  # NaN is bad too
    if bad.any():
        at = int(np.argmax(bad))
        raise DataError(
            f"{path}: line {found.line[at]}: {radius[at]:.6g} m from the Earth's centre is no orbit; "
            f"positions of {found.kind} files are in their standard's unit: convert the file or mend the line"
        )


def _unit(path: Path, v_file: np.ndarray, slope: np.ndarray) -> str:
    speed, in_file = (float(np.median(np.linalg.norm(x, axis=1))) for x in (slope, v_file))
    fits = [unit for unit, factor in UNITS_MPS.items() if abs(in_file * factor / speed - 1.0) < SAME_SPEED]
    if not fits:
        raise DataError(
            f"{path}: velocities of {in_file:.6g} match positions moving at {speed:.6g} m/s in none of "
            f"{', '.join(UNITS_MPS)}; give --velocity-unit (orbit.velocity_unit): the right one, or {DERIVE} to "
            "differentiate the positions"
        )
    return fits[0]


def _mismatch(path: Path, line: np.ndarray, v_mps: np.ndarray, slope: np.ndarray) -> float:
    apart = np.nan_to_num(np.linalg.norm(v_mps - slope, axis=1), nan=np.inf)
    median = float(np.median(apart))
    worst = int(np.argmax(apart))
    if median > MEDIAN_MPS or apart[worst] > max(CONTRADICTION_MPS, CONTRADICTION_MEDIANS * median):
        raise DataError(
            f"{path}: line {line[worst]}: velocity and differentiated position are {apart[worst]:.3g} m/s apart "
            f"({median:.3g} m/s in the median): a broken line nearby, a burn, or another frame or unit than the file "
            f"says; cut that part out, or give --velocity-unit (orbit.velocity_unit), {DERIVE} to differentiate "
            "the positions"
        )
    return median
