"""What long outages show: whether the bound holds to the flag, when the flag comes, and whether it was foretold."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ground.campaign.cells import ALTITUDE_BANDS_KM, CELLS, F107_RANGES_SFU
from ground.campaign.certificate import (
    AGE_BINS_S,
    CELL_LIMIT,
    FLAG_SHARE,
    POOLED_LIMIT,
    SETTLED_S,
    Target,
    bin_name,
    number,
    rare,
    violations,
)
from ground.campaign.outage import LIMITS_M, Arrays, ages_s
from ground.campaign.statistics import CONTENT, quantile, tightness, upper_limit

FULL_BAND_RUNS = 1000
ASKED = ("at loss", "at 60 s", "at half time")
FORETOLD_SHARE, FORETOLD_S = 0.02, 25.0  # of the age of the flag; the refresh time of the tables
FACTORS = (1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6)  # of every bound, for the trade-off
_WIDE = len(F107_RANGES_SFU)


def grade_of(figures: Arrays, quick: bool) -> str:
    """ "full" with a thousand outages in each band of altitude."""
    counts = [int(rows.sum()) for rows in _bands(figures)]
    return "full" if min(counts) >= FULL_BAND_RUNS and not quick else "quick"


def summarise(figures: Arrays, longest_s: float) -> dict[str, Any]:
    """All numbers from the figures of all runs."""
    every = np.ones(len(figures["run"]), bool)
    bands = [
        _group(figures, rows, longest_s) | {"band": f"{low:g}-{high:g} km"}
        for rows, (low, high) in zip(_bands(figures), ALTITUDE_BANDS_KM, strict=True)
        if rows.any()
    ]
    cells = [
        {"cell": cell.label, "limits": _flags(figures, figures["cell"] == index)}
        for index, cell in enumerate(CELLS)
        if (figures["cell"] == index).any()
    ]
    return {
        "runs": len(every),
        "longest_s": longest_s,
        "ended_by_the_day": int((~figures["reached"]).sum()),
        "pooled": _group(figures, every, longest_s),
        "bands": bands,
        "cells": cells,
        "foretold": {f"{limit:g}": _foretold(figures, k) for k, limit in enumerate(LIMITS_M)},
        "trade_off": [_traded(figures, factor, longest_s) for factor in FACTORS],
    }


def judge(summary: dict[str, Any]) -> list[Target]:
    """What is wanted of long outages, and whether it was reached."""
    pooled = summary["pooled"]
    lines = [rare("long outages violated, 95 % limit", POOLED_LIMIT, pooled["upper_limit_95"])]
    lines += [rare(f"violated, {b['band']}", CELL_LIMIT, b["upper_limit_95"]) for b in summary["bands"]]
    for limit in pooled["limits"]:
        hazard = pooled["limits"][limit]["hazardous_upper_limit_95"]
        lines.append(rare(f"hazardous at {limit} m, 95 % limit", POOLED_LIMIT, hazard))
        for cell in summary["cells"]:
            share = cell["limits"][limit]["t_flag_over_t"]
            met = None if share is None else share >= FLAG_SHARE
            name = f"median T_flag / T at {limit} m, {cell['cell']}"
            lines.append(Target(name, f">= {FLAG_SHARE:g}", "not reached" if share is None else f"{share:.2f}", met))
        for when, told in summary["foretold"][limit].items():
            name = f"flag at {limit} m foretold {when}"
            met = None if not told["asked"] else told["missed"] == 0
            lines.append(Target(name, "within 2 % or 25 s, all", f"{told['missed']} of {told['asked']} not", met))
    return lines


def _bands(figures: Arrays) -> list[np.ndarray]:
    return [figures["cell"] // _WIDE == band for band in range(len(ALTITUDE_BANDS_KM))]


def _group(figures: Arrays, rows: np.ndarray, longest_s: float) -> dict[str, Any]:
    started = rows & figures["started"]
    ages = ages_s(longest_s)
    # to the flag at the highest limit: what comes after is offered to nobody
    before = ages < np.nan_to_num(figures["crossing_bound_s"][started, -1:], nan=np.inf)
    with np.errstate(invalid="ignore"):
        ratio = np.where(before, np.abs(figures["error_m"][started]).max(axis=2) / figures["bound_m"][started], np.nan)
    found = violations(figures, rows, "violated_before_flag") | {
        "worst_ratio_before_flag": number(quantile(ratio, 1.0)),
        "worst_ratio": number(quantile(figures["worst_ratio"][started], 1.0)),
        "tightness": {},
        "limits": _flags(figures, rows),
    }
    for b in AGE_BINS_S:
        inside = (ages >= b[0]) & (ages < b[1])
        if inside.any():
            found["tightness"][bin_name(b)] = number(tightness(ratio[:, inside]))
    return found


def _flags(figures: Arrays, rows: np.ndarray) -> dict[str, Any]:
    """By limit: flags late, T that 0.3 % of the settled outages do not reach without error beyond it, and T_flag.

    An outage that ended with its error within the limit counts as never beyond: it was flown past its flag by a third.
    """
    started = rows & figures["started"]
    settled = started & (figures["acquisition_s"] >= SETTLED_S) & (figures["burns"] == 0)
    found: dict[str, Any] = {}
    for k, limit in enumerate(LIMITS_M):
        by_error, by_bound = (
            np.nan_to_num(figures[f"crossing_{what}_s"][:, k], nan=np.inf) for what in ("error", "bound")
        )
        hazardous, trials = int((by_error < by_bound)[started].sum()), int(started.sum())
        t_s = _smallest(by_error[settled], 1.0 - CONTENT)
        t_flag_s = _smallest(by_bound[settled], 0.5)
        found[f"{limit:g}"] = {
            "hazardous": hazardous,
            "hazardous_upper_limit_95": upper_limit(hazardous, trials) if trials else 1.0,
            "flags": int(np.isfinite(by_bound[started]).sum()),
            "settled": int(settled.sum()),
            "t_s": number(t_s),
            "t_flag_first_s": number(_smallest(by_bound[settled], 0.0)),
            "t_flag_median_s": number(t_flag_s),
            "t_flag_over_t": number(t_flag_s / t_s if math.isfinite(t_s) else math.nan),
        }
    return found


def _traded(figures: Arrays, factor: float, longest_s: float) -> dict[str, Any]:
    """Had every bound been smaller by a factor: outages broken before the flag at the highest limit, at the ages that
    are kept, and by band the median T_flag / T at the lowest limit."""
    started = figures["started"]
    ages = ages_s(longest_s)
    bound_m = factor * figures["bound_m"]
    axis_m = np.abs(figures["error_m"]).max(axis=2)
    with np.errstate(invalid="ignore"):
        flagged = np.maximum.accumulate(bound_m > LIMITS_M[-1], axis=1)
        broken = started & ((axis_m > bound_m) & ~flagged).any(axis=1)
        above = bound_m > LIMITS_M[0]
    t_flag_s = np.where(above.any(axis=1), ages[above.argmax(axis=1)], np.inf)
    t_error_s = np.nan_to_num(figures["crossing_error_s"][:, 0], nan=np.inf)
    settled = started & (figures["acquisition_s"] >= SETTLED_S) & (figures["burns"] == 0)
    shares = []
    for rows in _bands(figures):
        t_s = _smallest(t_error_s[settled & rows], 1.0 - CONTENT)
        shares.append(number(_smallest(t_flag_s[settled & rows], 0.5) / t_s if math.isfinite(t_s) else math.nan))
    trials = int(started.sum())
    return {
        "factor": factor,
        "violated": int(broken.sum()),
        "upper_limit_95": upper_limit(int(broken.sum()), trials) if trials else 1.0,
        "t_flag_over_t": shares,
    }


def _smallest(values: np.ndarray, share: float) -> float:
    """The smallest value that this share of them does not exceed; NaN of none."""
    return float(np.sort(values)[max(math.ceil(share * len(values)) - 1, 0)]) if len(values) else math.nan


def _foretold(figures: Arrays, k: int) -> dict[str, Any]:
    """By when flight was asked: how far what it said was from the flag. Burns that came later are nobody's fault."""
    found: dict[str, Any] = {}
    actual_s = np.nan_to_num(figures["crossing_bound_s"][:, k], nan=np.inf)
    for row, when in enumerate(ASKED):
        told_s = figures["foretold_s"][:, row, k]
        asked = figures["started"] & (figures["burns"] == 0) & ~np.isnan(told_s)
        # Both beyond what was flown agree.
        flown_s = figures["planned_s"]
        both = asked & ((actual_s < np.inf) | (told_s < flown_s))
        with np.errstate(invalid="ignore"):
            off_s = np.where(both, np.abs(np.minimum(told_s, flown_s) - np.minimum(actual_s, flown_s)), np.nan)
        allowed_s = np.maximum(FORETOLD_SHARE * np.minimum(actual_s, flown_s), FORETOLD_S)
        missed = both & (off_s > allowed_s)
        found[when] = {
            "asked": int(both.sum()),
            "missed": int(missed.sum()),
            "median_off_s": number(quantile(off_s, 0.5)),
            "q95_off_s": number(quantile(off_s, 0.95)),
            "worst_off_s": number(quantile(off_s, 1.0)),
        }
    return found
