"""A run folder as the reports see it: what was published beside what was true, on one time axis.

Reads `truth.npz` (the world's record) and `monitor.npz` (what the other onboard systems received on the
bus), aligned by tick number. Nothing here needs the flight code.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from flightsw.icd.enums import FlagState, Mode, Validity
from ground.errors import OperatorError

NS_PER_S = 1e9


class NotARun(OperatorError):
    """The folder does not hold a run; the text names the file and the remedy."""


@dataclass(frozen=True)
class Outage:
    """One GNSS outage of the run, in seconds since the first tick (true time).

    `last_fix_s` is the instant of the last accepted fix, from which every age is counted. `flag_s` (the flag
    not CLEAR) and `crossed_s` (error above the limit) are None when that did not happen between then and the
    first fix accepted again.
    """

    start_s: float
    end_s: float
    last_fix_s: float
    flag_s: float | None
    crossed_s: float | None
    back_in_service_s: float | None


@dataclass(frozen=True)
class Run:
    """Arrays over n ticks that both the world and the monitor recorded; NaN where nothing was published.

    Shapes: `t_s` (n,), `r_truth_gcrf_m` (n, 3), `error_gcrf_m` (n, 3) published minus true, `error_m` (n,)
    largest axis, `bound_m` (n,), `limit_m` (n,), `mode` and `flag` (n,) integers. `da_t_s`, `da_true_mps2`
    and `da_estimate_t_s`, `da_estimate_mps2` are the acceleration the onboard gravity lacks; the estimate
    is None when the run did not write it.
    """

    folder: Path
    summary: dict[str, Any]
    t_s: np.ndarray
    r_truth_gcrf_m: np.ndarray
    error_gcrf_m: np.ndarray
    error_m: np.ndarray
    bound_m: np.ndarray
    limit_m: np.ndarray
    mode: np.ndarray
    flag: np.ndarray
    fix_error_m: np.ndarray
    da_t_s: np.ndarray
    da_true_mps2: np.ndarray
    da_estimate_t_s: np.ndarray | None
    da_estimate_mps2: np.ndarray | None
    outages: tuple[Outage, ...]

    @property
    def scenario(self) -> str:
        """Name of the scenario, or of the folder when there is no summary."""
        return str(self.summary.get("scenario", self.folder.name))

    @property
    def limit_typical_m(self) -> float:
        """The limit in force for most of the run [m]; NaN when none was ever published."""
        finite = self.limit_m[np.isfinite(self.limit_m)]
        return float(np.median(finite)) if finite.size else float("nan")


def read_summary(folder: Path) -> dict[str, Any]:
    """`summary.json` of a run; raises NotARun with a reason when it is absent or not a JSON object."""
    path = folder / "summary.json"
    if not folder.is_dir():
        raise NotARun(f"{folder}: no such folder; give a run folder, for example runs/paper_outage")
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise NotARun(f"{folder}: not a run: no summary.json in it; make one with `hil_sim run`") from None
    except (OSError, ValueError) as error:
        raise NotARun(f"{path}: unreadable ({error}); run the scenario again") from None
    if not isinstance(summary, dict):
        raise NotARun(f"{path}: not a JSON object; run the scenario again")
    return summary


def load_run(run_dir: Path) -> Run:
    """Read and align a run; raises NotARun naming the file that is missing or damaged."""
    run_dir = Path(run_dir)
    if not run_dir.is_dir():
        raise NotARun(f"{run_dir}: no such folder; give a run folder, for example runs/paper_outage")
    summary = read_summary(run_dir) if (run_dir / "summary.json").exists() else {}
    truth = _load(run_dir / "truth.npz")
    monitor = _load(run_dir / "monitor.npz")
    try:
        return _align(run_dir, summary, truth, monitor, _estimate(run_dir))
    except (KeyError, ValueError, IndexError) as error:
        raise NotARun(f"{run_dir}: truth.npz and monitor.npz do not fit together ({error})") from None


def _load(path: Path) -> dict[str, np.ndarray]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except FileNotFoundError:
        raise NotARun(f"{path.parent}: not a run: no {path.name} in it; make one with `hil_sim run`") from None
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise NotARun(f"{path}: unreadable ({error}); run the scenario again") from None


def _estimate(run_dir: Path) -> dict[str, np.ndarray] | None:
    path = run_dir / "estimate.npz"
    return _load(path) if path.exists() else None


def _align(
    folder: Path,
    summary: dict[str, Any],
    truth: dict[str, np.ndarray],
    monitor: dict[str, np.ndarray],
    estimate: dict[str, np.ndarray] | None,
) -> Run:
    _, in_truth, in_monitor = np.intersect1d(truth["tick"], monitor["tick"], return_indices=True)
    if in_truth.size == 0:
        raise ValueError("no tick in common")
    # A tick on which flight published nothing offers no data; its row holds zeros.
    heard = np.ones(in_monitor.size, dtype=bool)
    for name in ("has_nav", "has_integrity"):
        if name in monitor:
            heard &= monitor[name][in_monitor].astype(bool)
    in_truth, in_monitor = in_truth[heard], in_monitor[heard]
    if in_truth.size == 0:
        raise ValueError("nothing was published")
    nav = monitor["nav"][in_monitor]
    integrity = monitor["integrity"][in_monitor]
    # The axis starts at the first tick of the world, also when the monitor heard flight only later.
    t_zero_ns = int(truth["t_true_gps_ns"][0])

    def seconds(t_gps_ns: np.ndarray) -> np.ndarray:
        return (np.asarray(t_gps_ns, dtype=np.int64) - t_zero_ns) / NS_PER_S

    t_s = seconds(truth["t_true_gps_ns"][in_truth])
    r_truth = truth["r_gcrf_m"][in_truth]
    r_published = np.column_stack([nav["x_gcrf_m"], nav["y_gcrf_m"], nav["z_gcrf_m"]])
    error = r_published - r_truth
    error[(nav["validity"] & Validity.INITIALISED) == 0] = np.nan
    mode = integrity["mode"].astype(int)
    bound = np.where(mode == Mode.INIT, np.nan, integrity["bound_m"])
    bound[~np.isfinite(bound) | (bound <= 0.0)] = np.nan
    limit = np.where(integrity["limit_m"] > 0.0, integrity["limit_m"], np.nan)
    error_max = np.max(np.abs(error), axis=1)
    flag = integrity["flag_state"].astype(int)
    spans = seconds(truth["outages"]).reshape(-1, 2)
    return Run(
        folder=folder,
        summary=summary,
        t_s=t_s,
        r_truth_gcrf_m=r_truth,
        error_gcrf_m=error,
        error_m=error_max,
        bound_m=bound,
        limit_m=limit,
        mode=mode,
        flag=flag,
        fix_error_m=truth["fix_error_m"].reshape(-1, 3),
        da_t_s=seconds(truth["da_t_gps_ns"]),
        da_true_mps2=truth["da_true_mps2"].reshape(-1, 3),
        da_estimate_t_s=None if estimate is None else seconds(estimate["t_gps_ns"]),
        da_estimate_mps2=None if estimate is None else estimate["da_mps2"].reshape(-1, 3),
        outages=tuple(_outages(spans, t_s, error_max, limit, flag, mode, integrity["fix_age_s"])),
    )


def _outages(
    spans: np.ndarray,
    t_s: np.ndarray,
    error_m: np.ndarray,
    limit_m: np.ndarray,
    flag: np.ndarray,
    mode: np.ndarray,
    fix_age_s: np.ndarray,
) -> Iterator[Outage]:
    for i, (start_s, end_s) in enumerate(spans):
        until_s = spans[i + 1, 0] if i + 1 < len(spans) else np.inf
        aged = np.flatnonzero((t_s >= start_s) & (t_s < until_s) & np.isfinite(fix_age_s))
        last_fix_s = float(start_s)
        if aged.size and 0.0 <= fix_age_s[aged[0]] < 60.0:
            last_fix_s = min(last_fix_s, float(t_s[aged[0]] - fix_age_s[aged[0]]))
        with np.errstate(invalid="ignore"):
            accepted_again = (t_s >= end_s) & (t_s < until_s) & (t_s - fix_age_s >= end_s - 1e-3)
        again_s = _first(t_s, accepted_again)
        inside = (t_s > last_fix_s) & (t_s < (until_s if again_s is None else again_s))
        serving = (mode == Mode.INTEGRATED) & (flag == FlagState.CLEAR) & (t_s < until_s)
        yield Outage(
            start_s=float(start_s),
            end_s=float(end_s),
            last_fix_s=last_fix_s,
            flag_s=_first(t_s, inside & (flag != FlagState.CLEAR)),
            crossed_s=_first(t_s, inside & (error_m > limit_m)),
            back_in_service_s=None if again_s is None else _first(t_s, serving & (t_s >= again_s)),
        )


def _first(t_s: np.ndarray, condition: np.ndarray) -> float | None:
    where = np.flatnonzero(condition)
    return float(t_s[where[0]]) if where.size else None
