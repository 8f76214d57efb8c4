"""One look for every figure: colours, bands, labels, and thinning that keeps the peaks.

Colours follow Okabe and Ito (2008), told apart by colour-blind readers; nothing is said by colour alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator

INK, GREY, FAINT = "#1b1f24", "#6a737d", "#d8dde3"
ERROR, BOUND, LIMIT, FLAG = "#0072b2", "#d55e00", "#a4133c", "#7b2cbf"
SERVICE = "#00795a"
AXIS_COLOURS = ("#0072b2", "#e69f00", "#009e73")
AXIS_NAMES = ("x", "y", "z")
OUTAGE_SHADE = "#eceff3"
MODE_SHADES = ("#e3e6ea", "#c9e7d8", "#ffe3b3", "#f6c1c1")  # INIT, INTEGRATED, AUTONOMOUS, FAILED

FIGURE_INCHES = (11.0, 6.2)
DPI = 120
EVENT_CHARACTER_PT = 5.9  # mean width of a bold character at the size of event labels
EVENT_ROW_PT = 14.0
POINTS = 1600  # of a thinned line: about the pixels across a figure

_RC: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10.5,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.7,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "text.color": INK,
    "lines.linewidth": 1.5,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "path.simplify": True,
    "path.simplify_threshold": 0.5,
}


def styled() -> Any:
    """Context in which figures are drawn and saved; leaves matplotlib's global settings alone."""
    return rc_context(_RC)


def new_figure(rows: int, title: str, subtitle: str, **grid: Any) -> tuple[Figure, list[Axes]]:
    """A figure of stacked panels on one time axis, with a title and a grey line of what is shown."""
    figure = Figure(figsize=FIGURE_INCHES, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, 1, squeeze=False, **({"sharex": True} | grid))[:, 0]
    figure.subplots_adjust(left=0.085, right=0.975, top=0.845, bottom=0.095, hspace=0.12)
    figure.text(0.085, 0.955, title, fontsize=15, fontweight="bold", va="center")
    figure.text(0.085, 0.91, subtitle, fontsize=10, color=GREY, va="center")
    return figure, list(axes)


def save(figure: Figure, path: Path) -> Path:
    """Write the PNG without a date or a version, so that equal runs give equal files."""
    figure.savefig(path, metadata={"Software": None})
    return path


def legend_in_header(figure: Figure, axes: Axes, columns: int = 6) -> None:
    """Legend beside the title, for figures whose margin above the panel holds event labels."""
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(
        unique.values(),
        unique.keys(),
        loc="center right",
        bbox_to_anchor=(0.98, 0.955),
        ncols=columns,
        columnspacing=1.4,
    )


def legend_above(axes: Axes, columns: int = 6) -> None:
    """Legend in the margin above the panel, where it covers no data."""
    if not axes.get_legend_handles_labels()[0]:
        return
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, columnspacing=1.4, handlelength=1.8)


def time_axis(axes: Axes, start_s: float, stop_s: float, label: str) -> float:
    """Label the time axis in minutes (or seconds for short spans); returns seconds per unit drawn."""
    unit_s, unit = (60.0, "min") if stop_s - start_s > 3600.0 else (1.0, "s")
    start_s = 0.0 if 0.0 <= start_s < 0.01 * stop_s else start_s
    axes.set_xlim(start_s / unit_s, stop_s / unit_s)
    axes.xaxis.set_major_locator(
        MultipleLocator(_step((stop_s - start_s) / unit_s)) if unit_s > 1.0 else MaxNLocator(10)
    )
    axes.set_xlabel(f"{label} [{unit}]")
    return unit_s


def _step(span: float) -> float:
    """A step of whole, customary minutes giving at most a dozen ticks."""
    return next((s for s in (5, 10, 15, 20, 30, 60, 120, 180, 360, 720, 1440) if span / s <= 13), span / 8)


def metres_ticks(axes: Axes) -> None:
    """Ticks of a metre axis written as people say them: 5 m, 200 m, 2 km."""
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: metres(value)))


def metres(value: float) -> str:
    """`0.1 m`, `25 m`, `2 km`: at most three digits."""
    if not np.isfinite(value):
        return "none"
    if abs(value) >= 1000.0:
        return f"{value / 1000.0:.3g} km"
    return f"{value:.3g} m" if abs(value) < 999.5 else "1 km"


