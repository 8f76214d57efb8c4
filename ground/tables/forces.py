"""The force table: what the force model sums, the satellite's surface, the state of the atmosphere, the integrator.

Solar flux and geomagnetic index come from CelesTrak's SW-All.csv for a day, or are given by hand.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from datetime import date, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd.table_checks import problems
from flightsw.icd.table_file import TableRefused, decode, encode
from flightsw.icd.table_schema import FORCES
from ground.errors import OperatorError, did_you_mean
from ground.tables.build import choices
from ground.tables.gps_time import NS_PER_DAY, calendar_day, gps_of_day
from ground.tables.gravity_field import build_gravity_field

_GPS_EPOCH = date(1980, 1, 6)
_MEAN_DAYS = 81  # three solar rotations
# How long space weather of one day stands for others. From SW-All.csv, 1995 to 2024, the logarithm of the density at
# 500 km differs from that of a day so much earlier by 0.42 rms after a week, 0.46 after 45 days, 0.52 after 90: up to
# 45 days the drag scale of the flight filter, 0.5 in all, covers it.
VALID_DAYS = 45.0
_FIELDS = {field.name: field for field in FORCES.fields}


class SpaceWeather(NamedTuple):
    """For one day: flux at 10.7 cm of the day before, its mean over the 81 days up to then [sfu], ap of the day."""

    f107: float
    f107_mean: float
    ap: float


def packaged_space_weather() -> Path:
    """SW-All.csv of satkit-data; ModuleNotFoundError where that is not installed."""
    import satkit_data

    return Path(next(iter(satkit_data.__path__))) / "data" / "SW-All.csv"


def read_space_weather(day: date, path: str | Path | None = None) -> SpaceWeather:
    """Space weather of a day as it would be known on board: the mean looks back only.

    A file of fewer days than 81 gives the mean of those it has, at least one. OperatorError where the day is missing.
    """
    source = Path(path) if path is not None else packaged_space_weather()
    try:
        with source.open(encoding="ascii", errors="replace", newline="") as lines:
            flux: dict[date, float] = {}
            ap = None
            for row in csv.DictReader(lines):
                at = date.fromisoformat(row["DATE"])
                if day - timedelta(days=_MEAN_DAYS) <= at < day:
                    flux[at] = float(row["F10.7_OBS"])
                elif at == day:
                    ap = float(row["AP_AVG"])
    except OSError as error:
        raise OperatorError(f"{source}: cannot be read: {error.strerror or error}") from None
    except (KeyError, ValueError, TypeError) as error:
        raise OperatorError(f"{source}: not CelesTrak's SW-All.csv, or without values on {day}: {error}") from None
    yesterday = day - timedelta(days=1)
    if ap is None or yesterday not in flux:
        raise OperatorError(f"{source}: no space weather for {yesterday} and {day}; give f107, f107_mean, ap instead")
    return SpaceWeather(flux[yesterday], sum(flux.values()) / len(flux), ap)


def build_forces(
    overrides: Mapping[str, Any] | None = None,
    name: str = "forces",
    day: date | None = None,
    valid_days: float = VALID_DAYS,
    space_weather_path: str | Path | None = None,
) -> bytes:
    """Binary table of kind "forces": the defaults of the schema, space weather of a day, then what is overridden.

    overrides: field -> number, or the word of an enumerated field ("RK4", "yes"). With `day` the table is valid for
    `valid_days` before its noon and after it; without, always. Raises OperatorError with the key and the remedy.
    """
    values = np.zeros(1, FORCES.dtype)
    record = values[0]
    for field in FORCES.fields:
        record[field.name] = field.default
    if day is not None:
        for key, value in read_space_weather(day, space_weather_path)._asdict().items():
            record[key] = value
        noon = gps_of_day(day) + NS_PER_DAY // 2
        if not 0.0 < valid_days * NS_PER_DAY <= noon:
            raise OperatorError(f"--valid-days {valid_days:g}: give days from 0, back to the GPS epoch at most")
        reach = round(valid_days * NS_PER_DAY)
        record["valid_from_gps_ns"], record["valid_until_gps_ns"] = noon - reach, noon + reach
    given = dict(overrides or {})
    if "degree" in given and "order" not in given:
        given["order"] = given["degree"]
    for key, value in given.items():
        record[key] = _number(key, value)
    found = problems(FORCES.name, values)
    if found:
        raise OperatorError("; also ".join(found))
    # The header of the file says the same; there 0 stands for "without end".
    valid_from, end = int(record["valid_from_gps_ns"]), int(record["valid_until_gps_ns"])
    valid_to = 0 if end == _FIELDS["valid_until_gps_ns"].maximum else end
    try:
        return encode(FORCES.name, name, values, valid_from_gps_ns=valid_from, valid_to_gps_ns=valid_to)
    except TableRefused as error:
        raise OperatorError(str(error)) from error


def build_force_tables(
    t_start_gps_ns: int,
    fixed_f107: float | None = None,
    space_weather_path: str | Path | None = None,
    gravity_path: str | Path | None = None,
) -> tuple[bytes, bytes]:
    """The two tables that the flight filter needs for a flight from t_start: forces and gravity field.

    Space weather of that day, or a fixed F10.7; gravity from a model file or the packaged one; the rest as the schema
    has it.
    """
    settings: dict[str, Any] = {}
    day: date | None = _GPS_EPOCH + timedelta(days=t_start_gps_ns // NS_PER_DAY)
    if fixed_f107 is not None:
        settings |= {"f107": fixed_f107, "f107_mean": fixed_f107}
        day = None
    forces = build_forces(settings, day=day, space_weather_path=space_weather_path)
    degree = int(decode(forces).values["degree"][0])
    return forces, build_gravity_field(gravity_path, degree)


def parse_day(text: str) -> date:
    """A calendar day of the command line."""
    try:
        return calendar_day(text)
    except ValueError:
        raise OperatorError(f"--day {text}: write it as YYYY-MM-DD, on or after 1980-01-06") from None


def _number(key: str, value: Any) -> float:
    field = _FIELDS.get(key)
    if field is None:
        raise OperatorError(f"{key}: unknown key{did_you_mean(key, _FIELDS)}; docs/icd.md lists every field")
    words = choices(field)
    if isinstance(value, str):
        number = {word.lower(): code for code, word in words.items()}.get(value.lower())
        if number is None:
            raise OperatorError(f'{key}: "{value}" is none of {", ".join(words.values()) or "numbers"}')
        return number
    if isinstance(value, bool) or not isinstance(value, int if field.kind == "i8" else (int, float)):
        raise OperatorError(f"{key}: {value!r} is not {'a whole number' if field.kind == 'i8' else 'a number'}")
    if not field.minimum <= value <= field.maximum:
        raise OperatorError(f"{key}: {value} is outside [{field.minimum!r}, {field.maximum!r}] {field.unit}")
    return value
