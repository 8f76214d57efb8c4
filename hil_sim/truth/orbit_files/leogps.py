"""Precise orbits as LEOGPS keeps them: CSV of date d/m/y, time, position [km], velocity [dm/s]; Earth-fixed, GPS time.

Columns have no header, so units and frame are this format's and are checked against each other, as everywhere.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from hil_sim.errors import DataError
from hil_sim.truth.orbit_files.text import FileSamples, Moment, moment, read_text

_ROW = re.compile(r"(\d{1,2})/(\d{1,2})/(\d{4}),(\d{1,2}):(\d{2}):(\d{2}(?:\.\d*)?)((?:,[-+\d.eE]+){6})$")


def is_leogps(text: str) -> bool:
    """Whether a file's first line is a row of such a file."""
    return _ROW.match(text.split("\n", 1)[0].strip()) is not None


def samples(path: Path) -> FileSamples:
    """The satellite of the file. Raises DataError with file and line."""
    moments: list[Moment] = []
    states: list[list[float]] = []
    numbers: list[int] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip():
            continue
        row = _ROW.match(line.strip())
        try:
            if row is None:
                raise ValueError("not d/m/yyyy,hh:mm:ss and six numbers")
            day, month, year, hour, minute = (int(word) for word in row.groups()[:5])
            moments.append(moment(year, month, day, hour, minute, row.group(6)))
            states.append([float(word) for word in row.group(7).split(",")[1:]])
        except ValueError as error:
            raise DataError(f"{path}: line {number}: {error}; fetch the file again") from None
        numbers.append(number)
    if not states:
        raise DataError(f"{path}: holds no row of an orbit")
    table = np.array(states)
    name = path.name.partition(".")[0]
    return FileSamples(
        moments, "GPS", table[:, :3] * 1e3, table[:, 3:], "dm/s", "ITRF", "", name, "LEOGPS", np.array(numbers)
    )
