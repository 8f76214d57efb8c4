"""The parts of `ground derivative study` on the paper's scenario, each a document; the runs can be resumed."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.derivative.declare import source_hash
from flightsw.derivative.setup import BankSettings, LagSettings
from ground.campaign import executor, store
from ground.derivative import paper, peers, scenario, tracks
from ground.derivative.conditioning import condition
from ground.derivative.tuning import CAUSAL_LIMITS, LAG_S, SMOOTHED_LIMITS

Advance = Callable[[int], None]
NAMES = scenario.Figures._fields


@dataclass(frozen=True)
class Estimators:
    """What flies every run; the same for all, picklable. Runs draw from a branch that depends on it."""

    seed: int
    bank: BankSettings = field(default_factory=BankSettings)
    lagged: LagSettings = field(default_factory=lambda: LagSettings(lag_s=LAG_S))


def positions(flight: Estimators, run: int) -> np.ndarray:
    """Positions (m,) [m] of a reported run."""
    true = scenario.truth()
    stream = scenario.reported_stream((flight.bank, flight.lagged), flight.seed, run)
    return np.asarray(true.y_m + scenario.errors(stream, len(true.t_s)))


def fly_run(flight: Estimators, run: int) -> dict[str, np.ndarray]:
    """Figures of one run, by estimator; how often errors are within two of their own sigmas."""
    true = scenario.truth()
    z = positions(flight, run)
    column, ones = z[:, None].copy(), np.ones((len(z), 1))
    causal = tracks.causal(flight.bank, true.t_s, column, ones)
    smoothed = tracks.smoothed(flight.lagged, true.t_s, column, ones)
    described = tracks.tuned(paper.described(), z)
    return {
        "causal": np.array(scenario.judge(causal.mean[:, 0])),
        "smoothed": np.array(scenario.judge(smoothed.mean[:, 0], LAG_S)),
        "paper": np.array(scenario.judge(described.mean)),
        "printed": np.array(scenario.judge(tracks.tuned(paper.printed(), z).mean)),
        "savitzky_golay": np.array(
            scenario.judge(peers.savitzky_golay(z, scenario.STEP_S, peers.best_half(flight.seed)), LAG_S)
        ),
        "paper_gain": described.gain,
        "within": np.array(
            [
                _within(track.mean[:, 0], track.sigma[:, 0], part, lag_s)
                for track, lag_s in ((causal, 0.0), (smoothed, LAG_S))
                for part in ("straight", "yawing")
            ]
        ),
    }


def _within(mean: np.ndarray, sigma: np.ndarray, part: str, lag_s: float) -> float:
    true = scenario.truth(lag_s)
    chosen = getattr(true, part)
    return float(np.mean(np.abs(mean[chosen, 1] - true.v_mps[chosen]) <= 2.0 * sigma[chosen, 1]))


def work(flight: Estimators, first: int, last: int) -> store.Arrays:
    """Figures of runs first to last, stacked."""
    return store.stacked(fly_run(flight, run) for run in range(first, last + 1))


def _code() -> str:
    folder = Path(__file__).resolve().parent
    names = ("paper.py", "peers.py", "scenario.py", "study.py", "tracks.py")
    return hashlib.sha256(b"\0".join((folder / name).read_bytes() for name in names)).hexdigest()


def scenario_part(
    folder: Path, flight: Estimators, runs: int, advance: Advance, peer_python: Path | None = None, **how: Any
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """All estimators on unseen runs: RMS pooled, of the worst run; verdicts against the limits."""
    what = {
        "format": "leonav derivative campaign 1",
        "flight": repr(flight),
        "code_sha256": source_hash(),
        "study_sha256": _code(),
    }
    store.open_folder(folder, what)
    figures = executor.complete(folder, flight, runs, advance, work=work, **how)
    document: dict[str, Any] = {"runs": runs, "estimators": {}, "pynumdiff": None}
    names = ["causal", "smoothed", "paper", "printed", "savitzky_golay"]
    if peer_python is not None:
        asked = peers.pynumdiff(peer_python, flight.seed, np.array([positions(flight, k) for k in range(runs)]))
        document["pynumdiff"] = {"version": asked.version, "parameters": asked.words}
        figures = {**figures, **asked.figures}
        names += asked.figures
    for name in names:
        pooled, worst = np.sqrt(np.mean(np.square(figures[name]), axis=0)), figures[name].max(axis=0)
        document["estimators"][name] = {
            "rms": _named(pooled),
            "worst_run": _named(worst),
        }
    document["paper_gain"] = np.median(figures["paper_gain"], axis=0).tolist()
    document["within_two_sigma"] = dict(
        zip(
            ("causal straight", "causal yawing", "smoothed straight", "smoothed yawing"),
            figures["within"].mean(axis=0).tolist(),
            strict=True,
        )
    )
    for name, limits in (("causal", CAUSAL_LIMITS), ("smoothed", SMOOTHED_LIMITS)):
        rms = document["estimators"][name]["rms"]
        document[f"{name}_limits"] = list(limits)
        document[f"{name}_met"] = all(rms[key] <= limit for key, limit in zip(NAMES, limits, strict=False))
    return document, figures


def _named(values: np.ndarray) -> dict[str, float | None]:
    return {
        name: float(value) if math.isfinite(value) else None for name, value in zip(NAMES, values.tolist(), strict=True)
    }


def paper_part(seed: int, runs: int) -> dict[str, Any]:
    """What the paper says of its own algorithm, recomputed: gains, their stability, the sweep, the literal argmin."""
    rows = paper.sweep(seed, runs)
    worst = [max(r["figures"][0] / paper.PRINTED_RMS[0], r["figures"][1] / paper.PRINTED_RMS[1]) for r in rows]
    best = rows[int(np.argmin(worst))]
    return {
        "runs": runs,
        "conditions": [condition(n, Fraction("0.2"))._asdict() for n in (2, 3, 4, 5, 10, 19, 20)],
        "sweep": rows,
        "best_of_both": best,
        "best_share": min(worst),
        "printed_gain": list(paper.PRINTED_GAIN),
        "printed_late": paper.printed_late(seed),
        "radius_si": paper.radius(paper.PRINTED_GAIN),
        "radius_normalised": paper.radius(paper.printed(True).gain),
        "literal_gain": paper.literal_gain(seed),
    }


def example(flight: Estimators) -> dict[str, np.ndarray]:
    """One more run, for the picture: true, causal and smoothed velocity and acceleration, weights of the models."""
    true = scenario.truth()
    stream = scenario.reported_stream((flight.bank, flight.lagged), flight.seed, 1 << 20)
    z = (true.y_m + scenario.errors(stream, len(true.t_s)))[:, None]
    ones = np.ones_like(z)
    causal = tracks.causal(flight.bank, true.t_s, z, ones)
    smoothed = tracks.smoothed(flight.lagged, true.t_s, z, ones)
    return {
        "t_s": true.t_s,
        "v_mps": true.v_mps,
        "causal": causal.mean[:, 0],
        "causal_sigma": causal.sigma[:, 0],
        "smoothed": smoothed.mean[:, 0],
        "weight": causal.weight,
    }
