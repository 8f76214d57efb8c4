"""The table of the inter-satellite monitor, from a set file (TOML) of its own; flight flies the function where it is.

A set file has `name`, `description` and one section for each group of the schema. What it leaves out takes the default.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.crosslink_schema import CROSSLINK
from flightsw.icd.table_checks import problems
from flightsw.icd.table_field import Field
from flightsw.icd.table_file import TableRefused, encode
from ground.errors import OperatorError, did_you_mean
from ground.tables.build import number_of, read_toml

SETS = Path(__file__).parent / "functions"
USUAL_SET = "crosslink"
_FIELDS = {field.name: field for field in CROSSLINK.fields}
_SECTIONS = tuple(dict.fromkeys(field.group for field in CROSSLINK.fields))


def build_crosslink(name_or_path: str = USUAL_SET, overrides: Mapping[str, Any] | None = None) -> bytes:
    """Binary table of a shipped set by name, or of any set file by path.

    overrides: field -> value on top of the file; a table built with any carries the set's name with a `*` behind it.
    Raises OperatorError with file, key and remedy.
    """
    path = _find(name_or_path)
    document = read_toml(path)
    name = document.pop("name", None)
    if not isinstance(name, str) or not isinstance(document.pop("description", None), str):
        raise OperatorError(f"{path}: give the set a name and a description")
    values = np.zeros(1, CROSSLINK.dtype)
    for field in CROSSLINK.fields:
        values[0][field.name] = field.default
    for section, content in document.items():
        if section not in _SECTIONS or not isinstance(content, dict):
            raise OperatorError(
                f"{path}: {section}: no section{did_you_mean(section, _SECTIONS)}; sections: {', '.join(_SECTIONS)}"
            )
        for key, value in content.items():
            _put(values, f"{path}: {section}.{key}", key, value, section)
    for key, value in (overrides or {}).items():
        _put(values, f"override {key}", key, value, "")
    if found := problems(CROSSLINK.name, values):
        raise OperatorError(f"{path}: {'; also '.join(found)}")
    try:
        return encode(CROSSLINK.name, name + ("*" if overrides else ""), values)
    except TableRefused as error:
        raise OperatorError(f"{path}: {error}") from error


def _find(name_or_path: str) -> Path:
    is_path = name_or_path.endswith(".toml") or "/" in name_or_path or "\\" in name_or_path
    path = Path(name_or_path) if is_path else SETS / f"{name_or_path}.toml"
    if not path.is_file():
        known = ", ".join(sorted(one.stem for one in SETS.glob("*.toml")))
        raise OperatorError(f"{path}: no such set file; shipped: {known}; or give the path of a .toml file")
    return path


def _put(values: np.ndarray, place: str, key: str, value: Any, section: str) -> None:
    field = _FIELDS.get(key)
    if field is None:
        raise OperatorError(f"{place}: unknown key{did_you_mean(key, _FIELDS)}; docs/icd.md lists every field")
    if section and field.group != section:
        raise OperatorError(f"{place}: belongs to section [{field.group}]; move it there")
    values[0][key] = _list(place, field, value) if field.shape else number_of(place, field, value)


def _list(place: str, field: Field, value: Any) -> list[float]:
    longest = field.shape[0]
    if not isinstance(value, list | tuple) or len(value) > longest:
        raise OperatorError(f"{place}: give a list of at most {longest} numbers")
    return [number_of(place, field, item) for item in value] + [field.default or 0] * (longest - len(value))
