"""What differs between two navigation tables, in words: the one that flies, read back, and a file on the ground."""

from __future__ import annotations

import numpy as np

from flightsw.icd.table_file import TableImage, TableRefused, decode
from flightsw.icd.table_schema import SCHEMAS

_SHOWN = 4  # elements of an array


def table_diff(flying: bytes, other: bytes) -> list[str]:
    """Lines `field: flies -> file unit`, in the order of the schema; TableRefused where one of them is no table."""
    one, two = _decode(flying, "the table that flies"), _decode(other, "the file")
    if one.kind != two.kind:
        raise TableRefused(f"the table that flies is of kind {one.kind}, the file of kind {two.kind}")
    lines = []
    if one.set_name != two.set_name:
        lines.append(f"set: {one.set_name} -> {two.set_name}")
    for field in SCHEMAS[one.kind].fields:
        flies, file = one.values[field.name][0], two.values[field.name][0]
        if np.array_equal(flies, file, equal_nan=True):
            continue
        if field.shape == ():
            lines.append(f"{field.name}: {flies:.9g} -> {file:.9g} {field.unit}".rstrip())
            continue
        a, b = np.ravel(flies), np.ravel(file)
        places = np.flatnonzero((a != b) & ~(np.isnan(a.astype(float)) & np.isnan(b.astype(float))))
        shown = ", ".join(f"[{place}] {a[place]:.9g} -> {b[place]:.9g}" for place in places[:_SHOWN])
        more = f", and {len(places) - _SHOWN} more" if len(places) > _SHOWN else ""
        lines.append(f"{field.name}: {shown}{more} {field.unit}".rstrip())
    if flying != other and not lines:
        lines.append("every field is the same; certificate or validity differ")
    return lines


def _decode(raw: bytes, what: str) -> TableImage:
    try:
        return decode(raw)
    except TableRefused as error:
        raise TableRefused(f"{what}: {error}") from error
