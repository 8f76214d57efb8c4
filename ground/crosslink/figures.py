"""Pictures of the studies: figures 3 to 8 of the paper, by its model and by true geometry, and our own.

The paper draws three-dimensional histograms of dR over time and neighbour. Here each is a map, a row a neighbour, where
nothing hides behind anything; the white line is the threshold's first majority.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ground.crosslink import paper
from ground.crosslink.day_noise import ANOMALY
from ground.crosslink.paper_tables import JUMP_AT_S, PrintedTable
from ground.crosslink.scene import Setting, ready
from ground.reports import style
from hil_sim.truth.constellation.broadcast import DIRECTIONS

_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7")
_ROWS_OF_A_MAP = ("scalar", *DIRECTIONS)


def draw(document: dict[str, Any], figures: dict[str, Any], folder: Path, seed: int) -> list[Path]:
    """Draw what the document has; figures: arrays of campaigns flown just now, for distributions. Returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    setting = Setting()
    made: list[tuple[str, Callable[[], Figure]]] = []
    if "paper" in document:
        made.append(("3_healthy.png", lambda: healthy(setting, seed)))
        for number, table in enumerate(paper.printed(), start=4):
            made.append((f"{number}_table_{table.number}.png", partial(maps, setting, table, seed)))
    if "uploads" in document:
        made.append(("detection.png", lambda: detection(document["uploads"])))
    if "roc" in document:
        made.append(("roc.png", lambda: roc(document["roc"])))
    if "ramps" in figures:
        made.append(("time_to_detect.png", lambda: time_to_detect(figures["ramps"])))
    if "day" in document:
        made.append(("day.png", lambda: day(document["day"])))
    with style.styled():
        return [style.save(make(), folder / name) for name, make in made]


def healthy(setting: Setting, seed: int) -> Figure:
    """Figure 3: dR of healthy uploads against the threshold."""
    sigma_m = paper.nominal_sigma_m(setting)
    dr = np.abs(np.random.default_rng(seed).normal(0.0, sigma_m, 2_000_000))
    figure, (axes,) = style.new_figure(
        1, "Healthy range differences and the paper's threshold", f"one link, sigma {sigma_m:.1f} m, 2 million uploads"
    )
    axes.hist(dr, bins=np.arange(0.0, 75.0, 0.5).tolist(), color=style.ERROR, log=True)
    axes.axvline(paper.THRESHOLD_M, color=style.LIMIT)
    axes.annotate(
        f"59.7 m: beyond it {math.erfc(paper.THRESHOLD_M / sigma_m / math.sqrt(2.0)):.1e} of the links",
        (paper.THRESHOLD_M, 1e4),
        xytext=(-6, 0),
        textcoords="offset points",
        ha="right",
        color=style.LIMIT,
    )
    axes.set_xlabel("|measured - computed| [m]")
    axes.set_ylabel("links")
    return figure


def maps(setting: Setting, table: PrintedTable, seed: int) -> Figure:
    """Figures 4 to 8: dR by neighbour and time, in the paper's model and for an error in each true direction."""
    rng = np.random.default_rng([seed, table.number])
    memory, pairs = ready(setting, 0.0)
    mine = np.flatnonzero((pairs[:, 0] == 0) | (pairs[:, 1] == 0))
    h = np.array(memory.network["h"][0])[mine]
    own_end = np.where(pairs[mine, 0] == 0, 0, 1)
    own = h[np.arange(len(mine)), own_end]
    stop = 100.0 if table.jump_m else 1.6 * paper.THRESHOLD_M / table.ramp_mps
    times = np.linspace(0.0, stop, 200)
    fault = np.where(times >= JUMP_AT_S, table.jump_m, 0.0) + table.ramp_mps * times
    sigma_m = paper.nominal_sigma_m(setting)
    name = f"a jump of {table.jump_m:g} m" if table.jump_m else f"a ramp of {table.ramp_mps:g} m/s"
    figure, axes = style.new_figure(
        5,
        f"Table {table.number}: range differences of satellite 1 under {name}",
        f"rows: satellites {_listed(pairs[mine])} against 1; white: first majority of |dR| > 59.7 m. Top: the paper's "
        "model; below: true directions",
    )
    figure.subplots_adjust(hspace=0.3, left=0.12, right=0.9)
    image = None
    for panel, label in zip(axes, _ROWS_OF_A_MAP, strict=True):
        noise = rng.normal(0.0, sigma_m, (len(mine), len(times)))
        if label == "scalar":
            dr = np.abs(noise) + fault
        else:
            dr = np.abs(noise + own[:, _ROWS_OF_A_MAP.index(label) - 1][:, None] * fault)
        image = panel.imshow(
            np.minimum(dr, 2.0 * paper.THRESHOLD_M),
            aspect="auto",
            cmap="magma_r",
            vmin=0.0,
            vmax=2.0 * paper.THRESHOLD_M,
            extent=(0.0, stop, -0.5, len(mine) - 0.5),
        )
        votes = 2 * (dr > paper.THRESHOLD_M).sum(axis=0) > len(mine)
        if votes.any():
            panel.axvline(float(times[np.argmax(votes)]), color="white", linewidth=1.5)
        panel.grid(False)
        panel.set_yticks([])
        share = 100.0 * votes[times >= (JUMP_AT_S if table.jump_m else 0.0)].mean()
        panel.set_ylabel(f"{label}\n{share:.0f} % flagged", rotation=0, ha="right", va="center", fontsize=9)
    axes[-1].set_xlabel("time [s]")
    if image is not None:
        top, bottom = axes[0].get_position().y1, axes[-1].get_position().y0
        bar = figure.colorbar(image, cax=figure.add_axes((0.915, bottom, 0.014, top - bottom)), extend="max")
        bar.set_label("|dR| [m]")
        bar.ax.axhline(paper.THRESHOLD_M, color="white", linewidth=1.5)
    return figure


