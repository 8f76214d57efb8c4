"""Pictures of a certification: error under bound by age, tightness, Stanford diagram, coverage of cells."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ground.campaign.cells import ALTITUDE_BANDS_KM, CELLS
from ground.campaign.certify import Certified
from ground.campaign.outage import LIMITS_M, ages_s
from ground.campaign.statistics import quantile, tightness
from ground.reports import style

BAND_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7")
_DASHES = ("-", "--", ":")
_SHOWN_M = 0.05


def draw(certified: Certified, folder: Path) -> list[Path]:
    """Draw all into the folder; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    drawings: tuple[tuple[str, Callable[[Certified], Figure]], ...] = (
        ("1_error_and_bound.png", error_and_bound),
        ("2_tightness.png", tightness_by_age),
        ("3_stanford.png", stanford),
        ("4_worst_ratio.png", worst_ratio),
    )
    with style.styled():
        return [style.save(drawing(certified), folder / name) for name, drawing in drawings]


def title(certified: Certified) -> str:
    """What was flown, under a title."""
    document = certified.document
    grade = "" if document["certified"] else ", not certified"
    return (
        f"set {document['table_set']}, {document['summary']['pooled']['outages']} outages, {document['grade']}{grade}"
    )


def _ages(certified: Certified) -> np.ndarray:
    return ages_s(certified.ensemble.outage_s[1])


def error_and_bound(certified: Certified) -> Figure:
    """Medians of error and bound against age, by band of altitude."""
    figure, (axes,) = style.new_figure(1, "Error without GNSS and its bound, medians", title(certified))
    figures, ages = certified.figures, _ages(certified)
    for band, colour in zip(ALTITUDE_BANDS_KM, BAND_COLOURS, strict=True):
        rows = figures["started"] & np.isin(figures["cell"], [i for i, c in enumerate(CELLS) if c.altitude_km == band])
        if not rows.any():
            continue
        axis_m = np.abs(figures["error_m"][rows]).max(axis=2)
        label = f"{band[0]:g}-{band[1]:g} km"
        axes.plot(ages, [quantile(column, 0.5) for column in axis_m.T], color=colour, label=f"{label}: error")
        axes.plot(
            ages, [quantile(column, 0.5) for column in figures["bound_m"][rows].T], color=colour, ls="--", label="bound"
        )
    axes.axhline(LIMITS_M[0], color=style.LIMIT, lw=1.0)
    axes.annotate("50 m", (ages[0], LIMITS_M[0]), color=style.LIMIT, xytext=(4, 4), textcoords="offset points")
    axes.set(xscale="log", yscale="log", xlabel="age since the last fix [s]", ylabel="largest axis [m]")
    axes.set_xlim(ages[0], ages[-1])
    style.metres_ticks(axes)
    axes.legend(loc="lower right", ncols=2)
    return figure


def tightness_by_age(certified: Certified) -> Figure:
    """By what factor bounds could be divided, against age, by cell, beside the floor."""
    figure, (axes,) = style.new_figure(1, "Tightness: 1 / q0.997(error / bound)", title(certified))
    figures, ages = certified.figures, _ages(certified)
    with np.errstate(invalid="ignore"):
        ratio = np.abs(figures["error_m"]).max(axis=2) / figures["bound_m"]
    for index in certified.ensemble.cells:
        rows = figures["started"] & (figures["cell"] == index)
        if not rows.any():
            continue
        band, flux = divmod(index, len(_DASHES))
        values = [tightness(column) for column in ratio[rows].T]
        axes.plot(ages, values, color=BAND_COLOURS[band], ls=_DASHES[flux], lw=1.2, label=CELLS[index].label)
    lowest = certified.document["summary"]["floor"]["tightness"].values()
    known = [value for value in lowest if value is not None]
    if known:
        axes.axhline(sum(known) / len(known), color=style.GREY, lw=1.0, label="floor")
    axes.axhline(1.0, color=style.LIMIT, lw=1.2, label="broken below")
    axes.set(xscale="log", xlabel="age since the last fix [s]", ylabel="factor")
    axes.set_xlim(ages[0], ages[-1])
    axes.set_ylim(0.0, 1.4 * axes.get_ylim()[1])  # room for the legend
    axes.legend(loc="upper right", ncols=3, fontsize=8)
    return figure


def stanford(certified: Certified) -> Figure:
    """Error against bound for every age kept; above the diagonal the bound held."""
    figure, (axes,) = style.new_figure(1, "Stanford diagram of the outages", title(certified))
    figures = certified.figures
    started = figures["started"]
    error = np.abs(figures["error_m"][started]).max(axis=2).ravel()
    bound = figures["bound_m"][started].ravel()
    known = np.isfinite(error) & np.isfinite(bound)
    error, bound = np.maximum(error[known], _SHOWN_M), np.maximum(bound[known], _SHOWN_M)
    top = 1.3 * max(float(error.max()), float(bound.max()), LIMITS_M[0])
    edges = np.geomspace(_SHOWN_M, top, 120)
    counts, _, _ = np.histogram2d(error, bound, (edges, edges))
    mesh = axes.pcolormesh(
        edges, edges, np.where(counts > 0, np.log10(np.maximum(counts, 1)), np.nan).T, cmap="viridis"
    )
    figure.colorbar(mesh, ax=axes, label="log10 of epochs kept")
    axes.plot(edges, edges, color=style.LIMIT, lw=1.2)
    axes.fill_between(edges, edges, _SHOWN_M, color=style.LIMIT, alpha=0.08, lw=0)
    share = float(np.mean(error > bound))
    axes.annotate(
        f"error > bound: {100.0 * share:.3f} % of epochs",
        (0.97, 0.05),
        xycoords="axes fraction",
        ha="right",
        color=style.LIMIT,
    )
    limit = LIMITS_M[0]
    axes.plot([_SHOWN_M, top], [limit, limit], color=style.FLAG, lw=1.0)
    axes.annotate("flag at 50 m", (1.3 * _SHOWN_M, limit), color=style.FLAG, xytext=(0, 4), textcoords="offset points")
    axes.set(xscale="log", yscale="log", xlabel="error, largest axis [m]", ylabel="bound [m]")
    return figure


def worst_ratio(certified: Certified) -> Figure:
    """The worst error / bound of every outage, sorted, by band of altitude."""
    figure, (axes,) = style.new_figure(1, "Worst error / bound of each outage", title(certified))
    figures = certified.figures
    for band, colour in zip(ALTITUDE_BANDS_KM, BAND_COLOURS, strict=True):
        rows = figures["started"] & np.isin(figures["cell"], [i for i, c in enumerate(CELLS) if c.altitude_km == band])
        worst = np.sort(figures["worst_ratio"][rows])[::-1]
        if len(worst):
            share = np.arange(1, len(worst) + 1) / len(worst)
            axes.step(worst, share, color=colour, where="post", label=f"{band[0]:g}-{band[1]:g} km")
    axes.axvline(1.0, color=style.LIMIT, lw=1.2)
    axes.axhline(0.003, color=style.GREY, lw=1.0, ls=":", label="0.3 %")
    axes.set(yscale="log", xlabel="largest error / bound of an outage", ylabel="share of outages beyond")
    axes.set_xlim(0.0, None)
    axes.legend(loc="upper right")
    return figure
