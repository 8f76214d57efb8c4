"""Figures of a case, from the arrays of its flights to the numbers of accuracy.json. Definitions: docs/accuracy.md."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ground.accuracy.bench_cases import CURVE_STEP_S, Case, Plan
from ground.accuracy.bench_flight import BLOCK_S, STATES, Arrays

CONVERGED_FACTOR = 3.0  # times the steady rms, for CONVERGED_S
CONVERGED_S = 600.0
NEAR_M, NEAR_S = 5.0, 60.0  # after an outage: so near again, so soon
STEADY_FACTOR, STEADY_S = 2.0, 600.0  # and within so many times the steady rms
STEADY_WINDOW_S = 60  # over which the rms after an outage is taken
REVOLUTION_S = 6000  # of steady flight: its mean NEES counts as one draw

Summary = dict[str, Any]


def summarise(case: Case, figures: Arrays) -> Summary:
    """One entry of `cases` in accuracy.json. Numbers that are not known are None."""
    steady = steady_figures(case.plan, figures)
    rms_m = steady["rms_3d_m"]
    return {
        "orbit": case.orbit.name,
        "measured": case.orbit.period_s is None,
        "profile": case.profile,
        "table_set": case.table_set,
        "settings": list(case.settings),
        "area_to_mass_m2pkg": case.orbit.area_to_mass_m2pkg,
        "start_gps": case.orbit.start.isoformat(),
        "flight_s": case.plan.flight_s,
        "convergence_given_s": case.plan.convergence_s,
        "shortened": case.plan.shortened,
        "convergence": convergence_figures(figures, rms_m),
        "steady": steady,
        "starts": start_list(case.plan, figures),
        "outages": {str(age): age_figures(case.plan, figures, age) for age in case.plan.ages_s},
        "outage_beyond_bound_share": _share(figures["outage_beyond"].sum(), figures["outage_ticks"].sum()),
        "validation": validation_figures(case.plan, figures),
        "drag_scale_fitted_median": _number(np.nanmedian(figures["drag_scale"]))
        if np.isfinite(figures["drag_scale"]).any()
        else None,
        "back_to_steady": {
            str(length): return_figures(case.plan, figures, k, rms_m) for k, length in enumerate(case.plan.returns_s)
        },
    }


def steady_figures(plan: Plan, figures: Arrays) -> Summary:
    """Of the long flight, after the convergence that the plan gives."""
    steady = figures["flight_t_s"] >= plan.convergence_s
    position, velocity = _worst_if_nan(figures["flight_3d_m"][steady]), _worst_if_nan(figures["flight_3d_mps"][steady])
    rms_m = _rms(position)
    beyond = ~(figures["flight_axis_m"][steady] <= figures["flight_bound_m"][steady])
    found = {
        "epochs": int(steady.sum()),
        "rms_3d_m": _number(rms_m),
        "rms_3d_mps": _number(_rms(velocity)),
        "max_3d_m": _number(position.max()),
        "max_3d_mps": _number(velocity.max()),
        "bound_median_m": _number(np.median(figures["flight_bound_m"][steady])),
        "beyond_bound_share": _share(beyond.sum(), len(beyond)),
        "beyond_twice_rms_share": _share(np.sum(position > STEADY_FACTOR * rms_m), len(position)),
        "not_steady_by_chance_share": chance_of_a_late_return(position, rms_m),
    }
    if "flight_nees" in figures:
        values = figures["flight_nees"][steady] / STATES
        count = len(values) // REVOLUTION_S
        found |= _mean_nees(values, values[: count * REVOLUTION_S].reshape(count, REVOLUTION_S).mean(axis=1))
    return found


def convergence_figures(figures: Arrays, steady_rms_m: float | None) -> Summary:
    """Over all arcs: from when the 3-D error stays below CONVERGED_FACTOR times the steady rms for CONVERGED_S."""
    times = np.array([converged_s(row, steady_rms_m or np.nan) for row in figures["converging_3d_m"]])
    reached = times[np.isfinite(times)]
    return {
        "arcs": len(times),
        "never": int(len(times) - len(reached)),
        "median_s": _number(np.median(reached)) if len(reached) else None,
        "max_s": _number(reached.max()) if len(reached) else None,
    }


def converged_s(blocks_m: np.ndarray, steady_rms_m: float) -> float:
    """Convergence time [s] of largest errors in blocks of BLOCK_S; infinite where it is not reached."""
    good = blocks_m < CONVERGED_FACTOR * steady_rms_m
    run = 0
    for index, ok in enumerate(good):
        run = run + 1 if ok else 0
        if run * BLOCK_S >= CONVERGED_S:
            return float((index + 1 - run) * BLOCK_S)
    return np.inf


def age_index(age_s: int) -> int:
    """Where an age stands on the curve."""
    return age_s // CURVE_STEP_S - 1


def outage_axis_m(figures: Arrays, name: str = "outage_error_m") -> np.ndarray:
    """Largest GCRF axis of each start at each age of the curve (starts, ages) [m]."""
    return np.abs(figures[name]).max(axis=2)


def age_figures(plan: Plan, figures: Arrays, age_s: int) -> Summary:
    """Over all starts after which the orbit is known for so long. Largest-axis errors, but `rms_3d` ones."""
    index = age_index(age_s)
    error = outage_axis_m(figures)[:, index]
    known = ~np.isnan(error)
    found: Summary = {"starts": int(known.sum())}
    if not known.any():
        return found
    error, bound = error[known], figures["outage_bound_m"][known, index]
    vector = figures["outage_error_m"][known, index]
    rms = _rms(np.linalg.norm(vector, axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(np.isnan(bound), np.inf, error / bound)
    found |= {
        **_spread(error, ""),
        "q997_m": _number(_quantile(error, 0.997)),
        "rms_3d_m": _number(rms),
        "bound_median_m": _number(np.median(bound)),
        "worst_error_to_bound": _number(ratio.max()),
    }
    if "outage_nees" in figures:
        values = figures["outage_nees"][known, index] / STATES
        found |= _mean_nees(values, values)
    for name in ("floor", "floor_drag"):
        floor = figures[f"{name}_m"][known, index]
        usable = np.isfinite(floor).all(axis=1)
        if usable.any():
            floor_rms = _rms(np.linalg.norm(floor[usable], axis=1))
            found |= _spread(np.abs(floor[usable]).max(axis=1), f"{name}_")
            found[f"{name}_rms_3d_m"] = _number(floor_rms)
            found[f"{name}_share"] = _share(floor_rms**2, rms**2)
    return found


def validation_figures(plan: Plan, figures: Arrays) -> Summary:
    """How the bound did in the outages, over all their ages: a validation, no certification.

    Outages of one orbit overlap; so many arcs of it are independent as there is room for, end to end.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = outage_axis_m(figures) / figures["outage_bound_m"]
    ratio[np.isnan(figures["outage_bound_m"]) & np.isfinite(outage_axis_m(figures))] = np.inf
    flown = ~np.isnan(ratio).all(axis=1)
    worst = np.nanmax(ratio[flown], axis=1) if flown.any() else np.array([np.nan])
    last_s, arcs = -np.inf, 0
    for begin_s in sorted(plan.begins_s):
        if begin_s >= last_s + plan.ages_s[-1]:
            last_s, arcs = begin_s, arcs + 1
    violated = int((figures["outage_beyond"][flown] > 0).sum())
    return {**_validation(worst, arcs, violated), "error_to_bound": [_number(value) for value in worst if flown.any()]}


