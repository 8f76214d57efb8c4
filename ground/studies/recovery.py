"""After an outage: are fixes taken again, is the error soon small again, whatever of its predicted size it has become?

From one long flight with fixes outages begin every spacing_s; after each length of them fixes come back twice. Once to
the state as it is; once to a state whose error is drawn from its own covariance, all states of it: r and v are put at
the truth and moved by the draw, the others moved by it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd.alerts import AlertId
from flightsw.memory import Memory
from flightsw.records import HISTORY
from ground.accuracy.bench_summary import NEAR_S, STEADY_S, near_s, steady_again_s
from ground.studies import arcs

ORBITS = ("simulated", "gracefo", "sentinel3a")
TRUE_ERROR, DRAWN_ERROR = "as it is", "drawn"
_RESTARTS = 1 << int(AlertId.REINITIALISED) | 1 << int(AlertId.DIVERGED)
_ALARMS = 1 << int(AlertId.MANOEUVRE_DETECTED) | 1 << int(AlertId.SLOW_FAULT)


class Plan(NamedTuple):
    """Seconds: of the long flight, before its first outage, between their beginnings, of outages, of fixes after."""

    along_s: int = 86_000
    settled_s: int = 6000
    spacing_s: int = 800
    outages_s: tuple[int, ...] = (600, 2000, 7200)
    return_s: int = 900


QUICK = Plan(along_s=4200, settled_s=2000, spacing_s=400, outages_s=(600,))


class Task(NamedTuple):
    """One long flight; limit: of its outages, None for all that fit."""

    orbit: str
    table_set: str
    plan: Plan
    seed: int = 0
    limit: int | None = None
    overrides: tuple[tuple[str, Any], ...] = ()
    gravity: Path | None = None


@dataclass(frozen=True)
class Return:
    """One return of fixes. Errors 3-D [m], times from the first fix again [s]; infinite where it did not happen.

    taken_s: until a fix is used. error_to_bound: largest axis as fixes come back, by the bound at that time.
    restarted, alarmed: the state was given up; a fault was found, of which there was none.
    """

    orbit: str
    outage_s: int
    kind: str
    start_s: int
    error_m: float
    error_to_bound: float
    taken_s: float
    near_s: float
    steady_s: float
    at_60_s_m: float
    largest_from_60_s_m: float
    beyond_s: int
    restarted: bool
    alarmed: bool


def fly(task: Task) -> list[Return]:
    """All returns of one flight. Raises OperatorError where data or tables do not allow it."""
    plan = task.plan
    sky = arcs.sky(task.orbit, plan.along_s, task.gravity)
    number = list(arcs.ALL_ORBITS).index(task.orbit)
    noise = arcs.stream(3, task.seed, number)
    flight = arcs.Flight(sky, task.table_set, arcs.WHITE, noise, dict(task.overrides))
    last = len(sky) - plan.outages_s[-1] - plan.return_s
    starts = list(range(plan.settled_s, last, plan.spacing_s))[: task.limit]
    parts: list[tuple[int, int, str, np.ndarray, np.ndarray]] = []
    for start in starts:
        flight.until(start)
        coasting, done = arcs.fork(flight.memory), start
        for length in plan.outages_s:
            outputs = arcs.fly(coasting, flight.blank(done, start + length))
            done = start + length
            last_error = arcs.Errors.of(flight.track.part(done - 2, done), outputs[-2:])
            track = flight.track.part(done, done + plan.return_s)
            inputs = flight.measured(track, noise)
            for kind in (TRUE_ERROR, DRAWN_ERROR):
                returning = arcs.fork(coasting)
                if kind == DRAWN_ERROR:
                    redraw(returning, np.concatenate((last_error.r_m[-1], last_error.v_mps[-1])), noise)
                parts.append((start, length, kind, outputs[-1:], arcs.fly(returning, inputs)))
    flight.until()
    steady_error = arcs.Errors.of(flight.track, flight.outputs).all_m[plan.settled_s :]
    rms = float(np.sqrt(np.mean(steady_error**2)))
    return [_figures(task, flight, rms, *part) for part in parts]


def redraw(memory: Memory, error: np.ndarray, noise: np.random.Generator) -> None:
    """Give the state another error: `error` (6,) of r and v is taken out, one drawn from the covariance put in.

    Kept epochs of late fixes are moved along: within them the error of r grows by that of v.
    """
    nav: Any = memory.nav[0]
    ud = nav["UD"]
    n = int(np.max(np.flatnonzero(np.diag(ud)))) + 1
    factors = np.triu(ud[:n, :n], 1) + np.eye(n)
    change = factors @ (np.sqrt(np.diag(ud)[:n]) * noise.standard_normal(n))
    change[:6] -= error
    nav["x"][:n] += change
    for k in range(HISTORY):
        age_s = (int(nav["t_gps_ns"]) - int(nav["history_t_gps_ns"][k])) * 1e-9
        nav["history_x"][k, :n] += change
        nav["history_x"][k, :3] -= age_s * change[3:6]


def _figures(
    task: Task,
    flight: arcs.Flight,
    rms_m: float,
    start: int,
    length: int,
    kind: str,
    before: np.ndarray,
    outputs: np.ndarray,
) -> Return:
    at = start + length
    error = arcs.Errors.of(flight.track.part(at, at + len(outputs)), outputs)
    all_m = np.nan_to_num(error.all_m, nan=np.inf)
    used = np.flatnonzero(outputs["fix_used"] == 1)
    r_before = arcs.Errors.of(flight.track.part(at - 2, at), np.repeat(before, 2)).axis_m[-1]
    axis = r_before if kind == TRUE_ERROR else error.axis_m[0]
    return Return(
        task.orbit,
        length,
        kind,
        start,
        float(all_m[0]),
        float(axis / before["bound_m"][0]),
        float(used[0]) if len(used) else np.inf,
        near_s(all_m),
        steady_again_s(all_m, rms_m),
        float(all_m[int(NEAR_S)]),
        float(all_m[int(NEAR_S) :].max()),
        int(np.sum(~(error.axis_m <= outputs["bound_m"]))),
        bool(np.any(outputs["events"] & _RESTARTS)),
        bool(np.any(outputs["events"] & _ALARMS)),
    )


@dataclass(frozen=True)
class Summary:
    """Returns after one length of outage with one kind of error; good: all of what is asked."""

    outage_s: int
    kind: str
    runs: int
    good: int
    taken: int
    near: int
    steady: int
    taken_largest_s: float
    near_largest_s: float
    steady_largest_s: float
    error_median_m: float
    error_largest_m: float
    largest_from_60_s_m: float
    beyond_share: float
    restarted: int
    alarmed: int


def summarise(returns: Iterable[Return]) -> list[Summary]:
    """One summary for each length and kind."""
    everything = list(returns)
    found = []
    for length, kind in dict.fromkeys((one.outage_s, one.kind) for one in everything):
        some = [one for one in everything if (one.outage_s, one.kind) == (length, kind)]
        ok = [
            (bool(np.isfinite(one.taken_s)), one.near_s <= NEAR_S, one.steady_s <= STEADY_S and not one.restarted)
            for one in some
        ]
        found.append(
            Summary(
                length,
                kind,
                len(some),
                sum(all(three) for three in ok),
                sum(three[0] for three in ok),
                sum(three[1] for three in ok),
                sum(three[2] for three in ok),
                max(one.taken_s for one in some),
                max(one.near_s for one in some),
                max(one.steady_s for one in some),
                float(np.median([one.error_m for one in some])),
                float(max(one.error_m for one in some)),
                float(max(one.largest_from_60_s_m for one in some)),
                sum(one.beyond_s for one in some) / (len(some) * QUICK.return_s),
                sum(one.restarted for one in some),
                sum(one.alarmed for one in some),
            )
        )
    return found


def shortfalls(summaries: Iterable[Summary]) -> list[str]:
    """What is asked and was not reached, in words."""
    return [
        f"after {one.outage_s} s, error {one.kind}: {one.runs - one.good} of {one.runs} not back as wanted"
        for one in summaries
        if one.good < one.runs
    ]


def table(summaries: Iterable[Summary]) -> str:
    """Figures as text."""
    lines = [
        "fixes return after an outage; 3-D error, seconds since the first fix again",
        f"  {'outage':>8} {'error':<10}{'runs':>6}{'median m':>10}{'largest m':>11}{'used':>6}{'<= 5 m in 60 s':>16}"
        f"{'<= 2x in 600 s':>16}{'slowest s':>11}{'from 60 s m':>13}{'past %':>8}{'restarts':>10}{'alarms':>8}",
    ]
    for one in summaries:
        lines.append(
            f"  {one.outage_s:>6} s {one.kind:<10}{one.runs:>6}{one.error_median_m:>10.2f}{one.error_largest_m:>11.2f}"
            f"{one.taken:>6}{one.near:>16}{one.steady:>16}{one.steady_largest_s:>11.0f}{one.largest_from_60_s_m:>13.2f}"
            f"{100 * one.beyond_share:>8.3f}{one.restarted:>10}{one.alarmed:>8}"
        )
    return "\n".join(lines)


def as_document(returns: list[Return]) -> dict[str, Any]:
    """Plain numbers for a JSON file; a time that was not reached is None."""
    summaries = summarise(returns)
    return {
        "summary": [asdict(one) for one in summaries],
        "runs": [
            {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(one).items()}
            for one in returns
        ],
        "shortfalls": shortfalls(summaries),
    }
