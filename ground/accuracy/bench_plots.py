"""Pictures of the bench, a set for each profile: errors without fixes, steady flight, the return of fixes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullFormatter

from ground.accuracy.bench import Flown
from ground.accuracy.bench_summary import (
    NEAR_M,
    NEAR_S,
    STEADY_FACTOR,
    STEADY_S,
    outage_axis_m,
    steady_figures,
)
from ground.errors import OperatorError
from ground.reports import style

COLUMNS = 3
FLOOR = "#009e73"
ORBIT_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#1b1f24")
TITLES = {
    "sentinel3a": "Sentinel-3A, 800 km",
    "gracefo": "GRACE-FO C, 500 km",
    "jason2": "Jason-2, 1336 km",
    "sentinel1a": "Sentinel-1A, 700 km",
    "simulated": "Simulated, 500 km",
    "simulated_storm": "Simulated in a storm, 500 km",
}
FIXES = {
    "white": "white fixes, 10 m and 0.1 m/s",
    "position_only": "fixes without velocity, 10 m",
    "coloured": "coloured fixes, 10 m white, 5 m of 300 s, 2 m periodic with the orbit",
    "white_perfect_clock": "white fixes and a perfect clock",
}


def make_figures(flown: Sequence[Flown], folder: Path) -> list[Path]:
    """Draw and write all pictures; returns the files."""
    files = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with style.styled():
            for profile in dict.fromkeys(one.case.profile for one in flown):
                some = [one for one in flown if one.case.profile == profile]
                for name, draw in (("outage", outages), ("steady", steady), ("return", returns)):
                    files.append(style.save(draw(some, profile), folder / f"{name}_{profile}.png"))
    except OSError as error:
        raise OperatorError(f"{error.filename}: cannot be written: {error.strerror}") from error
    return files


def outages(flown: Sequence[Flown], profile: str) -> Figure:
    """Error by age of the last fix, a panel an orbit: all starts, median, bound, and the floor of the force model."""
    figure, panels = _grid(len(flown), "Error without fixes", f"{FIXES.get(profile, profile)}; largest GCRF axis")
    everything = [outage_axis_m(one.figures) for one in flown]
    bounds = [np.nanmax(np.where(np.isfinite(one.figures["outage_bound_m"]), one.figures["outage_bound_m"], np.nan))
              for one in flown]  # fmt: skip
    top = 1.6 * max(np.nanmax(np.where(np.isfinite(e), e, np.nan)) for e in (*everything, np.array(bounds)))
    for panel, one, error in zip(panels, flown, everything, strict=False):
        age_min = np.array(one.case.plan.curve_s) / 60.0
        rows = ~np.isnan(error).all(axis=0)
        count = (~np.isnan(error)).sum(axis=0)
        panel.plot(age_min, error.T, color=style.ERROR, alpha=0.13, lw=0.6)
        panel.plot(
            age_min[rows], _over(np.nanmax, error)[rows], color=style.ERROR, lw=1.0, ls=":", label="largest error"
        )
        panel.plot(age_min[rows], _over(np.nanmedian, error)[rows], color=style.ERROR, lw=2.2, label="median error")
        bound = one.figures["outage_bound_m"]
        panel.plot(
            age_min[rows], _over(np.nanmedian, bound)[rows], color=style.BOUND, lw=1.8, label="bound on board, median"
        )
        floor = np.abs(one.figures["floor_m"]).max(axis=2)
        if np.isfinite(floor).any():
            known = rows & np.isfinite(floor).any(axis=0)
            panel.plot(
                age_min[known], _over(np.nanmedian, floor)[known], color=FLOOR, lw=1.6, ls="--",
                label="floor: same forces, true state, median",
            )  # fmt: skip
        panel.set_yscale("log")
        panel.set_xlim(0.0, age_min[-1])
        panel.xaxis.set_major_locator(MultipleLocator(20.0 if age_min[-1] > 40.0 else 5.0))
        panel.set_ylim(0.02, top)
        style.metres_ticks(panel)
        panel.grid(which="minor", visible=False)
        fewest = f"{count[0]} starts" if count[-1] == count[0] else f"{count[0]} starts, {count[-1]} to the end"
        _name(panel, one, fewest)
    _edges(panels, len(flown), "age of the last fix [min]", "position error")
    _legend(figure, panels[0], 4)
    return figure


def steady(flown: Sequence[Flown], profile: str) -> Figure:
    """3-D errors of the long flight with fixes: position above, velocity below, a column an orbit."""
    figure, panels = _grid(
        len(flown), "With fixes", f"{FIXES.get(profile, profile)}; 3-D position error, range and rms of stretches"
    )
    tops = []
    for panel, one in zip(panels, flown, strict=False):
        t_h = one.figures["flight_t_s"] / 3600.0
        position, bound = one.figures["flight_3d_m"], one.figures["flight_bound_m"]
        plan, figures = one.case.plan, steady_figures(one.case.plan, one.figures)
        e = style.buckets(t_h, position, 160)
        panel.axvspan(0.0, plan.convergence_s / 3600.0, color=style.OUTAGE_SHADE, lw=0, zorder=0, label="convergence")
        panel.fill_between(e.t, e.low, e.high, color=style.ERROR, alpha=0.28, lw=0)
        panel.plot(e.t, e.rms, color=style.ERROR, lw=1.4, label="3-D error")
        b = style.buckets(t_h, np.where(np.isfinite(bound), bound, np.nan), 160)
        panel.plot(b.t, b.mean, color=style.BOUND, lw=1.6, label="bound on board (largest axis)")
        panel.set_xlim(0.0, t_h[-1])
        panel.xaxis.set_major_locator(MultipleLocator(4.0 if t_h[-1] > 6.0 else 0.5))
        later = one.figures["flight_t_s"] >= plan.convergence_s
        tops += [np.nanmax(position[later]), 1.1 * np.nanmedian(bound[later])]
        rms_m, rms_mps = figures["rms_3d_m"], figures["rms_3d_mps"]
        words = "no steady state" if rms_m is None else f"rms {rms_m:.2f} m, {1e3 * rms_mps:.2f} mm/s"
        _name(panel, one, words)
    finite = [top for top in tops if np.isfinite(top)]
    for panel in panels[: len(flown)]:
        panel.set_ylim(0.0, 1.25 * max(finite, default=1.0))
        style.metres_ticks(panel)
    _edges(panels, len(flown), "time since the start [h]", "position error")
    _legend(figure, panels[0], 3)
    return figure


def returns(flown: Sequence[Flown], profile: str) -> Figure:
    """3-D error after fixes have come back, a panel a length of outage: median and worst run of each orbit."""
    lengths = flown[0].case.plan.returns_s
    figure, panels = _grid(
        len(lengths),
        "Fixes again",
        f"{FIXES.get(profile, profile)}; 3-D error, median and worst run (dotted); "
        f"bars: {STEADY_FACTOR:g} times the steady rms from {STEADY_S:g} s on",
    )
    for k, (panel, length) in enumerate(zip(panels, lengths, strict=False)):
        runs = 0
        for one, colour in zip(flown, ORBIT_COLOURS * 4, strict=False):
            if length not in one.case.plan.returns_s:
                continue
            error = one.figures["return_3d_m"][:, k]
            error = np.maximum(error[~np.isnan(error).any(axis=1)], 1e-3)
            if not len(error):
                continue
            runs += len(error)
            at = _log_seconds(error.shape[1])
            panel.plot(at + 1, np.median(error, axis=0)[at], color=colour, lw=1.6, label=_short(one))
            panel.plot(at + 1, error.max(axis=0)[at], color=colour, lw=1.1, ls=":")
            rms_m = steady_figures(one.case.plan, one.figures)["rms_3d_m"]
            if rms_m is not None:
                panel.plot([STEADY_S + 1, at[-1] + 1], [STEADY_FACTOR * rms_m] * 2, color=colour, lw=3.0, alpha=0.5)
        panel.plot([NEAR_S + 1, 901], [NEAR_M, NEAR_M], color=style.LIMIT, lw=1.5, ls="--")
        panel.annotate(
            f"{NEAR_M:g} m from {NEAR_S:g} s on", (NEAR_S + 1, NEAR_M), xytext=(0, 4), textcoords="offset points",
            color=style.LIMIT, fontsize=9.0,
        )  # fmt: skip
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_xlim(1.0, 901.0)
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        style.metres_ticks(panel)
        panel.grid(which="minor", visible=False)
        panel.set_title(f"after {length} s, {runs} runs", loc="left", fontsize=10.5, fontweight="bold")
    low = min(panel.get_ylim()[0] for panel in panels[: len(lengths)])
    high = max(panel.get_ylim()[1] for panel in panels[: len(lengths)])
    for panel in panels[: len(lengths)]:
        panel.set_ylim(max(low, 0.03), high)
    _edges(panels, len(lengths), "time since the return of fixes [s]", "position error")
    _legend(figure, panels[0], 6)
    return figure


def _grid(count: int, title: str, subtitle: str) -> tuple[Figure, list[Axes]]:
    columns = _columns(count)
    rows = math.ceil(count / columns)
    height = 2.2 + 2.75 * rows if rows > 1 else 5.0
    figure = Figure(figsize=(style.FIGURE_INCHES[0], height), dpi=style.DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True)
    figure.subplots_adjust(
        left=0.085, right=0.975, top=1.0 - 1.22 / height, bottom=0.62 / height, hspace=0.36, wspace=0.09
    )
    figure.text(0.085, 1.0 - 0.3 / height, title, fontsize=15, fontweight="bold", va="center")
    figure.text(0.085, 1.0 - 0.57 / height, subtitle, fontsize=10, color=style.GREY, va="center")
    panels = list(axes.ravel())
    for panel in panels[count:]:
        panel.set_visible(False)
    return figure, panels


def _columns(count: int) -> int:
    """Two by two for four panels, else rows of three."""
    return 2 if count == 4 else min(COLUMNS, count)


def _edges(panels: list[Axes], count: int, x: str, y: str) -> None:
    """Axis names where the reader looks for them: below the last panel of a column, left of a row."""
    columns = _columns(count)
    for index, panel in enumerate(panels[:count]):
        if index + columns >= count:
            panel.set_xlabel(x)
        if index % columns == 0:
            panel.set_ylabel(y)
        panel.yaxis.set_minor_formatter(NullFormatter())
        if panel.get_yscale() == "log":
            panel.yaxis.set_major_locator(LogLocator(10.0, numticks=12))


def _legend(figure: Figure, panel: Axes, columns: int) -> None:
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="upper left", bbox_to_anchor=(0.077, 1.0 - 0.66 / figure.get_figheight()), ncols=columns,
        columnspacing=1.6, handlelength=2.0,
    )  # fmt: skip


def _name(panel: Axes, one: Flown, words: str) -> None:
    title = TITLES.get(one.case.orbit.name, one.case.orbit.name)
    panel.set_title(title, loc="left", fontsize=10.5, fontweight="bold")
    # within the panel: a second title would run into the first
    panel.annotate(
        words, (0.985, 0.975), xycoords="axes fraction", ha="right", va="top", fontsize=9.0, color=style.GREY
    )


def _short(one: Flown) -> str:
    """Name of an orbit without its height."""
    return TITLES.get(one.case.orbit.name, one.case.orbit.name).partition(",")[0]


def _over(measure: object, values: np.ndarray) -> np.ndarray:
    """A nan-measure over starts; NaN, without a warning, where there is none."""
    found = np.full(values.shape[1], np.nan)
    known = ~np.isnan(values).all(axis=0)
    found[known] = measure(values[:, known], axis=0)  # type: ignore[operator]
    return found


def _log_seconds(count: int) -> np.ndarray:
    """Seconds to draw on a logarithmic axis: all at first, fewer later."""
    return np.unique(np.geomspace(1, count, 300).astype(int)) - 1
