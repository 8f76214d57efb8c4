"""`ground ledger`: measure everything the reproduction ledger judges by, and write it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ground.errors import OperatorError

HELP = "measure the paper's claims and write the reproduction ledger (one to three minutes)"


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground ledger`."""
    parser = subparsers.add_parser("ledger", help=HELP, description=HELP)
    parser.add_argument(
        "--out", type=Path, default=Path("docs/ledger.md"), metavar="FILE", help="file to write (docs/ledger.md)"
    )
    parser.add_argument("--jobs", type=int, metavar="N", help="processes to fly in (default: 2, or 1 on one processor)")


def run(args: argparse.Namespace) -> int:
    """Measure, judge, write. Exit status 1, and nothing written, where a verdict no longer holds."""
    if args.jobs is not None and args.jobs < 1:
        raise OperatorError(f"--jobs {args.jobs}: give 1 or more")
    if not args.out.parent.is_dir():
        raise OperatorError(f"--out {args.out}: no such folder; make it, or name another file")
    from ground.studies.flights import usual_jobs
    from ground.studies.ledger import ROWS, VerdictsFail, render
    from ground.studies.measurement import Effort, measure

    measured = measure(Effort(), usual_jobs() if args.jobs is None else args.jobs)
    try:
        text = render(measured)
    except VerdictsFail as failure:
        print(f"ground ledger: not written, measurements and verdicts disagree:\n{failure}")
        return 1
    try:
        args.out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OperatorError(f"--out {args.out}: cannot be written: {error.strerror}") from error
    print(f"{args.out}: {len(ROWS)} claims")
    return 0
