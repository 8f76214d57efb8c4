"""Pictures: the paper's scenario with its estimates, what no constant gain can do, a track, the velocity check."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ground.derivative.scenario import JUMPS_S, SETTLED_S
from ground.derivative.track_file import Result
from ground.reports import style

TRUE, CAUSAL, SMOOTHED = style.INK, style.ERROR, style.SERVICE


def draw(document: dict[str, Any], example: dict[str, np.ndarray] | None, folder: Path) -> list[Path]:
    """Draw what the document has; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    made: list[tuple[str, Figure]] = []
    with style.styled():
        if example is not None:
            made.append(("scenario.png", scenario_figure(example)))
        if "paper" in document and "scenario" in document:
            made.append(("gains.png", gains_figure(document["paper"], document["scenario"])))
        if "monitor" in document:
            made.append(("velocity_check.png", check_figure(document["monitor"])))
        return [style.save(figure, folder / name) for name, figure in made]


def scenario_figure(run: dict[str, np.ndarray]) -> Figure:
    """True velocity, errors of both estimates, weights of the models."""
    figure, (above, middle, below) = style.new_figure(
        3,
        "Velocity from positions: the paper's scenario",
        "positions every 0.2 s with 1 m; north velocity; grey: 100 s after the start and after each jump of the course",
    )
    t = run["t_s"]
    for axes in (above, middle, below):
        for start in (0.0, *JUMPS_S):
            axes.axvspan(start, start + SETTLED_S, color=style.OUTAGE_SHADE, lw=0)
    above.plot(*style.thin(t, run["causal"][:, 1]), color=CAUSAL, lw=1.2, label="causal, several models")
    above.plot(*style.thin(t, run["v_mps"]), color=TRUE, lw=1.0, ls="--", label="true")
    above.set_ylim(run["v_mps"].min() - 1.0, run["v_mps"].max() + 1.0)
    above.set_ylabel("velocity [m/s]")
    style.legend_above(above)
    error = run["causal"][:, 1] - run["v_mps"]
    band = 2.0 * run["causal_sigma"][:, 1]
    middle.fill_between(t[::5], -band[::5], band[::5], color=CAUSAL, alpha=0.15, lw=0, label="2 sigma, causal")
    middle.plot(*style.thin(t, error), color=CAUSAL, lw=0.9, label="error, causal")
    later = np.isfinite(run["smoothed"][:, 1])
    middle.plot(
        *style.thin(t[later], (run["smoothed"][:, 1] - run["v_mps"])[later]),
        color=SMOOTHED,
        lw=1.1,
        label="error, 30 s later",
    )
    middle.set_ylim(-0.25, 0.25)
    middle.set_ylabel("error [m/s]")
    style.legend_above(middle)
    names = ("quiet", "turning", "jumping")
    below.stackplot(
        t[::5], run["weight"][::5].T, labels=names, colors=("#c9e7d8", "#ffe3b3", "#f6c1c1"), edgecolor="none"
    )
    below.set_ylim(0.0, 1.0)
    below.set_ylabel("probability")
    style.legend_above(below)
    style.time_axis(below, 0.0, float(t[-1]), "time")
    figure.subplots_adjust(hspace=0.32)
    return figure


def gains_figure(paper: dict[str, Any], found: dict[str, Any]) -> Figure:
    """Straight against yawing: every constant gain of the paper's kind, what it claims, what is reached here."""
    figure, (axes,) = style.new_figure(
        1,
        "No constant gain does both legs of the paper's scenario",
        "RMS error of velocity, from 100 s after a jump of the course on; small points: constant Kalman-type gains",
    )
    straight, yawing = (np.array([row["figures"][k] for row in paper["sweep"]]) for k in (0, 1))
    axes.loglog(straight, yawing, color=style.GREY, marker="o", ms=3, lw=1.0, label="constant gains")
    marks: tuple[tuple[str, float, float, str, str], ...] = (
        ("claimed by the paper", 0.019, 0.090, "X", style.LIMIT),
        ("the paper's algorithm", *_both(found, "paper"), "s", style.BOUND),
        ("several models, causal", *_both(found, "causal"), "o", CAUSAL),
        ("fixed lag of 30 s", *_both(found, "smoothed"), "D", SMOOTHED),
        ("local polynomial of best width", *_both(found, "savitzky_golay"), "^", style.FLAG),
    )
    if found["pynumdiff"]:
        marks = (*marks, ("pynumdiff, whole record", *_both(found, "pynumdiff_rts"), "v", "#e69f00"))
    for label, x, y, marker, colour in marks:
        axes.plot([x], [y], marker=marker, ms=9, color=colour, lw=0, label=label)
    axes.axvline(0.019, color=style.LIMIT, lw=0.8, ls=":")
    axes.axhline(0.065, color=style.LIMIT, lw=0.8, ls=":")
    axes.set_xlabel("straight [m/s]; dotted: wanted of a causal estimate")
    axes.set_ylabel("yawing [m/s]")
    axes.legend(loc="upper left")
    return figure


