"""A binary table in words, as flight would read it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flightsw.icd.certificate import CertificateRefused, open_certificate
from flightsw.icd.table_file import TableImage, TableRefused, decode
from flightsw.icd.table_schema import EARTH_ORIENTATION, GRAVITY_FIELD, SCHEMAS, Field
from ground.errors import OperatorError
from ground.tables.build import choices
from ground.tables.gps_time import format_gps
from ground.tables.sign import render_certificate

_EARTH_COLUMNS = ("X [rad]", "Y [rad]", "s [rad]", "xp [rad]", "yp [rad]", "UT1-GPS [s]")


def read_table(path: str | Path) -> TableImage:
    """Open a table file. Raises OperatorError naming the file when it is refused."""
    try:
        return decode(Path(path).read_bytes())
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read: {error.strerror or error}") from error
    except TableRefused as error:
        raise OperatorError(f"{path}: refused: {error}") from error


def render(table: TableImage) -> str:
    """Text for the operator: identity first, then every value with unit and reason."""
    lines = [
        f"kind         {table.kind}",
        f"set          {table.set_name}",
        f"CRC-32       {table.crc32:08x}",
        f"schema       {SCHEMAS[table.kind].hash:016x}",
        f"valid        {_validity(table)}",
    ]
    lines += _certificate(table)
    special = {EARTH_ORIENTATION.name: _render_earth_orientation, GRAVITY_FIELD.name: _render_gravity_field}
    lines += special.get(table.kind, _render_fields)(table)
    return "\n".join(lines)


def _certificate(table: TableImage) -> list[str]:
    try:
        return render_certificate(open_certificate(table, None))
    except CertificateRefused as error:
        return [f"certificate  REFUSED: {error}"]


def _validity(table: TableImage) -> str:
    if not table.valid_from_gps_ns and not table.valid_to_gps_ns:
        return "always"
    end = format_gps(table.valid_to_gps_ns) if table.valid_to_gps_ns else "without end"
    return f"{format_gps(table.valid_from_gps_ns)} to {end}"


def _render_fields(table: TableImage) -> list[str]:
    lines: list[str] = []
    record = table.values[0]
    rows = int(record["tuning_rows"]) if "tuning_rows" in (table.values.dtype.names or ()) else 0
    group = ""
    for field in SCHEMAS[table.kind].fields:
        if field.group != group:
            group = field.group
            lines += ["", f"[{group}]"]
        value = record[field.name]
        used = np.ravel(value)[:rows] if field.group == "tuning" else np.ravel(value)
        text = " ".join(f"{x:g}" for x in used) if field.shape else _scalar(field, value)
        unit = "" if choices(field) or field.unit == "1" else field.unit
        lines.append(f"{field.name:<26} {text:>24} {unit:<14} {field.why}")
    return lines


def _scalar(field: Field, value: float) -> str:
    word = choices(field).get(int(value)) if choices(field) else None
    if word:
        return word
    if field.unit == "GPS ns":
        return "without end" if value == field.maximum else format_gps(int(value)).removesuffix(" GPS")
    return str(int(value)) if field.kind == "i8" else repr(float(value))


def _render_earth_orientation(table: TableImage) -> list[str]:
    record = table.values[0]
    count, t0, step = int(record["count"]), int(record["t0_gps_ns"]), int(record["step_ns"])
    lines = [f"nodes        {count}, every {step / 3.6e12:g} h", ""]
    lines.append(f"{'time of node':<24}" + "".join(f"{name:>16}" for name in _EARTH_COLUMNS))
    for i in range(count):
        x, y, s, xp, yp, ut1 = record["nodes"][i]
        angles = "".join(f"{value:>16.8e}" for value in (x, y, s, xp, yp))
        lines.append(f"{format_gps(t0 + i * step):<24}{angles}{ut1:>16.7f}")
    return lines


def _render_gravity_field(table: TableImage) -> list[str]:
    """What belongs to the coefficients, and of these the size of each degree: the root of the sum of squares."""
    record = table.values[0]
    lines = [""]
    for field in GRAVITY_FIELD.fields:
        if not field.shape:
            unit = "" if choices(field) or field.unit == "1" else field.unit
            lines.append(f"{field.name:<26} {_scalar(field, record[field.name]):>24} {unit:<14} {field.why}")
    lines += ["", f"{'degree':>6}{'C n0':>24}{'all orders':>16}"]
    for n in range(2, int(record["degree"]) + 1):
        row = record["coefficients"][n * (n + 1) : (n + 1) * (n + 2)]
        lines.append(f"{n:>6}{row[0]:>24.15e}{np.sqrt(row @ row):>16.6e}")
    return lines
