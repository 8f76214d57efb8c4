"""CCSDS Orbit Ephemeris Messages, KVN and XML (CCSDS 502.0-B-2 and B-3, section 5; XML 505.0-B), versions 1 to 3.

Several segments of one object become one series: each segment counts within its usable times, and where two meet the
same instant they must agree. Covariances and accelerations are not read.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import erfa
import numpy as np

from hil_sim.errors import DataError
from hil_sim.truth.orbit_files.text import FileSamples, Moment, iso_moment, read_text, to_gps_ns
from hil_sim.truth.orbit_files.xml_nodes import Node, parse

KIND = "CCSDS OEM"
JUNCTION_M = 1.0  # what two segments may differ by at a shared instant
_TIME_SYSTEMS = {"UTC": "UTC", "TAI": "TAI", "TT": "TT", "GPS": "GPS", "GPST": "GPS"}
_TERRESTRIAL = re.compile(r"ITRF(?:[-_ ]?(?:\d{2}|\d{4}))?$")
_CELESTIAL = {"GCRF": "GCRF", "ICRF": "GCRF", "EME2000": "EME2000", "J2000": "EME2000"}
_NEEDED = ("OBJECT_NAME", "CENTER_NAME", "REF_FRAME", "TIME_SYSTEM")
_XML_STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")


class _Segment(NamedTuple):
    """Metadata, and rows of (moment, x y z [km] vx vy vz [km/s], line)."""

    meta: dict[str, str]
    rows: list[tuple[Moment, list[float], int]]
    line: int


def is_oem(text: str) -> bool:
    """Whether a file's text is such a message in KVN (the XML form is known by its root element)."""
    return re.match(r"\s*(?:COMMENT[^\n]*\s+)*CCSDS_OEM_VERS\s*=", text) is not None


def samples(path: Path, satellite: str | None = None, time_scale: str | None = None) -> FileSamples:
    """One object of a message. satellite: its OBJECT_NAME or OBJECT_ID; None if there is only one.

    time_scale: overrides TIME_SYSTEM. The EME2000 frame is turned to GCRF. Raises DataError with file and line.
    """
    text = read_text(path)
    segments = _xml_segments(path, text) if text.lstrip().startswith("<") else _kvn_segments(path, text)
    segments = [segment for segment in segments if segment.rows]
    if not segments:
        raise DataError(f"{path}: a {KIND} without ephemeris data")
    for segment in segments:
        lacking = [key for key in _NEEDED if key not in segment.meta]
        if lacking:
            raise DataError(f"{path}: line {segment.line}: metadata without {', '.join(lacking)}")
    chosen = _of_satellite(path, segments, satellite)
    meta = chosen[0].meta
    frames = {_frame(path, segment) for segment in chosen}
    scales = {_scale(path, segment, time_scale) for segment in chosen}
    if len(frames) > 1 or len(scales) > 1:
        raise DataError(f"{path}: segments of {meta['OBJECT_NAME']} in several frames or time systems; split the file")
    (frame,), (scale,) = frames, scales
    rows = _joined(path, chosen, scale)
    states = np.array([row[1] for row in rows]) * 1e3
    r_m, v = states[:, :3], states[:, 3:]
    if frame == "EME2000":
        # the Conventions' frame bias, 23 mas: 0.8 m at 7000 km
        bias = erfa.bp06(erfa.DJ00, 0.0)[0]
        r_m, v, frame = r_m @ bias, v @ bias, "GCRF"
    return FileSamples(
        [row[0] for row in rows],
        scale,
        r_m,
        v * 1e-3,
        "km/s",
        frame,
        meta.get("OBJECT_ID", meta["OBJECT_NAME"]),
        meta["OBJECT_NAME"],
        KIND,
        np.array([row[2] for row in rows]),
    )


def _kvn_segments(path: Path, text: str) -> list[_Segment]:
    segments: list[_Segment] = []
    place = "header"
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        if not line or line.startswith("COMMENT"):
            continue
        if line == "META_START":
            segments.append(_Segment({}, [], number))
            place = "meta"
        elif line in ("META_STOP", "COVARIANCE_STOP"):
            place = "data"
        elif line == "COVARIANCE_START":
            place = "covariance"
        elif place == "data":
            words = line.split()
            segments[-1].rows.append(_row(path, number, words[0], words[1:]))
        elif place == "meta":
            key, equals, value = line.partition("=")
            if not equals:
                raise DataError(f"{path}: line {number}: {line!r} is no KEYWORD = value between META_START and _STOP")
            segments[-1].meta[key.strip()] = value.strip()
        elif place == "header" and "=" not in line:
            raise DataError(f"{path}: line {number}: {line!r} before any META_START; not a {KIND} or cut off")
    if place == "meta":
        raise DataError(f"{path}: ends within the metadata that begin at line {segments[-1].line}; fetch it again")
    return segments


