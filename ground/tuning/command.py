"""`ground tune`: from flown errors to a table set, by the method named."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ground.errors import OperatorError
from ground.exit_status import STOPPED

HELP = "make a table set from flown errors: the paper's descent on (17), or k and process noise of the flight filter"
METHODS = ("paper", "overbound")


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground tune`."""
    parser = subparsers.add_parser("tune", help=HELP, description=HELP)
    parser.add_argument("--method", choices=METHODS, default="overbound", help="default overbound")
    parser.add_argument(
        "--set", dest="table_set", metavar="NAME", help="base set (default paper, or flight), or a file"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder (default runs/tune/METHOD); resumed if begun")
    parser.add_argument("--quick", action="store_true", help="little is flown: a set to try, not one to certify")
    parser.add_argument("--runs", type=int, metavar="N", help="outages, or start phases; default by method")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="root of the random numbers (default 1)")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes to fly in (default: 2, or 1 on one processor)")


def run(args: argparse.Namespace) -> int:
    """Tune, write, print, return 0."""
    for name, least in (("runs", 2), ("jobs", 1), ("seed", 0)):
        value = getattr(args, name)
        if value is not None and value < least:
            raise OperatorError(f"--{name} {value}: give {least} or more")
    folder = args.out if args.out is not None else Path("runs") / "tune" / args.method
    if folder.exists() and not folder.is_dir():
        raise OperatorError(f"--out {folder}: is a file; name a folder")
    from ground.studies.flights import usual_jobs
    from ground.tuning import written
    from ground.tuning.method import Effort

    method = _method(args.method)
    table_set = args.table_set or method.usual_set
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OperatorError(f"--out {folder}: cannot be made: {error.strerror}") from error
    effort = Effort(args.quick, args.jobs if args.jobs is not None else usual_jobs(), args.seed, args.runs)
    try:
        tuned = method.tune(table_set, folder, effort, _bar)
    except KeyboardInterrupt:
        print("\nstopped; what was flown is kept, the same command goes on from there", file=sys.stderr)
        return STOPPED
    path = written.write(folder, table_set, args.method, effort, tuned)
    print(f"{path}: {tuned.summary}")
    print(f"evidence: {folder / written.REPORT}, {folder / written.EVIDENCE}")
    print(f"uncertified; to fly it: hil_sim run nominal --set flight.table_set={path}")
    return 0


def _method(name: str) -> Any:
    if name == "paper":
        from ground.tuning.paper import Paper

        return Paper()
    from ground.tuning.overbound import Overbound

    return Overbound()


@contextmanager
def _bar(label: str, total: int) -> Iterator[Any]:
    """A bar on stderr that is told how many more are done."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as progress:
        task = progress.add_task(label, total=total)
        yield lambda n: progress.advance(task, n)
