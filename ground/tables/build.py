"""From a set file (TOML) to a navigation table: every key is checked, every value has a known origin.

A set file has `name`, `description`, one section for each group of the schema with the schema's field names
as keys, and one `[[tuning]]` table for each tuning row (Table 1 of the paper). What it leaves out takes the schema's
default; a field without a default must be given.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.table_checks import problems
from flightsw.icd.table_file import TableRefused, encode
from flightsw.icd.table_schema import MAX_TUNING_ROWS, NAVIGATION, Field
from ground.errors import OperatorError, did_you_mean

SETS = Path(__file__).parent / "sets"

_ROWS = "tuning"
_ROW_PREFIX = "tuning_"
_FIELDS = {f.name: f for f in NAVIGATION.fields}
# keys of an [[tuning]] row, without the prefix that the schema's columns carry
ROW_KEYS = tuple(f.name.removeprefix(_ROW_PREFIX) for f in NAVIGATION.fields if f.group == _ROWS and f.shape)
SECTIONS = tuple(dict.fromkeys(f.group for f in NAVIGATION.fields))


def list_sets() -> dict[str, str]:
    """Shipped sets: name -> description."""
    return {path.stem: str(read_toml(path).get("description", "")) for path in sorted(SETS.glob("*.toml"))}


def find_set(name_or_path: str | Path) -> Path:
    """The set file for a shipped name or for a path (anything with a separator or ending in .toml)."""
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or text.endswith(".toml") or "/" in text or "\\" in text:
        path = Path(name_or_path)
        if not path.is_file():
            raise OperatorError(f"{path}: no such set file; `ground table sets` lists those that ship")
        return path
    path = SETS / f"{text}.toml"
    if not path.is_file():
        known = [p.stem for p in sorted(SETS.glob("*.toml"))]
        raise OperatorError(
            f'no set named "{text}"{did_you_mean(text, known)}; shipped: {", ".join(known)}; '
            "or give the path of a .toml file"
        )
    return path


def read_set(name_or_path: str | Path) -> dict[str, Any]:
    """The content of a set file, as TOML has it: name, description, sections, list of rows; not checked."""
    return read_toml(find_set(name_or_path))


def build_navigation(
    name_or_path: str | Path,
    overrides: Mapping[str, Any] | None = None,
    certificate: bytes = b"",
) -> bytes:
    """Binary navigation table of a set.

    overrides: key -> value on top of the file. A key is a field name (`limit_m`), may carry its section
    (`bound.limit_m`), names a cell of a row (`tuning.0.q_r_m2`) or replaces all rows (`tuning`,
    a list of mappings). A table built with overrides carries the set's name with a `*` behind it.
    Raises OperatorError with file, key and remedy.
    """
    path = find_set(name_or_path)
    document = read_toml(path)
    name = document.pop("name", None)
    if not isinstance(name, str):
        raise OperatorError(f'{path}: name: give the set a name, for example name = "{path.stem}"')
    if not isinstance(document.pop("description", None), str):
        raise OperatorError(f"{path}: description: say in one line what the set is for")

    given, rows = _collect(str(path), document)
    if overrides:
        _apply(given, rows, overrides)
        name += "*"
    values = _assemble(str(path), given, rows)
    try:
        return encode(NAVIGATION.name, name, values, certificate)
    except TableRefused as error:
        raise OperatorError(f"{path}: {error}") from error


def parse_setting(text: str) -> tuple[str, Any]:
    """`key=value` of the command line; the value is TOML, a bare word counts as a string."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise OperatorError(f"--set {text}: write it as key=value")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file; OperatorError where it is none."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise OperatorError(f"{path}: not valid TOML: {error}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise OperatorError(f"{path}: cannot be read: {error}") from error


Given = dict[str, tuple[str, float]]  # field or row key -> where it was said, number


def _collect(where: str, document: dict[str, Any]) -> tuple[Given, list[Given]]:
    given: Given = {}
    rows: list[Given] = []
    for section, content in document.items():
        if section not in SECTIONS:
            hint = did_you_mean(section, SECTIONS)
            raise OperatorError(f"{where}: {section}: unknown section{hint}; sections: {', '.join(SECTIONS)}")
        if section == _ROWS:
            rows = _collect_rows(f"{where}: {_ROWS}", content)
            continue
        if not isinstance(content, dict):
            raise OperatorError(f"{where}: {section}: is a section; write [{section}] and keys below it")
        for key, value in content.items():
            place = f"{where}: {section}.{key}"
            field = _field(place, key, section)
            given[key] = (place, number_of(place, field, value))
    return given, rows


def _collect_rows(where: str, content: Any) -> list[Given]:
    if not isinstance(content, list) or not all(isinstance(row, Mapping) for row in content):
        raise OperatorError(f"{where}: tuning rows; write each as [[tuning]] with its keys")
    if not 1 <= len(content) <= MAX_TUNING_ROWS:
        raise OperatorError(f"{where}: {len(content)} rows; give 1 to {MAX_TUNING_ROWS}")
    rows: list[Given] = []
    for index, row in enumerate(content):
        known: Given = {}
        for key, value in row.items():
            place = f"{where}.{index}.{key}"
            known[key] = (place, number_of(place, _row_field(place, key), value))
        missing = [key for key in ROW_KEYS if key not in known]
        if missing:
            raise OperatorError(f"{where}.{index}: {', '.join(missing)} missing; a row needs every key")
        rows.append(known)
    return rows


def _apply(given: Given, rows: list[Given], overrides: Mapping[str, Any]) -> None:
    for key, value in overrides.items():
        place = f"override {key}"
        if key == _ROWS:
            rows[:] = _collect_rows(place, value)
        elif key.startswith(_ROWS + "."):
            _, index, *rest = key.split(".")
            if len(rest) != 1 or not index.isdecimal() or int(index) >= len(rows):
                raise OperatorError(f"{place}: write tuning.ROW.KEY, rows here: 0 to {len(rows) - 1}")
            rows[int(index)][rest[0]] = (place, number_of(place, _row_field(place, rest[0]), value))
        else:
            section, _, name = key.rpartition(".")
            if section and section not in SECTIONS:
                raise OperatorError(f"{place}: unknown section{did_you_mean(section, SECTIONS)}")
            field = _field(place, name, section)
            given[name] = (place, number_of(place, field, value))


def _field(place: str, key: str, section: str) -> Field:
    """The field a key names; section may be empty when the key stands alone."""
    field = _FIELDS.get(key)
    if field is None:
        scope = [f.name for f in NAVIGATION.fields if section in ("", f.group) and f.group != _ROWS]
        hint = did_you_mean(key, scope) or did_you_mean(key, _FIELDS)
        raise OperatorError(f"{place}: unknown key{hint}; docs/icd.md lists every field")
    if field.group == _ROWS:
        raise OperatorError(f"{place}: belongs to a row; write it in an [[tuning]] table")
    if section and field.group != section:
        raise OperatorError(f"{place}: belongs to section [{field.group}]; move it there")
    return field


def _row_field(place: str, key: str) -> Field:
    if key not in ROW_KEYS:
        raise OperatorError(f"{place}: unknown key{did_you_mean(key, ROW_KEYS)}; a row has {', '.join(ROW_KEYS)}")
    return _FIELDS[_ROW_PREFIX + key]


def number_of(place: str, field: Field, value: Any) -> float:
    """A checked number: right type, finite, in range. Words are accepted where the unit lists them."""
    words = choices(field)
    if isinstance(value, str) and words:
        number = {word.lower(): code for code, word in words.items()}.get(value.lower())
        if number is None:
            hint = did_you_mean(value, words.values())
            raise OperatorError(f'{place}: "{value}" is none of {", ".join(words.values())}{hint}')
        return number
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, int if field.kind == "i8" else (int, float)):
        wanted = "a whole number" if field.kind == "i8" else "a number"
        raise OperatorError(f"{place}: {value!r} is not {wanted} [{field.unit}]; give it without quotes")
    if not math.isfinite(value) or not field.minimum <= value <= field.maximum:
        raise OperatorError(
            f"{place}: {value} is outside [{field.minimum!r}, {field.maximum!r}] {field.unit} ({field.why})"
        )
    return value


