"""Broadcast ephemerides of a RINEX navigation file: GPS, Galileo and GLONASS; RINEX 2, 3; plain or gzipped.

Read here and not by georinex, which reads observations for us: under the xarray that it is installed with today its
navigation reader leaves out most records of a satellite whose times differ from the first one's, without a word.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ground.errors import OperatorError
from hil_sim.truth.orbit_files.text import DataError, moment, read_text, to_gps_ns

_LINES = {"G": 8, "E": 8, "R": 4, "C": 8, "J": 8, "I": 8, "S": 4}
_WEEK_NS = 604_800 * 10**9
_WIDTH = 19


class Ephemeris(NamedTuple):
    """One record. clock_gps_ns: reference of its clock; values: the numbers of the record, in order."""

    name: str
    clock_gps_ns: int
    values: tuple[float, ...]

    @property
    def reference_gps_ns(self) -> int:
        """When its orbit holds best: toe of GPS and Galileo, t_b of GLONASS."""
        if self.name[0] == "R":
            return self.clock_gps_ns
        toe_ns = round(self.values[11] * 1e9)
        return self.clock_gps_ns + (toe_ns - self.clock_gps_ns + _WEEK_NS // 2) % _WEEK_NS - _WEEK_NS // 2

    @property
    def healthy(self) -> bool:
        """As the satellite says of itself."""
        return self.values[6 if self.name[0] == "R" else 24] == 0.0


def read_ephemerides(path: Path, systems: str = "GER") -> list[Ephemeris]:
    """All records of a file, in order. Raises OperatorError naming file and line."""
    try:
        lines = read_text(path).splitlines()
    except (DataError, OSError) as error:
        raise OperatorError(f"{path}: cannot be read: {error}") from error
    head = lines[0] if lines else ""
    if "RINEX VERSION" not in head or "NAV" not in head[20:60].upper():
        raise OperatorError(f"{path}: is no RINEX navigation file; name one (N, G or MN)")
    try:
        version = float(head[:9])
        at = next(n for n, line in enumerate(lines) if "END OF HEADER" in line) + 1
    except (ValueError, StopIteration):
        raise OperatorError(f"{path}: its header has no version or no END OF HEADER") from None
    if not 2.0 <= version < 4.0:
        raise OperatorError(f"{path}: RINEX {version:g} is not read; give RINEX 2 or 3")
    alone = "" if version >= 3.0 else ("R" if "GLONASS" in head[20:60].upper() else "G")
    found = []
    while at < len(lines):
        line = lines[at]
        if not line.strip():
            at += 1
            continue
        system = alone or line[:1]
        if system not in _LINES:
            raise OperatorError(f"{path}:{at + 1}: {line[:3]!r} begins no record of a known constellation")
        count = _LINES[system]
        if not alone:  # GLONASS has a line more from 3.05 on
            ends = (k for k in range(at + 1, len(lines)) if not lines[k].startswith(" "))
            count = next(ends, len(lines)) - at
        if system in systems:
            try:
                found.append(_record(lines[at : at + count], system, bool(alone)))
            except (ValueError, IndexError, DataError) as error:
                raise OperatorError(f"{path}:{at + 1}: not a navigation record ({error})") from None
        at += count
    if not found:
        raise OperatorError(f"{path}: holds no ephemeris of {', '.join(systems)}")
    return found


def _record(lines: list[str], system: str, short: bool) -> Ephemeris:
    """A record of RINEX 3, or of RINEX 2 (short), which is one column to the left."""
    if len(lines) < _LINES[system]:
        raise ValueError("the file ends in it")
    head = lines[0]
    left, number, second = (3, head[0:2], head[17:22]) if short else (4, head[1:3], head[21:23])
    year, month, day, hour, minute = (int(word) for word in head[left : 17 if short else 20].split())
    if short:
        year += 2000 if year < 80 else 1900
    reading = moment(year, month, day, hour, minute, second.strip())
    t_ns = int(to_gps_ns((reading,), "UTC" if system == "R" else "GPS")[0])
    texts = [head[left + _WIDTH * k : left + _WIDTH * (k + 1)] for k in (1, 2, 3)]
    texts += [line[left + _WIDTH * k : left + _WIDTH * (k + 1)] for line in lines[1 : _LINES[system]] for k in range(4)]
    values = [_number(text) for text in texts]
    if not all(np.isfinite(values)):
        raise ValueError("a number in it is not finite")
    return Ephemeris(f"{system}{int(number):02d}", t_ns, tuple(values))


def _number(text: str) -> float:
    """Of a field; what is blank is zero, as the format has it."""
    return float(text.replace("D", "E").replace("d", "e")) if text.strip() else 0.0
