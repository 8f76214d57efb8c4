"""Pseudoranges of a RINEX file, 2 or 3, plain, gzipped or Hatanaka-compressed, free of the ionosphere's delay.

georinex (with hatanaka) reads the file; here two frequencies become one range (IS-GPS-200, 20.3.3.3.3.3).
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightsw.gnss.records import Constellation
from ground.errors import OperatorError

LETTERS = {"G": Constellation.GPS, "R": Constellation.GLONASS, "E": Constellation.GALILEO}
# first and second code, in order of preference, and the ratio of their frequencies; RINEX 3 and 2 names
PAIRS = {
    "G": ((("C1W", "C2W"), ("C1C", "C2W"), ("P1", "P2"), ("C1", "P2")), 154.0 / 120.0),
    "R": ((("C1P", "C2P"), ("C1C", "C2C"), ("P1", "P2")), 9.0 / 7.0),
    "E": ((("C1C", "C5Q"), ("C1X", "C5X")), 154.0 / 115.0),
}


class Observed(NamedTuple):
    """m epochs, k satellites. t_gps_ns (m,): time stamps of the receiver. names (k,): as G05. range_m (m,k), NaN: none.

    place_m: of the header, or None. height_m: of the antenna above the marker.
    """

    t_gps_ns: np.ndarray
    names: tuple[str, ...]
    range_m: np.ndarray
    place_m: np.ndarray | None
    height_m: float


def read_observed(path: Path, systems: str = "GER") -> Observed:
    """Ionosphere-free pseudoranges of a file. Raises OperatorError where it cannot be read or holds none."""
    import georinex

    wanted = sorted({code for system in systems for pair in PAIRS[system][0] for code in pair})
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            header = georinex.rinexheader(path)
            data = georinex.load(path, use=set(systems), meas=wanted)
    except (OSError, ValueError, KeyError, TypeError, LookupError) as error:
        raise OperatorError(f"{path}: cannot be read as RINEX observations: {error}") from error
    if "time" not in data or data.sizes.get("time", 0) == 0:
        raise OperatorError(f"{path}: holds no observation of {', '.join(systems)}; name an observation file (O)")
    names = tuple(str(name) for name in data.sv.values)
    range_m = np.full((data.sizes["time"], len(names)), np.nan)
    for system in systems:
        mine = [k for k, name in enumerate(names) if name[0] == system]
        pairs, ratio = PAIRS[system]
        for first, second in reversed(pairs):
            if first in data and second in data:
                one, two = data[first].values[:, mine], data[second].values[:, mine]
                free = (ratio**2 * one - two) / (ratio**2 - 1.0)
                range_m[:, mine] = np.where(np.isfinite(free), free, range_m[:, mine])
    if not np.isfinite(range_m).any():
        raise OperatorError(f"{path}: no satellite has codes on two frequencies ({', '.join(wanted)})")
    times = data.time.values.astype("datetime64[ns]") - np.datetime64("1980-01-06", "ns")
    return Observed(times.astype(np.int64), names, range_m, _place(header), _height(header))


def _place(header: object) -> np.ndarray | None:
    position = header.get("position") if isinstance(header, dict) else None
    return None if position is None or not np.any(position) else np.asarray(position, float)


def _height(header: object) -> float:
    words = str(header.get("ANTENNA: DELTA H/E/N", "")).split() if isinstance(header, dict) else []
    return float(words[0]) if words else 0.0
