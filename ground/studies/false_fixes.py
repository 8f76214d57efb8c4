"""Fixes that are wrong: jumps, frozen and repeated ones through the frames, ramps in hundreds of directions.

A ramp is flown twice with the same noise, with it and without: the difference of the published positions is what the
state has absorbed of it. In a consistent ramp the velocity agrees with the positions: to a single receiver that is a
manoeuvre, or nothing at all; it shows what cannot be found.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd.alerts import AlertId
from flightsw.icd.table_file import decode
from flightsw.memory import Memory
from ground.accuracy.bench_cases import Case, Plan
from ground.accuracy.bench_flight import force_tables
from ground.studies import arcs
from ground.studies.flights import COARSE_TICK_NS, NS, Prepared, prepare

WANTED_S, WANTED_M = 300.0, 5.0
RAMP_MPS = 0.1
SLOW_FAULT, MANOEUVRE, DOUBT = (
    1 << int(alert) for alert in (AlertId.SLOW_FAULT, AlertId.MANOEUVRE_DETECTED, AlertId.FIXES_IN_DOUBT)
)
RAMP, CONSISTENT = "position_ramp", "consistent_ramp"
ORBITS = ("simulated", "gracefo", "sentinel3a")

# name, fault of the scenario, whether each fix in it must be refused
FRAMES = (
    ("jump of 500 m, 1 s", 'kind="position_step", value=500.0, duration_s=1.0'),
    ("jump of 500 m, 60 s", 'kind="position_step", value=500.0, duration_s=60.0'),
    ("jump of 500 m, 300 s", 'kind="position_step", value=500.0, duration_s=300.0'),
    ("frozen fix, new tag, 60 s", 'kind="frozen_fix", duration_s=60.0'),
    ("frozen fix, old tag, 60 s", 'kind="frozen_fix", hold_time=true, duration_s=60.0'),
    ("repeated frames, 60 s", 'kind="repeat_counter", duration_s=60.0'),
)
FAULT_AT_S, FRAMES_RUN_S = 3000.0, 3900.0


class Ramps(NamedTuple):
    """Ramps along one orbit: kind, how fast [m/s], from every spacing_s of a long flight, directions at each."""

    orbit: str
    table_set: str
    kind: str
    speed_mps: float
    along_s: int = 86_000
    settled_s: int = 6000
    spacing_s: int = 1000
    directions: int = 2
    watched_s: int = 600
    seed: int = 0
    overrides: tuple[tuple[str, Any], ...] = ()
    gravity: Path | None = None


class Frames(NamedTuple):
    """A fault of FRAMES through the frames, with one seed and axis of ITRF."""

    number: int
    seed: int
    axis: str
    table_set: str
    overrides: tuple[tuple[str, Any], ...] = ()
    gravity: Path | None = None


@dataclass(frozen=True)
class Ramp:
    """One ramp. Times since its beginning [s], infinite: never. doubt_s: alert FIXES_IN_DOUBT; found_s: SLOW_FAULT;
    misnamed_s: MANOEUVRE_DETECTED. absorbed_m: largest 3-D difference to the twin; last_m at the end. beyond_s:
    seconds past the bound."""

    orbit: str
    kind: str
    speed_mps: float
    start_s: int
    doubt_s: float
    found_s: float
    misnamed_s: float
    absorbed_m: float
    last_m: float
    error_m: float
    worst_error_to_bound: float
    beyond_s: int


@dataclass(frozen=True)
class Struck:
    """One fault through the frames. used: fixes used while it acted; moved_m: largest 3-D error until the end of the
    run; restarted: the state was replaced by what the fixes said."""

    fault: str
    seed: int
    axis: str
    used: int
    moved_m: float
    worst_error_to_bound: float
    restarted: bool
    accepted_again_s: float


def fly_ramps(task: Ramps) -> list[Ramp]:
    """All ramps of one flight."""
    sky = arcs.sky(task.orbit, task.along_s, task.gravity)
    noise = arcs.stream(4, task.seed, list(arcs.ALL_ORBITS).index(task.orbit))
    flight = arcs.Flight(sky, task.table_set, arcs.WHITE, noise, dict(task.overrides))
    found = []
    age_s = np.arange(task.watched_s)[:, None]
    for start in range(task.settled_s, len(sky) - task.watched_s, task.spacing_s):
        flight.until(start)
        track = flight.track.part(start, start + task.watched_s)
        for _ in range(task.directions):
            inputs = flight.measured(track, noise)
            plain = arcs.fly(arcs.fork(flight.memory), inputs)
            direction = noise.standard_normal(3)
            direction *= task.speed_mps / np.linalg.norm(direction)
            inputs["fix_r_itrf_m"] += age_s * direction
            if task.kind == CONSISTENT:
                inputs["fix_v_itrf_mps"] += direction
            outputs = arcs.fly(arcs.fork(flight.memory), inputs)
            found.append(_ramp(task, start, track, plain, outputs))
    return found


def _ramp(task: Ramps, start: int, track: arcs.Track, plain: np.ndarray, outputs: np.ndarray) -> Ramp:
    absorbed = np.linalg.norm(outputs["r_gcrf_m"] - plain["r_gcrf_m"], axis=1)
    error = arcs.Errors.of(track, outputs)
    ratio = np.nan_to_num(error.axis_m / outputs["bound_m"], nan=np.inf)
    return Ramp(
        task.orbit,
        task.kind,
        task.speed_mps,
        start,
        first(outputs["alerts"] & DOUBT),
        first(outputs["events"] & SLOW_FAULT),
        first(outputs["events"] & MANOEUVRE),
        float(np.nan_to_num(absorbed, nan=np.inf).max()),
        float(absorbed[-1]),
        float(error.all_m.max()),
        float(ratio.max()),
        int(np.sum(ratio > 1.0)),
    )


def first(said: np.ndarray) -> float:
    """Second of the first that is not zero; infinite where there is none."""
    at = np.flatnonzero(said)
    return float(at[0]) if len(at) else np.inf


def fly_frames(task: Frames) -> Struck:
    """One world with a fault, flown through the frames of the bus."""
    name, fault = FRAMES[task.number]
    case = Case(arcs.ALL_ORBITS["simulated"], "white", Plan.of(86_400), task.table_set, (), task.gravity)
    axis = "" if "position" not in fault else f', axis="{task.axis}"'
    settings = (
        *case.scenario_settings(0),
        f"time.duration_s={FRAMES_RUN_S!r}",
        f"seed={task.seed + 1}",
        f"fault=[{{start_s={FAULT_AT_S!r}, {fault}{axis}}}]",
    )
    prepared = prepare(case.orbit.scenario, settings, COARSE_TICK_NS)
    memory = Memory()
    memory.load(prepared.table(dict(task.overrides)).values, prepared.orientation.values)
    memory.load_forces(*(decode(table).values for table in force_tables(case, prepared.world.t_start_gps_ns)))
    return _struck(task, name, prepared, arcs.fly(memory, prepared.inputs[0]))


def _struck(task: Frames, name: str, prepared: Prepared, calls: np.ndarray) -> Struck:
    inputs, ticks = prepared.inputs
    world = prepared.world
    (fault,) = world.scenario.fault
    # a fix of the last second before it may arrive late; a repeated fix has its tag, so go by when it arrives
    age_s = prepared.age_s[ticks]
    acting = (age_s > fault.start_s + 1.5) & (age_s <= fault.start_s + fault.duration_s + 0.5)
    if fault.duration_s < 2.0:
        t = (inputs["fix_gps_ns"] - world.t_start_gps_ns) / NS
        acting = (inputs["fix_present"] == 1) & (t >= fault.start_s) & (t < fault.start_s + fault.duration_s)
    after = age_s >= fault.start_s
    outputs = calls[np.r_[np.flatnonzero(np.diff(ticks)), len(ticks) - 1]]
    later = prepared.age_s >= fault.start_s
    error = outputs["r_gcrf_m"][later] - world.r_true_gcrf_m[later]
    ratio = np.nan_to_num(np.abs(error).max(axis=1) / outputs["bound_m"][later], nan=np.inf)
    restarts = 1 << int(AlertId.REINITIALISED) | 1 << int(AlertId.DIVERGED)
    ended = age_s > fault.start_s + fault.duration_s + 0.5
    again = np.flatnonzero(ended & (calls["fix_used"] == 1))
    return Struck(
        name,
        task.seed,
        task.axis,
        int(calls["fix_used"][acting].sum()),
        float(np.nan_to_num(np.linalg.norm(error, axis=1), nan=np.inf).max()),
        float(ratio.max()),
        bool(np.any(calls["events"][after] & restarts)),
        float(age_s[again[0]] - fault.start_s - fault.duration_s) if len(again) else np.inf,
    )


def summarise_ramps(ramps: Iterable[Ramp]) -> list[dict[str, Any]]:
    """One summary for each kind and speed."""
    everything = list(ramps)
    found = []
    for kind, speed in dict.fromkeys((one.kind, one.speed_mps) for one in everything):
        some = [one for one in everything if (one.kind, one.speed_mps) == (kind, speed)]
        found.append(
            {
                "kind": kind,
                "speed_mps": speed,
                "runs": len(some),
                "found_in_time": sum(one.found_s <= WANTED_S for one in some),
                "found": sum(bool(np.isfinite(one.found_s)) for one in some),
                "misnamed_first": sum(one.misnamed_s < one.found_s for one in some),
                "neither": sum(not np.isfinite(min(one.found_s, one.misnamed_s)) for one in some),
                "found_s": quantiles(one.found_s for one in some),
                "doubt_s": quantiles(one.doubt_s for one in some),
                "absorbed_m": quantiles(one.absorbed_m for one in some),
                "little_absorbed": sum(one.absorbed_m <= WANTED_M for one in some),
                "last_m": quantiles(one.last_m for one in some),
                "worst_error_to_bound": max(one.worst_error_to_bound for one in some),
                "beyond_share": sum(one.beyond_s for one in some) / (600.0 * len(some)),
                "runs_beyond": sum(one.beyond_s > 0 for one in some),
            }
        )
    return found


def quantiles(values: Iterable[float]) -> dict[str, float | None]:
    """Median, 95 %, largest; None where that is infinite: it did not happen."""
    array = np.sort(np.array(list(values)))
    picked = {"median": 0.5, "q95": 0.95, "largest": 1.0}
    at = {name: float(array[min(int(np.ceil(share * len(array))), len(array)) - 1]) for name, share in picked.items()}
    return {name: value if np.isfinite(value) else None for name, value in at.items()}


def summarise_frames(struck: Iterable[Struck]) -> list[dict[str, Any]]:
    """One summary for each fault."""
    everything = list(struck)
    found = []
    for name in dict.fromkeys(one.fault for one in everything):
        some = [one for one in everything if one.fault == name]
        found.append(
            {
                "fault": name,
                "runs": len(some),
                "used": sum(one.used for one in some),
                "restarted": sum(one.restarted for one in some),
                "largest_error_m": max(one.moved_m for one in some),
                "worst_error_to_bound": max(one.worst_error_to_bound for one in some),
                "accepted_again_largest_s": max(one.accepted_again_s for one in some),
            }
        )
    return found


def shortfalls(ramps: list[dict[str, Any]], frames: list[dict[str, Any]]) -> list[str]:
    """What is asked and was not reached, in words."""
    said = [f"{one['fault']}: {one['used']} wrong fixes used" for one in frames if one["used"]]
    for one in ramps:
        if one["kind"] == RAMP and one["speed_mps"] == RAMP_MPS:
            n = one["runs"]
            if one["found_in_time"] < n:
                said.append(f"ramp of {RAMP_MPS} m/s: named within {WANTED_S:g} s in {one['found_in_time']} of {n}")
            if one["little_absorbed"] < n:
                said.append(f"ramp of {RAMP_MPS} m/s: <= {WANTED_M:g} m absorbed in {one['little_absorbed']} of {n}")
    return said


def table(ramps: list[dict[str, Any]], frames: list[dict[str, Any]]) -> str:
    """Figures as text."""
    lines = ["wrong fixes through the frames"]
    lines.append(f"  {'fault':<28}{'runs':>6}{'used':>6}{'restarts':>10}{'largest m':>11}{'/bound':>8}{'again s':>9}")
    for one in frames:
        lines.append(
            f"  {one['fault']:<28}{one['runs']:>6}{one['used']:>6}{one['restarted']:>10}{one['largest_error_m']:>11.2f}"
            f"{one['worst_error_to_bound']:>8.2f}{one['accepted_again_largest_s']:>9.0f}"
        )
    lines.append("ramps; seconds since their beginning: median / 95 % / largest")
    lines.append(
        f"  {'kind':<16}{'m/s':>6}{'runs':>6}{'named s':>18}{'in time':>8}{'wrong name':>11}{'neither':>8}"
        f"{'absorbed m':>18}{'<= 5 m':>8}{'past bound':>11}"
    )
    for one in ramps:
        lines.append(
            f"  {one['kind']:<16}{one['speed_mps']:>6g}{one['runs']:>6}{_three(one['found_s'], 0):>18}"
            f"{one['found_in_time']:>8}{one['misnamed_first']:>11}{one['neither']:>8}{_three(one['absorbed_m'], 1):>18}"
            f"{one['little_absorbed']:>8}{one['runs_beyond']:>11}"
        )
    return "\n".join(lines)


def _three(spread: dict[str, float | None], digits: int) -> str:
    return " / ".join("-" if value is None else f"{value:.{digits}f}" for value in spread.values())


def as_document(ramps: list[Ramp], struck: list[Struck]) -> dict[str, Any]:
    """Plain numbers for a JSON file; a time that was not reached is None."""
    plain = [
        {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in row.items()}
        for row in ([asdict(one) for one in ramps] + [asdict(one) for one in struck])
    ]
    summaries = summarise_ramps(ramps), summarise_frames(struck)
    return {
        "ramps": summaries[0],
        "frames": summaries[1],
        "ramp_runs": plain[: len(ramps)],
        "frame_runs": plain[len(ramps) :],
        "shortfalls": shortfalls(*summaries),
    }
