"""What the bench says: lines for the terminal, accuracy.md, accuracy.json."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ground.accuracy.bench_cases import PERFECT_CLOCK
from ground.accuracy.bench_summary import Summary, clock_ratios, pooled_validation, velocity_ratios
from ground.accuracy.bench_verdict import Line
from ground.errors import OperatorError

SCHEMA = "leonav accuracy bench, version 1"
_VERDICT_HEAD = "item | orbit | fixes | what | wanted | goal | measured | "
_STEADY_HEAD = "orbit | fixes | converged in | position rms | max | velocity rms | beyond bound | NEES/n"
_OUTAGE_HEAD = "orbit | fixes | age | starts | median | 99.7 % | max | error/bound | bound median | NEES/n | "
_OUTAGE_HEAD += "floor median | floor max | share"
_POOLED = "all measured orbits"
_VALIDATION_HEAD = "orbit | fixes | outages | independent arcs | violated | largest | 1 / q.95"
_RETURN_HEAD = "orbit | fixes | outage | runs | error then (max) | 5 m in 60 s | worst | 2x steady in 600 s | worst | "
_RETURN_HEAD += "rms at 600 s by steady | late without outage"


def document(summaries: Sequence[Summary], lines: Sequence[Line], code_sha256: str) -> dict[str, Any]:
    """The content of accuracy.json; its fields are explained in docs/accuracy.md."""
    return {
        "schema": SCHEMA,
        "code_sha256": code_sha256,
        "cases": list(summaries),
        "pooled_validation": pooled_validation(summaries),
        "position_only_velocity_ratio": velocity_ratios(summaries),
        "oscillator_outage_ratio": clock_ratios(summaries, PERFECT_CLOCK),
        "verdict": [line.as_document() for line in lines],
    }


def write(folder: Path, content: dict[str, Any], lines: Sequence[Line]) -> list[Path]:
    """Write accuracy.json and accuracy.md; returns the paths."""
    machine, table = folder / "accuracy.json", folder / "accuracy.md"
    try:
        machine.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        table.write_text(markdown(content["cases"], lines), encoding="utf-8")
    except OSError as error:
        raise OperatorError(f"{error.filename}: cannot be written: {error.strerror}") from error
    return [machine, table]


def markdown(summaries: Sequence[Summary], lines: Sequence[Line]) -> str:
    """accuracy.md: the verdict, then steady flight, outages and returns of every case."""
    pooled = pooled_validation(summaries)
    return "\n".join(
        [
            "# Accuracy",
            "",
            "Errors are published minus true at the instant of use; outage errors are the largest GCRF axis. "
            "Definitions: docs/accuracy.md of the project.",
            "",
            "## Verdict",
            "",
            *_table(_VERDICT_HEAD, map(_verdict_row, lines)),
            "",
            "## With fixes",
            "",
            *_table(
                _STEADY_HEAD,
                map(_steady_row, summaries),
            ),
            "",
            "## Without fixes",
            "",
            "Floor: the same force model from the true state; in brackets with the drag scale that fits each outage "
            "best. Share: of the mean square error, what the floor alone would make.",
            "",
            *_table(
                _OUTAGE_HEAD,
                (row for one in summaries for row in _outage_rows(one)),
            ),
            "",
            "## Bound without fixes",
            "",
            "A validation on orbits that no tuning has seen, no certification. Largest error / bound of each outage "
            "over all its ages: the largest of them, and 1 / their 95 % quantile.",
            "",
            *_table(
                _VALIDATION_HEAD,
                (_validation_row(one) for one in [*summaries, *({"orbit": _POOLED, **one} for one in pooled)]),
            ),
            "",
            "## Fixes again",
            "",
            *_table(
                _RETURN_HEAD,
                (row for one in summaries for row in _return_rows(one)),
            ),
            "",
        ]
    )


def terminal(summary: Summary) -> str:
    """A few lines for one case."""
    steady, convergence = summary["steady"], summary["convergence"]
    lines = [
        f"{summary['orbit']}, {summary['profile']} fixes, set {summary['table_set']}: steady 3-D rms "
        f"{_metres(steady['rms_3d_m'])}, {_velocity(steady['rms_3d_mps'])}, converged in "
        f"{_seconds(convergence['median_s'])} (max {_seconds(convergence['max_s'])})"
    ]
    if summary["shortened"]:
        lines.append(f"  only {summary['convergence_given_s']} s of fixes before each outage, not two orbits")
    lines.append(
        f"  {'age':>7}{'starts':>8}{'median':>10}{'99.7 %':>10}{'max':>10}{'error/bound':>13}{'floor median':>14}"
    )
    for age, one in summary["outages"].items():
        if not one["starts"]:
            continue
        lines.append(
            f"  {age:>5} s{one['starts']:>8}{_metres(one['median_m']):>10}{_metres(one['q997_m']):>10}"
            f"{_metres(one['max_m']):>10}{_plain(one['worst_error_to_bound']):>13}{_metres(one.get('floor_median_m')):>14}"
        )
    for length, one in summary["back_to_steady"].items():
        if one["runs"]:
            lines.append(
                f"  fixes again after {length} s: {one['near_in_time']} of {one['runs']} within 5 m in 60 s, "
                f"{one['steady_in_time']} within twice the steady rms in 600 s"
            )
    return "\n".join(lines)


def verdict_lines(lines: Sequence[Line]) -> Iterator[str]:
    """One line each: item, what, wanted, goal, measured, met or missed."""
    for line in lines:
        item, orbit, profile, what, wanted, goal, measured, word = _verdict_row(line)
        yield f"  {item:<2} {orbit:<16} {profile:<14} {what:<46} {wanted:>14} {goal:>8} {measured:>10}  {word}"


def verdict_head() -> str:
    """The head over `verdict_lines`."""
    return f"  {'':<2} {'orbit':<16} {'fixes':<14} {'':<46} {'wanted':>14} {'goal':>8} {'measured':>10}"


def _verdict_row(line: Line) -> tuple[str, ...]:
    unit = f" {line.unit}" if line.unit else ""
    wanted = f"{line.wanted:.3g}{unit}" if line.least is None else f"{line.least:.3g} to {line.wanted:.3g}"
    goal = "" if line.goal is None else f"{line.goal:.3g}{unit}"
    measured = "none" if line.measured is None else f"{line.measured:.3g}{unit}"
    word = "MISSED" if not line.met else "goal" if line.goal_met else "met"
    return line.item, line.orbit, line.profile, line.what, wanted, goal, measured, word


def _steady_row(one: Summary) -> tuple[str, ...]:
    steady, convergence = one["steady"], one["convergence"]
    return (
        one["orbit"],
        one["profile"],
        f"{_seconds(convergence['median_s'])}, max {_seconds(convergence['max_s'])}",
        _metres(steady["rms_3d_m"]),
        _metres(steady["max_3d_m"]),
        _velocity(steady["rms_3d_mps"]),
        _percent(steady["beyond_bound_share"]),
        _nees(steady),
    )


def pooled_lines(summaries: Sequence[Summary]) -> list[str]:
    """A line for each profile that several measured orbits were flown with."""
    return [
        f"{_POOLED}, {one['profile']} fixes: {told['outages']} outages, {told['independent_arcs']} independent arcs, "
        f"{told['violated']} violated, largest error / bound {_plain(told['worst_error_to_bound'])}, "
        f"1 / 95 % quantile {_plain(told['tightness_q95'])}"
        for one in pooled_validation(summaries)
        for told in (one["validation"],)
    ]


def _validation_row(one: Summary) -> tuple[str, ...]:
    told = one["validation"]
    return (
        one["orbit"],
        one["profile"],
        str(told["outages"]),
        str(told["independent_arcs"]),
        str(told["violated"]),
        _plain(told["worst_error_to_bound"]),
        _plain(told["tightness_q95"]),
    )


def _outage_rows(summary: Summary) -> Iterator[tuple[str, ...]]:
    for age, one in summary["outages"].items():
        if one["starts"]:
            yield (
                summary["orbit"],
                summary["profile"],
                f"{age} s",
                str(one["starts"]),
                _metres(one["median_m"]),
                _metres(one["q997_m"]),
                _metres(one["max_m"]),
                _plain(one["worst_error_to_bound"]),
                _metres(one["bound_median_m"]),
                _nees(one),
                f"{_metres(one.get('floor_median_m'))} ({_metres(one.get('floor_drag_median_m'))})",
                f"{_metres(one.get('floor_max_m'))} ({_metres(one.get('floor_drag_max_m'))})",
                f"{_percent(one.get('floor_share'))} ({_percent(one.get('floor_drag_share'))})",
            )


def _return_rows(summary: Summary) -> Iterator[tuple[str, ...]]:
    for length, one in summary["back_to_steady"].items():
        if one["runs"]:
            yield (
                summary["orbit"],
                summary["profile"],
                f"{length} s",
                str(one["runs"]),
                _metres(one["error_at_return_max_m"]),
                f"{one['near_in_time']} of {one['runs']}",
                _seconds(one["near_max_s"]),
                f"{one['steady_in_time']} of {one['runs']}",
                _seconds(one["steady_max_s"]),
                _plain(one["rms_then_by_steady"]),
                _percent(summary["steady"]["not_steady_by_chance_share"]),
            )


def _table(head: str, rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    yield f"| {head} |"
    yield "|" + "---|" * (head.count("|") + 1)
    for row in rows:
        yield "| " + " | ".join(row) + " |"


def _nees(one: Summary) -> str:
    mean, error = one.get("nees_per_state"), one.get("nees_per_state_standard_error")
    return _plain(mean) if error is None else f"{_plain(mean)} ± {_plain(error)}"


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} m" if abs(value) < 100 else f"{value:.0f} m"


def _velocity(value_mps: float | None) -> str:
    return "-" if value_mps is None else f"{1e3 * value_mps:.2f} mm/s"


def _seconds(value: float | None) -> str:
    return "never" if value is None else f"{value:.0f} s"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{1e2 * share:.3g} %"


def _plain(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
