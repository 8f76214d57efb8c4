"""Scenarios: TOML file plus `--set` overrides -> a validated `Scenario`, with the origin of every key.

Every refusal names the file (or --set), the key and the remedy.
"""

from __future__ import annotations

import difflib
import json
import os
import re
import tomllib
from collections.abc import Iterable, Iterator
from datetime import date, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import msgspec

from hil_sim import gps_time
from hil_sim.crosslink_schema import CrosslinkFault
from hil_sim.errors import DataError, ScenarioError
from hil_sim.pseudorange_schema import SatelliteFault
from hil_sim.scenario_checks import check_events
from hil_sim.scenario_schema import (
    Burn,
    Command,
    Fault,
    Outage,
    Scenario,
    cross_check,
    field_docs,
)
from hil_sim.scenario_section import Section

SCENARIO_FOLDER = Path(__file__).parent / "scenarios"
DATA_VARIABLE = "LEONAV_DATA"
_ITEMS: dict[str, type[Section]] = {
    "outage": Outage,
    "burn": Burn,
    "command": Command,
    "fault": Fault,
    "crosslink_fault": CrosslinkFault,
    "satellite_fault": SatelliteFault,
}
_FREE_TABLES = ("flight.table",)
_ALTERNATIVES = {"orbit.period_s": "semi_major_axis_m", "orbit.semi_major_axis_m": "period_s"}
_UNITS = {"s": "seconds", "m": "metres", "mps": "metres per second", "deg": "degrees", "hz": "hertz"} | {
    "ns": "nanoseconds",
    "ppm": "parts per million",
    "m2pkg": "m2/kg",
}
_PLAIN_TYPES = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "object": "a table",
}


class LoadedScenario(NamedTuple):
    """A validated scenario, its file, and the origin ('default', 'file', '--set') of each dotted key."""

    scenario: Scenario
    path: Path
    origin: dict[str, str]

    @property
    def t_start_gps_ns(self) -> int:
        """GPS time of the scenario's start [ns]."""
        return start_gps_ns(self.scenario)


def shipped() -> dict[str, Path]:
    """Scenarios that ship with the package: name -> file."""
    return {path.stem: path for path in sorted(SCENARIO_FOLDER.glob("*.toml"))}


def find(name_or_path: str) -> Path:
    """File of a shipped scenario by name, or of any scenario by path."""
    path = Path(name_or_path)
    if path.suffix == ".toml" or os.sep in name_or_path:
        if not path.is_file():
            raise ScenarioError(f"{path}: no such scenario file; `hil_sim list` names those that ship")
        return path
    known = shipped()
    if name_or_path not in known:
        raise ScenarioError(
            f"no scenario {name_or_path!r}{_did_you_mean(name_or_path, known)}; `hil_sim list` names them"
        )
    return known[name_or_path]


def load(name_or_path: str, overrides: Iterable[str] = ()) -> LoadedScenario:
    """Read, override, validate. `overrides` are 'dotted.key=value' with TOML values.

    Raises ScenarioError whose text names file or --set, key and remedy.
    """
    path = find(name_or_path)
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: not TOML: {error}; see {SCENARIO_FOLDER} for examples") from None
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
    tree.setdefault("name", path.stem)
    origin = dict.fromkeys(_leaves(tree), "file")
    for text in overrides:
        key = _override(tree, text)
        by_override = {k for k, source in origin.items() if source == "--set"} | set(_leaves(_get(tree, key), key))
        origin = {leaf: "--set" if leaf in by_override else "file" for leaf in _leaves(tree)}
    return _validated(tree, path, origin)


def from_tree(tree: dict[str, Any], where: str) -> LoadedScenario:
    """A scenario that was made, not written: the tree a file would hold. where: stands for the file in messages.

    Raises ScenarioError as `load` does.
    """
    return _validated(tree, Path(where), dict.fromkeys(_leaves(tree), "file"))


def _validated(tree: dict[str, Any], path: Path, origin: dict[str, str]) -> LoadedScenario:
    where = _Where(path, origin)
    for key in _unknown_keys(tree):
        raise ScenarioError(where.tell(key, _explain_unknown(key)))
    _stringify_moments(tree)
    try:
        scenario = msgspec.convert(tree, Scenario)
    except msgspec.ValidationError as error:
        key, what = _explain_invalid(str(error), tree)
        raise ScenarioError(where.tell(key, what)) from None
    try:
        start_gps_ns(scenario)
    except ValueError as error:
        raise ScenarioError(where.tell("time.start", f"{error}; write 2019-01-01T00:00:00")) from None
    for problem in (*cross_check(scenario), *check_events(scenario)):
        raise ScenarioError(where.tell(problem.key, f"{problem.what}; {problem.remedy}"))
    for key in _leaves(msgspec.to_builtins(scenario)):
        origin.setdefault(key, "default")
    return LoadedScenario(scenario, path, origin)