def pooled_validation(summaries: Sequence[Summary]) -> list[Summary]:
    """By profile of fixes: the outages of all measured orbits together, where there is more than one such orbit."""
    pooled = []
    for profile in dict.fromkeys(one["profile"] for one in summaries):
        told = [one["validation"] for one in summaries if one["profile"] == profile and one["measured"]]
        if len(told) > 1:
            worst = [np.inf if value is None else value for one in told for value in one["error_to_bound"]]
            arcs, violated = (sum(one[name] for one in told) for name in ("independent_arcs", "violated"))
            pooled.append({"profile": profile, "validation": _validation(np.array(worst or [np.nan]), arcs, violated)})
    return pooled


def _validation(worst: np.ndarray, arcs: int, violated: int) -> Summary:
    """worst (n,): largest error / bound of each outage, NaN for none flown."""
    q95 = _quantile(worst, 0.95)
    return {
        "outages": int(np.sum(~np.isnan(worst))),
        "independent_arcs": arcs,
        "violated": violated,
        "worst_error_to_bound": _number(worst.max()),
        "q95_error_to_bound": _number(q95),
        "tightness_q95": _number(1.0 / q95) if q95 > 0.0 else None,
    }


def return_figures(plan: Plan, figures: Arrays, k: int, steady_rms_m: float | None) -> Summary:
    """Back to steady after outages of plan.returns_s[k]; times from the first tick with fixes again."""
    error = figures["return_3d_m"][:, k]
    error = error[~np.isnan(error).any(axis=1)]
    found: Summary = {"runs": len(error)}
    if not len(error):
        return found
    near = np.array([near_s(row) for row in error])
    steady = np.array([steady_again_s(row, steady_rms_m or np.nan) for row in error])
    mode = figures["return_mode_s"][:, k]
    mode = mode[~np.isnan(mode)]
    found |= {
        "error_at_return_median_m": _number(np.median(error[:, 0])),
        "error_at_return_max_m": _number(error[:, 0].max()),
        "near_median_s": _number(np.median(near)),
        "near_max_s": _number(near.max()),
        "near_in_time": int(np.sum(near <= NEAR_S)),
        "steady_median_s": _number(np.median(steady)),
        "steady_max_s": _number(steady.max()),
        "steady_in_time": int(np.sum(steady <= STEADY_S)),
        "rms_then_by_steady": _quotient(_rms(error[:, min(int(STEADY_S), error.shape[1] - 1)]), steady_rms_m),
        "integrated_max_s": _number(mode.max()),
        "beyond_bound_share": _share(figures["return_beyond"][:, k].sum(), figures["return_ticks"][:, k].sum()),
    }
    return found


