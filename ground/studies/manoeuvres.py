"""Burns nobody announced: when they are found, by what name, what error passes meanwhile; and alarms without a burn.

From a long flight with fixes, whose own alarms are counted, burns of every size and direction are flown at many
instants. Beside what was measured stands what any test of these fixes can know: expected log-likelihood ratio.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd.alerts import AlertId
from ground.accuracy.bench_summary import chance_of_a_late_return, steady_again_s
from ground.studies import arcs
from ground.studies.false_fixes import DOUBT, MANOEUVRE, SLOW_FAULT, first, quantiles
from ground.studies.kicks import Burn, kicked

SPEEDS_MPS = (0.01, 0.02, 0.05, 0.1, 0.5, 2.0, 10.0)
DIRECTIONS = {
    name: np.array(axis, dtype=float)
    for name, axis in (
        ("+R", (1, 0, 0)),
        ("-R", (-1, 0, 0)),
        ("+T", (0, 1, 0)),
        ("-T", (0, -1, 0)),
        ("+N", (0, 0, 1)),
        ("-N", (0, 0, -1)),
    )
}
NOISES = ((10.0, 0.1), (3.0, 0.03), (1.0, 0.01))
ORBITS = ("simulated", "gracefo", "sentinel3a")
THRESHOLDS = (20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0)
APART_S = 300  # excesses closer together are one
BURN_S = 10
WANTED_FROM_MPS, WANTED_S, WANTED_STEADY_S = 0.02, 120.0, 600.0
NEAR_M = 2.0
RESTARTS = 1 << int(AlertId.REINITIALISED) | 1 << int(AlertId.DIVERGED)


class Task(NamedTuple):
    """A long flight, with burns every spacing_s of it, at most `starts`; 0: the flight alone, for its alarms."""

    orbit: str
    table_set: str
    sigma_m: float
    sigma_mps: float
    seed: int
    starts: int
    along_s: int = 86_000
    settled_s: int = 6000
    watched_s: int = 1200
    speeds_mps: tuple[float, ...] = SPEEDS_MPS
    overrides: tuple[tuple[str, Any], ...] = ()
    gravity: Path | None = None


@dataclass(frozen=True)
class Found:
    """One burn. Times since its start [s], infinite: never. alert_s: the first of doubt, manoeuvre, slow fault.

    named_s: MANOEUVRE_DETECTED; wrong_s: SLOW_FAULT. largest_m: 3-D. before, after: error / bound on both sides of the
    first alert; beyond_s: seconds past the bound. near_s: from when the error stays within NEAR_M; steady_s: until
    steady again.
    """

    orbit: str
    sigma_m: float
    speed_mps: float
    direction: str
    start_s: int
    alert_s: float
    named_s: float
    wrong_s: float
    largest_m: float
    before: float
    after: float
    beyond_s: int
    near_s: float
    steady_s: float
    restarted: bool


@dataclass(frozen=True)
class Healthy:
    """One long flight without a burn, from settled_s on. excesses: how often the statistic rose above THRESHOLDS.

    late_by_chance: share of all instants of it from which the yardstick of a return would say "late".
    """

    orbit: str
    sigma_m: float
    seed: int
    days: float
    rms_m: float
    named: int
    wrong: int
    doubts: int
    excesses: tuple[int, ...]
    largest_statistic: float
    beyond_s: int
    late_by_chance: float | None


def fly(task: Task) -> tuple[Healthy, list[Found]]:
    """Fly one task. Raises OperatorError where data or tables do not allow it."""
    sky = arcs.sky(task.orbit, task.along_s, task.gravity)
    number = list(arcs.ALL_ORBITS).index(task.orbit)
    noise = arcs.stream(5, task.seed, number, round(task.sigma_m * 1000))
    receiver = arcs.Receiver(task.sigma_m, task.sigma_mps)
    flight = arcs.Flight(sky, task.table_set, receiver, noise, dict(task.overrides))
    last = len(sky) - task.watched_s
    parts = []
    for start in np.linspace(task.settled_s, last, task.starts + 1)[:-1].astype(int).tolist():
        flight.until(start)
        track = flight.track.part(start, start + task.watched_s)
        names = [(speed, name) for speed in task.speeds_mps for name in DIRECTIONS]
        burns = [Burn(0, BURN_S, speed * DIRECTIONS[name]) for speed, name in names]
        for (speed, name), moved in zip(names, kicked(track, burns), strict=True):
            outputs = arcs.fly(arcs.fork(flight.memory), flight.measured(moved, noise))
            parts.append((start, speed, name, arcs.Errors.of(moved, outputs), outputs))
    flight.until()
    healthy = _healthy(task, flight)
    return healthy, [_found(task, healthy.rms_m, *part) for part in parts]


def _found(
    task: Task, rms_m: float, start: int, speed: float, name: str, error: arcs.Errors, outputs: np.ndarray
) -> Found:
    said = (outputs["alerts"] & DOUBT) | (outputs["events"] & (MANOEUVRE | SLOW_FAULT))
    alert = first(said)
    ratio = np.nan_to_num(error.axis_m / outputs["bound_m"], nan=np.inf)
    until = len(ratio) if not np.isfinite(alert) else int(alert)
    all_m = np.nan_to_num(error.all_m, nan=np.inf)
    far = np.flatnonzero(all_m > NEAR_M)
    near = 0.0 if not len(far) else float(far[-1] + 1) if far[-1] + 1 < len(all_m) else np.inf
    peak = int(np.argmax(all_m))
    return Found(
        task.orbit,
        task.sigma_m,
        speed,
        name,
        start,
        alert,
        first(outputs["events"] & MANOEUVRE),
        first(outputs["events"] & SLOW_FAULT),
        float(all_m.max()),
        float(ratio[:until].max()) if until else 0.0,
        float(ratio[until:].max()) if until < len(ratio) else 0.0,
        int(np.sum(ratio > 1.0)),
        near,
        # steady before the burn is felt is not steady again
        peak + steady_again_s(all_m[peak:], rms_m),
        bool(np.any(outputs["events"] & RESTARTS)),
    )


def _healthy(task: Task, flight: arcs.Flight) -> Healthy:
    outputs = flight.outputs[task.settled_s :]
    error = arcs.Errors.of(flight.track, flight.outputs)
    statistic = outputs["monitor_statistic"]
    rms_m = float(np.sqrt(np.mean(error.all_m[task.settled_s :] ** 2)))
    return Healthy(
        task.orbit,
        task.sigma_m,
        task.seed,
        len(outputs) / 86_400.0,
        rms_m,
        int(np.sum((outputs["events"] & MANOEUVRE) != 0)),
        int(np.sum((outputs["events"] & SLOW_FAULT) != 0)),
        rises((outputs["alerts"] & DOUBT) != 0),
        tuple(rises(statistic > threshold) for threshold in THRESHOLDS),
        float(statistic.max()),
        int(np.sum(~(error.axis_m[task.settled_s :] <= outputs["bound_m"]))),
        chance_of_a_late_return(error.all_m[task.settled_s :], rms_m),
    )


def rises(over: np.ndarray) -> int:
    """How many separate excesses there are in (n,) bool: those less than APART_S apart are one."""
    at = np.flatnonzero(over)
    return int(len(at) > 0) + int(np.sum(np.diff(at) >= APART_S))


def information_nats(speed_mps: float, sigma_m: float, sigma_mps: float, t_s: np.ndarray) -> np.ndarray:
    """Expected log-likelihood ratio of a velocity change after t, of fixes each second and a perfectly known orbit."""
    return np.asarray(0.5 * (speed_mps / sigma_mps) ** 2 * t_s + 0.5 * (speed_mps / sigma_m) ** 2 * t_s**3 / 3.0)


def limit_s(speed_mps: float, sigma_m: float, sigma_mps: float, threshold: float) -> float:
    """When the mean of the best test's statistic, 3 + twice the information, passes the threshold [s]."""
    t = np.geomspace(0.1, 1e5, 60_001)
    return float(
        t[np.searchsorted(3.0 + 2.0 * information_nats(speed_mps, sigma_m, sigma_mps, t), threshold)]
        if threshold > 3.0
        else 0.0
    )


