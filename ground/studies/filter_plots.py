"""Pictures of the filter's studies, from their documents: averages in their bands, returns and ramps, burns found."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from ground.reports import style
from ground.studies.false_fixes import RAMP, RAMP_MPS, WANTED_M
from ground.studies.false_fixes import WANTED_S as RAMP_WANTED_S
from ground.studies.manoeuvres import NOISES, SPEEDS_MPS, WANTED_S, limit_s

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
Document = dict[str, Any]


def draw_consistency(document: Document, folder: Path) -> list[Path]:
    """Averages of the ensemble at its epochs, a figure for each table set."""
    files = []
    with style.styled():
        for one in document["drawn"]:
            words = f"set {one['table_set']}: average of {one['runs']} runs, truth drawn from the filter's own model"
            figure, panels = _figure("Errors by their covariance", words, 2, 1)
            nees, nis = one["series"][:2], one["series"][2:]
            for panel, some, name in ((panels[0], nees, "NEES by 6"), (panels[1], nis, "NIS by 3")):
                _bands(panel, some)
                panel.set_ylabel(name)
                panel.legend(loc="upper right", ncols=3)
            panels[1].set_xlim(panels[0].get_xlim())
            panels[1].set_xlabel("time since the first fix [s]")
            files.append(style.save(figure, folder / f"consistency_{one['table_set']}.png"))
    return files


def _bands(panel: Axes, some: list[Document]) -> None:
    start, end = min(s["t_s"][0] for s in some), max(s["t_s"][-1] for s in some)
    panel.axhspan(some[0]["low"], some[0]["high"], color=style.OUTAGE_SHADE, lw=0, label="95 %")
    for series, colour in zip(some, COLOURS, strict=False):
        inside = f"{series['name']}: inside at {100 * series['inside']:.0f} %"
        panel.plot(series["t_s"], series["mean"], color=colour, marker="o", ms=3.5, lw=1.0, label=inside)
    panel.set_xlim(start - 50.0, end + 50.0)
    low = min(some[0]["low"], *(min(s["mean"]) for s in some))
    high = max(some[0]["high"], *(max(s["mean"]) for s in some))
    panel.set_ylim(low - 0.1, high + 0.25)


def draw_recovery(document: Document, folder: Path) -> list[Path]:
    """How fast errors are small again, and what ramps do before they are found."""
    with style.styled():
        figure, panels = _figure("After outages, and under false fixes", "share of all runs", 2, 2)
        for colour, summary in zip(("#0072b2", "#d55e00", "#009e73") * 2, _kinds(document), strict=False):
            length, kind, runs = summary
            dashes = "-" if kind == "as it is" else ":"
            for panel, key in ((panels[0], "near_s"), (panels[1], "steady_s")):
                _cumulative(panel, [run[key] for run in runs], colour, f"{length} s, error {kind}", dashes)
        panels[0].set_xlim(-1.0, 70.0)
        panels[0].axvline(60.0, color=style.LIMIT, lw=1.2, ls="--")
        panels[1].axvline(600.0, color=style.LIMIT, lw=1.2, ls="--")
        panels[0].set_xlabel("3-D error within 5 m from then on: seconds since fixes are back")
        panels[1].set_xlabel("within twice the steady rms: seconds since fixes are back")
        panels[1].legend(loc="lower right", fontsize=8.5)
        ramps = [run for run in document["false_fixes"]["ramp_runs"] if run["kind"] == RAMP]
        for colour, speed in zip(COLOURS, sorted({run["speed_mps"] for run in ramps}), strict=False):
            some = [run for run in ramps if run["speed_mps"] == speed]
            for panel, key in ((panels[2], "found_s"), (panels[3], "absorbed_m")):
                _cumulative(panel, [run[key] for run in some], colour, f"ramp of {speed:g} m/s", "-")
        panels[2].axvline(RAMP_WANTED_S, color=style.LIMIT, lw=1.2, ls="--")
        panels[3].axvline(WANTED_M, color=style.LIMIT, lw=1.2, ls="--")
        panels[2].set_xlabel(f"named a slow fault: seconds since it began (asked at {RAMP_MPS:g} m/s)")
        panels[3].set_xlabel("largest position absorbed [m]")
        panels[2].legend(loc="lower right", fontsize=8.5)
        return [style.save(figure, folder / "recovery.png")]


def _kinds(document: Document) -> list[tuple[int, str, list[Document]]]:
    runs = document["returns"]["runs"]
    pairs = sorted({(run["outage_s"], run["kind"]) for run in runs}, key=lambda pair: (pair[1], pair[0]))
    return [(s, kind, [r for r in runs if (r["outage_s"], r["kind"]) == (s, kind)]) for s, kind in pairs]


def draw_manoeuvres(document: Document, folder: Path) -> list[Path]:
    """Time to the first alert beside the limit of information; alarms without a burn by threshold."""
    found = document["unannounced"]["burn_runs"]
    with style.styled():
        figure, panels = _figure(
            "Burns nobody announced",
            "first alert of all runs (dots), and when the best test's mean statistic passes 40 (lines)",
            1,
            2,
            (1.9, 1.0),
        )
        speeds = np.geomspace(min(SPEEDS_MPS), max(SPEEDS_MPS), 200)
        for number, (colour, (sigma, velocity)) in enumerate(zip(COLOURS, NOISES, strict=False)):
            some = [run for run in found if run["sigma_m"] == sigma]
            if not some:
                continue
            limit = [max(limit_s(speed, sigma, velocity, 40.0), 1.0) for speed in speeds]
            panels[0].plot(speeds, limit, color=colour, lw=1.8, label=f"{sigma:g} m, {velocity:g} m/s")
            shift = 1.0 + 0.07 * (number - 1)
            known = [(run["speed_mps"] * shift, max(run["alert_s"], 1.0)) for run in some if run["alert_s"] is not None]
            panels[0].plot(*zip(*known, strict=True), ls="", marker="o", ms=3.5, color=colour, alpha=0.35)
            never = sum(run["alert_s"] is None for run in some)
            if never:
                panels[0].plot([], [], ls="", label=f"  ({never} of {len(some)} not found in {1200} s)")
        panels[0].axhline(WANTED_S, color=style.LIMIT, lw=1.2, ls="--")
        panels[0].axvline(0.02, color=style.LIMIT, lw=1.2, ls="--")
        panels[0].set_xscale("log")
        panels[0].set_yscale("log")
        panels[0].set_xlabel("size of the burn [m/s]")
        panels[0].set_ylabel("first alert [s]")
        for axis in (panels[0].xaxis, panels[0].yaxis):
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
        panels[0].legend(loc="upper right")
        _rates(panels[1], document["unannounced"]["healthy"])
        return [style.save(figure, folder / "manoeuvres.png")]


def _rates(panel: Axes, healthy: Iterable[Document]) -> None:
    for colour, one in zip(COLOURS, healthy, strict=False):
        thresholds = [float(name) for name in one["excesses_per_day"]]
        rates = list(one["excesses_per_day"].values())
        panel.plot(
            thresholds, rates, color=colour, marker="o", ms=4, label=f"{one['sigma_m']:g} m, {one['days']:.0f} days"
        )
    panel.set_yscale("symlog", linthresh=0.05)
    panel.set_ylim(bottom=0.0)
    panel.axvline(40.0, color=style.LIMIT, lw=1.2, ls="--")
    panel.set_xlabel("threshold on the statistic")
    panel.set_title("no burn: excesses a day", loc="left", fontsize=10.5, fontweight="bold")
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.legend(loc="upper right")


def _cumulative(panel: Axes, values: list[float | None], colour: str, label: str, dashes: str) -> None:
    """Share of the runs that are no larger; those without a value are never reached."""
    known = np.sort([value for value in values if value is not None])
    share = np.arange(1, len(known) + 1) / len(values)
    panel.step(np.r_[0.0, known], np.r_[0.0, share], where="post", color=colour, ls=dashes, lw=1.5, label=label)
    panel.set_ylim(0.0, 1.03)
    panel.set_xlim(left=0.0)


def _figure(
    title: str, words: str, rows: int, columns: int, widths: tuple[float, ...] | None = None
) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=style.FIGURE_INCHES, dpi=style.DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw={"width_ratios": widths} if widths else None)
    figure.subplots_adjust(left=0.075, right=0.975, top=0.86, bottom=0.095, hspace=0.32, wspace=0.14)
    figure.text(0.075, 0.955, title, fontsize=15, fontweight="bold", va="center")
    figure.text(0.075, 0.91, words, fontsize=10, color=style.GREY, va="center")
    return figure, list(axes.ravel())
