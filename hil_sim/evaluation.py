"""What a run showed: published against true, from truth.npz and monitor.npz alone.

Definitions (issue and docs/integrity.md): errors are the largest axis in GCRF, taken at the true instant of each
tick; ages count from the last accepted fix; a violation is an epoch from the last accepted fix to the flag whose
published bound is below the error. A bound that is not a number covers nothing. A tick on which flight
published nothing offers no data and is counted apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.enums import FlagState, Mode, Validity, Verdict

SETTLING_S = 600.0  # after the first INTEGRATED tick, before the integrated figures begin
STALL_GROWTH = 0.02  # a bound that grows by less over the last third of an outage has settled
NEVER_NS = np.iinfo(np.int64).max


@dataclass(frozen=True)
class Record:
    """Published and true on the n ticks both have. Shapes (n,); t_ns is true GPS time.

    error_m, speed_error_mps: largest axis; error_3d_m: Euclidean. `offered`: a state was published and initialised.
    """

    t_ns: np.ndarray
    offered: np.ndarray
    error_m: np.ndarray
    error_3d_m: np.ndarray
    speed_error_mps: np.ndarray
    bound_m: np.ndarray
    bound_3d_m: np.ndarray
    limit_m: np.ndarray
    fix_age_s: np.ndarray
    mode: np.ndarray
    flag: np.ndarray
    verdict: np.ndarray


def evaluate_run(folder: Path) -> dict[str, Any]:
    """`evaluate` on the files of a run folder."""
    with np.load(folder / "truth.npz") as truth, np.load(folder / "monitor.npz") as monitor:
        return evaluate({k: truth[k] for k in truth}, {k: monitor[k] for k in monitor})


def evaluate(truth: Mapping[str, np.ndarray], monitor: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The keys `integrated`, `outages`, `fault_of_table`, `ticks_without_output`, `said`; `burns` if any.

    Figures that were not reached are None; no NaN leaves this function.
    """
    record = align(truth, monitor)
    spans = np.asarray(truth["outages"], dtype=np.int64).reshape(-1, 2)
    t_zero_ns = int(truth["t_true_gps_ns"][0]) if len(truth["t_true_gps_ns"]) else 0
    outages = []
    excluded = np.zeros(len(record.t_ns), dtype=bool)
    for i, (start_ns, end_ns) in enumerate(spans):
        next_ns = int(spans[i + 1, 0]) if i + 1 < len(spans) else NEVER_NS
        outage, unavailable = _outage(record, int(start_ns), int(end_ns), next_ns, t_zero_ns)
        outages.append(outage)
        excluded |= unavailable
    faults = list(dict.fromkeys(o["fault_of_table"] for o in outages if o["fault_of_table"]))
    return {
        "integrated": _integrated(record, excluded, np.asarray(truth["fix_error_m"]).reshape(-1, 3)),
        "outages": outages,
        "fault_of_table": " ".join(faults) or None,
        "ticks_without_output": int(np.count_nonzero(~record.offered)),
        "said": _said(record.verdict),
        **({"burns": _burns(truth)} if "burn_start_s" in truth else {}),
    }


def _said(verdict: np.ndarray) -> dict[str, float]:
    """Share of the ticks at which flight said each verdict."""
    return {one.name: round(float(np.mean(verdict == one)), 4) for one in Verdict if np.any(verdict == one)}


def _burns(truth: Mapping[str, np.ndarray]) -> list[dict[str, Any]]:
    """Every burn: what was commanded, what was flown, when it was announced."""
    return [
        {
            "start_s": _seconds(truth["burn_start_s"][i]),
            "duration_s": _seconds(truth["burn_duration_s"][i]),
            "announced_s": _seconds(told_s) if np.isfinite(told_s) else None,
            "frame": "rtn" if truth["burn_rtn"][i] else "gcrf",
            "dv_mps": truth["burn_dv_mps"][i].tolist(),
            "flown_dv_mps": truth["burn_flown_dv_mps"][i].round(9).tolist(),
        }
        for i, told_s in enumerate(truth["burn_announced_s"])
    ]


