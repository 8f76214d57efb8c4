"""The ensemble of (17) with its means, arcs of 2000 s a second: in lanes, on one processor and two; and one by one."""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.kernels import gravity, integrators
from flightsw.kernels.registry import I8, MATRIX, VECTOR, entry, records, warm_up
from flightsw.nav import filter
from flightsw.records import TABLE, WORK
from ground.tables.build import build_navigation
from ground.tuning import ensemble
from ground.tuning.lanes_step import LANES

EPOCHS = 2000
_ROW = np.array([1.0, 0.01, 1e-6, 12.0, 0.15])
_POLE = np.array([0.0, 0.0, 1.0])


@entry(records(TABLE), VECTOR, VECTOR, MATRIX, records(WORK), I8)
def _scalar(tables, pole, x, p, works, epochs):
    """The same work by flight's own kernels, one arc."""
    table, work = tables[0], works[0]
    for _ in range(epochs):
        gravity.gradient(table, x[0:3], pole, work.gradient)
        filter.transition(table, 1.0, work.gradient, work)
        integrators.euler(table, x, 1.0, pole, work.stages)
        filter.predict_covariance(table, 0, 1.0, p, work, p)
        filter.gain(p, work.R, work)
        filter.condition(p, work.R, work, p)


class Rate(NamedTuple):
    """One way: arcs of 2000 s in a second."""

    name: str
    arcs_per_s: float


def compare(rounds: int = 60) -> list[Rate]:
    """All ways in turn, the best of some rounds each: so many steps that no neighbour of this machine is in all."""
    warm_up()
    table, work = np.zeros(1, TABLE), np.zeros(1, WORK)
    values = decode(build_navigation("paper")).values
    for name in values.dtype.names or ():
        table[name] = values[name]
    table["gravity_model"], table["integrator"] = gravity.J2, integrators.EULER
    work["R"][0] = np.diag(np.repeat(_ROW[3:] ** 2, 3))
    field = ensemble.Field(float(table["mu_m3ps2"][0]), float(table["j2"][0]), 6_378_136.3, _POLE)
    few, many = 2 * LANES, 64 * LANES
    x0, p0 = np.zeros((many, 9)), np.tile(np.diag(np.repeat([100.0, 1.0, 1e-6], 3)), (many, 1, 1))
    x0[:, 0], x0[:, 4], x0[:, 5] = 6_878_136.3, 3800.0, 6580.0
    ways = {
        "lanes, one thread": (few, 200, 1),
        f"lanes, one thread, {many} arcs": (many, EPOCHS, 1),
        f"lanes, two threads, {many} arcs": (many, EPOCHS, 2),
    }
    least = dict.fromkeys([*ways, "flight's kernels, one arc"], math.inf)
    for turn in range(rounds):
        for name, (arcs, epochs, threads) in ways.items():
            if arcs == many and turn % 10:
                continue
            began = time.perf_counter()
            ensemble.fly(x0[:arcs], p0[:arcs], field, _ROW, epochs, threads=threads)
            least[name] = min(least[name], (time.perf_counter() - began) / (arcs * epochs))
        x, p = x0[0].copy(), p0[0].copy()
        began = time.perf_counter()
        _scalar(table, _POLE, x, p, work, EPOCHS)
        last = "flight's kernels, one arc"
        least[last] = min(least[last], (time.perf_counter() - began) / EPOCHS)
    return [Rate(name, 1.0 / (EPOCHS * seconds)) for name, seconds in least.items()]
