"""What a tuning leaves: a table set in the format of those that ship, and the evidence for it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.icd.table_saturation import saturation
from flightsw.icd.table_schema import NAVIGATION
from ground.errors import OperatorError
from ground.reports import style
from ground.tables.build import build_navigation, choices, read_set
from ground.tuning.method import Effort, Tuned

REPORT, EVIDENCE, PICTURES = "report.md", "tuning.json", "figures"
_FIELDS = {field.name: field for field in NAVIGATION.fields}


def write(folder: Path, table_set: str, method: str, effort: Effort, tuned: Tuned) -> Path:
    """Write set, report, evidence and pictures; returns the set's file.

    Raises OperatorError, before anything is written, for a table that flight would refuse.
    """
    base = read_set(table_set)
    refused = saturation(decode(build_navigation(table_set, dict(tuned.changes))).values)
    if refused:
        raise OperatorError(f"the tuned table would be refused by flight: {'; '.join(refused)}; no set is written")
    name = f"{base['name']}_tuned"
    path = folder / f"{name}.toml"
    path.write_text(set_text(base, name, method, effort, tuned), encoding="utf-8")
    built = decode(build_navigation(path))
    with style.styled():
        pictures = [_draw(folder, file, drawing) for file, drawing in tuned.drawings]
    evidence = {
        "format": "leonav tuning 1",
        "set": path.name,
        "table_crc32": f"{built.crc32:08x}",
        "base_set": table_set,
        "base_crc32": f"{decode(build_navigation(table_set)).crc32:08x}",
        "grade": "quick" if effort.quick else "full",
        "changes": dict(tuned.changes),
        "summary": tuned.summary,
        "evidence": dict(tuned.evidence),
    }
    text = json.dumps(evidence, indent=2, sort_keys=True, allow_nan=False) + "\n"
    (folder / EVIDENCE).write_text(text, encoding="utf-8")
    head = [
        f"# {name} (CRC {built.crc32:08x}), tuned from {table_set} by {method}",
        "",
        f"- {tuned.summary}",
        f"- {'quick: too little is flown for use; ' if effort.quick else ''}uncertified: `ground certify --set {path}`",
        f"- fly it: `hil_sim run nominal --set flight.table_set={path}`",
        "- the saturation linter passes it",
        "",
    ]
    shown = [f"![{one.stem}]({one.relative_to(folder).as_posix()})" for one in pictures]
    (folder / REPORT).write_text("\n".join([*head, *tuned.lines, "", *shown, ""]), encoding="utf-8")
    return path


def _draw(folder: Path, name: str, drawing: Any) -> Path:
    (folder / PICTURES).mkdir(exist_ok=True)
    return style.save(drawing(), folder / PICTURES / name)


def set_text(base: Mapping[str, Any], name: str, method: str, effort: Effort, tuned: Tuned) -> str:
    """A set file: what the base set says, with the changes, and beside each of them what it was."""
    sections: dict[str, dict[str, Any]] = {k: dict(v) for k, v in base.items() if isinstance(v, dict)}
    rows = [dict(row) for row in base.get("tuning", [])]
    notes: dict[tuple[str, str], str] = {}
    for key, value in tuned.changes.items():
        section, _, field = key.rpartition(".")
        first, _, index = section.partition(".")
        place = rows[int(index)] if first == "tuning" else sections.setdefault(section, {})
        was = place.get(field, _FIELDS[field].default if first != "tuning" else None)
        notes[section, field] = f" # was {_value(field, was)}"
        place[field] = value
    effort_word = "quick" if effort.quick else "full"
    found = [
        f"# Written by `ground tune --method {method}` ({effort_word}, seed {effort.seed}).",
        f"# {EVIDENCE} beside it has the evidence.",
        f"# {tuned.summary}",
        f"name = {json.dumps(name)}",
        f"description = {json.dumps(_description(base, method, effort))}",
    ]
    order = tuple(dict.fromkeys(field.group for field in NAVIGATION.fields))
    for section in order:
        if section == "tuning":
            for number, row in enumerate(rows):
                found += ["", "[[tuning]]", *_lines(row, f"tuning.{number}", notes)]
        elif section in sections:
            found += ["", f"[{section}]", *_lines(sections[section], section, notes)]
    return "\n".join(found) + "\n"


def _description(base: Mapping[str, Any], method: str, effort: Effort) -> str:
    grade = "quick, " if effort.quick else ""
    return f"{base['description']} ({grade}tuned by {method})"


def _lines(values: Mapping[str, Any], section: str, notes: Mapping[tuple[str, str], str]) -> list[str]:
    return [f"{key} = {_value(key, value)}{notes.get((section, key), '')}" for key, value in values.items()]


def _value(key: str, value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value)
    words = choices(_FIELDS[key]) if key in _FIELDS else {}
    if words and value in words:
        return json.dumps(words[value])
    if isinstance(value, float) and value == int(value) and abs(value) < 1e6:
        return f"{value:.1f}"
    if isinstance(value, float) and abs(value) >= 1e6:
        return np.format_float_scientific(value, trim="-", exp_digits=1)
    return repr(value)
