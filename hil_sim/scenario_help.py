"""Every key a scenario may hold, as text: default, meaning, and what the kinds of fault do."""

from __future__ import annotations

from typing import get_args, get_type_hints

import msgspec

from hil_sim.fault_kinds import KINDS
from hil_sim.pseudorange_schema import KINDS as SATELLITE_KINDS
from hil_sim.scenario import toml_text
from hil_sim.scenario_schema import Scenario, field_docs
from hil_sim.scenario_section import Section


def describe_keys() -> str:
    """One line for each key, in the order of the schema; `N` counts the items of a list from 0."""
    rows: list[tuple[str, str, str]] = []
    for name, hint in get_type_hints(Scenario).items():
        section, prefix = _section(hint), name
        if section is None:
            rows.append(_row(Scenario, name, name))
            continue
        if hint not in (section, section | None):
            prefix = f"{name}.N"
        rows += [_row(section, f"{prefix}.{field}", field) for field in section.__struct_fields__]
    width, middle = (max(len(row[i]) for row in rows) for i in range(2))
    lines = [f"{key:<{width}}  {default:<{middle}}  {why}".rstrip() for key, default, why in rows]
    lines.append("")
    lines.append("kinds of fault, and what `value` is:")
    longest = max(map(len, KINDS))
    for kind, what in KINDS.items():
        value = "" if what.value is None else f"; {what.value}"
        default = "" if what.default is None else f", {what.default:g} by default"
        lines.append(f"  {kind:<{longest}}  {what.why}{value}{default}")
    lines.append("kinds of satellite_fault, and what `value` is:")
    for kind, befalls in SATELLITE_KINDS.items():
        lines.append(f"  {kind:<{longest}}  {befalls.why}{f'; {befalls.value}' if befalls.value else ''}")
    return "\n".join(lines)


def _section(hint: object) -> type[Section] | None:
    """The section in a type: itself, one that may be absent, or one of a list."""
    for option in (hint, *get_args(hint)):
        if isinstance(option, type) and issubclass(option, Section):
            return option
    return None


def _row(section: type[Section], key: str, field: str) -> tuple[str, str, str]:
    (info,) = (f for f in msgspec.structs.fields(section) if f.name == field)
    if info.required:
        default = "required"
    elif info.default is None or info.default is msgspec.NODEFAULT:
        default = "-"
    else:
        default = toml_text(info.default)
    return key, default, field_docs(section)[field]
