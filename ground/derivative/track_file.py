"""A track of positions from a CSV file, and velocity and acceleration of it with their sigmas into another.

The first line names the columns: `t_s` or `t`, then one to three positions, of any names, in metres, or `lat_deg`,
`lon_deg` and `h_m` (WGS 84), which become east, north, up of the first point; `sigma` or `sigma_<position>` [m] if
known.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightsw.derivative.setup import BankSettings, LagSettings, Model
from ground.derivative import tracks
from ground.errors import OperatorError

_TIMES = ("t_s", "t", "time_s", "time")
_GEODETIC = ("lat_deg", "lon_deg", "h_m")
_AXIS_M, _FLATTENING = 6378137.0, 1.0 / 298.257223563  # WGS 84
ROWS_MIN = 10


class Positions(NamedTuple):
    """Times (m,) ascending, positions (m, axes) [m], sigmas of the same shape, names, rows left out."""

    t_s: np.ndarray
    z_m: np.ndarray
    sigma_m: np.ndarray
    names: tuple[str, ...]
    left_out: int
    sigma_from: str


class Result(NamedTuple):
    """Estimates over a file's positions, at once and lag_s later."""

    positions: Positions
    causal: tracks.Track
    smoothed: tracks.Track
    lag_s: float
    gap_s: float
    nis: float


