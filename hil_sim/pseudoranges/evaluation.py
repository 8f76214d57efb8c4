"""What a run showed of the consistency test: its verdicts on the bus against the satellite faults of the scenario."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.enums import GnssVerdict
from hil_sim.pseudorange_schema import SYSTEMS
from hil_sim.pseudoranges.receiver import RawSeries
from hil_sim.scenario_schema import Scenario

_NS = 1e9
_LETTERS = "GREC"  # of SYSTEMS, as in RINEX


def truth_arrays(scenario: Scenario, raw: RawSeries | None) -> dict[str, np.ndarray]:
    """Satellite faults (k,) of the run: from when to when [s], masks (k,4) of whom they strike by constellation.

    Nothing for a run without pseudoranges.
    """
    if raw is None:
        return {}
    masks = np.zeros((len(scenario.satellite_fault), len(SYSTEMS)), np.uint64)
    for k, hit in enumerate(raw.struck):
        for system, number in zip(raw.system[hit].tolist(), raw.number[hit].tolist(), strict=True):
            masks[k, system] |= np.uint64(1 << number - 1)
    return {
        "gnss_fault_mask": masks,
        "gnss_fault_kind": np.array([fault.kind for fault in scenario.satellite_fault], dtype="U24"),
        "gnss_fault_start_s": np.array([fault.start_s for fault in scenario.satellite_fault]),
        "gnss_fault_end_s": np.array([fault.start_s + fault.duration_s for fault in scenario.satellite_fault]),
    }


def evaluate_run(folder: Path) -> dict[str, Any] | None:
    """`evaluate` on the files of a run folder; None for a run without pseudoranges."""
    with np.load(folder / "truth.npz") as truth, np.load(folder / "monitor.npz") as monitor:
        if "gnss_fault_mask" not in truth:
            return None
        return evaluate({k: truth[k] for k in truth}, {k: monitor[k] for k in monitor if k.startswith("gnss_")})


def evaluate(truth: Mapping[str, np.ndarray], monitor: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Epochs judged, fixes made of them, verdicts, satellites in a fix; epochs that lost a healthy satellite.

    Of every fault: satellites, epochs in which it lasted, in how many of them exactly its satellites were named (with
    those of other faults at the time), and when first, in seconds after its start; None: never. Times are by the
    receiver's clock, a few microseconds from true.
    """
    if "gnss_check" not in monitor:
        return {"epochs": 0, "fixes": 0, "verdicts": {}, "satellites": None, "in_vain": 0, "faults": []}
    check, named = monitor["gnss_check"], monitor["gnss_excluded"]
    _, a, b = np.intersect1d(check["t_gps_ns"], named["t_gps_ns"], return_indices=True)
    check = check[a]
    out = np.stack([named[system][b] for system in SYSTEMS], axis=1).astype(np.uint64)
    t_s = (check["t_gps_ns"] - int(truth["t_true_gps_ns"][0])) / _NS
    lasting = np.array(
        [
            (t_s >= start_s) & (t_s < end_s)
            for start_s, end_s in zip(truth["gnss_fault_start_s"], truth["gnss_fault_end_s"], strict=True)
        ]
    ).reshape(-1, len(t_s))
    wrong = np.zeros_like(out)
    for mask, when in zip(truth["gnss_fault_mask"], lasting, strict=True):
        wrong |= np.where(when[:, None], mask, np.uint64(0))
    exact = (out == wrong).all(axis=1)
    fixes = check["offered"].astype(bool)
    faults = []
    for k, when in enumerate(lasting):
        found = t_s[when & exact]
        faults.append(
            {
                "kind": str(truth["gnss_fault_kind"][k]),
                "satellites": _names(truth["gnss_fault_mask"][k]),
                "start_s": float(truth["gnss_fault_start_s"][k]),
                "epochs": int(when.sum()),
                "named": int((when & exact).sum()),
                "named_after_s": round(float(found[0] - truth["gnss_fault_start_s"][k]), 1) if len(found) else None,
            }
        )
    verdicts = {verdict.name: int((check["gnss_verdict"] == verdict).sum()) for verdict in GnssVerdict}
    return {
        "epochs": len(check),
        "fixes": int(fixes.sum()),
        "verdicts": {name: count for name, count in verdicts.items() if count},
        "satellites": round(float(check["used"][fixes].mean()), 1) if fixes.any() else None,
        "in_vain": int((out & ~wrong).any(axis=1).sum()),
        "faults": faults,
    }


def _names(mask: np.ndarray) -> list[str]:
    return [
        f"{_LETTERS[system]}{bit + 1:02d}"
        for system in range(len(SYSTEMS))
        for bit in range(64)
        if int(mask[system]) >> bit & 1
    ]
