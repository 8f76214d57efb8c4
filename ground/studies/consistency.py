"""Is the filter right about its own error? Errors against its covariance, innovations against theirs.

drawn: truth from the filter's own stochastic model (drawn_truth.py), an ensemble of runs. At fixed epochs the average
over the runs of the NEES (r, v: 6 states) and of the NIS (position, velocity: 3 each) is chi-square over their number:
Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4.2.
along: motions of which the filter knows forces only nearly, real orbits and satkit's: averages over time and outages.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd.alerts import AlertId
from ground.accuracy.bench_flight import nees
from ground.studies import arcs
from ground.studies.drawn_truth import draw

RUNS = 200
CHUNK = 10  # runs of one task
DRAWN_ORBIT = "simulated"
RECEIVERS = {"flight": arcs.WHITE, "flight_coloured": arcs.COLOURED}
AGES_S = (60, 300, 900, 2000)
WANTED_SHARE, WANTED_BEYOND = 0.9, 0.003
WANTED_LEAST, WANTED_MOST = 0.3, 1.1
ORBITS = ("simulated", "simulated_800", "gracefo", "sentinel3a")
FALSE_ALARMS = 1 << int(AlertId.MANOEUVRE_DETECTED) | 1 << int(AlertId.SLOW_FAULT)


class Plan(NamedTuple):
    """Seconds. Fixes for converged_s, then fixes_s with epochs, then outage_s with epochs, one every epoch_s.

    along_s: length of a flight along an orbit; outages begin every spacing_s of it. drawn_span_s: of the orbit on which
    drawn truths begin. coloured_seeds: flights of each orbit where the fixes are coloured, as six amplitudes are few.
    """

    converged_s: int = 4000
    fixes_s: int = 2000
    outage_s: int = 2000
    epoch_s: int = 100
    along_s: int = 86_000
    settled_s: int = 6000
    spacing_s: int = 1000
    drawn_span_s: int = 86_000
    coloured_seeds: int = 10

    @property
    def epochs_s(self) -> np.ndarray:
        """Ages since the first fix at which the ensemble is looked at."""
        return np.arange(self.converged_s, self.converged_s + self.fixes_s + self.outage_s, self.epoch_s)


QUICK = Plan(
    converged_s=600,
    fixes_s=300,
    outage_s=300,
    along_s=2900,
    settled_s=1500,
    spacing_s=500,
    drawn_span_s=2900,
    coloured_seeds=1,
)


class Task(NamedTuple):
    """Some runs of the ensemble, or (orbit not None) one flight along an orbit."""

    table_set: str
    plan: Plan
    numbers: tuple[int, ...]
    orbit: str | None = None
    overrides: tuple[tuple[str, Any], ...] = ()
    gravity: Path | None = None


class Ensemble(NamedTuple):
    """Of some runs (r) at all epochs (e): nees (r, e), nis (r, e, 2), alarms (r,); NaN where there is none."""

    nees: np.ndarray
    nis: np.ndarray
    alarms: np.ndarray


@dataclass(frozen=True)
class Along:
    """Along one orbit. nees_per_state: with fixes, and by age without; beyond: share of seconds past the bound.

    by_part: NEES by number of states of position and velocity alone, with fixes. alarms: of a fault there was none of.
    """

    table_set: str
    orbit: str
    seed: int
    rms_3d_m: float
    nees_fixes: float
    nees_position: float
    nees_velocity: float
    nis_position: float
    nis_velocity: float
    beyond_fixes: float
    outages: int
    nees_outage: dict[str, float]
    error_median_m: dict[str, float]
    error_largest_m: dict[str, float]
    worst_error_to_bound: float
    beyond_outage: float
    beyond: float
    alarms: int


def tasks(
    table_sets: Iterable[str], runs: int, plan: Plan, orbits: Iterable[str], overrides: Any, gravity: Path | None
) -> list[Task]:
    """All there is to fly, long ones first."""
    sets = list(table_sets)
    found = []
    for name in sets:
        seeds = range(plan.coloured_seeds) if RECEIVERS[name].coloured_m else range(1)
        found += [Task(name, plan, (seed,), orbit, overrides, gravity) for orbit in orbits for seed in seeds]
    for name in sets:
        for k in range(0, runs, CHUNK):
            found.append(Task(name, plan, tuple(range(k, min(k + CHUNK, runs))), None, overrides, gravity))
    return found


def fly(task: Task) -> Ensemble | Along:
    """Fly one task. Raises OperatorError where data or tables do not allow it."""
    return fly_drawn(task) if task.orbit is None else fly_along(task)


def fly_drawn(task: Task) -> Ensemble:
    """Runs of the ensemble: each its own truth, phase along the orbit, oscillator and noise."""
    plan = task.plan
    length = plan.converged_s + plan.fixes_s + plan.outage_s + 1
    sky = arcs.sky(DRAWN_ORBIT, plan.drawn_span_s, task.gravity)
    fresh = sky.memory(task.table_set, dict(task.overrides))
    receiver = RECEIVERS[task.table_set]
    rows: list[tuple[np.ndarray, np.ndarray, bool]] = []
    for number in task.numbers:
        noise = arcs.stream(1, number)
        first = int(noise.integers(0, len(sky) - length))
        track = draw(sky, fresh, first, length, noise)
        inputs = arcs.measured(sky, track, receiver, arcs.counter_of(fresh, length, noise), noise)
        inputs[plan.converged_s + plan.fixes_s :]["fix_present"] = 0
        inputs[plan.converged_s + plan.fixes_s :]["pulse_present"] = 0
        outputs = arcs.fly(arcs.fork(fresh), inputs)
        at = plan.epochs_s
        error = arcs.Errors.of(track, outputs)
        rows.append(
            (
                nees(error.both[at], outputs["covariance"][at]),
                outputs["type_nis"][at],
                bool(np.any(outputs["events"] & FALSE_ALARMS)),
            )
        )
    return Ensemble(*(np.array(column) for column in zip(*rows, strict=True)))


def fly_along(task: Task) -> Along:
    """One flight with fixes, and from it outages that each begin with its state."""
    assert task.orbit is not None
    plan, seed = task.plan, task.numbers[0]
    sky = arcs.sky(task.orbit, plan.along_s, task.gravity)
    noise = arcs.stream(2, seed, list(arcs.ALL_ORBITS).index(task.orbit))
    flight = arcs.Flight(sky, task.table_set, RECEIVERS[task.table_set], noise, dict(task.overrides))
    ages = [age for age in AGES_S if age <= plan.outage_s]
    starts = range(plan.settled_s, len(sky) - ages[0], plan.spacing_s)
    at_age: dict[int, list[tuple[float, float]]] = {age: [] for age in ages}
    past, seconds, worst = 0, 0, 0.0
    for start in starts:
        flight.until(start)
        end = min(start + ages[-1], len(sky))
        outputs = arcs.fly(arcs.fork(flight.memory), flight.blank(start, end))
        error = arcs.Errors.of(flight.track.part(start, end), outputs)
        values = nees(error.both, outputs["covariance"])
        ratio = np.nan_to_num(error.axis_m / outputs["bound_m"], nan=np.inf)
        past, seconds, worst = past + int(np.sum(ratio > 1.0)), seconds + len(ratio), max(worst, float(ratio.max()))
        for age in ages:
            if age <= end - start:
                at_age[age].append((values[age - 1] / 6.0, error.axis_m[age - 1]))
    flight.until()
    outputs, track = flight.outputs, flight.track
    steady = np.arange(len(outputs)) >= plan.settled_s
    error = arcs.Errors.of(track, outputs)
    beyond = ~(error.axis_m <= outputs["bound_m"])[steady]
    both, covariance = error.both[steady], outputs["covariance"][steady]
    return Along(
        task.table_set,
        task.orbit,
        seed,
        float(np.sqrt(np.mean(error.all_m[steady] ** 2))),
        float(np.mean(nees(both, covariance)) / 6.0),
        float(np.mean(nees(both[:, :3], covariance[:, :3, :3])) / 3.0),
        float(np.mean(nees(both[:, 3:], covariance[:, 3:, 3:])) / 3.0),
        float(np.nanmean(outputs["type_nis"][steady, 0]) / 3.0),
        float(np.nanmean(outputs["type_nis"][steady, 1]) / 3.0),
        float(beyond.mean()),
        len(starts),
        {str(age): float(np.mean([value for value, _ in pairs])) for age, pairs in at_age.items() if pairs},
        {str(age): float(np.median([value for _, value in pairs])) for age, pairs in at_age.items() if pairs},
        {str(age): float(np.max([value for _, value in pairs])) for age, pairs in at_age.items() if pairs},
        worst,
        past / seconds,
        (past + int(beyond.sum())) / (seconds + len(beyond)),
        int(np.sum((outputs["events"][steady] & FALSE_ALARMS) != 0)),
    )


def chi_square(dof: float, z: float) -> float:
    """Quantile of chi-square at the normal quantile z (Wilson and Hilferty, PNAS 17, 1931): to 1e-4 from 100 dof on."""
    spread = 2.0 / (9.0 * dof)
    return dof * (1.0 - spread + z * math.sqrt(spread)) ** 3


def band(states: int, runs: int) -> tuple[float, float]:
    """Of 95 % for the average over the runs of a chi-square of so many states, by their number: 1 in the mean."""
    dof = float(states * runs)
    return chi_square(dof, -1.959963984540054) / dof, chi_square(dof, 1.959963984540054) / dof


class Series(NamedTuple):
    """Ensemble averages by number of states at some epochs, their band, and the share inside it."""

    name: str
    t_s: list[float]
    mean: list[float]
    low: float
    high: float
    inside: float

    @classmethod
    def of(cls, name: str, t_s: np.ndarray, values: np.ndarray, states: int) -> Series:
        """Of values (runs, epochs)."""
        mean = values.mean(axis=0) / states
        low, high = band(states, len(values))
        inside = (mean >= low) & (mean <= high)
        return cls(name, t_s.tolist(), mean.tolist(), low, high, float(inside.mean()))


@dataclass(frozen=True)
class Drawn:
    """The ensemble of one table set."""

    table_set: str
    runs: int
    alarms: int
    series: list[Series]


def gathered(chosen: list[Task], results: list[Ensemble | Along]) -> tuple[list[Drawn], list[Along]]:
    """Figures of all tasks: an ensemble for each set, and every flight along an orbit."""
    along = [result for result in results if isinstance(result, Along)]
    drawn = []
    for name in dict.fromkeys(task.table_set for task in chosen):
        parts = [
            result
            for task, result in zip(chosen, results, strict=True)
            if task.table_set == name and isinstance(result, Ensemble)
        ]
        if not parts:
            continue
        plan = chosen[0].plan
        whole = Ensemble(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        t = plan.epochs_s
        fixes = t < plan.converged_s + plan.fixes_s
        series = [
            Series.of("NEES with fixes", t[fixes], whole.nees[:, fixes], 6),
            Series.of("NEES without", t[~fixes], whole.nees[:, ~fixes], 6),
            Series.of("NIS position", t[fixes], whole.nis[:, fixes, 0], 3),
            Series.of("NIS velocity", t[fixes], whole.nis[:, fixes, 1], 3),
        ]
        drawn.append(Drawn(name, len(whole.alarms), int(whole.alarms.sum()), series))
    return drawn, along


def shortfalls(drawn: list[Drawn], along: list[Along]) -> list[str]:
    """What is asked and was not reached, in words."""
    said = []
    for one in drawn:
        for series in one.series:
            if not series.inside >= WANTED_SHARE:
                said.append(f"{one.table_set}, drawn: {series.name} inside its band at {100 * series.inside:.0f} %")
    for name, orbit in dict.fromkeys((flight.table_set, flight.orbit) for flight in along):
        some = [flight for flight in along if (flight.table_set, flight.orbit) == (name, orbit)]
        values = {"with fixes": float(np.mean([flight.nees_fixes for flight in some]))}
        for age in some[0].nees_outage:
            values[f"{age} s without"] = float(np.mean([flight.nees_outage[age] for flight in some]))
        for when, value in values.items():
            if not WANTED_LEAST <= value <= WANTED_MOST:
                said.append(
                    f"{name}, {orbit}: NEES/n {value:.2f} {when}, wanted {WANTED_LEAST} to {WANTED_MOST}"
                    + (f" (mean of {len(some)} flights)" if len(some) > 1 else "")
                )
        beyond = float(np.mean([flight.beyond for flight in some]))
        if not beyond <= WANTED_BEYOND:
            said.append(f"{name}, {orbit}: past the bound for {100 * beyond:.2f} % of the time")
    return said


def table(drawn: list[Drawn], along: list[Along]) -> str:
    """Figures as text."""
    lines = []
    for one in drawn:
        lines.append(f"{one.table_set}: truth drawn from the filter's own model, {one.runs} runs")
        for s in one.series:
            lines.append(
                f"  {s.name:<16} {len(s.mean):>3} epochs, mean {np.mean(s.mean):.3f}, from {min(s.mean):.3f} to "
                f"{max(s.mean):.3f}; band {s.low:.3f} to {s.high:.3f}: inside at {100 * s.inside:.0f} %"
            )
        lines.append(f"  alarms in {one.alarms} of {one.runs} runs")
    if along:
        head = "".join(f"{f'{age} s':>8}" for age in along[0].nees_outage)
        lines.append("along orbits, NEES by number of states; error / bound and share past the bound")
        lines.append(
            f"  {'set':<16}{'orbit':<14}{'seed':>5}{'3-D m':>8}{'fixes':>8}{'r':>7}{'v':>7}{head}"
            f"{'worst':>8}{'past %':>8}{'alarms':>8}"
        )
    for f in along:
        lines.append(_row(f, f"{f.seed}"))
    for name, orbit in dict.fromkeys((f.table_set, f.orbit) for f in along):
        some = [f for f in along if (f.table_set, f.orbit) == (name, orbit)]
        if len(some) > 1:
            lines.append(_row(_mean(some), "mean"))
    missed = shortfalls(drawn, along)
    lines += [f"MISSED: {text}" for text in missed] or ["all that is asked is reached"]
    return "\n".join(lines)


def _row(f: Along, seed: str) -> str:
    ages = "".join(f"{value:>8.2f}" for value in f.nees_outage.values())
    return (
        f"  {f.table_set:<16}{f.orbit:<14}{seed:>5}{f.rms_3d_m:>8.2f}{f.nees_fixes:>8.2f}{f.nees_position:>7.2f}"
        f"{f.nees_velocity:>7.2f}{ages}{f.worst_error_to_bound:>8.2f}{100 * f.beyond:>8.3f}{f.alarms:>8}"
    )


def _mean(some: list[Along]) -> Along:
    """Of several seeds: means, but the worst of errors by bound, and the sum of alarms."""
    names = ("rms_3d_m", "nees_fixes", "nees_position", "nees_velocity", "beyond")
    means: dict[str, Any] = {name: float(np.mean([getattr(one, name) for one in some])) for name in names}
    return replace(
        some[0],
        **means,
        nees_outage={age: float(np.mean([one.nees_outage[age] for one in some])) for age in some[0].nees_outage},
        worst_error_to_bound=max(one.worst_error_to_bound for one in some),
        alarms=sum(one.alarms for one in some),
    )


def as_document(drawn: list[Drawn], along: list[Along]) -> dict[str, Any]:
    """Plain numbers for a JSON file."""
    return {
        "study": "consistency",
        "wanted": {"inside": WANTED_SHARE, "nees_per_state": [WANTED_LEAST, WANTED_MOST], "beyond": WANTED_BEYOND},
        "drawn": [{**asdict(one), "series": [series._asdict() for series in one.series]} for one in drawn],
        "along": [asdict(one) for one in along],
        "shortfalls": shortfalls(drawn, along),
    }
