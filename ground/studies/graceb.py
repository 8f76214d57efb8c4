"""GRACE-B's real receiver end to end: what its fixes err by, what the filter makes of them, what it bridges without.

The world's receiver solves the recorded observations, flight takes them from its frames, the truth is the precise orbit
of the same satellite. Gaps: from many epochs of one flight with all fixes, its navigation record is copied and flown on
without any; no epoch is left out.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.memory import Memory
from flightsw.records import INPUT
from ground.campaign import arc
from ground.errors import OperatorError
from ground.studies.flights import NS, TICK_NS, Prepared, prepare
from ground.tables.forces import build_force_tables

SCENARIO = "graceb_real"
CONVERGED_S = 8000.0  # a revolution and a half
GAP_S = 2000
GAP_STEP_S = 1000.0  # between the beginnings of gaps
AGES_S = (300, 900, 2000)

# what is asked of the filter, in metres: median 3-D error with fixes (and the goal), largest error within any gap
WANTED_MEDIAN_M, GOAL_MEDIAN_M, WANTED_GAP_M, WANTED_GAPS = 1.3, 0.9, 10.0, 10


class Variant(NamedTuple):
    """A way to use the recording: name, what it is, settings of the scenario."""

    name: str
    words: str
    settings: tuple[str, ...] = ()


VARIANTS = (
    Variant("positions", "positions by pseudoranges, the satellites' antennas in their places"),
    Variant(
        "plain",
        "positions by pseudoranges to the satellites' centres of mass, as far as the orbit files alone go",
        ("gnss.recorded_antennas=false", "flight.table.gnss_bias_sigma_m=1.5"),
    ),
    Variant("velocities", "positions, and velocities by carrier phase", ("gnss.velocity=true",)),
)


@dataclass(frozen=True)
class Spread:
    """Median, 95 %, root mean square and largest of some errors."""

    median: float
    q95: float
    rms: float
    largest: float

    @classmethod
    def of(cls, errors: np.ndarray) -> Spread:
        """Of errors (n,)."""
        return cls(
            float(np.median(errors)),
            float(np.quantile(errors, 0.95)),
            float(np.sqrt(np.mean(errors**2))),
            float(errors.max()),
        )


@dataclass(frozen=True)
class Found:
    """Figures of one variant. Errors 3-D but in gaps: there the largest GCRF axis, as in all outages.

    raw_m: fixes against the true place of the antenna. filtered_m, filtered_mps: published state from CONVERGED_S on.
    gap_start_s, gap_largest_m, gap_worst_to_bound: of each gap (list). gap_m: age -> Spread over the gaps.
    beyond_bound, epochs: ticks with fixes at which the largest axis was beyond the published bound, of how many.
    """

    variant: str
    fixes: int
    raw_m: Spread
    started_s: float
    filtered_m: Spread
    filtered_mps: Spread
    beyond_bound: int
    epochs: int
    gap_start_s: list[float]
    gap_largest_m: list[float]
    gap_worst_to_bound: list[float]
    gap_m: dict[str, Spread]

    @property
    def shortfalls(self) -> list[str]:
        """What is asked and was not reached, in words."""
        said = []
        if not self.filtered_m.median <= WANTED_MEDIAN_M:
            said.append(f"median {self.filtered_m.median:.2f} m with fixes, wanted {WANTED_MEDIAN_M} m")
        if not max(self.gap_largest_m) <= WANTED_GAP_M:
            said.append(f"{max(self.gap_largest_m):.1f} m in a gap, wanted {WANTED_GAP_M:g} m")
        if len(self.gap_largest_m) < WANTED_GAPS:
            said.append(f"{len(self.gap_largest_m)} gaps, wanted {WANTED_GAPS}")
        return said


class Task(NamedTuple):
    """A variant with the operator's settings."""

    variant: Variant
    settings: tuple[str, ...]


def tasks(settings: Iterable[str] = ()) -> list[Task]:
    """All flights of the study."""
    return [Task(variant, tuple(settings)) for variant in VARIANTS]


