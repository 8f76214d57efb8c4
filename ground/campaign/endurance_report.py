"""What is written and drawn of outages flown past the flag."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ground.campaign import pictures, report
from ground.campaign.cells import ALTITUDE_BANDS_KM, F107_RANGES_SFU
from ground.campaign.certificate import Target
from ground.campaign.certify import Certified
from ground.campaign.endurance_summary import ASKED, FORETOLD_SHARE
from ground.campaign.outage import LIMITS_M
from ground.reports import style

_MARKS = (".", "x")


def verdict(document: dict[str, Any], targets: list[Target]) -> list[str]:
    """What it comes to."""
    pooled = document["summary"]["pooled"]
    missed = sum(t.met is False for t in targets)
    return [
        f"{document['table_set']} (CRC {document['table_crc32']}), attempt {document['attempt']}, long outages, "
        f"grade {document['grade']}",
        f"{pooled['outages']} outages flown past the flag, {pooled['violated']} with a bound broken before it: at most "
        f"{100.0 * pooled['upper_limit_95']:.2f} % of outages at 95 % confidence",
        f"{sum(t.met is True for t in targets)} of {len(targets)} targets met, {missed} missed",
    ]


def write(folder: Path, document: dict[str, Any], targets: list[Target], drawn: list[Path]) -> Path:
    """Write report.md into the folder."""
    path = folder / report.REPORT
    path.write_text("\n".join(_lines(document, targets, [p.relative_to(folder) for p in drawn])), encoding="utf-8")
    return path


def _lines(document: dict[str, Any], targets: list[Target], drawn: list[Path]) -> list[str]:
    summary = document["summary"]
    first, *rest = verdict(document, targets)
    found = [f"# {first}", "", *[f"- {line}" for line in rest]]
    found.append(
        f"- {summary['ended_by_the_day']} of {summary['runs']} ended after {summary['longest_s']:.0f} s, the others by "
        "the flag at the highest limit and a third more"
    )
    groups = [*summary["bands"], summary["pooled"]]
    bins = list(summary["pooled"]["tightness"])
    found += ["", "## Bound before the flag at the highest limit", ""]
    found += report.table(
        ["altitude", "outages", "violated", "limit", "worst", *[f"tightness {b} s" for b in bins]],
        [
            [
                one.get("band", "all"),
                str(one["outages"]),
                str(one["violated"]),
                f"{one['upper_limit_95']:.4f}",
                report.text(one["worst_ratio_before_flag"]),
                *[report.text(one["tightness"].get(b)) for b in bins],
            ]
            for one in groups
        ],
    )
    found += ["", "## Flag", "", "T: 0.3 % of the outages settled for a revolution have an error beyond the limit.", ""]
    found += report.table(
        ["limit [m]", "altitude", "flags", "late", "limit at 95 %", "T [s]", "T_flag first, median [s]", "ratio"],
        [
            [
                limit,
                one.get("band", "all"),
                str(f["flags"]),
                str(f["hazardous"]),
                f"{f['hazardous_upper_limit_95']:.4f}",
                report.reached(f["t_s"]),
                f"{report.reached(f['t_flag_first_s'])}, {report.reached(f['t_flag_median_s'])}",
                report.reached(f["t_flag_over_t"]),
            ]
            for limit in summary["pooled"]["limits"]
            for one in groups
            for f in (one["limits"][limit],)
        ],
    )
    found += [
        "",
        "## Had every bound been smaller",
        "",
        "At the ages that are kept; T_flag / T at the lowest limit.",
        "",
    ]
    found += report.table(
        [
            "factor",
            "violated",
            "limit at 95 %",
            *[f"T_flag / T, {low:g}-{high:g} km" for low, high in ALTITUDE_BANDS_KM],
        ],
        [
            [
                f"{one['factor']:g}",
                str(one["violated"]),
                f"{one['upper_limit_95']:.4f}",
                *[report.text(share) for share in one["t_flag_over_t"]],
            ]
            for one in summary["trade_off"]
        ],
    )
    found += ["", "## Was the flag foretold?", "", "Without those in which a burn was announced later.", ""]
    found += report.table(
        ["limit [m]", "asked", "outages", "off by more than 2 % or 25 s", "median [s]", "95 % [s]", "worst [s]"],
        [
            [
                limit,
                when,
                str(told["asked"]),
                str(told["missed"]),
                *[report.text(told[f"{name}_off_s"]) for name in ("median", "q95", "worst")],
            ]
            for limit, by in summary["foretold"].items()
            for when, told in by.items()
        ],
    )
    found += ["", "## Wanted and measured", "", *report.wanted(targets)]
    found += ["", "## Pictures", "", *[f"![{path.stem}]({path.as_posix()})" for path in drawn], ""]
    return found


def draw(flown: Certified, folder: Path) -> list[Path]:
    """Draw all into the folder; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    with style.styled():
        return [
            style.save(drawing(flown), folder / name)
            for name, drawing in (
                ("1_error_and_bound.png", pictures.error_and_bound),
                ("2_flags.png", _flags),
                ("3_foretold.png", _foretold),
            )
        ]


def _flags(flown: Certified) -> Figure:
    """Share of outages whose flag has risen, against age, by band of altitude."""
    figure, axes = style.new_figure(2, "Ages at which the flag rose", pictures.title(flown), sharex=True)
    figures = flown.figures
    for k, (limit, panel) in enumerate(zip(LIMITS_M, axes, strict=True)):
        for band, colour in enumerate(pictures.BAND_COLOURS):
            rows = figures["started"] & (figures["cell"] // len(F107_RANGES_SFU) == band)
            if not rows.any():
                continue
            low, high = ALTITUDE_BANDS_KM[band]
            for what, dashes in (("bound", "-"), ("error", ":")):
                ages = np.sort(figures[f"crossing_{what}_s"][rows, k])
                share = np.arange(1, len(ages) + 1) / len(ages)
                label = f"{low:g}-{high:g} km" if what == "bound" else None
                panel.step(ages, share, color=colour, ls=dashes, where="post", label=label)
        panel.set(xscale="log", ylabel=f"share beyond {limit:g} m", ylim=(0.0, 1.0))
        panel.legend(loc="upper left", title="bound; dotted: error")
    axes[-1].set_xlabel("age since the last fix [s]")
    return figure


def _foretold(flown: Certified) -> Figure:
    """How far what was foretold was from the flag, against its age."""
    figure, axes = style.new_figure(2, "Foretold flag minus flag, share of its age", pictures.title(flown), sharex=True)
    figures = flown.figures
    rows = figures["started"] & (figures["burns"] == 0)
    for k, (limit, panel) in enumerate(zip(LIMITS_M, axes, strict=True)):
        actual_s = figures["crossing_bound_s"][rows, k]
        for row, mark in ((1, _MARKS[0]), (2, _MARKS[1])):
            told_s = figures["foretold_s"][rows, row, k]
            with np.errstate(invalid="ignore"):
                off = np.where(np.isfinite(told_s), told_s / actual_s - 1.0, np.nan)
            panel.plot(actual_s, 100.0 * off, mark, ms=4, label=ASKED[row])
        for edge in (-FORETOLD_SHARE, FORETOLD_SHARE):
            panel.axhline(100.0 * edge, color=style.LIMIT, lw=1.0)
        panel.set(xscale="log", ylabel=f"{limit:g} m: off [%]")
    axes[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    axes[-1].set_xlabel("age of the flag [s]")
    return figure