def _listed(pairs: np.ndarray) -> str:
    """Numbers, from 1, of those that satellite 1 has links with."""
    return ", ".join(str(number + 1) for number in sorted({int(one) for one in pairs.ravel()} - {0}))


def detection(found: dict[str, Any]) -> Figure:
    """Share of jumps found in one epoch by the three monitors, by direction and size."""
    figure, axes = style.new_figure(
        4,
        "Jumps found in one epoch",
        f"{found['cases'][0]['trials']:,} uploads of each size marked; false alarms at most 2e-7 an epoch, the paper's "
        "rule as it is",
    )
    rows = {row["case"]: row for row in found["cases"]}
    for panel, direction, colour in zip(axes, DIRECTIONS, _COLOURS, strict=True):
        mine = [(float(name.split()[1]), row) for name, row in rows.items() if name.startswith(direction + " ")]
        sizes = [size for size, _ in mine]
        panel.plot(sizes, [row["exact"] for _, row in mine], "o-", color=colour, label="network: named exactly")
        panel.plot(sizes, [row["own_fault"] for _, row in mine], "s--", color=style.GREY, label="own satellite")
        panel.plot(sizes, [row["majority"] for _, row in mine], "^:", color=style.LIMIT, label="the paper's rule")
        panel.set_xscale("log")
        panel.set_xticks(sizes, [f"{size:g}" for size in sizes])
        panel.set_xticks([], minor=True)
        panel.set_ylim(-0.05, 1.05)
        panel.set_ylabel(direction)
    axes[-1].set_xlabel("jump [m]")
    style.legend_above(axes[0], 3)
    return figure


def roc(found: dict[str, Any]) -> Figure:
    """Detection against false alarms for one size of jump in every direction."""
    size = found["jumps_m"].index(40.0)
    figure, (axes,) = style.new_figure(
        1,
        "Detection against false alarms, jumps of 40 m",
        "solid: network; dashed: own satellite; dotted: the paper's rule",
    )
    for direction, colour in enumerate(_COLOURS):
        for monitor, dashes in (("network", "-"), ("own", "--"), ("majority", ":")):
            values = [math.nan if v is None else v for v in found[monitor][size][direction]]
            label = found["directions"][direction] if monitor == "network" else None
            axes.plot(found["rates"], values, dashes, color=colour, label=label)
    axes.set_xscale("log")
    axes.set_xlabel("false alarms an epoch")
    axes.set_ylabel("detected")
    style.legend_above(axes, 4)
    return figure


