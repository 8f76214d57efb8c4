"""`ground report RUN_DIR`: make the figures of a run again and print its verdict."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ground.errors import OperatorError
from ground.reports.run_folder import NotARun, read_summary
from ground.reports.verdict import render_verdict

HELP = "make the figures of a run again and print its verdict"


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground report`."""
    parser = subparsers.add_parser("report", help=HELP, description=HELP)
    parser.add_argument("run_dir", type=Path, metavar="RUN_DIR", help="folder of a run: runs/<scenario>")


def run(args: argparse.Namespace) -> int:
    """Draw, print, return 0. Raises OperatorError when the folder is not a run or cannot be written."""
    run_dir: Path = args.run_dir
    summary = read_summary(run_dir)
    missing = [key for key in ("scenario", "integrated", "outages") if key not in summary]
    if missing:
        raise NotARun(f"{run_dir / 'summary.json'}: no {', '.join(missing)}; run the scenario again")
    from ground.reports.figures import make_figures

    try:
        paths = make_figures(run_dir)
    except OSError as error:
        raise OperatorError(f"{run_dir / 'figures'}: cannot be written ({error})") from None
    print(render_verdict(summary))
    print(f"{len(paths)} figures in {run_dir / 'figures'}")
    return 0
