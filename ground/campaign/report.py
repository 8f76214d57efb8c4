"""The report of a certification in Markdown: verdict first, then cells, ages, flags, coverage, attempts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ground.campaign.certificate import Target

REPORT = "report.md"


def write(folder: Path, document: dict[str, Any], targets: list[Target], pictures: list[Path]) -> Path:
    """Write report.md into the folder."""
    path = folder / REPORT
    path.write_text("\n".join(lines(document, targets, [p.relative_to(folder) for p in pictures])), encoding="utf-8")
    return path


def verdict(document: dict[str, Any], targets: list[Target]) -> list[str]:
    """What it comes to, in three lines."""
    pooled = document["summary"]["pooled"]
    missed, open_ = sum(t.met is False for t in targets), sum(t.met is None for t in targets)
    if document["certified"]:
        word = "CERTIFIED"
    else:
        word = "NOT CERTIFIED" if document["grade"] == "full" else "NOT CERTIFIED: a quick campaign certifies nothing"
    if document["certified"]:
        word += f" to an age of {document['envelope']['age_s']:.0f} s"
    return [
        f"{document['table_set']} (CRC {document['table_crc32']}), attempt {document['attempt']}: {word}",
        f"{pooled['outages']} outages, {pooled['violated']} with a broken bound: at most "
        f"{100.0 * pooled['upper_limit_95']:.2f} % of outages at 95 % confidence",
        f"{len(targets) - missed - open_} of {len(targets)} targets met, {missed} missed, {open_} not reached",
    ]


def lines(document: dict[str, Any], targets: list[Target], pictures: list[Path]) -> list[str]:
    """The report, line by line."""
    summary = document["summary"]
    pooled, floor = summary["pooled"], summary["floor"]
    first, *rest = verdict(document, targets)
    found = [f"# {first}", "", *[f"- {line}" for line in rest]]
    found += [
        f"- grade {document['grade']}, {summary['runs']} runs on {summary['days']} days, "
        f"{pooled['not_started']} without a state when GNSS was lost",
        f"- worst error / bound {text(pooled['worst_ratio'])} per axis, {text(pooled['worst_3d_ratio'])} in three "
        f"dimensions ({pooled['violated_3d']} outages beyond)",
        f"- misleading: {pooled['misleading_epochs']} of {pooled['epochs']} epochs had an error beyond the bound",
        f"- INTEGRATED: {summary['integrated']['violated']} runs broke the bound in "
        f"{summary['integrated']['orbits']:.0f} revolutions, worst {text(summary['integrated']['worst_ratio'])}",
        f"- second outages: {summary['second_outages']['violated']} of {summary['second_outages']['flown']} violated; "
        f"with a burn: {summary['with_burns']['violated']} of {summary['with_burns']['outages']}",
        f"- NEES before the loss: median {text(summary['nees_before']['median'])}, "
        f"95 % {text(summary['nees_before']['q95'])} (6 expected in the mean)",
        "",
    ]
    bins = list(pooled["tightness"])
    found += ["## Cells", "", "Violated outages with the upper limit at 95 %; tightness 1 / q0.997(error / bound).", ""]
    found += table(
        ["cell", "outages", "violated", "limit", "worst", *[f"{b} s" for b in bins]],
        [
            [
                row.get("cell", "all"),
                str(row["outages"]),
                str(row["violated"]),
                f"{row['upper_limit_95']:.4f}",
                text(row["worst_ratio"]),
                *[text(row["tightness"].get(b)) for b in bins],
            ]
            for row in (*summary["cells"], pooled)
        ]
        + [["floor", "", "", "", "", *[text(floor["tightness"].get(b)) for b in bins]]],
    )
    found += ["", f"The floor is a covariance known perfectly, at k = {floor['k']:.2f} (0.3 % of outages broken).", ""]
    found += ["## Kinds of fixes", ""]
    found += table(
        ["fixes, sigma", "outages", "violated", "limit", "worst", "INTEGRATED: violated", "revolutions", "worst"],
        [
            [
                row["kind"],
                str(row["outages"]),
                str(row["violated"]),
                f"{row['upper_limit_95']:.4f}",
                text(row["worst_ratio"]),
                str(row["integrated"]["violated"]),
                f"{row['integrated']['orbits']:.0f}",
                text(row["integrated"]["worst_ratio"]),
            ]
            for row in summary["fixes"]
        ],
    )
    found += ["", "## Error (q0.997) and median bound [m]", ""]
    found += table(
        ["cell", *[f"{b} s" for b in bins]],
        [
            [
                row.get("cell", "all"),
                *[f"{text(row['error_q997_m'].get(b))} / {text(row['bound_median_m'].get(b))}" for b in bins],
            ]
            for row in (*summary["cells"], pooled)
        ],
    )
    found += ["", "## Flag", ""]
    found += table(
        [
            "limit [m]",
            "flags",
            "early",
            "lead, median [s]",
            "late (HMI)",
            "limit at 95 %",
            "T [s]",
            "T_flag [s]",
            "ratio",
        ],
        [
            [
                limit,
                str(f["flags"]),
                str(f["early_flags"]),
                text(f["early_lead_median_s"]),
                str(f["hazardous"]),
                f"{f['hazardous_upper_limit_95']:.4f}",
                reached(f["t_s"]),
                reached(f["t_flag_median_s"]),
                reached(f["t_flag_over_t"]),
            ]
            for limit, f in pooled["limits"].items()
        ],
    )
    found += ["", "## Wanted and measured", "", *wanted(targets)]
    found += ["", "## Coverage", ""]
    for name, part in summary["coverage"].items():
        counts = ", ".join(f"{word}: {count}" for word, count in part["counts"].items())
        empty = f"; empty: {', '.join(part['empty'])}" if part["empty"] else ""
        found.append(f"- {name}: {counts}{empty}")
    found += ["", "## Attempts", ""]
    found += table(
        ["attempt", "state", "set", "runs", "violated", "targets missed"],
        [
            [
                str(one["attempt"]),
                one["state"],
                one["what"]["table_set"],
                str(one["what"]["runs"]),
                str(one.get("result", {}).get("violated", "")),
                str(one.get("result", {}).get("missed", "")),
            ]
            for one in document["attempts"]
        ],
    )
    found += ["", "## Pictures", "", *[f"![{path.stem}]({path.as_posix()})" for path in pictures], ""]
    return found


def wanted(targets: list[Target]) -> list[str]:
    """Targets as a table."""
    return table(
        ["target", "wanted", "measured", "met", "certified without"],
        [
            [t.what, t.wanted, t.measured, {True: "yes", False: "no", None: "-"}[t.met], "no" if t.integrity else "yes"]
            for t in targets
        ],
    )


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    """A table in Markdown."""
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def text(value: float | None) -> str:
    """Three digits; - for what is not known."""
    return "-" if value is None else f"{value:.3g}"


def reached(value: float | None) -> str:
    """Four digits, or that it was not reached."""
    return "not reached" if value is None else f"{value:.4g}"
