"""Report and pictures of the consistent tuning: what k each group needed, the shape of the bound, tightness left."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ground.campaign.cells import ALTITUDE_BANDS_KM, CELLS
from ground.campaign.certificate import AGE_BINS_S
from ground.campaign.ensemble import Ensemble
from ground.campaign.outage import Arrays, ages_s
from ground.campaign.statistics import quantile
from ground.reports import style
from ground.tuning.factors import Factor
from ground.tuning.method import table
from ground.tuning.shape import Shape, shape

_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7")


class Told(NamedTuple):
    """What the report is made of."""

    table_set: str
    ensemble: Ensemble
    figures: Arrays
    factors: tuple[list[Factor], list[Factor]]
    values: np.void
    changes: Mapping[str, float]
    tried: list[tuple[str, float, Shape]]


def lines(told: Told) -> list[str]:
    """The report's body."""
    found = ["## k", "", "The worst error / bound of an outage says which k it would have needed: order statistics of"]
    found += [
        "these give the k that proves the rate at 95 % (Clopper and Pearson). The largest of a column is taken.",
        "",
    ]
    for name, group in zip(("per axis", "in space"), told.factors, strict=True):
        found += [f"### {name}", ""]
        head = ["outages of", "count", "rate", "k", "would break", "limit at 95 %", ""]
        found += table(head, [_row(one, index == 0) for index, one in enumerate(group)])
        found.append("")
    bins = [b for b in AGE_BINS_S if b[0] < told.ensemble.outage_s[1]]
    words = [f"{low}-{high // 10 * 10} s" for low, high in bins]
    form = shape(told.figures, told.ensemble)
    found += ["## Shape", "", "rms of error / sigma, largest axis: equal numbers are a bound of the errors' shape.", ""]
    bands = [f"{low:g}-{high:g} km" for low, high in ALTITUDE_BANDS_KM]
    rows = [[band, *[_text(v) for v in form.sigmas[i, : len(bins)]]] for i, band in enumerate(bands)]
    found += table(["perigee", *words], rows)
    found += ["", f"Loss of tightness by shape: {100.0 * (np.exp(form.loss) - 1.0):.0f} % in the mean.", ""]
    if told.tried:
        found += [
            "## Process noise",
            "",
            "Tried on the same outages; kept where the loss falls by more than chance.",
            "",
        ]
        head = ["setting", "value", "loss", "1-sigma", "kept"]
        rows = [
            [key, f"{value:g}" if value else "", f"{one.loss:.3f}", f"{one.sigma:.3f}", _kept(told, key, value)]
            for key, value, one in told.tried
        ]
        found += [*table(head, rows), ""]
    found += ["## Tightness that this k leaves", "", "1 / q0.997(error / bound) by age, as a certificate has it.", ""]
    found += table(["perigee", *words], [[band, *row] for band, row in zip(bands, _tightness(told, bins), strict=True)])
    return found


def drawings(told: Told) -> tuple[tuple[str, Callable[[], Figure]], ...]:
    """Pictures, by file name."""
    return ("1_needed.png", lambda: _needed(told)), ("2_shape.png", lambda: _by_age(told))


def _row(one: Factor, pooled: bool) -> list[str]:
    few = "too few: carried on from the largest" if pooled else "too few to prove the rate: not used"
    how = "proven" if one.proven else few
    return [
        one.group, str(one.outages), f"{one.rate:g}", f"{one.k:.2f}", str(one.beyond), f"{one.upper_limit_95:.4f}", how
    ]  # fmt: skip


def _kept(told: Told, key: str, value: float) -> str:
    return "yes" if told.changes.get(key) == value else ""


def _rows_of(told: Told, band: tuple[float, float]) -> np.ndarray:
    inside = np.isin(told.figures["cell"], [k for k, cell in enumerate(CELLS) if cell.altitude_km == band])
    return np.asarray(told.figures["started"] & inside)


def _tightness(told: Told, bins: list[tuple[int, int]]) -> list[list[str]]:
    ages, k_axis = ages_s(told.ensemble.outage_s[1]), told.changes["bound.k_axis"]
    with np.errstate(invalid="ignore"):
        ratio = np.abs(told.figures["error_m"]).max(axis=2) / (k_axis / told.values["k_axis"] * told.figures["bound_m"])
    found = []
    for band in ALTITUDE_BANDS_KM:
        rows = ratio[_rows_of(told, band)]
        spans = [rows[:, (ages >= low) & (ages < high)] for low, high in bins]
        found.append([_text(1.0 / quantile(one)) for one in spans])
    return found


def _needed(told: Told) -> Figure:
    """Which k each outage would have needed, by band of altitude."""
    figure, (axes,) = style.new_figure(1, "Sigmas that the outages would have needed", _subtitle(told))
    for band, colour in zip(ALTITUDE_BANDS_KM, _COLOURS, strict=True):
        needed = np.sort(told.values["k_axis"] * told.figures["worst_ratio"][_rows_of(told, band)])[::-1]
        if len(needed):
            share = np.arange(1, len(needed) + 1) / len(needed)
            axes.step(needed, share, where="post", color=colour, label=f"{band[0]:g}-{band[1]:g} km")
    axes.axhline(0.003, color=style.GREY, lw=1.0, ls=":", label="0.3 %")
    axes.axvline(told.changes["bound.k_axis"], color=style.BOUND, lw=1.4, label="k chosen")
    axes.axvline(float(told.values["k_axis"]), color=style.GREY, lw=1.0, ls="--", label="k of the base set")
    axes.set(yscale="log", xlabel="k needed, worst epoch of an outage", ylabel="share of outages beyond")
    axes.legend(loc="upper right")
    return figure


def _by_age(told: Told) -> Figure:
    """Errors in sigmas against age, by band: q0.95, beside the k chosen."""
    figure, (axes,) = style.new_figure(1, "Errors in sigmas by age: 0.95 quantile (dashed), largest", _subtitle(told))
    ages = ages_s(told.ensemble.outage_s[1])
    with np.errstate(invalid="ignore"):
        ratio = np.abs(told.figures["error_m"]).max(axis=2) / told.figures["bound_m"] * told.values["k_axis"]
    for band, colour in zip(ALTITUDE_BANDS_KM, _COLOURS, strict=True):
        rows = ratio[_rows_of(told, band)]
        if len(rows):
            axes.plot(ages, [quantile(column, 0.95) for column in rows.T], color=colour, ls="--", lw=1.2)
            axes.plot(
                ages, [quantile(column, 1.0) for column in rows.T], color=colour, label=f"{band[0]:g}-{band[1]:g} km"
            )
    axes.axhline(told.changes["bound.k_axis"], color=style.BOUND, lw=1.4, label="k chosen")
    axes.set(xscale="log", xlabel="age since the last fix [s]", ylabel="sigmas, largest axis")
    axes.set_xlim(ages[0], ages[-1])
    axes.set_ylim(0.0, None)
    axes.legend(loc="upper left", ncols=3)
    return figure


def _subtitle(told: Told) -> str:
    count = int(told.figures["started"].sum())
    return (
        f"base set {told.table_set}, {count} outages of {told.ensemble.outage_s[1]:.0f} s, {told.ensemble.noise} noise"
    )


def _text(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "-"