def align(truth: Mapping[str, np.ndarray], monitor: Mapping[str, np.ndarray]) -> Record:
    """Put truth and monitor on the ticks that both hold."""
    _, a, b = np.intersect1d(truth["tick"], monitor["tick"], return_indices=True)
    nav, integrity = monitor["nav"][b], monitor["integrity"][b]
    heard = np.ones(len(b), dtype=bool)
    for key in ("has_nav", "has_integrity"):
        if key in monitor:
            heard &= monitor[key][b].astype(bool)
    r = np.column_stack([nav[f"{axis}_gcrf_m"] for axis in "xyz"]) - truth["r_gcrf_m"][a]
    v = np.column_stack([nav[f"v{axis}_gcrf_mps"] for axis in "xyz"]) - truth["v_gcrf_mps"][a]
    return Record(
        t_ns=truth["t_true_gps_ns"][a],
        offered=heard & ((nav["validity"] & Validity.INITIALISED) != 0),
        error_m=np.max(np.abs(r), axis=1, initial=0.0),
        error_3d_m=np.linalg.norm(r, axis=1),
        speed_error_mps=np.max(np.abs(v), axis=1, initial=0.0),
        bound_m=integrity["bound_m"],
        bound_3d_m=integrity["bound_3d_m"],
        limit_m=integrity["limit_m"],
        fix_age_s=integrity["fix_age_s"].astype(np.float64),
        mode=integrity["mode"].astype(np.int64),
        flag=integrity["flag_state"].astype(np.int64),
        verdict=integrity["verdict"].astype(np.int64),
    )


def _outage(
    record: Record, start_ns: int, end_ns: int, next_ns: int, t_zero_ns: int
) -> tuple[dict[str, Any], np.ndarray]:
    """One outage's figures, and the ticks (n,) that are not integrated flight because of it."""
    t = record.t_ns
    last_fix_ns = _last_accepted_fix_ns(record, start_ns)
    first = int(np.searchsorted(t, last_fix_ns, side="right"))
    limit = int(np.searchsorted(t, next_ns))
    fix_ns = t - np.nan_to_num(record.fix_age_s, nan=1e9) * 1e9
    # the age is by the onboard clock, which has drifted: the middle of the outage parts old fixes from new
    accepted_again = _first(np.flatnonzero((t >= end_ns) & (fix_ns > (start_ns + end_ns) / 2)), limit)
    stop = accepted_again if accepted_again is not None else limit
    window = np.arange(first, stop)
    age_s = (t - last_fix_ns) / 1e9
    flagged = _first(window[record.offered[window] & (record.flag[window] != FlagState.CLEAR)], stop)
    judged = window[: (flagged - first) if flagged is not None else len(window)]
    judged = judged[record.offered[judged]]
    offered = window[record.offered[window]]
    limit_m = float(record.limit_m[offered[0]]) if len(offered) else float("nan")
    crossed = _first(offered[record.error_m[offered] > record.limit_m[offered]], stop)
    below = ~(record.bound_m[judged] >= record.error_m[judged])
    below_3d = ~(record.bound_3d_m[judged] >= record.error_3d_m[judged])
    serving = np.flatnonzero(record.offered & (record.mode == Mode.INTEGRATED) & (record.flag == FlagState.CLEAR))
    back = _first(serving[serving >= stop], limit) if accepted_again is not None else None

    def at_age(values: np.ndarray, seconds: float) -> float | None:
        i = int(np.searchsorted(age_s, seconds - 1e-3))
        return _metres(values[i]) if first <= i < stop and record.offered[i] else None

    unavailable = np.zeros(len(t), dtype=bool)
    unavailable[first : back if back is not None else limit] = True
    in_outage = offered[t[offered] < end_ns]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(record.error_m[judged] / record.bound_m[judged], nan=np.inf)
    worst = float(ratio.max(initial=0.0))
    return {
        "start_s": _seconds((start_ns - t_zero_ns) / 1e9),
        "end_s": _seconds((end_ns - t_zero_ns) / 1e9),
        "last_accepted_fix_s": _seconds((last_fix_ns - t_zero_ns) / 1e9),
        "eps_m": _metres(limit_m),
        "error_crossed_eps_age_s": None if crossed is None else _seconds(age_s[crossed]),
        "flag_raised_age_s": None if flagged is None else _seconds(age_s[flagged]),
        "violations": int(np.count_nonzero(below)),
        "epochs": len(judged),
        "violated": bool(below.any()),
        "first_violation_age_s": _seconds(age_s[judged[np.argmax(below)]]) if below.any() else None,
        "worst_error_to_bound": round(worst, 4) if np.isfinite(worst) else None,
        "violations_3d": int(np.count_nonzero(below_3d)),
        "bound_at_flag_m": None if flagged is None else _metres(record.bound_m[flagged]),
        "error_at_900_s_m": at_age(record.error_m, 900.0),
        "error_at_2000_s_m": at_age(record.error_m, 2000.0),
        "bound_at_900_s_m": at_age(record.bound_m, 900.0),
        "error_max_m": _metres(record.error_m[in_outage].max()) if len(in_outage) else None,
        "back_in_service_s": None if back is None else _seconds((t[back] - end_ns) / 1e9),
        "fault_of_table": _settled_bound(record, in_outage, age_s),
    }, unavailable


