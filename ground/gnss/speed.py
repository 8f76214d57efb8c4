"""What an epoch costs, by what is in it."""

from __future__ import annotations

import os
from dataclasses import replace
from time import thread_time_ns
from typing import Any

import numpy as np

from flightsw.gnss.epoch import gnss_epoch
from flightsw.gnss.records import SATELLITES, Rule
from flightsw.gnss.setup import Memory, Settings
from ground.gnss.scene import SIGMA_M, Batch, User, add_faults, draw, judge, of_epochs

_SATELLITES = 26
_EPOCHS = 400


def measure(seed: int, epochs: int = _EPOCHS) -> dict[str, Any]:
    """Microseconds of processor time an epoch, 26 satellites, cold start: least, median, 99 %; the machine's load."""
    found: dict[str, Any] = {"satellites": _SATELLITES}
    flight = Settings()
    for name, faults, settings in (
        ("solve and test", 0, flight),
        ("1 fault excluded", 1, flight),
        ("3 faults excluded", 3, flight),
        ("5 faults excluded", 5, flight),
        ("3 faults, the paper's rule", 3, replace(flight, rule=Rule.GREEDY, local_alpha=0.0)),
        ("protection levels too", 0, replace(flight, protect=True)),
    ):
        rng = np.random.default_rng([seed, 8])
        batch = _of_26(rng, epochs)
        add_faults(batch, rng, faults, 20.0 * SIGMA_M)
        judge(batch, settings)
        found[name] = _timed(batch, settings)
    found["64 satellites, all faulty"] = _timed(_wide(np.random.default_rng([seed, 9]), epochs), flight)
    found["load"] = os.getloadavg()[0]
    return found


def _of_26(rng: np.random.Generator, epochs: int) -> Batch:
    """Epochs of exactly 26 satellites."""
    parts: list[np.ndarray] = []
    while sum(len(part) for part in parts) < epochs:
        batch = draw(User(), rng, 1_000)
        parts.append(batch.epochs[batch.count == _SATELLITES])
    return of_epochs(np.concatenate(parts)[:epochs])


def _wide(rng: np.random.Generator, epochs: int) -> Batch:
    """Epochs of as many satellites as there is room for, noise of 200 sigmas: nothing agrees, the budget is spent."""
    batch = _of_26(rng, epochs)
    for name in ("r_m", "range_m", "sigma_m", "constellation"):
        batch.epochs[name] = batch.epochs[name][:, np.arange(SATELLITES) % _SATELLITES]
    batch.epochs["satellite"] = np.arange(SATELLITES)
    batch.epochs["count"] = SATELLITES
    batch.epochs["range_m"] += rng.normal(0.0, 200.0 * SIGMA_M, (epochs, SATELLITES))
    return batch


def _timed(batch: Batch, settings: Settings) -> dict[str, float]:
    memory = Memory(settings)
    took_us = np.empty(len(batch.epochs))
    for k in range(len(took_us)):
        one = batch.epochs[k : k + 1]
        before = thread_time_ns()
        gnss_epoch(memory.table, one, memory.work, memory.result)
        took_us[k] = (thread_time_ns() - before) / 1e3
    low, middle, high = np.quantile(took_us, (0.0, 0.5, 0.99))
    return {"least_us": float(low), "median_us": float(middle), "p99_us": float(high)}