def _xml_segments(path: Path, text: str) -> list[_Segment]:
    segments = []
    for node in parse(path, text, KIND).every("segment"):
        metadata = node.first("metadata")
        meta = {} if metadata is None else {child.tag: child.text for child in metadata.children}
        rows = []
        for vector in node.every("stateVector"):
            values = [child for name in _XML_STATE if (child := vector.first(name)) is not None]
            _check_units(path, values)
            rows.append(_row(path, vector.line, vector.content("EPOCH") or "", [child.text for child in values]))
        segments.append(_Segment(meta, rows, node.line))
    return segments


def _check_units(path: Path, values: list[Node]) -> None:
    for node in values:
        unit = node.attributes.get("units", "")
        standard = "km/s" if node.tag.endswith("_DOT") else "km"
        if unit and unit.lower() != standard:
            raise DataError(f"{path}: line {node.line}: {node.tag} in {unit}; the standard's unit is {standard}")


def _row(path: Path, number: int, epoch: str, words: list[str]) -> tuple[Moment, list[float], int]:
    try:
        if len(words) not in (6, 9):  # the latter with accelerations
            raise ValueError(f"{len(words)} numbers after the epoch where position and velocity are six")
        values = [float(word) for word in words]
        if not all(map(math.isfinite, values)):
            raise ValueError("a value that is not finite")
        return iso_moment(epoch), values[:6], number
    except ValueError as error:
        raise DataError(f"{path}: line {number}: {error}") from None


def _of_satellite(path: Path, segments: list[_Segment], satellite: str | None) -> list[_Segment]:
    names = {(s.meta["OBJECT_NAME"], s.meta.get("OBJECT_ID", "")) for s in segments}
    known = ", ".join(sorted(f"{name} ({number})" if number else name for name, number in names))
    if satellite is None:
        if len(names) > 1:
            raise DataError(f"{path}: holds {len(names)} objects; name one in orbit.satellite: {known}")
        return segments
    chosen = [s for s in segments if satellite in (s.meta["OBJECT_NAME"], s.meta.get("OBJECT_ID"))]
    if not chosen:
        raise DataError(f"{path}: no object {satellite!r}; it holds {known}")
    return chosen


def _frame(path: Path, segment: _Segment) -> str:
    if segment.meta["CENTER_NAME"].upper() != "EARTH":
        raise DataError(
            f"{path}: line {segment.line}: CENTER_NAME is {segment.meta['CENTER_NAME']}: only orbits about the Earth"
        )
    name = segment.meta["REF_FRAME"].upper()
    if _TERRESTRIAL.match(name):
        return "ITRF"
    if name not in _CELESTIAL:
        raise DataError(
            f"{path}: line {segment.line}: REF_FRAME is {name}: known are ITRF with or without a year, "
            f"{', '.join(_CELESTIAL)}; convert the file"
        )
    return _CELESTIAL[name]


def _scale(path: Path, segment: _Segment, override: str | None) -> str:
    name = (override or segment.meta["TIME_SYSTEM"]).upper()
    if name not in _TIME_SYSTEMS:
        raise DataError(
            f"{path}: line {segment.line}: TIME_SYSTEM is {name}: known are {', '.join(_TIME_SYSTEMS)}; "
            "convert the file, or give --time-scale if it is known to be one of these"
        )
    return _TIME_SYSTEMS[name]


def _joined(path: Path, segments: list[_Segment], scale: str) -> list[tuple[Moment, list[float], int]]:
    """Rows of all segments in order of time, within their usable times, a shared instant once."""
    rows: list[tuple[int, tuple[Moment, list[float], int]]] = []
    for segment in segments:
        times = to_gps_ns([row[0] for row in segment.rows], scale)
        first, last = (_limit(path, segment, key, scale) for key in ("USEABLE_START_TIME", "USEABLE_STOP_TIME"))
        for t, row in zip(times.tolist(), segment.rows, strict=True):
            if (first is None or t >= first) and (last is None or t <= last):
                rows.append((t, row))
    rows.sort(key=lambda item: item[0])
    joined: list[tuple[Moment, list[float], int]] = []
    before = None
    for t, row in rows:
        if before == t:
            apart_m = 1e3 * math.dist(joined[-1][1][:3], row[1][:3])
            if apart_m > JUNCTION_M:
                raise DataError(
                    f"{path}: line {row[2]}: {apart_m:.3g} m from line {joined[-1][2]}, which gives the same instant; "
                    "keep one of the two segments"
                )
            continue
        before = t
        joined.append(row)
    if not joined:
        raise DataError(f"{path}: line {segments[0].line}: no state vector within the usable times")
    return joined


def _limit(path: Path, segment: _Segment, key: str, scale: str) -> int | None:
    text = segment.meta.get(key)
    if text is None:
        return None
    try:
        return int(to_gps_ns([iso_moment(text)], scale)[0])
    except ValueError as error:
        raise DataError(f"{path}: line {segment.line}: {key}: {error}") from None