def fly(task: Task) -> Found:
    """Solve, fly, and fly the gaps of one variant. Raises OperatorError where data or settings do not allow it."""
    prepared = prepare(SCENARIO, (*task.variant.settings, *task.settings), TICK_NS)
    world = prepared.world
    inputs, ticks = prepared.inputs
    memory = Memory()
    memory.load(prepared.table().values, prepared.orientation.values)
    memory.load_forces(*(decode(table).values for table in build_force_tables(world.t_start_gps_ns)))
    starts = np.searchsorted(prepared.age_s, np.arange(CONVERGED_S, prepared.age_s[-1] - GAP_S - 1.0, GAP_STEP_S))
    if not len(starts):
        raise OperatorError(f"time.duration_s: give more than {CONVERGED_S + GAP_S:g} s, for one gap at least")
    flown, gaps, done = [], [], 0
    for tick, call in zip(starts.tolist(), np.searchsorted(ticks, starts).tolist(), strict=True):
        flown.append(arc.fly(memory, inputs[done:call]))
        done = call
        gaps.append(_gap(prepared, memory, tick))
    flown.append(arc.fly(memory, inputs[done:]))
    outputs = np.concatenate(flown)[np.concatenate((np.flatnonzero(np.diff(ticks)), [len(ticks) - 1]))]
    error_m, bound_m = np.stack([gap[0] for gap in gaps]), np.stack([gap[1] for gap in gaps])
    truth = world.truth_arrays()
    started = np.isfinite(outputs["r_gcrf_m"]).all(axis=1) & (outputs["mode"] > 0)
    if not started.any():
        raise OperatorError("the filter never started; look at flight.table with `hil_sim run graceb_real`")
    error = outputs["r_gcrf_m"] - world.r_true_gcrf_m
    steady = started & (prepared.age_s >= CONVERGED_S)
    return Found(
        task.variant.name,
        len(truth["fix_error_m"]),
        Spread.of(np.linalg.norm(truth["fix_error_m"], axis=1)),
        float(prepared.age_s[np.argmax(started)]),
        Spread.of(np.linalg.norm(error[steady], axis=1)),
        Spread.of(np.linalg.norm((outputs["v_gcrf_mps"] - world.v_true_gcrf_mps)[steady], axis=1)),
        int(np.sum(~(np.abs(error[steady]).max(axis=1) <= outputs["bound_m"][steady]))),
        int(steady.sum()),
        prepared.age_s[starts].tolist(),
        error_m.max(axis=1).tolist(),
        (error_m / bound_m).max(axis=1).tolist(),
        {str(age): Spread.of(error_m[:, age * NS // world.tick_period_ns]) for age in AGES_S},
    )


def _gap(prepared: Prepared, memory: Memory, tick: int) -> tuple[np.ndarray, np.ndarray]:
    """Largest-axis error and bound [m] of every tick from `tick` to GAP_S later, without fixes."""
    world = prepared.world
    span = np.arange(tick, tick + GAP_S * NS // world.tick_period_ns + 1)
    blank = np.zeros(len(span), INPUT)
    blank["counter_now_ns"] = world.counter0_ns + span * world.tick_period_ns
    coasting = Memory()
    coasting.share_tables(memory)
    coasting.nav[:] = memory.nav
    outputs = arc.fly(coasting, blank)
    return np.abs(outputs["r_gcrf_m"] - world.r_true_gcrf_m[span]).max(axis=1), outputs["bound_m"]


def table(found: Iterable[Found]) -> str:
    """Figures as text."""
    words = {variant.name: variant.words for variant in VARIANTS}
    lines = []
    for one in found:
        lines.append(f"{one.variant}: {words[one.variant]}")
        lines.append(f"  {'3-D error':<24}{'median':>10}{'95 %':>10}{'rms':>10}{'largest':>10}")
        lines.append(_line(f"{one.fixes} fixes, raw", one.raw_m, "m", 1.0))
        lines.append(_line("filtered position", one.filtered_m, "m", 1.0))
        lines.append(_line("filtered velocity", one.filtered_mps, "mm/s", 1e3))
        lines.append(
            f"  started after {one.started_s:.0f} s; beyond the bound {one.beyond_bound} of {one.epochs} ticks"
        )
        lines.append(f"  {len(one.gap_largest_m)} gaps of {GAP_S} s, largest axis")
        lines += [_line(f"  after {age} s", spread, "m", 1.0) for age, spread in one.gap_m.items()]
        lines.append(
            f"  largest within any gap {max(one.gap_largest_m):.2f} m, error / bound at most "
            f"{max(one.gap_worst_to_bound):.2f}"
        )
        reached = "the goal too" if one.filtered_m.median <= GOAL_MEDIAN_M else f"not the goal of {GOAL_MEDIAN_M} m"
        lines.append(f"  {'MISSED: ' + '; '.join(one.shortfalls) if one.shortfalls else 'reached, ' + reached}")
    return "\n".join(lines)


def _line(name: str, spread: Spread, unit: str, scale: float) -> str:
    values = "".join(f"{scale * value:>10.2f}" for value in (spread.median, spread.q95, spread.rms, spread.largest))
    return f"  {name:<24}{values} {unit}"


def as_document(found: Iterable[Found]) -> dict[str, Any]:
    """Plain numbers for a JSON file."""
    return {
        "study": "graceb",
        "scenario": SCENARIO,
        "wanted": {"median_3d_m": WANTED_MEDIAN_M, "goal_3d_m": GOAL_MEDIAN_M, "gap_largest_m": WANTED_GAP_M},
        "variants": [{**asdict(one), "shortfalls": one.shortfalls} for one in found],
    }