def near_s(error_m: np.ndarray) -> float:
    """From when the 3-D error of each second stays within NEAR_M for as long as it was flown; infinite: never."""
    beyond = np.flatnonzero(~(error_m <= NEAR_M))
    if not len(beyond):
        return 0.0
    return float(beyond[-1] + 1) if beyond[-1] + 1 < len(error_m) else np.inf


def steady_again_s(error_m: np.ndarray, steady_rms_m: float) -> float:
    """First second from which the rms of STEADY_WINDOW_S is within STEADY_FACTOR of the steady rms; infinite: never.

    An rms, not each second: some seconds of steady flight are beyond twice its rms as well.
    """
    good = np.flatnonzero(_rms_of_windows(error_m) <= STEADY_FACTOR * steady_rms_m)
    return float(good[0]) if len(good) else np.inf


def chance_of_a_late_return(steady_m: np.ndarray, steady_rms_m: float) -> float | None:
    """Share of all instants of steady flight (n,), each second, from which `steady_again_s` is later than STEADY_S.

    What the same yardstick says where there was no outage at all: so often a return is late by chance.
    """
    if len(steady_m) < STEADY_S + STEADY_WINDOW_S or not np.isfinite(steady_m).all():
        return None
    good = _rms_of_windows(steady_m) <= STEADY_FACTOR * steady_rms_m
    counted = np.concatenate(([0], np.cumsum(good)))
    length = int(STEADY_S) + 1
    return _share(np.sum(counted[length:] == counted[:-length]), len(counted) - length)