def _both(found: dict[str, Any], name: str) -> tuple[float, float]:
    rms = found["estimators"][name]["rms"]
    return rms["v_straight"], rms["v_yawing"]


def draw_track(result: Result, path: Path) -> Path:
    """Velocity and acceleration of each axis with two sigmas."""
    with style.styled():
        return style.save(track_figure(result), path)


def track_figure(result: Result) -> Figure:
    """Velocity above, acceleration below."""
    positions = result.positions
    ends = np.flatnonzero(np.diff(positions.t_s) > result.gap_s) + 1  # a row of nothing breaks a line at each gap
    t = np.insert(positions.t_s - positions.t_s[0], ends, np.nan)
    at_once, later, spread_of = (
        np.insert(values, ends, np.nan, axis=0)
        for values in (result.causal.mean, result.smoothed.mean, result.smoothed.sigma)
    )
    figure, panels = style.new_figure(
        2,
        "Velocity and acceleration from positions",
        f"{len(positions.t_s)} positions; thin: at once; thick: {result.lag_s:g} s later; bands: 2 sigma of the latter",
    )
    for k, (axes, label) in enumerate(zip(panels, ("velocity [m/s]", "acceleration [m/s²]"), strict=True), start=1):
        low, high = [], []
        for axis, (name, colour) in enumerate(zip(positions.names, style.AXIS_COLOURS, strict=False)):
            late, spread = later[:, axis, k], 2.0 * spread_of[:, axis, k]
            axes.plot(*style.thin(t, at_once[:, axis, k]), color=colour, lw=0.6, alpha=0.6)
            axes.plot(*style.thin(t, late), color=colour, lw=1.8, label=name)
            rows = style.thin_rows(len(t))
            axes.fill_between(t[rows], (late - spread)[rows], (late + spread)[rows], color=colour, alpha=0.2, lw=0)
            low.append(np.nanquantile(late, 0.002))
            high.append(np.nanquantile(late, 0.998))
        margin = 0.15 * (max(high) - min(low)) + 1e-9
        axes.set_ylim(min(low) - margin, max(high) + margin)  # the start of a causal estimate would hide the rest
        axes.set_ylabel(label)
    style.legend_above(panels[0])
    style.time_axis(panels[1], 0.0, float(np.nanmax(t)), "time since the first position")
    return figure


def check_figure(found: dict[str, Any]) -> Figure:
    """Delays of detection by bias, and the delay that white noise allows."""
    figure, (axes,) = style.new_figure(
        1,
        "A receiver's biased velocity, found by its own positions",
        f"fixes of 10 m and 0.1 m/s at 1 Hz; at most one false alarm in {found['false_alarm_days']:g} days",
    )
    for (name, rows), colour in zip(found["delays"].items(), style.AXIS_COLOURS, strict=False):
        rows = [row for row in rows if row["median_s"] < found["give_up_s"]]  # of the others half were not found
        size = [row["bias_mps"] for row in rows]
        axes.plot(size, [row["median_s"] for row in rows], color=colour, marker="o", ms=4, label=f"{name}: median")
        axes.fill_between(
            size, [row["q05_s"] for row in rows], [row["q95_s"] for row in rows], color=colour, alpha=0.15, lw=0
        )
    axes.axhline(120.0, color=style.LIMIT, lw=1.0, ls="--", label="wanted at 0.05 m/s")
    axes.axvline(0.05, color=style.LIMIT, lw=0.8, ls=":")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("bias of the velocity on an axis [m/s]; band: 5 to 95 % of the runs")
    axes.set_ylabel("time to detect [s]")
    style.legend_above(axes)
    return figure
