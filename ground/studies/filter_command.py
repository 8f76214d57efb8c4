"""`ground study consistency`, `recovery`, `manoeuvres`: what the filter says of itself, against the truth."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ground.accuracy.command import data_folder, gravity_of
from ground.errors import OperatorError
from ground.exit_status import STOPPED

if TYPE_CHECKING:
    from ground.studies.filter_studies import Options

STUDIES = {
    "consistency": "errors by the filter's own covariance: drawn truth, simulated and real orbits, coloured fixes",
    "recovery": "the return of fixes after outages; jumps, frozen and repeated fixes, ramps",
    "manoeuvres": "burns, announced or not: bound, detection, false alarms; lever arm",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of these studies alone."""
    parser.add_argument("--orbits", nargs="+", metavar="NAME", help=f"of {', '.join(STUDIES)}: orbits to fly")
    parser.add_argument("--quick", action="store_true", help="of the same: a few short flights, whether all works")
    parser.add_argument("--figures", type=Path, metavar="DIR", help="of the same: draw the results into this folder")


def refuse(args: argparse.Namespace) -> None:
    """Options of these studies given to another one."""
    for option, value in (("--orbits", args.orbits), ("--quick", args.quick), ("--figures", args.figures)):
        if value:
            raise OperatorError(f"{option}: the study {args.name} has none; it is for {', '.join(STUDIES)}")


def run(args: argparse.Namespace) -> int:
    """Fly, print, write, return 0; misses are said, and are no error."""
    if args.sigma is not None:
        raise OperatorError(f"--sigma {args.sigma}: the study {args.name} has its own fixes; leave --sigma out")
    from ground.studies.filter_studies import study_of
    from ground.studies.flights import pool, progress_bar, usual_jobs

    study = study_of(args.name, _options(args))
    jobs = min(usual_jobs() if args.jobs is None else args.jobs, len(study.tasks))
    results: list[Any] = []
    stopped = False
    with progress_bar(f"flying {args.name}", len(study.tasks)) as advance, pool(jobs) as workers:
        flown = map(study.fly, study.tasks) if workers is None else workers.map(study.fly, study.tasks)
        try:
            for result in flown:
                results.append(result)
                advance()
        except KeyboardInterrupt:
            stopped = True
            if workers is not None:
                workers.shutdown(wait=False, cancel_futures=True)
    if stopped:
        print(f"\nstopped: {len(results)} of {len(study.tasks)} parts flown, figures are theirs", file=sys.stderr)
    if not results:
        return STOPPED
    text, document = study.show(study.tasks[: len(results)], results)
    print(text)
    _write(args.json, document | {"parts": len(results), "of": len(study.tasks)})
    if args.figures is not None:
        try:
            args.figures.mkdir(parents=True, exist_ok=True)
            for path in study.draw(document, args.figures):
                print(f"drawn: {path}")
        except OSError as error:
            raise OperatorError(f"--figures {args.figures}: cannot be written: {error.strerror}") from error
    return STOPPED if stopped else 0


def _options(args: argparse.Namespace) -> Options:
    from ground.studies.arcs import ALL_ORBITS
    from ground.studies.filter_studies import Options
    from ground.tables.build import build_navigation, parse_setting

    table_set, overrides = None, []
    for setting in args.settings:
        key, value = parse_setting(setting)
        if key == "flight.table_set":
            table_set = str(value)
        elif key.startswith("flight.table."):
            overrides.append((key.removeprefix("flight.table."), value))
        else:
            raise OperatorError(
                f"--set {setting}: the study {args.name} takes flight.table_set and flight.table.FIELD only"
            )
    build_navigation(table_set or "flight", dict(overrides) or None)  # refuses what no table can be made of
    data = data_folder()
    orbits = []
    for name in args.orbits or _usual_orbits(args.name, args.quick):
        if name not in ALL_ORBITS:
            raise OperatorError(f"--orbits {name}: none of {', '.join(ALL_ORBITS)}")
        file = ALL_ORBITS[name].file
        if file is None or (data / file).is_file():
            orbits.append(name)
        elif args.orbits:
            raise OperatorError(f"--orbits {name}: no file {data / file}; set LEONAV_DATA to the folder of real orbits")
        else:
            print(f"left out: {name}: no file {data / file}; set LEONAV_DATA to the folder of real orbits")
    return Options(table_set, tuple(overrides), tuple(orbits), args.runs, args.quick, gravity_of(data))


def _usual_orbits(name: str, quick: bool) -> tuple[str, ...]:
    if quick:
        return ("simulated",)
    from ground.studies import consistency, recovery

    return consistency.ORBITS if name == "consistency" else recovery.ORBITS


def _write(path: Path | None, document: dict[str, Any]) -> None:
    if path is None:
        return
    try:
        path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise OperatorError(f"--json {path}: cannot be written: {error.strerror}") from error
