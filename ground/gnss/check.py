"""`ground gnss check`: the flight test on the pseudoranges of a real receiver, with injected faults if wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.gnss.records import SATELLITES, Verdict
from flightsw.gnss.setup import Settings
from ground.errors import OperatorError
from ground.gnss.ephemeris import Orbits, Precise
from ground.gnss.files import Ready, prepare
from ground.gnss.rinex import Observed
from ground.gnss.scene import excluded, judge, of_epochs
from ground.gnss.study import rate

EVERY_FAULT_M = (15.0, 200.0)
_SYSTEMS = ("GPS", "GLONASS", "Galileo")


@dataclass(frozen=True)
class Checked:
    """Results (m,) of the epochs of a file, and what they were made from."""

    ready: Ready
    result: np.ndarray
    observed: Observed


def check(observed: Observed, orbits: Orbits, settings: Settings) -> Checked:
    """Two passes: a first fix without delays, whose median says where the delays are to be computed."""
    place = observed.place_m
    if place is None:
        first = judge(of_epochs(prepare(observed, orbits, np.array([6.4e6, 0.0, 0.0])).epochs), settings)
        good = first["verdict"] <= Verdict.INCONSISTENT
        if not good.any():
            raise OperatorError("no epoch has a fix, and the header no position")
        place = np.median(first["r_m"][good], axis=0)
    ready = prepare(observed, orbits, place)
    return Checked(ready, judge(of_epochs(ready.epochs), settings), observed)


def describe(checked: Checked, reference_m: np.ndarray | None) -> dict[str, Any]:
    """Verdicts, errors against a reference, biases between systems, what was left out."""
    result = checked.result
    names = np.array([*checked.observed.names, ""])[checked.ready.name]
    passed = result["verdict"] <= Verdict.EXCLUDED
    out = excluded(result)
    left_out = [name for row, mask in zip(names, out, strict=True) for name in row[mask]]
    document: dict[str, Any] = {
        "epochs": len(result),
        "verdicts": {v.name: int((result["verdict"] == v).sum()) for v in Verdict if (result["verdict"] == v).any()},
        "satellites": float(result["used"].mean()),
        "first_consistent": rate(int((result["first_statistic"] <= _threshold(result)).sum()), len(result)),
        "statistic_per_dof": float(np.nanmedian(result["first_statistic"] / np.maximum(result["first_dof"], 1))),
        "excluded": {name: left_out.count(name) for name in sorted(set(left_out))},
        "rows_excluded": len(left_out),
        "rows": int(result["usable"].sum()),
        "lone": int((result["lone"] != 0).sum()),
        "biases_m": {
            _SYSTEMS[j]: [float(np.nanmedian(bias)), float(np.nanstd(bias))]
            for j in (1, 2)
            if np.isfinite(bias := (result["clock_m"][passed, j] - result["clock_m"][passed, 0])).any()
        },
        "protection_m": np.median(result["protection_m"][passed], axis=0).tolist() if passed.any() else None,
        "available": rate(int((result["available"] * passed).sum()), len(result)),
    }
    document["residual_rms_m"] = {
        system: float(np.sqrt(np.nanmean(result["residual_m"][(np.char.startswith(names, system)) & ~out] ** 2)))
        for system in "GRE"
        if np.char.startswith(names, system).any()
    }
    if reference_m is not None and passed.any():
        error = np.einsum("mqk,mk->mq", result["axes"], result["r_m"] - reference_m)[passed]
        document["enu_mean_m"], document["enu_std_m"] = error.mean(axis=0).tolist(), error.std(axis=0).tolist()
        document["horizontal_mean_m"] = float(np.hypot(*error[:, :2].mean(axis=0)))
    return document


def _threshold(result: np.ndarray) -> np.ndarray:
    from flightsw.gnss.setup import thresholds

    return np.array(thresholds(Settings()))[np.maximum(result["first_dof"], 0)]


def inject(checked: Checked, settings: Settings, seed: int, trials: int) -> list[dict[str, Any]]:
    """1 to 3 faults of 15 to 200 m on random satellites of real epochs: how many are found, what else is left out."""
    clean_rows = np.flatnonzero(checked.result["verdict"] <= Verdict.AMBIGUOUS)
    if not len(clean_rows):
        raise OperatorError("no epoch is consistent: nothing to inject faults into")
    found = []
    for faults in (1, 2, 3):
        rng = np.random.default_rng([seed, faults])
        rows = rng.choice(clean_rows, trials)
        batch = of_epochs(checked.ready.epochs[rows].copy())
        already = excluded(checked.result[rows])
        present = (np.arange(SATELLITES) < batch.count[:, None]) & ~already
        order = np.argsort(np.where(present, rng.random(present.shape), 2.0), axis=1)[:, :faults]
        size = rng.uniform(*EVERY_FAULT_M, order.shape)
        at = np.arange(trials)[:, None]
        batch.epochs["range_m"][at, order] += rng.choice((-1.0, 1.0), order.shape) * size
        batch.fault[at, order] = True
        result = judge(batch, settings)
        out = excluded(result)
        fixed = result["verdict"] <= Verdict.AMBIGUOUS
        removed = fixed & (out | ~batch.fault).all(axis=1)
        wrong = out & ~batch.fault & ~already
        moved = np.linalg.norm(result["r_m"] - checked.result["r_m"][rows], axis=1)
        missed_m = size[(batch.fault & ~out)[at, order]]
        found.append(
            {
                "faults": faults,
                "removed": rate(int(removed.sum()), trials),
                "each_removed": rate(int((batch.fault & out & fixed[:, None]).sum()), int(batch.fault.sum())),
                "wrong_sets": rate(int((fixed & wrong.any(axis=1)).sum()), trials),
                "wrong_satellites": int(wrong[fixed].sum()),
                "ambiguous": int((result["verdict"] == Verdict.AMBIGUOUS).sum()),
                "no_answer": int((~fixed).sum()),
                "largest_missed_m": float(missed_m.max()) if len(missed_m) else 0.0,
                "moved_m": float(np.quantile(moved[fixed], 0.99)),
                "sizes_m": size.round(1).ravel().tolist(),
                "found": (batch.fault & out & fixed[:, None])[at, order].ravel().tolist(),
            }
        )
    return found


def load(path: Path, sp3: Path | None, nav: Sequence[Path] = ()) -> tuple[Observed, Orbits]:
    """The files of a check: precise orbits, or broadcast ones. Raises OperatorError naming the file."""
    from ground.gnss.broadcast import Broadcast
    from ground.gnss.rinex import read_observed

    if (sp3 is None) == (not nav):
        raise OperatorError("name either precise orbits with --sp3 or broadcast ones with --nav")
    for file in (path, *([] if sp3 is None else [sp3]), *nav):
        if not file.is_file():
            raise OperatorError(f"{file}: there is no such file")
    orbits: Orbits = Broadcast(nav) if sp3 is None else Precise(sp3)
    return read_observed(path), orbits