def time_to_detect(figures: dict[str, np.ndarray]) -> Figure:
    """Distribution of the time until a ramp is found, by case."""
    from ground.crosslink.ramps import CASES

    figure, axes = style.new_figure(
        2, "Time until a ramp is found", "solid: network; dashed: own satellite", sharex=False
    )
    figure.subplots_adjust(hspace=0.3)
    for index, case in enumerate(CASES):
        panel = axes[0] if case.rate_mps == 0.01 else axes[1]
        mine = figures["case"] == index
        for name, dashes in (("network_s", "-"), ("own_fault_s", "--")):
            times = np.concatenate(([0.0], np.sort(figures[name][mine])))  # what was not found, NaN, comes last
            share = np.arange(len(times)) / max(len(times) - 1, 1)
            panel.step(
                times,
                share,
                dashes,
                color=_COLOURS[case.direction],
                where="post",
                label=DIRECTIONS[case.direction] if name == "network_s" else None,
            )
        panel.set_ylabel(f"found, {case.rate_mps:g} m/s")
        panel.set_ylim(-0.05, 1.05)
        panel.set_xlim(left=0.0)
    axes[1].set_xlabel("time since the ramp began [s]")
    style.legend_above(axes[0], 4)
    return figure


def day(found: dict[str, Any]) -> Figure:
    """True errors of the real day's messages, and who was excluded when, with each noise table."""
    errors, flights = found["errors"], found["flights"]
    names, hours = list(errors["errors_m"]), np.array(errors["hours"])
    size = np.array([[math.nan if None in one else math.hypot(*one) for one in errors["errors_m"][n]] for n in names])
    caught = sorted({one["satellite"] for flight in flights.values() for one in flight["findings"]})
    figure, (above, below) = style.new_figure(
        2,
        "GLONASS, 1 April 2009: what satellites broadcast, and who was excluded",
        "above: error of messages by the precise orbits; below: exclusions by the network monitor, three noise tables",
        gridspec_kw={"height_ratios": (1.0, 0.24 * max(len(caught), 1))},
    )
    figure.set_size_inches(style.FIGURE_INCHES[0], 5.0 + 0.75 * len(caught))
    figure.subplots_adjust(top=0.88, bottom=0.075, hspace=0.14, right=0.9)
    image = above.pcolormesh(hours, np.arange(len(names)), size, cmap="YlGnBu", vmin=0.0, vmax=24.0, shading="nearest")
    for row, name in enumerate(names):
        said = np.flatnonzero(errors["unhealthy"][name])
        if len(said):
            span = (hours[said[0]], row - 0.5), float(hours[said[-1]] - hours[said[0]]), 1.0
            above.add_patch(Rectangle(*span, fill=False, hatch="//////", edgecolor=style.LIMIT, linewidth=1.2))
            above.annotate(
                "says it is unhealthy",
                (float(hours[said[-1]]), row),
                xytext=(5, 0),
                textcoords="offset points",
                va="center",
                fontsize=8.5,
                color=style.LIMIT,
            )
    above.set_yticks(range(len(names)), names, fontsize=8)
    above.grid(False)
    above.invert_yaxis()
    figure.canvas.draw()
    box = above.get_position()
    bar = figure.colorbar(image, cax=figure.add_axes((0.915, box.y0, 0.014, box.height)))
    bar.set_label("position and clock [m]")
    _exclusions(below, flights, caught)
    return figure


def _exclusions(axes: Axes, flights: dict[str, Any], caught: list[str]) -> None:
    """Bars of exclusions: a group for each satellite, a bar for each noise table; false ones crossed out."""
    height = 0.8 / len(flights)
    for place, ((table, flight), colour) in enumerate(zip(flights.items(), _COLOURS, strict=False)):
        for finding in flight["findings"]:
            y = caught.index(finding["satellite"]) - 0.4 + height * (place + 0.5)
            start, stop = finding["from_s"] / 3600.0, finding["to_s"] / 3600.0
            false = finding["beyond"] < ANOMALY
            axes.barh(y, max(stop - start, 0.04), left=start, height=0.85 * height, color=colour)
            text = f"{finding['size_m']:.1f} m" + (", within the noise" if false else "")
            axes.annotate(
                text,
                (max(stop, start + 0.04), y),
                xytext=(3, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
                color=style.LIMIT if false else style.INK,
            )
        axes.barh(math.nan, 0.0, color=colour, label=table)
    axes.set_yticks(range(len(caught)), caught)
    axes.set_ylim(len(caught) - 0.5, -0.5)
    axes.set_xlim(0.0, 24.0)
    axes.set_xticks(range(0, 25, 3))
    axes.set_xlabel("time of day [h]; beside each bar the true error when it was named")
    axes.grid(axis="y", visible=False)
    style.legend_above(axes, 3)