def _last_accepted_fix_ns(record: Record, start_ns: int) -> int:
    """Instant of the last fix accepted before the outage, by the age flight published at its start."""
    at = int(np.searchsorted(record.t_ns, start_ns))
    for i in range(at, min(at + 1000, len(record.t_ns))):
        age_s = record.fix_age_s[i]
        if record.offered[i] and np.isfinite(age_s) and age_s >= 0.0:
            return min(int(record.t_ns[i]) - round(float(age_s) * 1e9), start_ns)
    return start_ns


def _settled_bound(record: Record, ticks: np.ndarray, age_s: np.ndarray) -> str | None:
    """Text when the bound stops growing below the limit while the error exceeds it; the flag then never comes."""
    if not len(ticks):
        return None
    bound = np.maximum.accumulate(np.nan_to_num(record.bound_m[ticks], nan=0.0))
    limit_m, largest_m = float(record.limit_m[ticks[-1]]), float(record.error_m[ticks].max())
    span_s = age_s[ticks[-1]]
    before = float(bound[np.searchsorted(age_s[ticks], span_s * 2.0 / 3.0)])
    settled = float(bound[-1])
    if settled >= limit_m or largest_m <= limit_m or settled - before > STALL_GROWTH * settled:
        return None
    return (
        f"The bound settles at {settled:.0f} m, below the limit of {limit_m:.0f} m, while the error reached "
        f"{largest_m:.0f} m: with this table's row for (17) the flag can never be raised."
    )


def _integrated(record: Record, excluded: np.ndarray, fix_error_m: np.ndarray) -> dict[str, Any]:
    """Errors while integrated: settled, outside outages and the time until service after them."""
    integrated = record.offered & (record.mode == Mode.INTEGRATED)
    first = np.flatnonzero(integrated)
    chosen = integrated & ~excluded
    if len(first):
        chosen &= record.t_ns >= record.t_ns[first[0]] + round(SETTLING_S * 1e9)
    fix = np.max(np.abs(fix_error_m), axis=1, initial=0.0)
    position, speed = record.error_m[chosen], record.speed_error_mps[chosen]
    return {
        "fix_rms_m": _metres(_rms(fix)),
        "position_rms_m": _metres(_rms(position)),
        "position_max_m": _metres(position.max()) if len(position) else None,
        "velocity_rms_mps": None if not len(speed) else round(_rms(speed), 6),
        "epochs": len(position),
    }


def _first(indices: np.ndarray, below: int) -> int | None:
    return int(indices[0]) if len(indices) and indices[0] < below else None


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _metres(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None


def _seconds(value: float) -> float:
    return round(float(value), 3)
