"""`ground certify`: fly a fresh ensemble of outages, and say what it proves of a set's bound."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ground.errors import OperatorError
from ground.exit_status import STOPPED

if TYPE_CHECKING:
    from ground.campaign.ensemble import Ensemble

HELP = "fly a fresh ensemble of outages and say with what confidence a set's bound holds"
USUAL_RUNS, USUAL_LONG_RUNS = 12_000, 4008


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground certify`."""
    parser = subparsers.add_parser("certify", help=HELP, description=HELP)
    parser.add_argument("--set", dest="table_set", default="flight", metavar="NAME", help="table set (default flight)")
    parser.add_argument(
        "--long",
        action="store_true",
        help="outages flown past the flag, up to a day: how long the bound holds, and was the flag foretold",
    )
    parser.add_argument(
        "--runs",
        type=int,
        metavar="N",
        help=f"outages (default {USUAL_RUNS}, with --long {USUAL_LONG_RUNS}; with --quick 48 and 12)",
    )
    parser.add_argument(
        "--quick", action="store_true", help="short outages after short acquisitions: never a certificate"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder (default runs/certify/NAME); resumed if it has an open attempt"
    )
    parser.add_argument("--jobs", type=int, metavar="N", help="processes to fly in (default: 2, or 1 on one processor)")
    parser.add_argument("--dask", metavar="ADDRESS", help="fly on a Dask cluster instead, for example tcp://host:8786")
    parser.add_argument("--chunk", type=int, default=20, metavar="N", help="runs that are kept at a time (default 20)")
    parser.add_argument(
        "--judge", action="store_true", help="fly nothing: sum up again what was flown, by whatever version of this"
    )
    parser.add_argument(
        "--reproduce",
        type=int,
        metavar="N",
        help="fly N runs of a finished campaign again and compare their figures with what was certified; write nothing",
    )
    parser.add_argument("--again", action="store_true", help="a new attempt even though the last one is finished")


def run(args: argparse.Namespace) -> int:
    """Fly, write, print, return 0; targets that are missed are said, and are no error."""
    for name, least in (("runs", 1), ("jobs", 1), ("chunk", 1), ("reproduce", 1)):
        value = getattr(args, name)
        if value is not None and value < least:
            raise OperatorError(f"--{name} {value}: give {least} or more")
    if args.judge and args.again:
        raise OperatorError("--judge flies nothing, --again a new attempt: give one of them")
    folder = args.out if args.out is not None else Path("runs") / "certify" / Path(args.table_set).stem
    if folder.exists() and not folder.is_dir():
        raise OperatorError(f"--out {folder}: is a file; name a folder")
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from ground.campaign import certify, endurance, endurance_report, pictures, report
    from ground.studies.flights import usual_jobs

    ensemble = certify.ensemble_of(args.table_set, args.quick)
    fly, usual, quick = certify.certify, USUAL_RUNS, certify.QUICK_RUNS
    if args.long:
        fly, usual, quick = certify.endure, USUAL_LONG_RUNS, certify.QUICK_LONG_RUNS
        ensemble = endurance.ensemble_of(ensemble, args.quick)
    runs = args.runs if args.runs is not None else quick if args.quick else usual
    jobs = args.jobs if args.jobs is not None else usual_jobs()
    if args.reproduce is not None:
        return _reproduce(args, folder, ensemble, runs)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    try:
        with Progress(*columns, console=Console(file=sys.stderr), transient=True) as progress:
            task = progress.add_task("flying outages", total=runs)
            found = fly(
                folder,
                args.table_set,
                ensemble,
                runs,
                lambda n: progress.advance(task, n),
                args.quick,
                args.again,
                judge=args.judge,
                jobs=jobs,
                dask=args.dask,
                chunk_runs=args.chunk,
            )
    except KeyboardInterrupt:
        print("\nstopped; finished outages are kept, the same command goes on from there", file=sys.stderr)
        return STOPPED
    if args.long:
        place = folder / certify.LONG
        drawn = endurance_report.draw(found, place / "figures")
        written = endurance_report.write(place, found.document, found.targets, drawn)
        said, document = endurance_report.verdict(found.document, found.targets), place / certify.LONG_OUTAGES
    else:
        written = report.write(folder, found.document, found.targets, pictures.draw(found, folder / "figures"))
        said, document = report.verdict(found.document, found.targets), folder / certify.CERTIFICATE
    for line in said:
        print(line)
    for target in found.targets:
        if target.met is False:
            print(f"  missed: {target.what}: {target.measured}, wanted {target.wanted}")
    print(f"written: {written}, {document}")
    return 0


def _reproduce(args: argparse.Namespace, folder: Path, ensemble: Ensemble, runs: int) -> int:
    """Say whether this software flies the runs of a campaign as they were flown; 0 where it does, else 1."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from ground.campaign import again

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as progress:
        task = progress.add_task("flying again", total=args.reproduce)
        found = again.fly_again(
            folder,
            args.table_set,
            ensemble,
            runs,
            args.reproduce,
            args.long,
            args.quick,
            lambda n: progress.advance(task, n),
        )
    print(f"{len(found.runs)} of {runs} runs flown again")
    for one in found.differences:
        print(f"  differs: {one.name} in {one.runs} of them, by up to {one.largest:.3g} of its size")
    if not found.differences:
        print(f"the same figures to {again.TOLERANCE:g}: this software flies what was certified")
    return 1 if found.differences else 0
