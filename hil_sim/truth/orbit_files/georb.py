"""GEORB .orb text: a header of `name : value` lines, then MJD, seconds, position [m], velocity [m/s]."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError
from hil_sim.truth.orbit_files.text import FileSamples, Moment, read_text

JITTER_NS = 2_000  # time stamps are rounded to about 0.2 microseconds
_FRAMES = {"ICRF": "GCRF", "ITRF": "ITRF"}
_SCALES = {"Terrestrial Time": "TT", "TT": "TT", "GPS Time": "GPS", "TAI": "TAI", "UTC": "UTC"}


def is_georb(text: str) -> bool:
    """Whether a file's text begins as a GEORB file does."""
    return text.lstrip().startswith("GEORB format")


def samples(path: Path) -> FileSamples:
    """The satellite of a GEORB file; ICRF is taken as GCRF. Raises DataError with file and line."""
    header: dict[str, str] = {}
    rows: list[tuple[float, ...]] = []
    numbers: list[int] = []
    in_header, width = True, 0
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if in_header:
            key, _, value = (part.strip() for part in line.partition(":"))
            header[key] = value
            in_header = not line.startswith("end_of_header")
            continue
        words = line.split()
        if not words:
            continue
        width = width or len(line.rstrip())
        try:
            if len(words) != 8 or len(line.rstrip()) != width:
                raise ValueError
            rows.append((int(words[0]), *map(float, words[1:])))
            numbers.append(number)
        except ValueError:
            raise DataError(
                f"{path}: line {number}: not GEORB: MJD, seconds, position, velocity in a line as long as the first"
            ) from None
    frame, scale = header.get("Reference Frame", ""), header.get("Time scale", "")
    if scale not in _SCALES or frame not in _FRAMES or not rows:
        raise DataError(
            f"{path}: not a GEORB orbit in ICRF or ITRF and Terrestrial Time (frame {frame!r}, time scale {scale!r}, "
            f"{len(rows)} lines of data)"
        )
    table = np.array(rows)
    stamped_ns = np.rint(table[:, 1] * 1e9).astype(np.int64)
    # the orbit was integrated on a grid of whole milliseconds; 0.2 microseconds of rounding are 1.5 mm
    grid_ns = (stamped_ns + 500_000) // 1_000_000 * 1_000_000
    off_ns = np.abs(stamped_ns - grid_ns)
    if off_ns.max() > JITTER_NS:
        raise DataError(
            f"{path}: line {numbers[int(off_ns.argmax())]}: time stamps off the millisecond grid by more than "
            f"{JITTER_NS} ns"
        )
    days = table[:, 0].astype(np.int64) - gps_time.GPS_EPOCH_MJD
    satellite = header.get("Orbiting Object/Satellite", "")
    return FileSamples(
        [Moment(int(day), int(within)) for day, within in zip(days, grid_ns, strict=True)],
        _SCALES[scale],
        table[:, 2:5],
        table[:, 5:8],
        "m/s",
        _FRAMES[frame],
        satellite,
        path.name.partition(".")[0],
        "GEORB",
        np.array(numbers),
    )