def summarise(found: Iterable[Found], threshold: float = 40.0) -> list[dict[str, Any]]:
    """One summary for each noise and size of burn."""
    everything = list(found)
    sigma_mps = dict(NOISES)
    rows = []
    for sigma, speed in dict.fromkeys((one.sigma_m, one.speed_mps) for one in everything):
        some = [one for one in everything if (one.sigma_m, one.speed_mps) == (sigma, speed)]
        rows.append(
            {
                "sigma_m": sigma,
                "speed_mps": speed,
                "runs": len(some),
                "limit_s": limit_s(speed, sigma, sigma_mps.get(sigma, sigma / 100.0), threshold),
                "alert_s": quantiles(one.alert_s for one in some),
                "alert_in_time": sum(one.alert_s <= WANTED_S for one in some),
                "named_s": quantiles(one.named_s for one in some),
                "named": sum(bool(np.isfinite(one.named_s)) for one in some),
                "wrong": sum(bool(np.isfinite(one.wrong_s)) for one in some),
                "never": sum(not np.isfinite(one.alert_s) for one in some),
                "largest_m": quantiles(one.largest_m for one in some),
                "before": max(one.before for one in some),
                "after": max(one.after for one in some),
                "runs_beyond": sum(one.beyond_s > 0 for one in some),
                "beyond_s": sum(one.beyond_s for one in some),
                "near_s": quantiles(one.near_s for one in some),
                "steady_s": quantiles(one.steady_s for one in some),
                "steady_in_time": sum(one.steady_s <= WANTED_STEADY_S for one in some),
                "restarted": sum(one.restarted for one in some),
            }
        )
    return rows


