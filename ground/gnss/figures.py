"""Pictures of the study and of a check: detection and exclusion, a Stanford diagram, a file's errors and faults."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from flightsw.gnss.records import Verdict
from ground.gnss.check import Checked
from ground.reports import style

_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7")


def draw(document: dict[str, Any], folder: Path) -> list[Path]:
    """Draw what the document has; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    made: list[tuple[str, Callable[[], Figure]]] = []
    if "detection" in document and "exclusion" in document:
        made.append(("exclusion.png", lambda: exclusion(document["detection"], document["exclusion"])))
    if "protection" in document:
        made.append(("stanford.png", lambda: stanford(document["protection"]["availability"])))
    with style.styled():
        return [style.save(make(), folder / name) for name, make in made]


def exclusion(detection: dict[str, Any], found: dict[str, Any]) -> Figure:
    """Above: share of biases that the tests find, by size. Below: exact fault sets of both rules."""
    figure, (above, below) = style.new_figure(
        2,
        "Faults of navigation satellites: found, and named exactly",
        "GPS, GLONASS, Galileo, Earth user; 5 deg mask above; below both rules on the same epochs, alpha 0.001",
        sharex=False,
    )
    figure.subplots_adjust(hspace=0.5)
    for colour, (name, one) in zip(
        _COLOURS, ((n, o) for n, o in detection.items() if isinstance(o, dict) and "share" in o), strict=False
    ):
        above.plot(one["sigmas"], one["share"], color=colour, label=name, marker="o", markersize=3)
    for level in (0.5, 0.99):
        above.axhline(level, color=style.GREY, lw=0.7, ls=":")
    above.set_xlabel("bias of one satellite [sigma]")
    above.set_ylabel("found")
    style.legend_above(above)
    cases = found["cases"]
    at = np.arange(len(cases))
    for offset, name, label, colour in (
        (-0.2, "raw", "the paper's greedy rule", style.BOUND),
        (0.2, "flight", "most probable explanation", style.ERROR),
    ):
        share = np.array([case[name]["rate"] for case in cases])
        low = share - [case[name]["lower"] for case in cases]
        high = np.array([case[name]["upper"] for case in cases]) - share
        below.bar(at + offset, share, 0.38, color=colour, label=label, yerr=(low, high), ecolor=style.INK)
        for x, value in zip(at + offset, share, strict=True):
            below.annotate(f"{value:.3f}", (x, 0.03), ha="center", color="white", fontsize=8.5)
    for x, case in zip(at, cases, strict=True):
        if case["wanted"] is not None:
            below.plot([x, x + 0.4], [case["wanted"]] * 2, color=style.LIMIT, lw=2.0)
    below.set_xticks(at, [f"{c['faults']} x {c['sigmas']:.0f}σ\nmask {c['mask_deg']:.0f}°" for c in cases])
    below.set_ylabel("exact set")
    below.grid(axis="x", visible=False)
    style.legend_above(below)
    return figure


def stanford(found: dict[str, Any]) -> Figure:
    """Vertical error against protection level; whatever is below the diagonal would be misleading."""
    figure, (axes,) = style.new_figure(
        1,
        "Stanford diagram: vertical error and protection level in low orbit",
        f"500 km, healthy epochs, ranges of 1 m; available within {found['limit_m']:.0f} m: "
        f"{100 * found['available']['rate']:.2f} %",
    )
    error, level = np.abs(found["errors_m"]), np.array(found["levels_m"])
    figure.subplots_adjust(right=0.94)
    top = 1.5 * found["limit_m"]
    bins = np.linspace(0.0, top, 121)
    count, _, _ = np.histogram2d(error, np.minimum(level, top - 1e-6), bins=(bins, bins))
    mesh = axes.pcolormesh(bins, bins, np.where(count > 0, count, np.nan).T, cmap="viridis", norm=LogNorm())
    axes.plot([0.0, top], [0.0, top], color=style.LIMIT)
    axes.axhline(found["limit_m"], color=style.GREY, ls="--")
    _word(axes, 0.98 * top, 0.35 * top, "misleading: error beyond the level", style.LIMIT)
    _word(axes, 0.98 * top, found["limit_m"] + 0.02 * top, "alert limit", style.GREY)
    axes.set_xlim(0.0, top)
    axes.set_ylim(0.0, top)
    axes.set_xlabel("|vertical error| [m]")
    axes.set_ylabel("vertical protection level [m]")
    figure.colorbar(mesh, ax=axes, fraction=0.03, pad=0.01).set_label("epochs")
    return figure


