"""SP3 files, versions a, c and d: orbits and clocks of any number of satellites.

Format: Hilla, The Extended Standard Product 3 Orbit Format (SP3-c, 2010; SP3-d, 2016). Fixed columns; a record that
is cut off is refused, not read as a shorter number. Accuracy codes, correlations (EP, EV) and clock rates are not read.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from hil_sim.errors import DataError
from hil_sim.truth.orbit_files.text import SCALES, FileSamples, Moment, moment, read_text

_MISSING_CLOCK = 999_999.0
_COLUMNS = ((4, 18), (18, 32), (32, 46))


class Sp3(NamedTuple):
    """Everything of a file that is used. m epochs, k satellites.

    moments: m readings in `scale`. r_m (m, k, 3), NaN where missing. v (m, k, 3) in the file's unit, NaN where missing.
    clock_s (m, k): satellite clock minus time of the file, NaN where missing. line (m, k): of each position record.
    """

    path: Path
    version: str
    scale: str
    frame_name: str
    satellites: tuple[str, ...]
    moments: tuple[Moment, ...]
    r_m: np.ndarray
    v: np.ndarray
    clock_s: np.ndarray
    line: np.ndarray


def is_sp3(text: str) -> bool:
    """Whether a file's text begins as an SP3 file does."""
    return len(text) > 2 and text[0] == "#" and text[1] in "abcd" and text[2] in "PV"


def read_sp3(path: Path, time_scale: str | None = None) -> Sp3:
    """A whole SP3 file. time_scale: overrides the header's. Raises DataError with file and line."""
    lines = read_text(path).splitlines()
    if not lines or not is_sp3(lines[0]):
        raise DataError(f"{path}: not an SP3 file: its first line must begin with #a, #c or #d and P or V")
    scale, frame_name = "", lines[0][46:51].strip()
    moments: list[Moment] = []
    found: dict[tuple[int, str], list[float]] = {}  # epoch, satellite -> x y z clock vx vy vz line
    for number, line in enumerate(lines, start=1):
        try:
            if line.startswith("%c") and not scale:
                scale = line[9:12].strip()
            elif line.startswith("*"):
                words = line[1:].split()
                year, month, day, hour, minute = (int(word) for word in words[:5])
                moments.append(moment(year, month, day, hour, minute, words[5]))
            elif line[:1] in ("P", "V") and number > 2:
                _record(line, len(moments) - 1, number, found)
            elif line.startswith("EOF"):
                break
        except (ValueError, IndexError) as error:
            raise DataError(f"{path}: line {number}: not SP3: {error}; fetch the file again") from None
    return _assemble(path, lines[0][1], _scale(path, scale, time_scale), frame_name, moments, found)


def samples(file: Sp3, satellite: str | None = None) -> FileSamples:
    """One satellite of a file. satellite: its identifier, None if there is only one. Raises DataError."""
    known = ", ".join(file.satellites) or "none"
    if satellite is None:
        if len(file.satellites) > 1:
            raise DataError(
                f"{file.path}: holds {len(file.satellites)} satellites; name one in orbit.satellite: {known}"
            )
        satellite = file.satellites[0] if file.satellites else ""
    if satellite not in file.satellites:
        raise DataError(f"{file.path}: no satellite {satellite!r}; it holds {known}")
    k = file.satellites.index(satellite)
    there = np.isfinite(file.r_m[:, k, 0])
    v = file.v[there, k]
    has_v = np.isfinite(v[:, 0])
    if has_v.any() and not has_v.all():
        at = int(file.line[there, k][np.argmin(has_v)])
        raise DataError(
            f"{file.path}: line {at}: a position without velocity where others have one; "
            'give --velocity-unit derive (orbit.velocity_unit = "derive") to differentiate the positions'
        )
    return FileSamples(
        [when for when, here in zip(file.moments, there, strict=True) if here],
        file.scale,
        file.r_m[there, k],
        v if has_v.any() else None,
        "dm/s",
        "ITRF",
        satellite,
        f"{file.path.name.partition('.')[0]} {satellite}",
        f"SP3-{file.version}",
        file.line[there, k],
    )


def _record(line: str, epoch: int, number: int, found: dict[tuple[int, str], list[float]]) -> None:
    if epoch < 0:
        raise ValueError("a record before the first epoch")
    if len(line.rstrip()) < 46:
        raise ValueError("the record is cut off")
    name = line[1:4].strip()
    if not name or not line[46:].isascii():
        raise ValueError("no satellite identifier")
    name = f"G{int(name):02d}" if name.isdigit() else name.replace(" ", "0")  # version a knows GPS only
    vector = [float(line[a:b]) for a, b in _COLUMNS]
    row = found.setdefault((epoch, name), [np.nan] * 7 + [float(number)])
    if line[0] == "P":
        if not np.isnan(row[0]):
            raise ValueError(f"a second position of {name} at one epoch")
        clock = line[46:60].strip()
        row[3] = float(clock) if clock else _MISSING_CLOCK
        row[:3] = vector
        row[7] = number
    else:
        row[4:7] = vector


def _scale(path: Path, in_file: str, override: str | None) -> str:
    scale = override if override is not None else in_file
    if scale == "ccc":
        return "GPS"  # versions a and b have no other
    if scale not in SCALES:
        raise DataError(
            f"{path}: time scale {scale!r} in the %c record; known are {', '.join(SCALES)}; "
            "give --time-scale if the file is known to be right"
        )
    return scale


def _assemble(
    path: Path,
    version: str,
    scale: str,
    frame_name: str,
    moments: list[Moment],
    found: dict[tuple[int, str], list[float]],
) -> Sp3:
    satellites = tuple(sorted({name for _, name in found}))
    if not found:
        raise DataError(f"{path}: an SP3 file without position records")
    table = np.full((len(moments), len(satellites), 8), np.nan)
    column = {name: k for k, name in enumerate(satellites)}
    for (epoch, name), row in found.items():
        table[epoch, column[name]] = row
    r_m = table[..., :3] * 1e3
    r_m[np.all(table[..., :3] == 0.0, axis=-1)] = np.nan  # the standard's sign for missing
    v = table[..., 4:7].copy()
    v[np.all(v == 0.0, axis=-1)] = np.nan
    clock_s = table[..., 3] * 1e-6
    clock_s[table[..., 3] >= _MISSING_CLOCK] = np.nan
    line = np.nan_to_num(table[..., 7]).astype(np.int64)
    return Sp3(path, version, scale, frame_name, satellites, tuple(moments), r_m, v, clock_s, line)