def start_gps_ns(scenario: Scenario) -> int:
    """GPS time of the start [ns]; ValueError if the text is no calendar moment."""
    moment = datetime.fromisoformat(scenario.time.start)
    if moment.tzinfo is not None:
        raise ValueError(f"{scenario.time.start!r} has a time zone, the scale is given by time.scale")
    return gps_time.from_calendar(moment, scenario.time.scale)


def data_folder() -> Path:
    """Folder of real orbit data: the variable LEONAV_DATA, else ../shared/data beside the repository."""
    named = os.environ.get(DATA_VARIABLE)
    return Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"


def resolve_data_file(text: str, scenario_path: Path, key: str) -> Path:
    """A file named in a scenario: absolute, beside the scenario file, or in the data folder."""
    named = Path(text).expanduser()
    candidates = [named] if named.is_absolute() else [scenario_path.parent / named, data_folder() / named]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    looked = " or ".join(str(c) for c in candidates)
    raise DataError(
        f"{scenario_path}: {key}: no file {looked}; set {DATA_VARIABLE} to the folder of real orbits, "
        f"or give --set {key}=/path/to/file"
    )


def describe(loaded: LoadedScenario) -> str:
    """Every resolved key with value and origin, one a line, in the order of the schema."""
    values = dict(_items(msgspec.to_builtins(loaded.scenario)))
    width = max(len(key) for key in values)
    lines = [f"# {loaded.scenario.name}: {loaded.path}"]
    for key, value in values.items():
        shown = "-" if value is None else toml_text(value)
        lines.append(f"{key:<{width}}  {shown:<28} {loaded.origin.get(key, 'default')}")
    return "\n".join(lines)


# -- overrides ---------------------------------------------------------------------------------------------


def _override(tree: dict[str, Any], text: str) -> str:
    key, equals, value_text = text.partition("=")
    key = key.strip()
    if not equals or not re.fullmatch(r"[A-Za-z0-9_\-]+(\.[A-Za-z0-9_\-]+)*", key):
        raise ScenarioError(f"--set {text}: not key=value; write for example --set gnss.sigma_position_m=33")
    parts = key.split(".")
    node: Any = tree
    for depth, part in enumerate(parts[:-1]):
        at = ".".join(parts[: depth + 1])
        if isinstance(node, list):
            node = node[_index(node, part, text, may_append=True)]
        elif isinstance(node, dict):
            fresh: Any = [] if part in _ITEMS and depth == 0 else {}
            node = node.setdefault(part, fresh)
        if not isinstance(node, (dict, list)):
            raise ScenarioError(f"--set {text}: {at} is a value, not a table; `hil_sim show` lists the keys")
    value = _toml_value(value_text)
    if _is_text(key) and not isinstance(value, (str, date, dict, list)):
        value = value_text.strip()  # 'nan' and '120' are words where a word is wanted
    other = _ALTERNATIVES.get(key)
    if other is not None and isinstance(node, dict):
        node.pop(other, None)
    if isinstance(node, list):
        node[_index(node, parts[-1], text, may_append=True)] = value
    else:
        node[parts[-1]] = value
    return key


def _index(items: list[Any], part: str, text: str, may_append: bool) -> int:
    if not part.isdigit() or int(part) > len(items):
        raise ScenarioError(
            f"--set {text}: {part!r} is no item of {len(items)}; count from 0, and {len(items)} adds one"
        )
    if int(part) == len(items) and may_append:
        items.append({})
    return int(part)


def _is_text(key: str) -> bool:
    section, _, last = key.rpartition(".")
    try:
        return get_type_hints(_section_type(section)).get(last) in (str, str | None)
    except KeyError:
        return False


def _toml_value(text: str) -> Any:
    """A TOML value; a bare word counts as a string, so that shells need no double quoting."""
    try:
        return tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


# -- explaining --------------------------------------------------------------------------------------------


class _Where(NamedTuple):
    path: Path
    origin: dict[str, str]

    def tell(self, key: str, what: str) -> str:
        place = key.rpartition(".")[0] if key.split(".")[0] in _ITEMS else key
        by_override = any(
            source == "--set" and (k == place or k.startswith(place + ".")) for k, source in self.origin.items()
        )
        return f"{'--set' if by_override else self.path}: {key}: {what}"


def _explain_unknown(key: str) -> str:
    section, _, last = key.rpartition(".")
    known = list(_section_type(section).__struct_fields__)
    hint = _did_you_mean(last, known)
    if not hint:
        stem = last.rsplit("_", 1)[0]
        same = [k for k in known if k.startswith(stem + "_")]
        hint = f"; did you mean {same[0]!r}?" if same else ";"
    return f"unknown key{hint} keys here: {', '.join(known)}"