def read(path: Path, sigma_m: float | None) -> Positions:
    """Positions of a file. sigma_m: of each axis where the file has none; neither: from the data themselves."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = [row for row in csv.reader(line for line in stream if not line.startswith("#")) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise OperatorError(f"{path}: cannot be read: {error}") from error
    if len(rows) < ROWS_MIN + 1:
        raise OperatorError(
            f"{path}: has {max(len(rows) - 1, 0)} rows; {ROWS_MIN} or more and a line of names are needed"
        )
    header = [name.strip() for name in rows[0]]
    time = next((name for name in _TIMES if name in header), None)
    if time is None:
        raise OperatorError(f"{path}: no column {' or '.join(_TIMES)}; the first line must name the columns")
    sigmas = [name for name in header if name.startswith("sigma")]
    names = [name for name in header if name != time and name not in sigmas]
    if not 1 <= len(names) <= 3:
        raise OperatorError(f"{path}: {len(names)} columns of positions ({', '.join(names)}); give one to three")
    strange = [name for name in sigmas if name != "sigma" and name.removeprefix("sigma_") not in names]
    if strange:
        raise OperatorError(f"{path}: {strange[0]} belongs to no position; columns: {', '.join(names)}")
    table = np.array([_numbers(row, len(header)) for row in rows[1:]])
    t_s, z = table[:, header.index(time)], table[:, [header.index(name) for name in names]]
    given = [next((s for s in (f"sigma_{name}", "sigma") if s in sigmas), None) for name in names]
    spread = np.column_stack([table[:, header.index(s)] if s else np.full(len(table), sigma_m or 1.0) for s in given])
    good = np.isfinite(t_s) & np.isfinite(z).all(axis=1) & (spread > 0.0).all(axis=1) & np.isfinite(spread).all(axis=1)
    newest = np.concatenate(([-math.inf], np.fmax.accumulate(np.where(good, t_s, -math.inf))[:-1]))
    good &= t_s > newest
    if good.sum() < ROWS_MIN:
        raise OperatorError(
            f"{path}: {int(good.sum())} rows of numbers in order of time; {ROWS_MIN} or more are needed"
        )
    t_s, z, spread = t_s[good], z[good], spread[good]
    if set(names) <= set(_GEODETIC) and len(names) >= 2:
        if not {"lat_deg", "lon_deg"} <= set(names):
            raise OperatorError(f"{path}: lat_deg and lon_deg belong together")
        height = z[:, names.index("h_m")] if "h_m" in names else np.zeros(len(z))
        if any(s is not None and s != "sigma" for s in given):
            raise OperatorError(f"{path}: sigmas of lat_deg and lon_deg: give one column sigma, in metres")
        z = local(z[:, names.index("lat_deg")], z[:, names.index("lon_deg")], height)[:, : len(names)]
        names = ["east", "north", "up"][: len(names)]
    origin = "the file" if all(given) else "--sigma" if sigma_m else "the data's own scatter"
    if origin == "the data's own scatter":
        lacking = [k for k, s in enumerate(given) if s is None]
        spread[:, lacking] = scatter(z)[lacking]
    return Positions(
        t_s, np.ascontiguousarray(z), np.ascontiguousarray(spread), tuple(names), len(table) - len(t_s), origin
    )


def _numbers(row: list[str], width: int) -> list[float]:
    values = []
    for text in (row + [""] * width)[:width]:
        try:
            values.append(float(text))
        except ValueError:
            values.append(math.nan)
    return values


def local(lat_deg: np.ndarray, lon_deg: np.ndarray, h_m: np.ndarray) -> np.ndarray:
    """East, north, up (m, 3) [m] in the axes of the first point, WGS 84."""
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    e2 = _FLATTENING * (2.0 - _FLATTENING)
    normal = _AXIS_M / np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
    flat = (normal + h_m) * np.cos(lat)
    r = np.column_stack([flat * np.cos(lon), flat * np.sin(lon), (normal * (1.0 - e2) + h_m) * np.sin(lat)])
    s0, c0, sl, cl = np.sin(lat[0]), np.cos(lat[0]), np.sin(lon[0]), np.cos(lon[0])
    axes = np.array([[-sl, cl, 0.0], [-s0 * cl, -s0 * sl, c0], [c0 * cl, c0 * sl, s0]])
    return np.asarray((r - r[0]) @ axes.T)


def scatter(z: np.ndarray) -> np.ndarray:
    """Standard deviation (axes,) of white noise in a smooth track: from fourth differences, by the median."""
    differences = np.abs(np.diff(z, 4, axis=0))
    found = np.median(differences, axis=0) / (0.6745 * math.sqrt(70.0))  # 70 = 1 + 16 + 36 + 16 + 1
    return np.asarray(np.maximum(found, 1e-6))


def estimate(positions: Positions, lag_s: float, agility: float) -> Result:
    """Velocity and acceleration of a file's positions. agility: times as much noise in the manoeuvring models."""
    axes = positions.z_m.shape[1]
    step_s = float(np.median(np.diff(positions.t_s)))
    usual, later = BankSettings(), LagSettings()
    gap_s = max(usual.gap_s, 10.0 * step_s)
    quiet, *rest = usual.models
    models = (quiet, *(Model(m.order, m.q * agility**2, m.stay_s, m.enter) for m in rest))
    settings = BankSettings(models, axes, gap_s)
    lagged = LagSettings(later.order, later.q * agility**2, lag_s, axes, gap_s)
    causal = tracks.causal(settings, positions.t_s, positions.z_m, positions.sigma_m)
    smoothed = tracks.smoothed(lagged, positions.t_s, positions.z_m, positions.sigma_m)
    return Result(positions, causal, smoothed, lag_s, gap_s, float(np.nanmedian(causal.nis)))


def write(result: Result, path: Path) -> None:
    """One row for each position: causal and smoothed estimates with their sigmas, weights of the models."""
    header, columns = ["t_s"], [result.positions.t_s[:, None]]
    for word, track in (("", result.causal), ("smoothed_", result.smoothed)):
        for axis, name in enumerate(result.positions.names):
            for k, unit in enumerate(("m", "mps", "mps2")):
                kind = ("position", "velocity", "acceleration")[k]
                header += [f"{word}{kind}_{name}_{unit}", f"{word}sigma_{kind}_{name}_{unit}"]
                columns += [track.mean[:, axis, k : k + 1], track.sigma[:, axis, k : k + 1]]
    header += [f"weight_{word}" for word in ("quiet", "turning", "jumping")]
    columns.append(result.causal.weight)
    try:
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(header)
            writer.writerows([f"{value:.9g}" for value in row] for row in np.hstack(columns).tolist())
    except OSError as error:
        raise OperatorError(f"{path}: cannot be written: {error.strerror}") from error