def _rms_of_windows(error_m: np.ndarray) -> np.ndarray:
    """The rms of STEADY_WINDOW_S from each second on."""
    squares = np.concatenate(([0.0], np.cumsum(np.asarray(error_m, dtype=np.float64) ** 2)))
    return np.sqrt((squares[STEADY_WINDOW_S:] - squares[:-STEADY_WINDOW_S]) / STEADY_WINDOW_S)


def start_list(plan: Plan, figures: Arrays) -> list[Summary]:
    """Every outage start: when, where along the orbit, and the largest-axis error at the ages; none is left out."""
    axis = outage_axis_m(figures)
    return [
        {
            "start_s": begin + plan.convergence_s,
            "argument_of_latitude_deg": _number(figures["start_phase_deg"][n]),
            "error_m": {str(age): _number(axis[n, age_index(age)]) for age in plan.ages_s},
        }
        for n, begin in enumerate(plan.begins_s)
    ]


def velocity_ratios(summaries: Sequence[Summary]) -> dict[str, float | None]:
    """Orbit -> steady velocity error of position-only fixes by that of white ones."""
    by = {(one["orbit"], one["profile"]): one["steady"]["rms_3d_mps"] for one in summaries}
    orbits = [orbit for orbit, profile in by if profile == "position_only" and (orbit, "white") in by]
    return {orbit: _quotient(by[orbit, "position_only"], by[orbit, "white"]) for orbit in orbits}


def clock_ratios(summaries: Sequence[Summary], perfect: str) -> dict[str, dict[str, float | None]]:
    """Orbit -> age -> rms outage error with the 1 ppm oscillator by that with a perfect clock, the same noise."""
    by = {(one["orbit"], one["profile"]): one["outages"] for one in summaries}
    found: dict[str, dict[str, float | None]] = {}
    for orbit, profile in by:
        if profile == perfect and (orbit, "white") in by:
            ours, theirs = by[orbit, "white"], by[orbit, perfect]
            found[orbit] = {age: _quotient(ours[age].get("rms_3d_m"), theirs[age].get("rms_3d_m")) for age in ours}
    return found


def _spread(error: np.ndarray, prefix: str) -> Summary:
    return {f"{prefix}median_m": _number(np.median(error)), f"{prefix}max_m": _number(error.max())}


def _mean_nees(values: np.ndarray, draws: np.ndarray) -> Summary:
    """Mean NEES by state, and its standard error from the scatter of draws that are taken as independent.

    The seconds of one flight are not: its revolutions nearly are.
    """
    values, draws = values[np.isfinite(values)], draws[np.isfinite(draws)]
    error = np.std(draws, ddof=1) / np.sqrt(len(draws)) if len(draws) > 1 else np.nan
    return {
        "nees_per_state": _number(np.mean(values)) if len(values) else None,
        "nees_per_state_standard_error": _number(error),
    }


def _quantile(values: np.ndarray, share: float) -> float:
    """Infinite where an infinite value has a part in it."""
    with np.errstate(invalid="ignore"):
        found = float(np.quantile(values, share))
    return np.inf if np.isnan(found) else found


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.asarray(values, dtype=np.float64) ** 2))) if len(values) else float("nan")


def _worst_if_nan(values: np.ndarray) -> np.ndarray:
    """Errors in which a missing state counts as infinitely wrong."""
    return np.where(np.isnan(values), np.inf, values)


def _quotient(a: float | None, b: float | None) -> float | None:
    return None if a is None or not b else _number(a / b)


def _share(part: Any, whole: Any) -> float | None:
    return _number(part / whole) if whole > 0 else None


def _number(value: float | np.floating[Any]) -> float | None:
    """A plain number for JSON, six digits; None where it is not finite."""
    return float(f"{float(value):.6g}") if np.isfinite(value) else None
