"""The studies of the flight filter put together: which parts are flown, what is made of their results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ground.studies import announced, consistency, false_fixes, manoeuvres, recovery

RAMPS = (
    (false_fixes.RAMP, 0.1),
    (false_fixes.RAMP, 0.03),
    (false_fixes.RAMP, 0.5),
    (false_fixes.CONSISTENT, 0.1),
    (false_fixes.CONSISTENT, 0.01),
)
FRAME_SEEDS = 5
HEALTHY_SEEDS = 8  # flights without a burn of each orbit, for alarms
STARTS = 8  # of burns, each orbit


class Options(NamedTuple):
    """What is to be flown: table set (None: the study's own), fields of it on top, orbits at hand, runs."""

    table_set: str | None
    overrides: tuple[tuple[str, Any], ...]
    orbits: tuple[str, ...]
    runs: int | None
    quick: bool
    gravity: Path | None


class Study(NamedTuple):
    """Tasks, and what becomes of their results in order: text, a document, pictures into a folder."""

    tasks: Sequence[Any]
    fly: Callable[[Any], Any]
    show: Callable[[Sequence[Any], Sequence[Any]], tuple[str, dict[str, Any]]]
    draw: Callable[[dict[str, Any], Path], list[Path]]


def study_of(name: str, options: Options) -> Study:
    """The study of a name."""
    return {"consistency": _consistency, "recovery": _recovery, "manoeuvres": _manoeuvres}[name](options)


def fly(task: Any) -> Any:
    """Fly a part of any study; at the top of the module, for worker processes."""
    if isinstance(task, consistency.Task):
        return consistency.fly(task)
    if isinstance(task, recovery.Task):
        return recovery.fly(task)
    if isinstance(task, false_fixes.Ramps):
        return false_fixes.fly_ramps(task)
    if isinstance(task, false_fixes.Frames):
        return false_fixes.fly_frames(task)
    if isinstance(task, manoeuvres.Task):
        return manoeuvres.fly(task)
    if isinstance(task, announced.Task):
        return announced.fly(task)
    return announced.fly_lever(task)


def _consistency(options: Options) -> Study:
    sets = tuple(consistency.RECEIVERS) if options.table_set is None else (options.table_set,)
    plan = consistency.QUICK if options.quick else consistency.Plan()
    runs = options.runs or (4 if options.quick else consistency.RUNS)
    tasks = consistency.tasks(sets, runs, plan, options.orbits, options.overrides, options.gravity)

    def show(chosen: Sequence[Any], results: Sequence[Any]) -> tuple[str, dict[str, Any]]:
        drawn, along = consistency.gathered(list(chosen), list(results))
        return consistency.table(drawn, along), consistency.as_document(drawn, along)

    return Study(tasks, fly, show, _drawing("consistency"))


def _recovery(options: Options) -> Study:
    table_set, extra, gravity = options.table_set or "flight", options.overrides, options.gravity
    plan = recovery.QUICK if options.quick else recovery.Plan()
    tasks: list[Any] = [
        recovery.Task(orbit, table_set, plan, 0, options.runs, extra, gravity) for orbit in options.orbits
    ]
    short: dict[str, Any] = (
        {"along_s": 3300, "settled_s": 2000, "spacing_s": 500, "directions": 1} if options.quick else {}
    )
    tasks += [
        false_fixes.Ramps(orbit, table_set, kind, speed, overrides=extra, gravity=gravity, **short)
        for orbit in options.orbits
        for kind, speed in (RAMPS[:1] if options.quick else RAMPS)
    ]
    tasks += [
        false_fixes.Frames(number, seed, axis, table_set, extra, gravity)
        for number in (range(1) if options.quick else range(len(false_fixes.FRAMES)))
        for seed in (range(1) if options.quick else range(FRAME_SEEDS))
        for axis in ("x" if options.quick else "xyz")
    ]

    def show(chosen: Sequence[Any], results: Sequence[Any]) -> tuple[str, dict[str, Any]]:
        pairs = list(zip(chosen, results, strict=True))
        returns = [one for task, some in pairs if isinstance(task, recovery.Task) for one in some]
        ramps = [one for task, some in pairs if isinstance(task, false_fixes.Ramps) for one in some]
        struck = [one for task, one in pairs if isinstance(task, false_fixes.Frames)]
        document = {"study": "recovery", "returns": recovery.as_document(returns)}
        document["false_fixes"] = false_fixes.as_document(ramps, struck)
        summaries = false_fixes.summarise_ramps(ramps), false_fixes.summarise_frames(struck)
        missed = recovery.shortfalls(recovery.summarise(returns)) + false_fixes.shortfalls(*summaries)
        text = recovery.table(recovery.summarise(returns)) + "\n" + false_fixes.table(*summaries)
        return _with_misses(text, missed), document

    return Study(tasks, fly, show, _drawing("recovery"))


def _manoeuvres(options: Options) -> Study:
    table_set, extra, gravity = options.table_set or "flight", options.overrides, options.gravity
    noises = manoeuvres.NOISES[:1] if options.quick else manoeuvres.NOISES
    starts = options.runs or (1 if options.quick else STARTS)
    short: dict[str, Any] = {"along_s": 3400, "settled_s": 2000, "speeds_mps": (0.1, 2.0)} if options.quick else {}
    tasks: list[Any] = [
        manoeuvres.Task(orbit, table_set, *noise, 0, starts, overrides=extra, gravity=gravity, **short)
        for noise in noises
        for orbit in options.orbits
    ]
    few: dict[str, Any] = {"along_s": 4700, "settled_s": 2000, "speeds_mps": (1.0,)} if options.quick else {}
    tasks += [
        announced.Task(orbit, table_set, 0, starts, overrides=extra, gravity=gravity, **few) for orbit in options.orbits
    ]
    if options.quick:
        tasks.append(announced.LeverTask("x", False, table_set, 3000.0, 1800.0, extra, gravity))
    else:
        tasks += [
            manoeuvres.Task(orbit, table_set, *manoeuvres.NOISES[0], seed, 0, overrides=extra, gravity=gravity)
            for seed in range(1, HEALTHY_SEEDS)
            for orbit in options.orbits
        ]
        tasks += [
            announced.LeverTask(axis, turned, table_set, overrides=extra, gravity=gravity)
            for axis in announced.LEVERS
            for turned in (False, True)
        ]

    def show(chosen: Sequence[Any], results: Sequence[Any]) -> tuple[str, dict[str, Any]]:
        pairs = list(zip(chosen, results, strict=True))
        flown = [result for task, result in pairs if isinstance(task, manoeuvres.Task)]
        found, flights = [one for _, some in flown for one in some], [healthy for healthy, _ in flown]
        told = [one for task, some in pairs if isinstance(task, announced.Task) for one in some]
        levers = [one for task, one in pairs if isinstance(task, announced.LeverTask)]
        rows, burns = manoeuvres.summarise(found), announced.summarise(told)
        document = {"study": "manoeuvres", "unannounced": manoeuvres.as_document(found, flights)}
        document["announced"] = announced.as_document(told, levers)
        text = manoeuvres.table(rows, manoeuvres.summarise_healthy(flights)) + "\n" + announced.table(burns, levers)
        return _with_misses(text, manoeuvres.shortfalls(rows) + announced.shortfalls(burns, levers)), document

    return Study(tasks, fly, show, _drawing("manoeuvres"))


def _drawing(name: str) -> Callable[[dict[str, Any], Path], list[Path]]:
    def draw(document: dict[str, Any], folder: Path) -> list[Path]:
        from ground.studies import filter_plots  # matplotlib, only where pictures are asked for

        drawn: list[Path] = getattr(filter_plots, f"draw_{name}")(document, folder)
        return drawn

    return draw


def _with_misses(text: str, missed: list[str]) -> str:
    said = [f"MISSED: {one}" for one in missed] or ["all that is asked is reached"]
    return "\n".join([text, *said])
