"""The part of `ground gnss study` beside gnss_lib_py: exact fault sets and time, on the same epochs.

gnss_lib_py's residual method (J. Blanch, T. Walter, P. Enge, ITM 2015) knows one clock and weights of one. So all
clocks agree here, as if biases between constellations were known to the millimetre, and our rule is also run with that
one clock: both know the same then. Its threshold is a number; it gets the chi-square quantile of each epoch's degrees
of freedom, times the best factor of a grid on epochs of their own.
"""

from __future__ import annotations

from pathlib import Path
from time import thread_time_ns
from typing import Any

import numpy as np

from flightsw.crosslink.thresholds import chi2_quantile
from flightsw.gnss.epoch import gnss_epoch
from flightsw.gnss.records import SATELLITES
from flightsw.gnss.setup import Memory
from ground.gnss.scene import SIGMA_M, Batch, User, add_faults, draw, exact, judge
from ground.gnss.study import CASES, RULES, of_rows, rate
from ground.peers.interpreter import ask

SCRIPT = "gnss_lib_py_fde.py"
FACTORS = (0.6, 0.8, 1.0, 1.3, 1.8)
_ALPHA, _CLOCK_UNKNOWNS = 1e-3, 4
_TUNING, _REPORTED = 10, 11  # branches of the random streams


def peers_part(seed: int, cases: int, python: Path) -> dict[str, Any]:
    """Exact sets of gnss_lib_py and of both our rules on the same epochs, and microseconds an epoch."""
    tuned = max(cases // 15, 10)
    shares = {
        factor: float(
            np.mean([_peer(_case(seed, _TUNING, k, tuned), python, factor)[0].mean() for k in range(len(CASES))])
        )
        for factor in FACTORS
    }
    best = max(FACTORS, key=lambda factor: shares[factor])
    found: dict[str, Any] = {"factor": best, "tuning": shares, "tuning_cases": tuned, "cases": []}
    for number, (mask, faults, size, _wanted) in enumerate(CASES):
        batch = _case(seed, _REPORTED, number, cases)
        trials = len(batch.epochs)
        theirs, seconds, found["version"] = _peer(batch, python, best)
        one_clock = _one_clock(batch)
        found["cases"].append(
            {
                "mask_deg": mask,
                "faults": faults,
                "sigmas": size,
                "gnss_lib_py": rate(int(theirs.sum()), trials),
                "gnss_lib_py_us": float(np.median(seconds) * 1e6),
                "raw": rate(int(exact(batch, judge(batch, RULES["raw"])).sum()), trials),
                "flight": rate(int(exact(batch, judge(batch, RULES["flight"])).sum()), trials),
                "flight_us": float(np.median(_seconds(batch)) * 1e6),
                "flight_one_clock": rate(int(exact(one_clock, judge(one_clock, RULES["flight"])).sum()), trials),
            }
        )
    return found


def _case(seed: int, branch: int, number: int, cases: int) -> Batch:
    """Epochs of a case whose clocks all agree, as many as have satellites enough."""
    mask, faults, size, _ = CASES[number]
    rng = np.random.default_rng([seed, branch, number])
    batch = draw(User(mask_deg=mask), rng, cases + cases // 10, bias_m=0.0)
    add_faults(batch, rng, faults, size * SIGMA_M)
    return of_rows(batch, np.flatnonzero(batch.count - 6 - faults >= 1)[:cases])


def _peer(batch: Batch, python: Path, factor: float) -> tuple[np.ndarray, np.ndarray, str]:
    """(m,) bool: exact sets; (m,) seconds; the version."""
    limit = np.array([chi2_quantile(_ALPHA, max(int(n) - _CLOCK_UNKNOWNS, 1)) for n in batch.count])
    answer = ask(
        python,
        SCRIPT,
        count=batch.count,
        range_m=batch.epochs["range_m"],
        r_m=batch.epochs["r_m"],
        threshold=factor * SIGMA_M**2 * limit,
        method=np.array("residual"),
        max_faults=np.array(RULES["raw"].faulty_max),
    )
    return (answer["excluded"] == batch.fault).all(axis=1), answer["seconds"], str(answer["version"])


def _one_clock(batch: Batch) -> Batch:
    """The same satellites as if they were of one constellation."""
    alone = of_rows(batch, np.arange(len(batch.epochs)))
    alone.epochs["constellation"] = 0
    alone.epochs["satellite"] = np.arange(SATELLITES) + 1
    return alone


def _seconds(batch: Batch) -> np.ndarray:
    """Processor time (m,) [s] of the flight rule by epoch, with Python's call."""
    memory = Memory(RULES["flight"])
    took = np.empty(len(batch.epochs))
    for k in range(len(took)):
        before = thread_time_ns()
        gnss_epoch(memory.table, batch.epochs[k : k + 1], memory.work, memory.result)
        took[k] = (thread_time_ns() - before) / 1e9
    return took
