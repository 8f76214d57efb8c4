"""The plot of bound against limit in time: logarithmic, outages shaded with characters, gaps left open."""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise
from typing import Any

from flightsw.icd.enums import Mode
from ground.console.model import Sample
from ground.console.text import metres

SHADES = {Mode.AUTONOMOUS: "░", Mode.FAILED: "▒"}
SMALLEST_M, LARGEST_M = 1e-3, 1e9
GAP_STEPS = 5.0
LETTERS, COLOURS = "xyz3", ("cyan", "green", "magenta", "orange")  # of the levels in a Sample
FRAME_ROWS = 4  # of the panel: frame, tick labels, axis label


def draw(plt: Any, history: tuple[Sample, ...], step_s: float, columns: int, rows: int, by_axis: bool = False) -> None:
    """Draw the history into a plotext figure of at most `columns` x `rows` characters.

    by_axis: the levels of x, y, z and of the whole error, each in its letter, in place of the bound.
    """
    plt.clear_figure()
    points = [s for s in history if math.isfinite(s.bound_m) and s.bound_m > 0.0]
    if not points:
        plt.title("no bound received yet")
        return
    start_s, stop_s = history[0].t_gps_s, history[-1].t_gps_s
    unit_s, unit = (60.0, "min") if stop_s - start_s > 600.0 else (1.0, "s")
    limit_m = history[-1].limit_m
    levels = [level for s in points for level in s.levels_m if level > 0.0 and math.isfinite(level)] if by_axis else []
    low, high = _decades([s.bound_m for s in points] + levels, limit_m)
    span = max((stop_s - start_s) / unit_s, 1.0)
    plt.xlim(0.0, span)
    plt.ylim(low, high)
    _shade(plt, history, start_s, unit_s, span, (low, high), columns, rows)
    if math.isfinite(limit_m) and limit_m > 0.0:
        plt.plot([0.0, span], [_log(limit_m)] * 2, marker="─", color="red")
    if by_axis:
        _axes(plt, points, start_s, unit_s)
    for piece in () if by_axis else _pieces(points, GAP_STEPS * step_s):
        plt.plot(
            [(s.t_gps_s - start_s) / unit_s for s in piece],
            [_log(s.bound_m) for s in piece],
            marker="braille",
            color="orange",
        )
    ticks = _ticks(low, high, rows, limit_m)
    plt.yticks([height for height, _ in ticks], [label for _, label in ticks])
    step = _time_step(span)
    marks = [k * step for k in range(int(span / step) + 1)]
    plt.xticks(marks, [f"{mark:g}" for mark in marks])
    plt.xlabel(f"flight time since first heard [{unit}]")


def _axes(plt: Any, points: list[Sample], start_s: float, unit_s: float) -> None:
    """A letter for each point of each axis, the largest drawn last: it must not be hidden."""
    known = [s for s in points if s.levels_m]
    order = sorted(range(len(LETTERS)), key=lambda k: known[-1].levels_m[k] if known else 0.0)
    for k in order:
        shown = [s for s in known if math.isfinite(s.levels_m[k]) and s.levels_m[k] > 0.0]
        if shown:
            plt.scatter(
                [(s.t_gps_s - start_s) / unit_s for s in shown],
                [_log(s.levels_m[k]) for s in shown],
                marker=LETTERS[k],
                color=COLOURS[k],
            )


def metres_short(value: float) -> str:
    """Decades as people say them: 10 m, 1 km."""
    if value >= 1e3:
        return f"{value / 1e3:g} km"
    return f"{value:g} m"


def title(history: tuple[Sample, ...]) -> str:
    """Title of the panel: what the two lines are now."""
    if not history:
        return "bound against limit"
    last = history[-1]
    return f"bound {metres(last.bound_m)} against limit {metres(last.limit_m)}"


def _log(value_m: float) -> float:
    return math.log10(min(max(value_m, SMALLEST_M), LARGEST_M))


def _decades(bounds_m: list[float], limit_m: float) -> tuple[float, float]:
    seen = [*bounds_m, limit_m] if math.isfinite(limit_m) and limit_m > 0.0 else bounds_m
    low, high = _log(min(seen)), _log(max(seen))
    # Half a decade of air, on half decades, so that the scale does not twitch with every sample.
    low, high = math.floor(2.0 * (low - 0.15)) / 2.0, math.ceil(2.0 * (high + 0.15)) / 2.0
    return (low, high) if high - low >= 1.0 else (low - 0.5, high + 0.5)


def _ticks(low: float, high: float, rows: int, limit_m: float) -> list[tuple[float, str]]:
    """Heights and labels: decades, and the limit by name in place of a decade on its own row."""
    row = (high - low) / max(1, rows - FRAME_ROWS)
    decades = list(range(math.ceil(low), math.floor(high) + 1))
    every = max(1, math.ceil(2.0 * row))
    labels = [(float(k), metres_short(10.0**k)) for k in decades[::every]]
    if math.isfinite(limit_m) and limit_m > 0.0:
        height = _log(limit_m)
        labels = [(k, label) for k, label in labels if abs(k - height) > row] + [(height, "limit")]
    return labels


def _time_step(span: float) -> float:
    """A round step that gives at most eight marks."""
    raw = max(span / 8.0, 1e-3)
    decade = 10.0 ** math.floor(math.log10(raw))
    return next(decade * k for k in (1, 2, 5, 10) if decade * k >= raw)


def _pieces(points: list[Sample], gap_s: float) -> list[list[Sample]]:
    pieces = [[points[0]]]
    for earlier, later in pairwise(points):
        if later.t_gps_s - earlier.t_gps_s > gap_s:
            pieces.append([])
        pieces[-1].append(later)
    return pieces


def _shade(
    plt: Any,
    history: tuple[Sample, ...],
    start_s: float,
    unit_s: float,
    span: float,
    limits: tuple[float, float],
    columns: int,
    rows: int,
) -> None:
    """Fill the columns of an outage with a character, so that it shows without colour."""
    times = [s.t_gps_s for s in history]
    low, high = limits
    heights = [low + (high - low) * (k + 0.5) / rows for k in range(rows)]
    for mode, character in SHADES.items():
        xs: list[float] = []
        ys: list[float] = []
        for column in range(columns):
            x = span * (column + 0.5) / columns
            sample = history[max(0, bisect_right(times, start_s + x * unit_s) - 1)]
            if sample.mode == mode:
                xs += [x] * rows
                ys += heights
        if xs:
            plt.scatter(xs, ys, marker=character, color="gray")
