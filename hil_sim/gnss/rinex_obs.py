"""RINEX 2 observation files (Gurtner and Estey, RINEX 2.11, 2007) of a GPS receiver.

Read: pseudoranges, carrier phases, signal strengths and the loss-of-lock bits. Satellites of other systems are left
out. A file that breaks its columns is refused with the line, not guessed at.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from hil_sim.errors import DataError
from hil_sim.truth.orbit_files.text import Moment, moment, read_text, to_gps_ns

_PER_LINE = 5
_SATELLITES_PER_LINE = 12
_WIDTH = 16


class Observations(NamedTuple):
    """What a receiver saw. m epochs, n rows, a row one satellite at one epoch, in order of time.

    t_ns (m,): receiver's time stamps, GPS scale. epoch (n,): index into t_ns. prn (n,): GPS satellite 1 to 32.
    values: observation code ('P1', 'L2', ...) -> (n,), NaN where missing; ranges [m], phases [cycles].
    slipped: code -> (n,) bool, its loss-of-lock bit: the phase may have jumped since the epoch before.
    """

    path: Path
    t_ns: np.ndarray
    epoch: np.ndarray
    prn: np.ndarray
    values: dict[str, np.ndarray]
    slipped: dict[str, np.ndarray]


def read_observations(path: Path) -> Observations:
    """All GPS observations of a RINEX 2 file, plain or gzipped. Raises DataError with file and line."""
    lines = read_text(path).splitlines()
    codes, start = _header(path, lines)
    per_satellite = -(-len(codes) // _PER_LINE)
    moments, epochs, prns = [], [], []
    values: list[list[float]] = []
    slips: list[list[bool]] = []
    at = start
    while at < len(lines):
        if not lines[at].strip():
            at += 1
            continue
        try:
            flag, count = int(lines[at][28:29]), int(lines[at][29:32])
            if flag > 1:  # an event: header lines follow
                at += 1 + count
                continue
            when = _epoch(lines[at])
            satellites, taken = _satellites(lines, at, count)
            moments.append(when)
            at += taken
            for satellite in satellites:
                record = [line.ljust(_WIDTH * _PER_LINE) for line in lines[at : at + per_satellite]]
                if len(record) < per_satellite:
                    raise ValueError("the file ends within an epoch")
                if satellite[0] in " G":
                    row = [_field(record[k // _PER_LINE], k % _PER_LINE) for k in range(len(codes))]
                    epochs.append(len(moments) - 1)
                    prns.append(int(satellite[1:]))
                    values.append([value for value, _ in row])
                    slips.append([slip for _, slip in row])
                at += per_satellite
        except (ValueError, IndexError) as error:
            raise DataError(f"{path}: line {at + 1}: not RINEX 2: {error}; fetch the file again") from None
    if not values:
        raise DataError(f"{path}: holds no GPS observation")
    t_ns = to_gps_ns(moments, "GPS")
    if np.any(np.diff(t_ns) <= 0):
        late = int(np.argmax(np.diff(t_ns) <= 0)) + 1
        raise DataError(f"{path}: epoch {late + 1} is not after the one before it; sort the file and drop repeats")
    table, bits = np.array(values), np.array(slips)
    return Observations(
        path,
        t_ns,
        np.array(epochs),
        np.array(prns),
        {code: table[:, k] for k, code in enumerate(codes)},
        {code: bits[:, k] for k, code in enumerate(codes)},
    )


def _header(path: Path, lines: list[str]) -> tuple[list[str], int]:
    """Observation codes in the order of the records, and the index of the first line after the header."""
    if not lines or lines[0][60:80].strip() != "RINEX VERSION / TYPE":
        raise DataError(f"{path}: not a RINEX file: its first line must end in RINEX VERSION / TYPE")
    if not lines[0][:9].strip().startswith("2") or lines[0][20:21] != "O":
        what = f"RINEX {lines[0][:9].strip()} {lines[0][20:21]}"
        raise DataError(f"{path}: line 1: {what}: only observations of version 2 are read")
    codes: list[str] = []
    count = 0
    for number, line in enumerate(lines, start=1):
        label = line[60:].strip()
        try:
            if label == "# / TYPES OF OBSERV":
                count = int(line[:6]) if line[:6].strip() else count
                codes += line[6:60].split()
            elif label == "TIME OF FIRST OBS" and line[48:51].strip() not in ("", "GPS"):
                raise ValueError(f"time system {line[48:51]}: only GPS time")
        except ValueError as error:
            raise DataError(f"{path}: line {number}: not RINEX 2: {error}") from None
        if label == "END OF HEADER":
            if not codes or len(codes) != count:
                raise DataError(f"{path}: line {number}: {count} observation types declared and {len(codes)} named")
            return codes, number
    raise DataError(f"{path}: ends within its header; fetch it again")


def _epoch(line: str) -> Moment:
    year, month, day, hour, minute = (int(line[a : a + 2]) for a in (1, 4, 7, 10, 13))
    return moment(year + (2000 if year < 80 else 1900), month, day, hour, minute, line[15:26])


def _satellites(lines: list[str], at: int, count: int) -> tuple[list[str], int]:
    """Identifiers of an epoch, and how many lines they take."""
    taken = max(1, -(-count // _SATELLITES_PER_LINE))
    text = "".join(line.ljust(68)[32:68] for line in lines[at : at + taken])
    names = [text[3 * k : 3 * k + 3] for k in range(count)]
    if len(text) < 3 * count or not all(name[1:].strip().isdigit() for name in names):
        raise ValueError(f"{count} satellites announced, listed are {text.strip()!r}")
    return names, taken


def _field(line: str, place: int) -> tuple[float, bool]:
    """Value and loss-of-lock bit; blank or zero is missing."""
    text, lock = line[_WIDTH * place : _WIDTH * place + 14], line[_WIDTH * place + 14]
    value = float(text) if text.strip() else 0.0
    return value if value != 0.0 else float("nan"), lock.isdigit() and bool(int(lock) & 1)
