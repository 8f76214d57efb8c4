"""What a run showed of the inter-satellite monitor: its verdicts on the bus against the faults of the scenario."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.enums import CrosslinkState

_NS = 1e9


def evaluate_run(folder: Path) -> dict[str, Any] | None:
    """`evaluate` on the files of a run folder; None for a run without crosslinks."""
    with np.load(folder / "truth.npz") as truth, np.load(folder / "monitor.npz") as monitor:
        if "crosslink_own" not in truth:
            return None
        return evaluate({k: truth[k] for k in truth}, {k: monitor[k] for k in monitor})


def evaluate(truth: Mapping[str, np.ndarray], monitor: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Epochs judged, whom flight named in vain, and of every fault when it was named.

    Times are seconds of true GPS time after the start, taken at the tick whose frame said so; satellites count from 1.
    real_day: on a day of real messages whom it named, when, and by how much those were wrong.
    named_s: all satellites of the fault are excluded, the own one where it is called wrong; None: never.
    """
    own, zero_ns = int(truth["crosslink_own"]), int(truth["t_true_gps_ns"][0])
    told = monitor.get("crosslink")
    if told is None:
        told, rows = np.zeros(0, [("t_gps_ns", "i8"), ("faulty", "u4"), ("named", "u4"), ("own_state", "u1")]), []
    else:
        rows = np.minimum(monitor["crosslink_row"], len(monitor["tick"]) - 1)
    place = np.searchsorted(truth["tick"], monitor["tick"][rows] if len(rows) else [])
    said_s = (truth["t_true_gps_ns"][place] - zero_ns) / _NS
    epoch_s = (told["t_gps_ns"] - zero_ns) / _NS
    held = told["faulty"].astype(np.int64) | ((told["own_state"] == CrosslinkState.FAULT).astype(np.int64) << own)
    fresh = np.diff(told["t_gps_ns"], prepend=-1) != 0
    faults = [_fault(truth, index, said_s, epoch_s, held) for index in range(len(truth["crosslink_fault_mask"]))]
    wrong = np.zeros(len(held), np.int64)
    for mask, start_s, end_s in zip(
        *(truth[f"crosslink_fault_{name}"] for name in ("mask", "start_s", "end_s")), strict=True
    ):
        wrong |= np.where((epoch_s >= start_s) & (epoch_s < end_s), int(mask), 0)
    in_vain = told["named"].astype(np.int64) & ~wrong & np.where(fresh, -1, 0)
    if "crosslink_error_m" in truth:  # of a real day: whether it was in vain the true error tells, not the scenario
        real = {"real_day": [one for k in np.flatnonzero(in_vain) for one in _named(truth, int(in_vain[k]), said_s[k])]}
        in_vain = np.zeros_like(in_vain)
    else:
        real = {}
    return {
        "own": own + 1,
        "epochs": int(np.count_nonzero(fresh & (told["t_gps_ns"] > 0))),
        "faults": faults,
        **real,
        "named_in_vain": sorted({bit + 1 for mask in in_vain for bit in range(32) if int(mask) >> bit & 1}),
    }


def _named(truth: Mapping[str, np.ndarray], mask: int, said_s: float) -> list[dict[str, Any]]:
    """Satellites of a mask, with the true error of what they broadcast when they were named."""
    row = min(int(np.searchsorted(truth["crosslink_error_t_s"], said_s)), len(truth["crosslink_error_t_s"]) - 1)
    return [
        {
            "satellite": bit + 1,
            "named_s": round(float(said_s), 3),
            "error_m": round(float(truth["crosslink_error_m"][row, bit]), 3),
        }
        for bit in range(32)
        if mask >> bit & 1
    ]


def _fault(
    truth: Mapping[str, np.ndarray], index: int, said_s: np.ndarray, epoch_s: np.ndarray, held: np.ndarray
) -> dict[str, Any]:
    mask, start_s, end_s = (truth[f"crosslink_fault_{name}"][index].item() for name in ("mask", "start_s", "end_s"))
    jump_m, ramp_mps = truth["crosslink_fault_jump_m"][index], truth["crosslink_fault_ramp_mps"][index]
    found = np.flatnonzero((epoch_s >= start_s) & (epoch_s < end_s) & (held & mask == mask))
    gone = np.flatnonzero((epoch_s >= end_s) & (held & mask == 0))
    named = int(found[0]) if len(found) else None
    size_m = None if named is None else float(np.linalg.norm(jump_m + (epoch_s[named] - start_s) * ramp_mps))
    return {
        "satellites": [bit + 1 for bit in range(32) if mask >> bit & 1],
        "start_s": round(start_s, 3),
        "jump_m": round(float(np.linalg.norm(jump_m)), 3),
        "ramp_mps": round(float(np.linalg.norm(ramp_mps)), 6),
        "named_s": None if named is None else round(float(said_s[named]) - start_s, 3),
        "size_when_named_m": None if size_m is None else round(size_m, 3),
        "taken_in_again_s": round(float(said_s[gone[0]]) - end_s, 3) if len(gone) and named is not None else None,
    }
