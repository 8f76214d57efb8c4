"""A state with its covariance from a CCSDS Orbit Parameter Message in KVN. Source: CCSDS 502.0-B-3, section 3."""

from __future__ import annotations

import math
import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from flightsw.icd.enums import StateFrame
from ground.errors import OperatorError

_FRAMES = {"GCRF": StateFrame.GCRF, "ICRF": StateFrame.GCRF}
_EARTH_FIXED = re.compile(r"ITRF(-?\d{2,4})?")
_STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
_EPOCH = datetime(1980, 1, 6)
_GPS_MINUS_S = {"GPS": 0.0, "TAI": -19.0, "TT": -51.184}  # IS-GPS-200; IAU 1991
_INSTANT = re.compile(r"(\d{4}-\d{2}-\d{2}|\d{4}-\d{3})T(\d{2}:\d{2}:\d{2})(\.\d+)?Z?")
_LARGEST_BYTES = 1 << 20
_NS_PER_S = 1_000_000_000


class GivenState(NamedTuple):
    """t_gps_ns; frame; state (6) [m, m/s]; covariance (21): upper triangle, row by row [m2, m2/s, m2/s2]."""

    t_gps_ns: int
    frame: StateFrame
    state: tuple[float, ...]
    covariance: tuple[float, ...]


def read_opm(path: Path) -> GivenState:
    """The state of a file. Raises OperatorError that names the line or the keyword, and what would do."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read ({error.strerror})") from None
    if len(raw) > _LARGEST_BYTES:
        raise OperatorError(f"{path}: {len(raw)} bytes are no orbit parameter message")
    values = _keywords(path, raw.decode("utf-8", "replace"))

    def word(name: str) -> str:
        if name not in values:
            raise OperatorError(f"{path}: no {name}; a state needs it (CCSDS 502.0-B-3, table 3-3)")
        return values[name]

    def number(name: str) -> float:
        text = word(name).partition("[")[0].strip()
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise OperatorError(f"{path}: {name} = {text}: give a number")
        return value

    word("CCSDS_OPM_VERS")
    if word("CENTER_NAME").upper() != "EARTH":
        raise OperatorError(f"{path}: CENTER_NAME = {values['CENTER_NAME']}: flight knows states about EARTH only")
    frame = _frame(path, word("REF_FRAME"))
    told = values.get("COV_REF_FRAME", values["REF_FRAME"])
    if told.upper() != values["REF_FRAME"].upper():
        raise OperatorError(f"{path}: COV_REF_FRAME = {told}: give the covariance in the frame of the state")
    rows = [[number(f"C{_STATE[i]}_{_STATE[j]}") for j in range(i + 1)] for i in range(6)]
    return GivenState(
        _instant(path, word("EPOCH"), word("TIME_SYSTEM").upper()),
        frame,
        tuple(1e3 * number(name) for name in _STATE),
        tuple(1e6 * rows[j][i] for i in range(6) for j in range(i, 6)),
    )


def _keywords(path: Path, text: str) -> dict[str, str]:
    values: dict[str, str] = {}
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if not line or line.startswith("COMMENT"):
            continue
        name, equals, value = line.partition("=")
        name = name.strip().upper()
        if not equals or not name:
            raise OperatorError(f"{path}, line {number}: KEYWORD = value is expected; XML is not read")
        if name in values and not name.startswith(("MAN_", "USER_DEFINED")):
            raise OperatorError(f"{path}, line {number}: {name} for the second time; give one state to a file")
        values[name] = value.strip()
    return values


def _frame(path: Path, name: str) -> StateFrame:
    upper = name.upper()
    if upper in _FRAMES:
        return _FRAMES[upper]
    if _EARTH_FIXED.fullmatch(upper):
        return StateFrame.ITRF
    remedy = "; it differs from GCRF by some 0.8 m in low orbit: convert it" if upper == "EME2000" else ""
    raise OperatorError(f"{path}: REF_FRAME = {name}: give GCRF, ICRF or ITRF{remedy}")


def _instant(path: Path, text: str, scale: str) -> int:
    found = _INSTANT.fullmatch(text)
    try:
        if found is None:
            raise ValueError
        day, clock, fraction = found.groups()
        form = "%Y-%m-%dT%H:%M:%S" if day.count("-") == 2 else "%Y-%jT%H:%M:%S"
        instant = datetime.strptime(f"{day}T{clock}", form)
    except ValueError:
        raise OperatorError(f"{path}: EPOCH = {text}: give it as 2018-12-30T12:00:00.000") from None
    whole_s = (instant - _EPOCH) // timedelta(seconds=1)
    offset_s = _GPS_MINUS_S.get(scale)
    if scale == "UTC":
        import erfa

        offset_s = float(erfa.dat(instant.year, instant.month, instant.day, 0.0)) - 19.0
    if offset_s is None:
        raise OperatorError(f"{path}: TIME_SYSTEM = {scale}: give UTC, TAI, TT or GPS")
    t_gps_ns = whole_s * _NS_PER_S + round((float(fraction or 0.0) + offset_s) * _NS_PER_S)
    if t_gps_ns < 0:
        raise OperatorError(f"{path}: EPOCH = {text}: before GPS time began")
    return t_gps_ns
