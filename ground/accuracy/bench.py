"""Accuracy on real orbits: how good the state is with fixes, and how fast its error grows without them.

Fixes are simulated from the real truth, so the error of every published state is known. One long flight with fixes
is flown once; at each outage start its navigation record is copied and flown on without fixes. No start is dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.memory import Memory
from flightsw.nav.flight_model import FLIGHT
from flightsw.records import INPUT
from ground.campaign import arc
from ground.errors import OperatorError
from ground.studies.flights import COARSE_TICK_NS, NS, Prepared, prepare
from ground.tables.forces import build_force_tables

AGES_S = (60, 300, 900, 2000, 5580, 7200)
CONVERGENCE_S = 12_000.0  # two revolutions before the first outage
START_STEP_S = 1000.0  # outage starts at least so far apart


class Orbit(NamedTuple):
    """A real orbit: the shipped scenario that reads it, and settings on top (start, duration, file)."""

    name: str
    scenario: str
    settings: tuple[str, ...]


ORBITS = {
    "sentinel3a": Orbit(
        "sentinel3a", "sentinel3a_outage", ('time.start="2018-12-30T00:00:00"', "time.duration_s=86400.0")
    ),
    "gracefo": Orbit("gracefo", "gracefo_outage", ('time.start="2021-07-17T00:05:00"', "time.duration_s=85400.0")),
    "jason2": Orbit(
        "jason2",
        "sentinel3a_outage",
        (
            'time.start="2008-08-31T00:00:00"',
            "time.duration_s=86400.0",
            'orbit.file="leo_sp3/grgja203.b08243.e08247.D_S.sp3.gz"',
            'orbit.satellite="L27"',
            'orbit.velocity_unit="m/s"',
        ),
    ),
}

PROFILES: dict[str, tuple[str, ...]] = {
    "white": ("gnss.sigma_position_m=10.0", "gnss.sigma_velocity_mps=0.1"),
    "coloured": (
        "gnss.sigma_position_m=10.0",
        "gnss.sigma_velocity_mps=0.1",
        "gnss.coloured_sigma_m=5.0",
        "gnss.coloured_tau_s=300.0",
    ),
}


@dataclass(frozen=True)
class Accuracy:
    """Figures of one orbit. Errors in metres: `steady_*` three-dimensional, outages largest GCRF axis.

    outage_m, outage_bound_m: (starts, ages) error and bound at AGES_S after the last fix.
    """

    orbit: str
    profile: str
    table_set: str
    converged_s: float | None
    steady_rms_3d_m: float
    steady_rms_3d_mps: float
    steady_max_3d_m: float
    start_s: np.ndarray
    outage_m: np.ndarray
    outage_bound_m: np.ndarray

    def summary(self) -> dict[str, Any]:
        """Plain numbers for accuracy.json."""
        ages = {
            str(age): {
                "median_m": float(np.median(error)),
                "q997_m": float(np.quantile(error, 0.997)),
                "max_m": float(error.max()),
                "worst_error_to_bound": float(np.max(error / bound)),
            }
            for age, error, bound in zip(AGES_S, self.outage_m.T, self.outage_bound_m.T, strict=True)
        }
        return {
            "orbit": self.orbit,
            "profile": self.profile,
            "table_set": self.table_set,
            "converged_s": self.converged_s,
            "steady_rms_3d_m": self.steady_rms_3d_m,
            "steady_rms_3d_mps": self.steady_rms_3d_mps,
            "steady_max_3d_m": self.steady_max_3d_m,
            "starts": len(self.start_s),
            "ages": ages,
        }


def measure(
    orbit: Orbit,
    profile: str,
    table_set: str = "j2",
    overrides: Mapping[str, Any] | None = None,
    gravity: Path | None = None,
    advance: Callable[[int, int], None] | None = None,
) -> Accuracy:
    """Fly one orbit with one fix profile. Raises OperatorError where data or settings do not allow it."""
    prepared = prepare(
        orbit.scenario,
        (*orbit.settings, "outage=[]", f'flight.table_set="{table_set}"', *PROFILES[profile]),
        COARSE_TICK_NS,
    )
    inputs, ticks = prepared.inputs
    memory = Memory()
    navigation = prepared.table(overrides).values
    memory.load(navigation, prepared.orientation.values)
    if int(navigation["filter_model"][0]) == FLIGHT:
        tables = build_force_tables(prepared.world.t_start_gps_ns, gravity_path=gravity)
        memory.load_forces(*(decode(table).values for table in tables))
    starts = _start_ticks(prepared)
    if not len(starts):
        raise OperatorError(f"{orbit.name}: too short for {CONVERGENCE_S:g} s of fixes and {AGES_S[-1]} s without")
    flown: list[np.ndarray] = []
    errors, bounds = [], []
    calls = np.searchsorted(ticks, starts)
    done = 0
    for index, (tick, call) in enumerate(zip(starts, calls, strict=True)):
        flown.append(arc.fly(memory, inputs[done:call]))
        done = int(call)
        error, bound = _outage(prepared, memory, int(tick))
        errors.append(error)
        bounds.append(bound)
        if advance is not None:
            advance(index + 1, len(starts))
    flown.append(arc.fly(memory, inputs[done:]))
    outputs = np.concatenate(flown)
    position, velocity = _errors_3d(prepared, outputs, ticks)
    age_s = prepared.age_s[ticks]
    steady = age_s >= CONVERGENCE_S
    rms = float(np.sqrt(np.mean(position[steady] ** 2)))
    return Accuracy(
        orbit.name,
        profile,
        table_set,
        _converged_s(age_s, position, rms),
        rms,
        float(np.sqrt(np.mean(velocity[steady] ** 2))),
        float(position[steady].max()),
        prepared.age_s[starts],
        np.array(errors),
        np.array(bounds),
    )


def _start_ticks(prepared: Prepared) -> np.ndarray:
    """Ticks at which an outage starts: evenly spaced from convergence to the last that leaves room for all ages."""
    last_s = prepared.age_s[-1] - AGES_S[-1] - 2.0
    starts_s = np.arange(CONVERGENCE_S, last_s, START_STEP_S)
    return np.searchsorted(prepared.age_s, starts_s)


def _outage(prepared: Prepared, memory: Memory, tick: int) -> tuple[np.ndarray, np.ndarray]:
    """Largest-axis error and bound at AGES_S after tick, flown from a copy of the navigation record."""
    world = prepared.world
    span = np.arange(tick, tick + AGES_S[-1] * NS // world.tick_period_ns + 1)
    blank = np.zeros(len(span), INPUT)
    blank["counter_now_ns"] = world.counter0_ns + span * world.tick_period_ns
    coasting = Memory()
    coasting.share_tables(memory)
    coasting.nav[:] = memory.nav
    outputs = arc.fly(coasting, blank)
    at = [int(age * NS // world.tick_period_ns) for age in AGES_S]
    error = np.abs(outputs["r_gcrf_m"] - world.r_true_gcrf_m[span]).max(axis=1)
    return error[at], outputs["bound_m"][at]


def _errors_3d(prepared: Prepared, outputs: np.ndarray, ticks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    world = prepared.world
    r = np.linalg.norm(outputs["r_gcrf_m"] - world.r_true_gcrf_m[ticks], axis=1)
    v = np.linalg.norm(outputs["v_gcrf_mps"] - world.v_true_gcrf_mps[ticks], axis=1)
    return np.nan_to_num(r, nan=np.inf), np.nan_to_num(v, nan=np.inf)


def _converged_s(age_s: np.ndarray, position: np.ndarray, steady_rms_m: float) -> float | None:
    """Age from which the 3-D error stays below three times its steady rms for ten minutes."""
    good = position < 3.0 * steady_rms_m
    bad_until = -np.inf
    for age, ok in zip(age_s, good, strict=True):
        if not ok:
            bad_until = age
        elif age - max(bad_until, 0.0) >= 600.0:
            return float(max(bad_until, 0.0))
    return None


def table(results: Iterable[Accuracy]) -> str:
    """Results as text, a line for each orbit and age."""
    lines = []
    for result in results:
        lines.append(
            f"{result.orbit}, {result.profile} fixes, set {result.table_set}: steady 3-D rms "
            f"{result.steady_rms_3d_m:.2f} m, {1e3 * result.steady_rms_3d_mps:.2f} mm/s; {len(result.start_s)} outages"
        )
        lines.append(f"  {'age':>7} {'median':>10} {'99.7 %':>10} {'max':>10} {'max error/bound':>16}")
        for age, error, bound in zip(AGES_S, result.outage_m.T, result.outage_bound_m.T, strict=True):
            lines.append(
                f"  {age:>5} s {np.median(error):>8.2f} m {np.quantile(error, 0.997):>8.2f} m "
                f"{error.max():>8.2f} m {np.max(error / bound):>16.2f}"
            )
    return "\n".join(lines)
