"""The gravity field table: coefficients of an ICGEM model file (.gfc, also gzipped), up to a degree.

Source of the format: ICGEM-Format (F. Barthelmes, C. Förste, GFZ Potsdam, 2011).
"""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_file import SET_NAME_BYTES, TableRefused, encode
from flightsw.icd.table_schema import GRAVITY_FIELD, MAX_GRAVITY_DEGREE
from ground.errors import OperatorError

TIDE_FREE, ZERO_TIDE = 0, 1
# A zero-tide C20 holds the permanent tide, -4.17e-9; halfway between the two values of EGM2008 they are told apart.
# Models differ by some 1e-10, and the Earth's own change is 1e-11 a year.
_C20_BETWEEN = -0.48416723e-3


class GravityModel(NamedTuple):
    """A model file: name, GM [m3/s2], radius [m], tide system, degree, normalised coefficients [n, m] (two arrays)."""

    name: str
    gm_m3ps2: float
    radius_m: float
    tide_system: int
    degree: int
    c: np.ndarray
    s: np.ndarray


def packaged_model(name: str = "ITU_GRACE16") -> Path:
    """A model of satkit-data: by default ITU_GRACE16, the only one from the satellite tracking of this century.

    EGM96 doubles the steady error of a filter that flies it. ModuleNotFoundError where satkit-data is not installed.
    """
    import satkit_data

    return Path(next(iter(satkit_data.__path__))) / "data" / f"{name}.gfc"


def build_gravity_field(path: str | Path | None = None, degree: int = MAX_GRAVITY_DEGREE) -> bytes:
    """Binary table of kind "gravity_field" from a model file, by default the packaged one, up to `degree`.

    Raises OperatorError when the file does not serve or is of a lower degree.
    """
    source = Path(path) if path is not None else packaged_model()
    if not 2 <= degree <= MAX_GRAVITY_DEGREE:
        raise OperatorError(f"--degree {degree}: a gravity table holds degrees 2 to {MAX_GRAVITY_DEGREE}")
    model = read_gfc(source, degree)
    if model.degree < degree:
        raise OperatorError(f"{source}: complete to degree {model.degree}; ask for --degree {model.degree} or less")
    values = np.zeros(1, GRAVITY_FIELD.dtype)
    record = values[0]
    record["gm_m3ps2"] = model.gm_m3ps2
    record["radius_m"] = model.radius_m
    record["tide_system"] = model.tide_system
    record["degree"] = degree
    for n in range(degree + 1):
        place = n * (n + 1)
        record["coefficients"][place : place + 2 * n + 2 : 2] = model.c[n, : n + 1]
        record["coefficients"][place + 1 : place + 2 * n + 2 : 2] = model.s[n, : n + 1]
    name = f"{model.name} {degree}"[:SET_NAME_BYTES]
    try:
        return encode(GRAVITY_FIELD.name, name, values)
    except TableRefused as error:
        raise OperatorError(f"{source}: {error}") from error


def read_gfc(path: Path, degree_max: int = MAX_GRAVITY_DEGREE) -> GravityModel:
    """A static ICGEM model up to `degree_max`, or up to its own degree where that is less.

    Raises OperatorError for a file that is not one, that is not fully normalised, varies with time, holds the mean
    tide, or contradicts its own tide system.
    """
    lines = _lines(path)
    header: dict[str, str] = {}
    start = 0
    for number, line in enumerate(lines):
        words = line.split()
        if words and words[0] == "end_of_head":
            start = number + 1
            break
        if len(words) >= 2:
            header.setdefault(words[0], words[1])
    if not start or header.get("product_type") != "gravity_field":
        raise OperatorError(f"{path}: not an ICGEM gravity field (.gfc)")
    norm = header.get("norm", "fully_normalized")
    if norm != "fully_normalized":
        raise OperatorError(f"{path}: norm {norm}; only fully normalised coefficients serve")
    try:
        gm, radius = (_number(header[key]) for key in ("earth_gravity_constant", "radius"))
        declared = int(header["max_degree"])
    except (KeyError, ValueError) as error:
        raise OperatorError(f"{path}: header lacks earth_gravity_constant, radius or max_degree: {error}") from None
    degree = min(declared, degree_max)
    c, s = _coefficients(path, lines, start, degree)
    return GravityModel(
        header.get("modelname", path.name.partition(".")[0]),
        gm,
        radius,
        _tide_system(path, header.get("tide_system"), float(c[2, 0])),
        degree,
        c,
        s,
    )


def _coefficients(path: Path, lines: list[str], start: int, degree: int) -> tuple[np.ndarray, np.ndarray]:
    c = np.full((degree + 1, degree + 1), np.nan)
    s = np.full((degree + 1, degree + 1), np.nan)
    for number, line in enumerate(lines[start:], start=start + 1):
        words = line.split()
        if not words:
            continue
        if words[0] != "gfc":
            raise OperatorError(f"{path}: line {number}: {words[0]!r}: only static models (gfc lines) serve")
        try:
            n, m = int(words[1]), int(words[2])
            if n <= degree:
                c[n, m], s[n, m] = _number(words[3]), _number(words[4])
        except (ValueError, IndexError) as error:
            raise OperatorError(f"{path}: line {number}: {error}") from None
    if degree >= 1:  # left out of a file, degree 1 is zero: the origin is the centre of mass
        c[1, :2] = np.nan_to_num(c[1, :2])
        s[1, :2] = np.nan_to_num(s[1, :2])
    if np.isnan(c[0, 0]):
        c[0, 0], s[0, 0] = 1.0, 0.0
    s[:, 0] = 0.0  # no sine of order 0, whatever a file says there
    for n in range(degree + 1):
        if np.isnan(c[n, : n + 1]).any() or np.isnan(s[n, : n + 1]).any():
            raise OperatorError(f"{path}: coefficients of degree {n} are missing; get the file again")
    if c[0, 0] != 1.0:
        raise OperatorError(f"{path}: C00 is {c[0, 0]!r}, not 1; multiply GM by it in the header")
    return c, s


def _tide_system(path: Path, said: str | None, c20: float) -> int:
    """The tide system from the header, checked against C20, or from C20 where the header does not say."""
    looks = TIDE_FREE if c20 > _C20_BETWEEN else ZERO_TIDE
    if said is None or said == "unknown":
        return looks
    # some headers write "zero tide" or "tide free" in two words, of which one arrives here
    names = {"tide_free": TIDE_FREE, "tide": TIDE_FREE, "zero_tide": ZERO_TIDE, "zero": ZERO_TIDE}
    known = names.get(said.replace("-", "_"))
    if known is None:
        raise OperatorError(f"{path}: tide_system {said}; only tide_free and zero_tide serve")
    if known != looks:
        raise OperatorError(f"{path}: header says {said}, but C20 = {c20!r} does not; get the file again")
    return known


def _number(text: str) -> float:
    return float(text.replace("D", "e").replace("d", "e"))


def _lines(path: Path) -> list[str]:
    try:
        raw = path.read_bytes()
        if path.suffix == ".gz":
            raw = gzip.decompress(raw)
    except (OSError, EOFError, zlib.error) as error:
        raise OperatorError(f"{path}: cannot be read: {error}") from None
    return raw.decode("utf-8", errors="replace").splitlines()