def _word(axes: Axes, x: float, y: float, text: str, colour: str) -> None:
    axes.annotate(text, (x, y), ha="right", va="center", color=colour, fontweight="bold", fontsize=9.5)


def draw_check(checked: Checked, reference_m: np.ndarray | None, document: dict[str, Any], folder: Path) -> Path:
    """A file: errors with protection levels, test statistic, faults injected and found by size."""
    result = checked.result
    t_min = (result["t_gps_ns"] - result["t_gps_ns"][0]) / 60e9
    injected = document.get("injected", [])
    rows = 2 + (reference_m is not None) + bool(injected)
    with style.styled():
        figure, axes = style.new_figure(
            rows,
            f"Consistency of real pseudoranges: {document['file'].partition('.')[0].partition('_')[0]}",
            f"{document['epochs']} epochs, {document['satellites']:.1f} satellites; "
            + ", ".join(f"{count} {name.lower()}" for name, count in document["verdicts"].items()),
            sharex=False,
        )
        figure.set_size_inches(11.0, 2.15 * rows)
        figure.subplots_adjust(hspace=0.62)
        panels = iter(axes)
        if reference_m is not None:
            _errors(next(panels), t_min, result, reference_m)
        panel = next(panels)
        panel.plot(t_min, result["first_statistic"], color=style.ERROR, label="sum of squared residuals")
        panel.plot(t_min, result["threshold"], color=style.LIMIT, label="threshold")
        bad = result["verdict"] != Verdict.CONSISTENT
        if bad.any():
            panel.plot(t_min[bad], result["first_statistic"][bad], "o", color=style.BOUND, ms=4, label="not consistent")
        panel.set_ylabel("RSS")
        panel.tick_params(labelbottom=False)
        style.legend_above(panel)
        panel = next(panels)
        for j, (name, colour) in enumerate(zip(("GLONASS", "Galileo"), _COLOURS, strict=False), start=1):
            panel.plot(t_min, result["clock_m"][:, j] - result["clock_m"][:, 0], color=colour, label=f"{name} to GPS")
        panel.set_ylabel("bias [m]")
        panel.set_xlabel("time [min]")
        style.legend_above(panel)
        if injected:
            _found(next(panels), injected)
        return style.save(figure, folder / "check.png")


def _errors(panel: Axes, t_min: np.ndarray, result: np.ndarray, reference_m: np.ndarray) -> None:
    error = np.einsum("mqk,mk->mq", result["axes"], result["r_m"] - reference_m)
    for q, (name, colour) in enumerate(zip(("east", "north", "up"), style.AXIS_COLOURS, strict=True)):
        panel.plot(t_min, error[:, q], color=colour, label=name, lw=1.0)
        for sign in (-1.0, 1.0):
            level = np.where(np.isfinite(result["protection_m"][:, q]), result["protection_m"][:, q], np.nan)
            label = "protection levels (dotted)" if q == 0 and sign < 0.0 else None
            panel.plot(t_min, sign * level, color=colour, lw=0.8, ls=":", label=label)
    panel.set_ylabel("error [m]")
    panel.tick_params(labelbottom=False)
    style.legend_above(panel)


def _found(panel: Axes, injected: list[dict[str, Any]]) -> None:
    edges = np.array([15.0, 20.0, 25.0, 30.0, 40.0, 60.0, 90.0, 130.0, 200.0])
    middle = np.sqrt(edges[1:] * edges[:-1])
    for one, colour in zip(injected, _COLOURS, strict=False):
        size, found = np.array(one["sizes_m"]), np.array(one["found"], float)
        which = np.clip(np.digitize(size, edges) - 1, 0, len(middle) - 1)
        number = np.maximum(np.bincount(which, minlength=len(middle)), 1)
        share = np.bincount(which, found, len(middle)) / number
        panel.plot(middle, share, "o-", color=colour, ms=4, label=f"{one['faults']} at a time")
    panel.set_xscale("log")
    panel.set_xticks([15, 20, 30, 50, 100, 200], ["15", "20", "30", "50", "100", "200"])
    panel.minorticks_off()
    panel.set_xlabel("injected fault [m]")
    panel.set_ylabel("removed")
    style.legend_above(panel)
