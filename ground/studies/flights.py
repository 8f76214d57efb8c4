"""Flights for studies: a scenario prepared once, flown through the compiled arc with any table, many in parallel."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from flightsw.icd.table_file import TableImage, decode
from flightsw.kernels.registry import warm_up
from ground.campaign import flown
from ground.errors import OperatorError
from ground.tables.build import build_navigation
from ground.tables.earth_orientation import build_earth_orientation
from ground.workers import serve
from hil_sim import scenario
from hil_sim.errors import SimulationError
from hil_sim.evaluation import evaluate
from hil_sim.truth.interface import TrackTruth
from hil_sim.world import World, build_truth, earth_orientation_file

NS = 1_000_000_000
HOUR_NS = 3600 * NS
TICK_NS = 100_000_000  # of a run
COARSE_TICK_NS = NS  # where only the filter's own epochs matter

Item = TypeVar("Item")
Result = TypeVar("Result")
Advance = Callable[[], None]


@dataclass(frozen=True)
class Prepared:
    """A world with everything the step is told in it; the truth of its dA costs nothing until asked for."""

    world: World
    inputs: tuple[np.ndarray, np.ndarray]
    orientation: TableImage

    @property
    def age_s(self) -> np.ndarray:
        """True age of the scenario at each tick (n_ticks,) [s]."""
        return (self.world.t_true_gps_ns - self.world.t_start_gps_ns) / NS

    def table(self, overrides: Mapping[str, Any] | None = None) -> TableImage:
        """The scenario's navigation table, with overrides on top of the scenario's own."""
        flight = self.world.scenario.flight
        return decode(build_navigation(flight.table_set, {**flight.table, **(overrides or {})} or None))

    def fly(self, navigation: TableImage) -> tuple[np.ndarray, dict[str, Any]]:
        """OUTPUT of every tick (n_ticks,), and what a monitor would hold."""
        return flown.fly_world(self.world, navigation, self.orientation, self.inputs)

    def evaluate(self, monitor: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """The figures of summary.json, exactly as for a run."""
        return evaluate(self.world.truth_arrays(), monitor)

    def error_m(self, outputs: np.ndarray) -> np.ndarray:
        """Published minus true position at the true instant of each tick, largest GCRF axis (n_ticks,) [m]."""
        return np.abs(outputs["r_gcrf_m"] - self.world.r_true_gcrf_m).max(axis=1)


def load(name: str, settings: Iterable[str] = ()) -> scenario.LoadedScenario:
    """A scenario with settings, checked but not made ready. Raises OperatorError where they contradict it."""
    try:
        return scenario.load(name, tuple(settings))
    except SimulationError as error:
        raise OperatorError(str(error)) from error


def prepare(name: str, settings: Iterable[str] = (), tick_period_ns: int = TICK_NS) -> Prepared:
    """A scenario made ready to fly. Raises OperatorError where scenario or settings do not allow it."""
    loaded = load(name, settings)
    try:
        world = World.build(loaded, tick_period_ns)
        finals = earth_orientation_file(loaded)
    except SimulationError as error:
        raise OperatorError(str(error)) from error
    stop_gps_ns = int(world.t_true_gps_ns[-1])
    orientation = _orientation(world.t_start_gps_ns - HOUR_NS, stop_gps_ns + HOUR_NS, finals)
    return Prepared(world, flown.step_inputs(world), orientation)


def true_motion(name: str, settings: Iterable[str] = ()) -> tuple[TrackTruth, int]:
    """The true motion of a scenario, without sensors or frames, and when the scenario starts [GPS ns]."""
    loaded = load(name, settings)
    try:
        return build_truth(loaded), loaded.t_start_gps_ns
    except SimulationError as error:
        raise OperatorError(str(error)) from error


@lru_cache(maxsize=8)
def _orientation(start_gps_ns: int, stop_gps_ns: int, finals: Path | None) -> TableImage:
    return decode(build_earth_orientation(start_gps_ns, stop_gps_ns, finals))


@contextmanager
def pool(jobs: int) -> Iterator[ProcessPoolExecutor | None]:
    """Worker processes with kernels ready, or None for one job: then work is done here. Kernels are ready here too."""
    warm_up()
    if jobs <= 1:
        yield None
        return
    context = multiprocessing.get_context("spawn")  # a fork would copy the threads of numba and satkit half alive
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_make_ready, initargs=(os.getpid(),)) as executor:
        yield executor


def _make_ready(parent: int) -> None:
    serve(parent)
    warm_up()  # by a function of this module: a worker imports, and so declares, all kernels on the way here


def each(
    workers: ProcessPoolExecutor | None,
    work: Callable[[Item], Result],
    items: Iterable[Item],
    advance: Advance,
) -> list[Result]:
    """`work` on every item, in order; `advance` is called after each."""
    results = []
    for result in map(work, items) if workers is None else workers.map(work, items):
        results.append(result)
        advance()
    return results


def usual_jobs() -> int:
    """Worker processes when the operator names no number: two, if there are two processors."""
    return min(2, os.cpu_count() or 1)


@contextmanager
def progress_bar(label: str, total: int) -> Iterator[Advance]:
    """A bar on stderr; yields the function that moves it on by one."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as progress:
        task = progress.add_task(label, total=total)
        yield lambda: progress.advance(task)