def choices(field: Field) -> dict[int, str]:
    """Words of an enumerated field, from its unit: '0 central, 1 J2' -> {0: 'central', 1: 'J2'}."""
    parts = field.unit.split(", ")
    found = [re.fullmatch(r"(\d+) (\S+)", part) for part in parts]
    return {int(m[1]): m[2] for m in found if m} if all(found) else {}


# A field left out follows another one: the schema's default belongs to the default of that one.
_FOLLOWS = {"clear_limit_m": ("limit_m", 0.5)}


def _assemble(where: str, given: Given, rows: list[Given]) -> np.ndarray:
    if not rows:
        raise OperatorError(f"{where}: tuning: no row; add an [[tuning]] table")
    values = np.zeros(1, NAVIGATION.dtype)
    record = values[0]
    for field in NAVIGATION.fields:
        if field.name == "tuning_rows":
            record[field.name] = len(rows)
        elif field.group == _ROWS:
            key = field.name.removeprefix(_ROW_PREFIX)
            record[field.name] = field.default
            record[field.name][: len(rows)] = [row[key][1] for row in rows]
        elif field.name in given:
            record[field.name] = given[field.name][1]
        elif field.default is None:
            raise OperatorError(
                f"{where}: {field.group}.{field.name}: missing and without default; "
                f"give it in [{field.group}] [{field.unit}]"
            )
        else:
            record[field.name] = field.default
    for name, (leader, factor) in _FOLLOWS.items():
        if name not in given:
            record[name] = factor * record[leader]
    found = problems(NAVIGATION.name, values)
    if found:
        raise OperatorError(f"{where}: {'; also '.join(found)}")
    return values