def summarise_healthy(flights: Iterable[Healthy]) -> list[dict[str, Any]]:
    """One summary for each noise: days flown, alarms, and how often a day the statistic passes each threshold."""
    everything = list(flights)
    rows = []
    for sigma in dict.fromkeys(one.sigma_m for one in everything):
        some = [one for one in everything if one.sigma_m == sigma]
        days = sum(one.days for one in some)
        rows.append(
            {
                "sigma_m": sigma,
                "flights": len(some),
                "days": days,
                "named": sum(one.named for one in some),
                "wrong": sum(one.wrong for one in some),
                "doubts": sum(one.doubts for one in some),
                "excesses_per_day": {
                    f"{threshold:g}": sum(one.excesses[k] for one in some) / days
                    for k, threshold in enumerate(THRESHOLDS)
                },
                "largest_statistic": max(one.largest_statistic for one in some),
                "beyond_s": sum(one.beyond_s for one in some),
            }
        )
    return rows


def shortfalls(rows: list[dict[str, Any]]) -> list[str]:
    """What is asked and was not reached, in words."""
    said = []
    for one in rows:
        if one["speed_mps"] < WANTED_FROM_MPS:
            continue
        what = f"{one['speed_mps']:g} m/s, fixes of {one['sigma_m']:g} m"
        n = one["runs"]
        if one["alert_in_time"] < n:
            said.append(
                f"{what}: alert within {WANTED_S:g} s in {one['alert_in_time']} of {n} "
                f"(no test of these fixes before {one['limit_s']:.0f} s in the mean)"
            )
        if one["steady_in_time"] < n:
            said.append(f"{what}: steady within {WANTED_STEADY_S:g} s in {one['steady_in_time']} of {n}")
        if one["wrong"]:
            said.append(f"{what}: called a fault of the receiver in {one['wrong']} of {n}")
    return said


def table(rows: list[dict[str, Any]], healthy: list[dict[str, Any]]) -> str:
    """Figures as text."""
    lines = ["burns nobody announced; seconds since their start: median / 95 % / largest; error / bound"]
    lines.append(
        f"  {'fixes m':>7}{'m/s':>6}{'runs':>6}{'limit s':>9}{'alert s':>18}{'<=120':>6}{'named s':>18}{'wrong':>6}"
        f"{'largest m':>20}{'before':>8}{'after':>7}{'past':>6}{'<= 2 m from s':>18}{'steady s':>18}{'<=600':>6}"
    )
    for one in rows:
        lines.append(
            f"  {one['sigma_m']:>7g}{one['speed_mps']:>6g}{one['runs']:>6}{one['limit_s']:>9.1f}"
            f"{three(one['alert_s']):>18}{one['alert_in_time']:>6}{three(one['named_s']):>18}{one['wrong']:>6}"
            f"{three(one['largest_m'], 1):>20}{one['before']:>8.2f}{one['after']:>7.2f}{one['runs_beyond']:>6}"
            f"{three(one['near_s']):>18}{three(one['steady_s']):>18}{one['steady_in_time']:>6}"
        )
    lines.append("flights without a burn: alarms, and how often a day the statistic passes a threshold")
    head = "".join(f"{f'> {threshold:g}':>8}" for threshold in THRESHOLDS)
    lines.append(f"  {'fixes m':>7}{'days':>8}{'manoeuvre':>11}{'slow fault':>12}{'in doubt':>10}{head}{'largest':>9}")
    for one in healthy:
        rates = "".join(f"{rate:>8.2f}" for rate in one["excesses_per_day"].values())
        lines.append(
            f"  {one['sigma_m']:>7g}{one['days']:>8.1f}{one['named']:>11}{one['wrong']:>12}{one['doubts']:>10}{rates}"
            f"{one['largest_statistic']:>9.1f}"
        )
    return "\n".join(lines)


def three(spread: dict[str, float | None], digits: int = 0) -> str:
    """Median, 95 % and largest as text."""
    return " / ".join("-" if value is None else f"{value:.{digits}f}" for value in spread.values())


def as_document(found: list[Found], flights: list[Healthy]) -> dict[str, Any]:
    """Plain numbers for a JSON file; a time that was not reached is None."""
    rows = summarise(found)
    return {
        "burns": rows,
        "healthy": summarise_healthy(flights),
        "burn_runs": [
            {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(one).items()}
            for one in found
        ],
        "healthy_flights": [asdict(one) for one in flights],
        "shortfalls": shortfalls(rows),
    }
