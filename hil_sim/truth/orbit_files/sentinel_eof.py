"""Sentinel orbit files (.EOF): Earth Explorer XML of restituted and precise orbits, Earth-fixed, in metres.

Each state vector carries TAI, UTC and UT1 (Earth Observation CFI, Data Handling). TAI is taken, UTC where it is absent;
UT1 alone would need a table. Where TAI and UTC are both there they must differ by the leap seconds.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError
from hil_sim.truth.orbit_files.text import FileSamples, Moment, iso_moment, read_text, to_gps_ns
from hil_sim.truth.orbit_files.xml_nodes import Node, parse

KIND = "Sentinel orbit file"
_UNITS = {"X": "m", "Y": "m", "Z": "m", "VX": "m/s", "VY": "m/s", "VZ": "m/s"}
_LEAP_TOLERANCE_NS = 10_000  # microseconds are printed


def samples(path: Path, time_scale: str | None = None) -> FileSamples:
    """The satellite of the file. time_scale: 'TAI' or 'UTC', which of the printed times to take; None: TAI, else UTC.

    Raises DataError with file and line.
    """
    root = parse(path, read_text(path), KIND)
    frame = root.content("Ref_Frame")
    if frame != "EARTH_FIXED":
        raise DataError(f"{path}: Ref_Frame is {frame}: only EARTH_FIXED is read; ask for the Earth-fixed product")
    vectors = list(root.every("OSV"))
    if not vectors:
        raise DataError(f"{path}: a {KIND} without state vectors: no OSV in it")
    _check_count(path, root, len(vectors))
    if time_scale not in (None, "TAI", "UTC"):
        raise DataError(f"{path}: a {KIND} carries TAI and UTC; give --time-scale TAI or UTC, not {time_scale}")
    scale = time_scale or ("TAI" if vectors[0].first("TAI") is not None else "UTC")
    moments = [_moment(path, vector, scale) for vector in vectors]
    if time_scale is None and scale == "TAI":
        _check_leap_seconds(path, vectors, moments)
    states = np.array([[_value(path, vector, name) for name in _UNITS] for vector in vectors])
    return FileSamples(
        moments,
        scale,
        states[:, :3],
        states[:, 3:],
        "m/s",
        "ITRF",
        root.content("Mission") or "",
        path.name.partition(".")[0],
        "Sentinel EOF",
        np.array([vector.line for vector in vectors]),
    )


def _check_count(path: Path, root: Node, count: int) -> None:
    listing = root.first("List_of_OSVs")
    declared = None if listing is None else listing.attributes.get("count")
    if declared is not None and declared.strip() != str(count):
        raise DataError(f"{path}: declares {declared} state vectors and holds {count}; fetch the file again")


def _check_leap_seconds(path: Path, vectors: list[Node], moments: list[Moment]) -> None:
    if any(vector.first("UTC") is None for vector in vectors):
        return
    apart_ns = to_gps_ns(moments, "TAI") - to_gps_ns([_moment(path, vector, "UTC") for vector in vectors], "UTC")
    at = int(np.abs(apart_ns).argmax())
    if abs(int(apart_ns[at])) > _LEAP_TOLERANCE_NS:
        raise DataError(
            f"{path}: line {vectors[at].line}: TAI and UTC are {apart_ns[at] / gps_time.NS:+.6f} s from what the leap "
            "seconds say; give --time-scale with the one that is right"
        )


def _moment(path: Path, vector: Node, scale: str) -> Moment:
    text = vector.content(scale)
    if text is None:
        raise DataError(f"{path}: line {vector.line}: a state vector without {scale}; give the other --time-scale")
    try:
        return iso_moment(text.removeprefix(f"{scale}="))
    except ValueError as error:
        raise DataError(f"{path}: line {vector.line}: {scale}: {error}") from None


def _value(path: Path, vector: Node, name: str) -> float:
    node = vector.first(name)
    if node is None:
        raise DataError(f"{path}: line {vector.line}: a state vector without {name}; fetch the file again")
    unit = node.attributes.get("unit", _UNITS[name])
    try:
        value = float(node.text)
    except ValueError:
        value = math.nan
    if unit != _UNITS[name] or not math.isfinite(value):
        raise DataError(f"{path}: line {node.line}: {name} is {node.text!r} {unit}, not a number in {_UNITS[name]}")
    return value
