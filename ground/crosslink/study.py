"""The parts of `ground crosslink study`, each a document; the Monte Carlo parts are campaigns that can be resumed."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.crosslink.declare import source_hash
from flightsw.crosslink.thresholds import chi2_tail
from ground.campaign import executor, store
from ground.campaign.seeds import tuning
from ground.campaign.statistics import lower_limit, upper_limit
from ground.crosslink import paper, ramps, special, tail, uploads
from ground.crosslink.scene import Setting, mean_neighbours, neighbours_of, ready

Advance = Callable[[int], None]
# ICAO Annex 10, volume I, as in the paper's table 1: operation, time to alert [s], integrity
REQUIREMENTS = (
    ("en route", 300.0, "1 - 1e-7 per hour"),
    ("en route, terminal", 15.0, "1 - 1e-7 per hour"),
    ("initial approach, NPA, departure", 10.0, "1 - 1e-7 per hour"),
    ("APV-I", 10.0, "1 - 2e-7 per approach"),
    ("APV-II", 6.0, "1 - 2e-7 per approach"),
    ("category I", 6.0, "1 - 2e-7 per approach"),
)
_TAIL_GEOMETRIES = 8


def paper_part(setting: Setting, seed: int) -> dict[str, Any]:
    """Threshold, neighbours and the printed tables against the scalar model."""
    memory, _ = ready(setting, 0.0)
    sets = paper.neighbour_sets(setting)
    return {
        "threshold_m": float(memory.table["majority_threshold_m"][0]),
        "neighbours_of_1": list(neighbours_of(setting, 0, 0.0)),
        "mean_neighbours": mean_neighbours(setting),
        "neighbour_sets_of_1": {" ".join(map(str, key)): count for key, count in sorted(sets.items())},
        "instants": sum(sets.values()),
        "tables": [
            asdict(paper.compare(table, setting, np.random.default_rng([seed, table.number])))
            for table in paper.printed()
        ],
    }


def uploads_part(
    folder: Path, setting: Setting, runs: int, seed: int, advance: Advance, **how: Any
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Healthy and faulty uploads, one epoch each; document and figures of all runs."""
    flight = uploads.Uploads(setting, tuning(seed))
    figures = _campaign(folder, flight, runs, advance, uploads.work, **how)
    healthy = int(figures["healthy"].sum())
    document: dict[str, Any] = {"runs": runs, "healthy": healthy, "p_false_alarm": setting.p_false_alarm, "false": {}}
    for name in ("majority", "own", "network"):
        count = int(figures[f"{name}_false"].sum())
        document["false"][name] = {
            "count": count,
            "rate": count / healthy,
            "lower": lower_limit(count, healthy),
            "upper": upper_limit(count, healthy),
        }
    document["link_beyond"] = int(figures["link_beyond"].sum())
    cases = []
    for index, case in enumerate(uploads.CASES):
        trials = int(figures["faulty"][:, index].sum())
        row: dict[str, Any] = {"case": case.name, "trials": trials}
        for name in ("majority", "named", "exact", "own_fault", "own_suspect"):
            count = int(figures[name][:, index].sum())
            row[name] = count / trials
            row[f"{name}_lower"] = _at_least(count, trials)
        row["worst_geometry"] = float((figures["exact"][:, index] / figures["faulty"][:, index]).min())
        cases.append(row)
    document["cases"] = cases
    four = figures["dof"] == 4
    document["own_statistic"] = _against_chi2(figures["own_histogram"][four].sum(axis=0))
    return document, figures


def _at_least(count: int, trials: int) -> float:
    """Lower 95 % limit of a share, by way of the fewer ones: exact limits take a term for each that is counted."""
    return lower_limit(count, trials) if 2 * count < trials else 1.0 - upper_limit(trials - count, trials)


def _against_chi2(histogram: np.ndarray) -> dict[str, float]:
    """Largest distance of a histogram of statistics from chi-square with four degrees of freedom, at bin edges."""
    n = int(histogram.sum())
    edges = uploads.BIN * np.arange(1, uploads.BINS)
    tail_of = 1.0 - np.cumsum(histogram)[:-1] / n
    expected = np.array([chi2_tail(float(edge), 4) for edge in edges])
    return {"samples": n, "distance": float(np.abs(tail_of - expected).max()), "expected": 1.63 / math.sqrt(n)}


def tail_part(setting: Setting, seed: int, samples: int = 4000) -> dict[str, Any]:
    """The rate of false alarms of the network test of one epoch, by importance sampling, in several geometries."""
    rng = np.random.default_rng(seed)
    rates = []
    for _ in range(_TAIL_GEOMETRIES):
        memory, _ = ready(setting, float(rng.uniform(0.0, 40_000.0)))
        found = tail.family_rate(memory, rng, samples)
        rates.append({"rate": found.rate, "error": found.error, "bound": found.bound})
    return {"geometries": rates, "largest": max(one["rate"] for one in rates), "claimed": setting.p_false_alarm}


def ramps_part(
    folder: Path, setting: Setting, runs: int, seed: int, advance: Advance, **how: Any
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Slow errors: times to detect of the three monitors, false findings and statistics before them."""
    flight = ramps.Ramps(setting, tuning(seed))
    figures = _campaign(folder, flight, runs, advance, ramps.work, **how)
    rows = []
    for index, case in enumerate(ramps.CASES):
        mine = figures["case"] == index
        row: dict[str, Any] = {"case": case.name, "runs": int(mine.sum())}
        for name in ("network_s", "own_s", "own_fault_s", "majority_s"):
            times = np.where(np.isnan(figures[name][mine]), np.inf, figures[name][mine])
            row[name] = [_finite(np.quantile(times, q, method="higher")) for q in (0.1, 0.5, 0.9)] if len(times) else []
        row["named_right"] = int(figures["named_right"][mine].sum())
        rows.append(row)
    tested = int(figures["slow_tested"].sum())
    return {
        "cases": rows,
        "quiet_epochs": runs * ramps.QUIET_S,
        "quiet_named": int(figures["quiet_named"].sum()),
        "quiet_own": int(figures["quiet_own"].sum()),
        "slow_tested": tested,
        "slow_beyond": {
            str(p): int(count) / max(tested, 1)
            for p, count in zip(ramps.CHECKED_TAILS, figures["slow_beyond"].sum(axis=0), strict=True)
        },
    }, figures


def special_part(setting: Setting, seed: int) -> dict[str, Any]:
    """What is weakest, what no range shows, what a whole plane does."""
    return special.cases(setting, seed)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _study_hash() -> str:
    """SHA-256 over what draws and counts."""
    folder = Path(__file__).resolve().parent
    names = ("judge.py", "ramps.py", "scene.py", "uploads.py")
    return hashlib.sha256(b"\0".join((folder / name).read_bytes() for name in names)).hexdigest()


def _campaign(
    folder: Path, flight: Any, runs: int, advance: Advance, work: executor.Work, **how: Any
) -> dict[str, np.ndarray]:
    what = {
        "format": "leonav crosslink campaign 1",
        "flight": repr(flight),
        "code_sha256": source_hash(),
        "study_sha256": _study_hash(),
    }
    store.open_folder(folder, what)
    return executor.complete(folder, flight, runs, advance, work=work, **how)