def thin(t: np.ndarray, y: np.ndarray, points: int = POINTS) -> tuple[np.ndarray, np.ndarray]:
    """At most 2 * `points` samples of a line: the lowest and the highest of each bucket, gaps (NaN) kept.

    Plain decimation would lose the very peaks the figures are about.
    """
    if t.size <= 2 * points:
        return t, y
    edges = np.linspace(0, t.size, points, endpoint=False).astype(int)
    low, high = np.fmin.reduceat(y, edges), np.fmax.reduceat(y, edges)
    middle = np.r_[edges[1:], t.size] + edges
    return np.column_stack([t[edges], t[middle // 2]]).ravel(), np.column_stack([low, high]).ravel()


def thin_rows(rows: int, points: int = POINTS) -> np.ndarray:
    """Indices that thin smooth arrays (orbits, the bound) evenly, ends included."""
    return np.unique(np.linspace(0, rows - 1, min(rows, 2 * points)).astype(int))


class Buckets(NamedTuple):
    """A dense signal in equal stretches: middle time, lowest, highest, mean and rms of each; NaN in gaps."""

    t: np.ndarray
    low: np.ndarray
    high: np.ndarray
    mean: np.ndarray
    rms: np.ndarray


def buckets(t: np.ndarray, y: np.ndarray, count: int = 500) -> Buckets:
    """Summarise a noisy line, so that a figure shows its level and its spread, not a block of ink."""
    edges = np.unique(np.linspace(0, t.size, min(count, t.size), endpoint=False).astype(int))
    known = np.isfinite(y)
    number = np.add.reduceat(known.astype(float), edges)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.add.reduceat(np.where(known, y, 0.0), edges) / number
        rms = np.sqrt(np.add.reduceat(np.where(known, y, 0.0) ** 2, edges) / number)
    middle = (edges + np.r_[edges[1:], t.size]) // 2
    return Buckets(t[middle], np.fmin.reduceat(y, edges), np.fmax.reduceat(y, edges), mean, rms)


class Event(NamedTuple):
    """Something worth a word above a panel, at `x` in the units of its time axis."""

    x: float
    text: str
    colour: str


class Label(NamedTuple):
    """Where an event's words go: position of its line and row above the panel, words left of the line or not."""

    event: Event
    at: float
    row: int
    leftward: bool


def place_events(axes: Axes, events: Iterable[Event]) -> list[Label]:
    """Rows for the labels such that no line runs through another label's words."""
    width_pt = 72.0 * axes.get_position().width * FIGURE_INCHES[0]
    low, high = axes.get_xlim()
    placed: list[Label] = []
    spans: list[tuple[float, float]] = []
    # From the right: a label reaches over later lines, so it must stand above them.
    for event in sorted(events, reverse=True):
        at = (event.x - low) / (high - low)
        width = (EVENT_CHARACTER_PT * len(event.text) + 8.0) / width_pt
        leftward = at + width > 1.02
        start, stop = (at - width, at) if leftward else (at, at + width)
        touched = (
            label.row
            for label, (a, b) in zip(placed, spans, strict=True)
            if start <= label.at <= stop or (a < stop and start < b)
        )
        placed.append(Label(event, at, 1 + max(touched, default=-1), leftward))
        spans.append((start, stop))
    return placed


def head_room(labels: list[Label]) -> float:
    """Top of a panel, as a fraction of the figure, that leaves room for these labels under the header."""
    rows = max((label.row + 1 for label in labels), default=0)
    return 0.875 - (EVENT_ROW_PT * rows + 6.0) / (72.0 * FIGURE_INCHES[1])


def name_events(axes: Axes, labels: list[Label]) -> None:
    """Vertical lines with words in rows above the panel."""
    height_pt = 72.0 * axes.get_position().height * FIGURE_INCHES[1]
    for event, at, row, leftward in labels:
        y = 1.0 + (9.0 + EVENT_ROW_PT * row) / height_pt
        axes.plot(
            [at, at],
            [0.0, y + 5.0 / height_pt],
            color=event.colour,
            lw=1.1,
            transform=axes.transAxes,
            clip_on=False,
        )
        axes.annotate(
            event.text,
            (at, y),
            xycoords="axes fraction",
            xytext=(-4 if leftward else 4, 0),
            textcoords="offset points",
            ha="right" if leftward else "left",
            va="center",
            color=event.colour,
            fontsize=9.5,
            fontweight="bold",
            annotation_clip=False,
        )
