"""`ground crosslink study`: what the inter-satellite monitors find, how fast, and how often in vain."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from ground.exit_status import STOPPED
from ground.studies.study_folder import check_counts, fly_parts, make_folder, progress

HELP = "study the integrity monitors of a constellation that ranges between its satellites"
USUAL_STUDY = Path("runs/crosslink")
PARTS = ("paper", "uploads", "once", "tail", "ramps", "roc", "special", "speed", "day")
USUAL_RUNS = {"uploads": 300, "once": 40, "ramps": 320}
QUICK_RUNS = {"uploads": 2, "once": 1, "ramps": 8}


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground crosslink`."""
    parser = subparsers.add_parser("crosslink", help=HELP, description=HELP)
    words = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    study = words.add_parser("study", help="fly the studies and write figures, tables and study.json")
    study.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART", help=", ".join(PARTS))
    study.add_argument("--runs", type=int, metavar="N", help="runs of each campaign (default: 300 of 50 000 uploads)")
    study.add_argument("--quick", action="store_true", help="a few runs, whether all works")
    study.add_argument("--seed", type=int, default=1, metavar="N", help="root of all random numbers (default 1)")
    study.add_argument("--out", type=Path, default=USUAL_STUDY, metavar="DIR", help=f"folder (default {USUAL_STUDY})")
    study.add_argument(
        "--day-seeds", type=int, default=2, metavar="N", help="noises that the day is flown with (default 2)"
    )
    study.add_argument("--jobs", type=int, metavar="N", help="processes to fly in (default: 2, or 1 on one processor)")
    study.add_argument("--dask", metavar="ADDRESS", help="fly on a Dask cluster instead, for example tcp://host:8786")
    study.add_argument("--no-figures", action="store_true", help="draw nothing")
    ledger = words.add_parser("ledger", help="write the reproduction ledger of the paper from a study")
    ledger.add_argument(
        "--study", type=Path, default=USUAL_STUDY / "study.json", metavar="FILE", help="study.json with paper, uploads"
    )
    ledger.add_argument(
        "--out",
        type=Path,
        default=Path("docs/crosslink_ledger.md"),
        metavar="FILE",
        help="file to write (docs/crosslink_ledger.md)",
    )


def run(args: argparse.Namespace) -> int:
    """Fly, write, print, return 0; of a ledger whose verdicts do not hold, 1."""
    return _ledger(args) if args.action == "ledger" else _study(args)


def _ledger(args: argparse.Namespace) -> int:
    from ground.crosslink import ledger
    from ground.studies import paper_ledger

    return paper_ledger.write("crosslink", ledger, args.study, args.out)


def _study(args: argparse.Namespace) -> int:
    check_counts(args, "runs", "jobs", "day_seeds")
    make_folder(args.out)
    # products of small matrices: a second thread waits for the first; before numpy, and for workers as well
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from ground.crosslink import report

    figures: dict[str, Any] = {}
    parts = [part for part in PARTS if part in args.parts]
    document, stopped = fly_parts(args.out, args.seed, parts, lambda part: _fly(part, args, figures), report.lines)
    if stopped:
        return STOPPED
    if not args.no_figures:
        from ground.crosslink import figures as pictures

        for drawn in pictures.draw(document, figures, args.out / "figures", args.seed):
            print(f"drawn: {drawn}")
    return 0


def _fly(part: str, args: argparse.Namespace, figures: dict[str, Any]) -> dict[str, Any]:
    from ground.crosslink import real_day, roc, speed, study
    from ground.crosslink.scene import Setting

    both = Setting(both=True)
    runs = args.runs or (QUICK_RUNS if args.quick else USUAL_RUNS).get(part, 0)
    if part == "paper":
        return study.paper_part(Setting(), args.seed)
    if part in ("uploads", "once", "ramps"):
        from ground.studies.flights import usual_jobs

        how = {"jobs": args.jobs or usual_jobs(), "dask": args.dask, "chunk_runs": 4}
        folder = args.out / (f"{part}-quick" if args.quick else part)
        fly = study.ramps_part if part == "ramps" else study.uploads_part
        with progress(part, runs) as advance:
            found, figures[part] = fly(folder, Setting() if part == "once" else both, runs, args.seed, advance, **how)
        return found
    if part == "tail":
        return study.tail_part(both, args.seed, 300 if args.quick else 4000)
    if part == "special":
        return study.special_part(both, args.seed)
    if part == "speed":
        return speed.measure(both)
    if part == "roc":
        return roc.curves(both, args.seed, 1 if args.quick else 20)
    from ground.accuracy.command import data_folder

    stop_s = 2400.0 if args.quick else None
    seeds = 1 if args.quick else args.day_seeds
    folder = args.out / ("day-quick" if args.quick else "day")
    return real_day.day_part(folder, data_folder(), both.range_sigma_m, args.seed, seeds, stop_s, progress)
