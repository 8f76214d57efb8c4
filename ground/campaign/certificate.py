"""What a flown ensemble proves: violations with exact limits, tightness, time to flag, coverage; what was wanted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ground.campaign.cells import CELLS
from ground.campaign.ensemble import EARTH_RADIUS_KM, Ensemble
from ground.campaign.floor import MU_M3PS2, floor
from ground.campaign.outage import LIMITS_M, Arrays, ages_s
from ground.campaign.statistics import quantile, tightness, upper_limit

AGE_BINS_S = ((0, 60), (60, 200), (200, 600), (600, 1200), (1200, 2001), (2001, 7200), (7200, 28_800), (28_800, 86_401))
JUDGED_S = (60, 2001)  # ages whose tightness is judged
SETTLED_S = 5000.0  # of fixes, about a revolution
FINE_M = 2.0  # position sigma below which fixes are called fine
FULL_RUNS, FULL_CELL_RUNS = 12_000, 1000
POOLED_LIMIT, CELL_LIMIT = 0.003, 0.01
MEAN_TIGHTNESS, WORST_TIGHTNESS, FLAG_SHARE = 1.5, 2.0, 0.70


class Target(NamedTuple):
    """A line of what is wanted: met None where it could not be judged.

    integrity: whether the bound held as often as it must, without which nothing is certified. The others say how useful
    a bound is that holds: how close to the error, how early the flag, how well foretold.
    """

    what: str
    wanted: str
    measured: str
    met: bool | None
    integrity: bool = False


def grade_of(ensemble: Ensemble, counts: Sequence[int], quick: bool) -> str:
    """ "full" for an ensemble large enough in every cell, all of which it has; else "quick"."""
    whole = len(ensemble.cells) == len(CELLS) and sum(counts) >= FULL_RUNS and min(counts) >= FULL_CELL_RUNS
    return "full" if whole and not quick else "quick"


def summarise(ensemble: Ensemble, figures: Arrays) -> dict[str, Any]:
    """All numbers of the certificate from the figures of all runs. Plain numbers, None for what is not known."""
    cells = [
        _group(ensemble, figures, figures["cell"] == cell) | {"cell": CELLS[cell].label} for cell in ensemble.cells
    ]
    pooled = _group(ensemble, figures, np.ones(len(figures["run"]), bool))
    altitude_km = float(np.median(figures["perigee_km"]))
    lowest = floor(round(altitude_km, -2), min(ensemble.outage_s[1], 2000.0))
    bins = [b for b in AGE_BINS_S if b[0] < ensemble.outage_s[1]]
    return {
        "runs": len(figures["run"]),
        "days": len(np.unique(figures["day"])),
        "pooled": pooled,
        "cells": cells,
        "floor": {"k": lowest.k, "tightness": {bin_name(b): number(lowest.over(*b)) for b in bins}},
        "integrated": _integrated(figures),
        "second_outages": {
            "flown": int(figures["second_outage"].sum()),
            "violated": int(figures["second_violated"].sum()),
            "worst_ratio": number(_max(figures["second_ratio"])),
        },
        "returns": {"worst_ratio": number(_max(figures["return_ratio"]))},
        "with_burns": violations(figures, figures["burns"] > 0),
        "fixes": _by_fixes(figures),
        "nees_before": {
            "median": number(quantile(figures["nees_before"], 0.5)),
            "q95": number(quantile(figures["nees_before"], 0.95)),
            "expected": 6,
        },
        "coverage": coverage(ensemble, figures),
    }


def _group(ensemble: Ensemble, figures: Arrays, rows: np.ndarray) -> dict[str, Any]:
    ages = ages_s(ensemble.outage_s[1])
    started = rows & figures["started"]
    axis_m = np.abs(figures["error_m"][started]).max(axis=2)
    ratio = axis_m / figures["bound_m"][started]
    found = violations(figures, rows) | {
        "worst_ratio": number(_max(figures["worst_ratio"][started])),
        "worst_3d_ratio": number(_max(figures["worst_3d_ratio"][started])),
        "violated_3d": int((figures["worst_3d_ratio"][started] > 1.0).sum()),
        "epochs": int(figures["epochs"][started].sum()),
        "misleading_epochs": int(figures["broken_epochs"][started].sum()),
        "tightness": {},
        "error_q997_m": {},
        "bound_median_m": {},
    }
    for b in AGE_BINS_S:
        inside = (ages >= b[0]) & (ages < b[1])
        if inside.any():
            found["tightness"][bin_name(b)] = number(tightness(ratio[:, inside]))
            found["error_q997_m"][bin_name(b)] = number(quantile(axis_m[:, inside]))
            found["bound_median_m"][bin_name(b)] = number(quantile(figures["bound_m"][started][:, inside], 0.5))
    found["limits"] = {f"{limit:g}": _flagging(figures, started, axis_m, ages, k) for k, limit in enumerate(LIMITS_M)}
    return found


def violations(figures: Arrays, rows: np.ndarray, counted: str = "violated") -> dict[str, Any]:
    """Outages with a broken bound and the limit of their rate; counted: to the end, or `violated_before_flag`."""
    started = rows & figures["started"]
    trials = int(started.sum())
    failures = int(figures[counted][started].sum())
    return {
        "outages": trials,
        "not_started": int((rows & ~figures["started"]).sum()),
        "violated": failures,
        "violated_to_the_end": int(figures["violated"][started].sum()),
        "violated_before_flag": int(figures["violated_before_flag"][started].sum()),
        "upper_limit_95": upper_limit(failures, trials) if trials else 1.0,
    }


def _flagging(figures: Arrays, started: np.ndarray, axis_m: np.ndarray, ages: np.ndarray, k: int) -> dict[str, Any]:
    """How a flag at a limit would have served: late is hazardous, early costs availability."""
    by_error, by_bound = figures["crossing_error_s"][started, k], figures["crossing_bound_s"][started, k]
    hazardous = int((by_error < np.nan_to_num(by_bound, nan=np.inf)).sum())
    trials = int(started.sum())
    # The age at which 0.3 % of the outages are beyond the limit, and when half of them have raised the flag. Of those
    # after a revolution of fixes: the worst errors follow a minute of fixes, the median bound does not.
    settled = figures["acquisition_s"][started] >= SETTLED_S
    count = int(settled.sum())
    beyond = np.array([count > 0 and quantile(axis_m[settled, j]) > LIMITS_M[k] for j in range(len(ages))], bool)
    t_s = float(ages[np.argmax(beyond)]) if beyond.any() else math.nan
    t_flag_s = float(np.sort(np.nan_to_num(by_bound[settled], nan=np.inf))[(count - 1) // 2]) if count else math.nan
    lead = (by_error - by_bound)[(by_error > by_bound)]
    return {
        "hazardous": hazardous,
        "hazardous_upper_limit_95": upper_limit(hazardous, trials) if trials else 1.0,
        "flags": int(np.isfinite(by_bound).sum()),
        "early_flags": int((np.isfinite(by_bound) & ~(by_error <= by_bound)).sum()),
        "early_lead_median_s": number(float(np.median(lead)) if len(lead) else math.nan),
        "t_s": number(t_s),
        "t_flag_median_s": number(t_flag_s),
        "t_flag_over_t": number(t_flag_s / t_s),
    }


def _integrated(figures: Arrays) -> dict[str, Any]:
    """INTEGRATED mode: runs that broke the bound there, once each, per revolution flown."""
    orbits = float(figures["orbits"].sum())
    failures = int((figures["integrated_broken"] > 0).sum())
    trials = max(int(orbits), failures, 1)
    return {
        "orbits": orbits,
        "violated": failures,
        "upper_limit_95": upper_limit(failures, trials),
        "worst_ratio": number(_max(figures["integrated_ratio"])),
    }


def _by_fixes(figures: Arrays) -> list[dict[str, Any]]:
    """Violations by what receivers give: velocity or none, fine positions or coarse ones."""
    alone, fine = figures["positions_alone"] > 0, figures["sigma_position_m"] < FINE_M
    found = []
    for kind, with_kind in (("with velocity", ~alone), ("positions alone", alone)):
        for size, with_size in ((f"below {FINE_M:g} m", fine), (f"{FINE_M:g} m and more", ~fine)):
            rows = with_kind & with_size
            if rows.any():
                of_kind = {name: values[rows] for name, values in figures.items()}
                found.append(
                    {"kind": f"{kind}, {size}", "integrated": _integrated(of_kind)}
                    | violations(figures, rows)
                    | {"worst_ratio": number(_max(figures["worst_ratio"][rows & figures["started"]]))}
                )
    return found


def coverage(ensemble: Ensemble, figures: Arrays) -> dict[str, Any]:
    """How many outages lie in each bin of phase, age, altitude and activity; bins without any are named."""
    axis_km = (EARTH_RADIUS_KM + figures["perigee_km"]) / (1.0 - figures["eccentricity"])
    period_s = 2.0 * np.pi * np.sqrt((1e3 * axis_km) ** 3 / MU_M3PS2)
    phase = (figures["argument_of_latitude_deg"] + 360.0 * figures["acquisition_s"] / period_s) % 360.0
    lows, highs = zip(*(CELLS[cell].altitude_km for cell in ensemble.cells), strict=True)
    edges: dict[str, tuple[np.ndarray, np.ndarray]] = {
        "phase at loss [deg]": (phase, np.arange(0.0, 361.0, 30.0)),
        "longest age [s]": (figures["outage_s"], np.array([0.0, 600.0, 2000.0, 2001.0, 7200.0, 86_401.0])),
        "perigee altitude [km]": (figures["perigee_km"], np.linspace(min(lows), max(highs), 15)),
        "F10.7 [sfu]": (figures["f107"], np.array([60.0, 70, 85, 100, 130, 170, 200, 250, 501])),
        "ap": (figures["ap"], np.array([0.0, 4, 8, 15, 30, 50, 100, 401])),
        "fixes before [s]": (figures["acquisition_s"], np.array([0.0, 61, 301, 601, 1801, 7200, 20_000])),
        "sigma of fixes [m]": (figures["sigma_position_m"], np.array([0.0, 1, 2, 4, 8, 15, 1000])),
    }
    found: dict[str, Any] = {}
    for name, (values, bounds) in edges.items():
        counts = np.histogram(values, bounds)[0].tolist()
        words = [f"{low:g}-{high:g}" for low, high in pairwise(bounds.tolist())]
        found[name] = {
            "counts": dict(zip(words, counts, strict=True)),
            "empty": [word for word, count in zip(words, counts, strict=True) if count == 0],
        }
    return found


def envelope(ensemble: Ensemble, figures: Arrays) -> dict[str, Any]:
    """Within what this holds: flight says NOT CERTIFIED beyond."""
    altitudes = [CELLS[cell].altitude_km for cell in ensemble.cells]
    return {
        "perigee_altitude_km": [min(low for low, _ in altitudes), max(high for _, high in altitudes)],
        "apogee_altitude_km": ensemble.apogee_km,
        "eccentricity": list(ensemble.eccentricity),
        "inclination_deg": list(ensemble.inclination_deg),
        "age_s": ensemble.outage_s[1],
        "f107_sfu": [float(figures["f107"].min()), float(figures["f107"].max())],
        "ap": [float(figures["ap"].min()), float(figures["ap"].max())],
        "space_weather": "of the day",
        "area_to_mass_m2pkg": list(ensemble.area_to_mass_m2pkg),
        "area_step": list(ensemble.area_step),
        "noise": ensemble.noise,
        "sigma_position_m": list(ensemble.sigma_position_m),
        "sigma_velocity_mps": [ensemble.velocity_to_position_ps * s for s in ensemble.sigma_position_m],
        "positions_alone": ensemble.positions_alone_share > 0.0,
        "coloured_sigma_m": list(ensemble.coloured_sigma_m) if ensemble.noise == "coloured" else [0.0, 0.0],
        "periodic_sigma_m": list(ensemble.periodic_sigma_m) if ensemble.noise == "coloured" else [0.0, 0.0],
        "fixes_before_s": float((figures["acquisition_s"] - figures["start_s"]).min()),
        "second_outage_after_s": ensemble.second_gap_s[0] if ensemble.second_share > 0.0 else None,
        "announced_burns_mps": list(ensemble.burn_dv_mps) if ensemble.burn_share > 0.0 else [0.0, 0.0],
    }


def judge(summary: dict[str, Any]) -> list[Target]:
    """What was wanted of the flight filter, and whether it was reached."""
    pooled, cells, integrated = summary["pooled"], summary["cells"], summary["integrated"]
    lines = [
        rare("violated outages, all cells, 95 % limit", POOLED_LIMIT, pooled["upper_limit_95"]),
        *(rare(f"violated, {c['cell']}", CELL_LIMIT, c["upper_limit_95"]) for c in cells),
        rare("violations in INTEGRATED mode per orbit, 95 % limit", POOLED_LIMIT, integrated["upper_limit_95"]),
    ]
    for limit, flagging in pooled["limits"].items():
        lines.append(
            rare(f"hazardous at {limit} m, all cells, 95 % limit", POOLED_LIMIT, flagging["hazardous_upper_limit_95"])
        )
    for cell in cells:
        judged = [
            value
            for b, value in ((b, cell["tightness"].get(bin_name(b))) for b in AGE_BINS_S)
            if value is not None and b[0] >= JUDGED_S[0] and b[1] <= JUDGED_S[1]
        ]
        mean, worst = (sum(judged) / len(judged), max(judged)) if judged else (math.nan, math.nan)
        lines.append(below(f"mean tightness, {cell['cell']}", MEAN_TIGHTNESS, mean))
        lines.append(below(f"worst tightness, {cell['cell']}", WORST_TIGHTNESS, worst))
        for limit, flagging in cell["limits"].items():
            share = flagging["t_flag_over_t"]
            name = f"median T_flag / T at {limit} m, {cell['cell']}"
            met = None if share is None else share >= FLAG_SHARE
            lines.append(Target(name, f">= {FLAG_SHARE:g}", "not reached" if share is None else f"{share:.2f}", met))
    return lines


def below(what: str, wanted: float, measured: float) -> Target:
    """A line of what may not exceed what is wanted."""
    if math.isnan(measured):
        return Target(what, f"<= {wanted:g}", "none", None)
    return Target(what, f"<= {wanted:g}", f"{measured:.4g}", measured <= wanted)


def rare(what: str, wanted: float, measured: float) -> Target:
    """A line of integrity: a rate that may not exceed what is wanted."""
    return below(what, wanted, measured)._replace(integrity=True)


def unproven(targets: Sequence[Target]) -> list[str]:
    """Lines of integrity that were not reached or not judged: with one of them nothing is certified."""
    return [line.what for line in targets if line.integrity and not line.met]


def bin_name(ages: tuple[int, int]) -> str:
    """`60-200`."""
    return f"{ages[0]}-{ages[1] // 10 * 10}"


def _max(values: np.ndarray) -> float:
    return float(np.nanmax(values)) if np.any(~np.isnan(values)) else math.nan


def number(value: float) -> float | None:
    """For JSON, which knows neither NaN nor infinity."""
    return float(value) if math.isfinite(value) else None
