"""From a set file (TOML) to the table of a function beside navigation.

A set file has `name`, `description` and one section for each group of the schema. What it leaves out takes the schema's
default; a field without a default must be given.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.table_checks import problems
from flightsw.icd.table_file import TableRefused, encode
from flightsw.icd.table_schema import CROSSLINK, GNSS, VELOCITY_CHECK, Field, Schema
from ground.errors import OperatorError, did_you_mean
from ground.tables.build import number_of, read_toml

SETS = Path(__file__).parent / "functions"
FUNCTIONS: dict[str, Schema] = {schema.name: schema for schema in (GNSS, CROSSLINK, VELOCITY_CHECK)}
Value = float | list[float]


def list_function_sets(kind: str) -> list[str]:
    """Names of the shipped sets of a kind: they begin with it."""
    return [path.stem for path in sorted(SETS.glob(f"{kind}*.toml"))]


def build_function(kind: str, name_or_path: str | Path, overrides: Mapping[str, Any] | None = None) -> bytes:
    """Binary table of a kind from a shipped set's name or the path of a .toml file.

    overrides: key -> value on top of the file; a key is a field's name and may carry its section. A table built with
    overrides carries the set's name with a `*` behind it. Raises OperatorError with file, key and remedy.
    """
    schema = FUNCTIONS.get(kind)
    if schema is None:
        raise OperatorError(f"no function has tables of kind {kind!r}; there are: {', '.join(FUNCTIONS)}")
    path = _find(kind, name_or_path)
    document = read_toml(path)
    name = document.pop("name", None)
    if not isinstance(name, str):
        raise OperatorError(f'{path}: name: give the set a name, for example name = "{path.stem}"')
    if not isinstance(document.pop("description", None), str):
        raise OperatorError(f"{path}: description: say in one line what the set is for")
    given = _collect(schema, str(path), document)
    for key, value in (overrides or {}).items():
        section, _, last = key.rpartition(".")
        field = _field(schema, f"override {key}", last, section)
        given[last] = _value(f"override {key}", field, value)
    values = _assemble(schema, str(path), given)
    try:
        return encode(kind, name + "*" if overrides else name, values)
    except TableRefused as error:
        raise OperatorError(f"{path}: {error}") from error


def _find(kind: str, name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    written = isinstance(name_or_path, Path) or text.endswith(".toml") or "/" in text or "\\" in text
    path = Path(name_or_path) if written else SETS / f"{text}.toml"
    if not path.is_file():
        known = list_function_sets(kind)
        hint = did_you_mean(text, known)
        raise OperatorError(
            f"no set {text!r} of kind {kind}{hint}; shipped: {', '.join(known)}; or give the path of a .toml file"
        )
    return path


def _collect(schema: Schema, where: str, document: dict[str, Any]) -> dict[str, Value]:
    sections = tuple(dict.fromkeys(field.group for field in schema.fields))
    given: dict[str, Value] = {}
    for section, content in document.items():
        if section not in sections:
            hint = did_you_mean(section, sections)
            raise OperatorError(f"{where}: {section}: unknown section{hint}; sections: {', '.join(sections)}")
        if not isinstance(content, dict):
            raise OperatorError(f"{where}: {section}: is a section; write [{section}] and keys below it")
        for key, value in content.items():
            place = f"{where}: {section}.{key}"
            given[key] = _value(place, _field(schema, place, key, section), value)
    return given


def _value(place: str, field: Field, value: Any) -> Value:
    """A number, or of a field that holds several a list of at most so many; the rest takes the default."""
    if not field.shape:
        return number_of(place, field, value)
    longest = field.shape[0]
    if not isinstance(value, list | tuple) or len(value) > longest:
        raise OperatorError(f"{place}: give a list of at most {longest} numbers")
    return [number_of(place, field, item) for item in value] + [field.default or 0.0] * (longest - len(value))


def _field(schema: Schema, place: str, key: str, section: str) -> Field:
    fields = {field.name: field for field in schema.fields}
    field = fields.get(key)
    if field is None:
        raise OperatorError(f"{place}: unknown key{did_you_mean(key, fields)}; docs/icd.md lists every field")
    if section and field.group != section:
        raise OperatorError(f"{place}: belongs to section [{field.group}]; move it there")
    return field


def _assemble(schema: Schema, where: str, given: dict[str, Value]) -> np.ndarray:
    values = np.zeros(1, schema.dtype)
    for field in schema.fields:
        value = given.get(field.name, field.default)
        if value is None:
            raise OperatorError(
                f"{where}: {field.group}.{field.name}: missing and without default; "
                f"give it in [{field.group}] [{field.unit}]"
            )
        values[0][field.name] = value
    if found := problems(schema.name, values):
        raise OperatorError(f"{where}: {'; also '.join(found)}")
    return values