def _explain_invalid(message: str, tree: dict[str, Any]) -> tuple[str, str]:
    """msgspec's text turned into key and remedy."""
    what, _, where = message.partition(" - at `$")
    key = re.sub(r"\[(\d+)\]", r".\1", where.rstrip("`")).lstrip(".")
    missing = re.search(r"missing required field `(\w+)`", what)
    if missing:
        key = f"{key}.{missing.group(1)}".lstrip(".")
        return key, f"missing; give {_doc(key) or 'a value'}"
    shown, remedy = toml_text(_get(tree, key)), _doc(key)
    expected = what.replace("Expected ", "expected ").replace("`", "")
    if "matching regex" in expected:
        return key, f"{shown} refused: write {remedy}"
    if expected.startswith(("expected float", "expected int")) and "got str" in expected:
        unit = _UNITS.get(key.rpartition("_")[2], "")
        remedy = f"a plain number{' in ' + unit if unit else ''}, no quotes, no unit: the key's name carries it"
    for name, plain in _PLAIN_TYPES.items():
        expected = re.sub(rf"\b{name}\b", plain, expected)
    return key, f"{shown} refused: {expected}" + (f"; it is {remedy}" if remedy else "")


def _did_you_mean(word: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else ""


def _doc(key: str) -> str:
    section, _, last = _without_index(key).rpartition(".")
    try:
        return field_docs(_section_type(section)).get(last, "")
    except KeyError:
        return ""


def _without_index(key: str) -> str:
    """'burn.0.dv_mps.1' as 'burn.0.dv_mps': the key that holds the component; 'burn.0' stays."""
    head, _, last = key.rpartition(".")
    return head if last.isdigit() and head not in _ITEMS else key


# -- walking -----------------------------------------------------------------------------------------------


@lru_cache(maxsize=256)
def _section_type(key: str) -> type[Section]:
    """Struct of a section by dotted key ('' the scenario, 'outage.0' an outage), or KeyError."""
    head, _, rest = key.partition(".")
    if not head:
        return Scenario
    if head in _ITEMS:
        return _ITEMS[head]
    section: type[Section] = Scenario
    for part in (head, *(rest.split(".") if rest else ())):
        hint = get_type_hints(section)[part]
        # a section, or one that may be absent
        options = [o for o in (hint, *get_args(hint)) if isinstance(o, type) and issubclass(o, Section)]
        if not options:
            raise KeyError(key)
        section = options[0]
    return section


def _is_section(key: str) -> bool:
    try:
        return bool(_section_type(key))
    except KeyError:
        return False


def _unknown_keys(tree: dict[str, Any]) -> Iterator[str]:
    for key, value in tree.items():
        if key not in Scenario.__struct_fields__:
            yield key
            continue
        tables = value if key in _ITEMS and isinstance(value, list) else [value]
        for i, table in enumerate(tables):
            prefix = f"{key}.{i}" if key in _ITEMS else key
            if isinstance(table, dict) and _is_section(key):
                yield from _unknown_in(table, _section_type(key), prefix)


def _unknown_in(table: dict[str, Any], section: type[Section], prefix: str) -> Iterator[str]:
    for key, value in table.items():
        path = f"{prefix}.{key}"
        if key not in section.__struct_fields__:
            yield path
        elif isinstance(value, dict) and _is_section(path):
            yield from _unknown_in(value, _section_type(path), path)


def _items(node: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(node, dict) and (node or not prefix):
        for key, value in node.items():
            yield from _items(value, f"{prefix}.{key}" if prefix else key)
    elif isinstance(node, (list, tuple)) and node and isinstance(node[0], dict):
        for i, value in enumerate(node):
            yield from _items(value, f"{prefix}.{i}")
    else:
        yield prefix, node


def _leaves(node: Any, prefix: str = "") -> list[str]:
    return [key for key, _ in _items(node, prefix)]


def _get(tree: Any, key: str) -> Any:
    node = tree
    for part in key.split(".") if key else []:
        try:
            node = node[int(part)] if isinstance(node, list) else node[part]
        except (KeyError, IndexError, ValueError, TypeError):
            return None
    return node


def _stringify_moments(tree: dict[str, Any]) -> None:
    """TOML has dates of its own: an unquoted time.start is as good as a quoted one."""
    time = tree.get("time")
    if isinstance(time, dict) and isinstance(time.get("start"), date):
        time["start"] = time["start"].isoformat()


def toml_text(value: Any) -> str:
    """A value as a scenario file would write it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, float):
        return f"{value:.12g}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_text(item) for item in value) + "]"
    return str(value)
