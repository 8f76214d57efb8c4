"""`ground compare RUN_A RUN_B`: what two runs were, flew and said, figure beside figure."""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

from ground.errors import OperatorError

HELP = "put the figures of two runs beside each other"
# What depends on the machine and the hour and not on the run.
OF_THE_MACHINE = ("summary.wall_s", "summary.realtime_factor")

Fact = float | int | str | bool | None


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground compare`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "compare", help=HELP, description=f"{HELP}. Exit status: 0 nothing differs, 1 something does, 2 a mistake."
    )
    parser.add_argument("run_a", type=Path, metavar="RUN_A", help="folder that a run left")
    parser.add_argument("run_b", type=Path, metavar="RUN_B", help="another")
    parser.add_argument("--all", action="store_true", help="also what is the same")
    parser.add_argument("--json", action="store_true", help="as JSON on one line")


def run(args: argparse.Namespace) -> int:
    """Compare, print, return the exit status. Raises OperatorError for a folder that holds no run."""
    a, b = facts(args.run_a), facts(args.run_b)
    names = [*a, *(name for name in b if name not in a)]
    differing = [name for name in names if not same(a.get(name), b.get(name)) and name not in OF_THE_MACHINE]
    shown = names if args.all else differing
    if args.json:
        told = {name: {"a": a.get(name), "b": b.get(name)} for name in shown}
        print(json.dumps({"compared": len(names), "differing": len(differing), "facts": told}, allow_nan=False))
    else:
        for line in table(a, b, shown):
            print(line)
        count = f"{len(differing)} of {len(names)} figures differ" if differing else f"all {len(names)} figures agree"
        print(f"{args.run_a} and {args.run_b}: {count}")
    return 1 if differing else 0


def facts(folder: Path) -> dict[str, Fact]:
    """What is known of a run, by dotted name: run.json, summary.json where there is one, and what link.tlog said."""
    found: dict[str, Fact] = {}
    for name in ("run", "summary"):
        path = folder / f"{name}.json"
        if name == "summary" and not path.exists():
            continue  # a live flight knows no truth to be judged by
        try:
            record = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise OperatorError(f"{path}: cannot be read ({error}); give the folder that a run left") from None
        flatten(name, record, found)
    if (folder / "link.tlog").exists():
        found |= {f"said.{name}": value for name, value in said(folder / "link.tlog").items()}
    return found


def flatten(name: str, value: Any, into: dict[str, Fact]) -> None:
    """Enter every leaf of a JSON value under its dotted name."""
    if isinstance(value, dict):
        for key, inner in value.items():
            flatten(f"{name}.{key}", inner, into)
    elif isinstance(value, list):
        into[f"{name}.count"] = len(value)
        for index, inner in enumerate(value):
            flatten(f"{name}[{index}]", inner, into)
    else:
        into[name] = value


def said(path: Path) -> dict[str, Fact]:
    """What a log told an operator: seconds of each verdict, alerts raised by name, messages and losses."""
    from ground.console.model import State, alert_text, reduce
    from ground.console.tlog import TlogLink
    from ground.console.verdict import judge

    link = TlogLink(path, 1.0, time.monotonic)
    state, last_s, word = State(started_s=link.start_s), link.start_s, ""
    seconds: dict[str, float] = {}
    alerts: dict[str, int] = {}
    for time_s, message in link.everything():
        before = state.alert_sequence
        state = reduce(state, message, time_s)
        kind = message.get_type()
        if kind == "LEONAV_INTEGRITY":
            if word:
                seconds[word] = seconds.get(word, 0.0) + time_s - last_s
            last_s, word = time_s, judge(state, time_s).word
        elif kind == "LEONAV_ALERT" and message.active and state.alert_sequence != before:
            name = alert_text(message.alert_id, 1, 0.0).rpartition("(")[2].rstrip(")")
            alerts[name] = alerts.get(name, 0) + 1
    found: dict[str, Fact] = {f"seconds_of.{name}": round(total, 3) for name, total in sorted(seconds.items())}
    found |= {f"alerts.{name}": count for name, count in sorted(alerts.items())}
    return {**found, "messages": link.statistics.frames, "lost": link.statistics.lost}


def same(a: Fact, b: Fact) -> bool:
    """Whether two facts are one: of equal value and kind; two that are not a number are the same."""
    if isinstance(a, float) and isinstance(b, float) and math.isnan(a) and math.isnan(b):
        return True
    return (type(a) is type(b) and a == b) or (_is_number(a) and _is_number(b) and a == b)


def table(a: dict[str, Fact], b: dict[str, Fact], names: list[str]) -> list[str]:
    """A line for each fact: name, both values, and for numbers the change from A to B."""
    if not names:
        return []
    width = max(len(name) for name in names)
    rows = [f"{'':<{width}}  {'A':>20}  {'B':>20}  change"]
    for name in names:
        one, two = a.get(name), b.get(name)
        change = ""
        if _is_number(one) and _is_number(two):
            assert isinstance(one, int | float)
            assert isinstance(two, int | float)
            share = f" ({100.0 * (two - one) / abs(one):+.3g} %)" if one else ""
            change = f"{two - one:+.6g}{share}"
        missing = f"only in {'A' if name not in b else 'B'}" if (name in a) != (name in b) else change
        rows.append(f"{name:<{width}}  {_word(one, name in a):>20}  {_word(two, name in b):>20}  {missing}".rstrip())
    return rows


def _is_number(value: Fact) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _word(value: Fact, there: bool) -> str:
    if not there:
        return "-"
    text = f"{value:.9g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 20 else text[:19] + "…"
