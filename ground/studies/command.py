"""`ground study`: fly what the paper claims, many times, and say what came out."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ground.errors import OperatorError
from ground.studies import filter_command

HELP = "fly an outage from many start phases and summarise error, flag and bound"
_SCENARIOS = {"paper": "paper_outage", "j2": "j2_outage"}
_RECORDED = "graceb"  # no seeds to vary: its noise was real
_TIME_TO_FLAG = "time_to_flag"
_LINES = (
    ("error passes the limit", "crossed_age_s", "s", 0),
    ("flag", "flag_age_s", "s", 0),
    ("flag / crossing", "flag_to_crossing", "", 2),
    ("violated epochs", "violations", "", 0),
    ("largest error / bound", "worst_error_to_bound", "", 2),
    ("fix rms", "fix_rms_m", "m", 2),
    ("integrated rms", "integrated_rms_m", "m", 2),
    ("fix / integrated", "fix_to_integrated", "", 2),
    ("error at 900 s", "error_at_900_s_m", "m", 0),
    ("error at 2000 s", "error_at_2000_s_m", "m", 0),
    ("back in service", "back_in_service_s", "s", 0),
)


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground study`."""
    parser = subparsers.add_parser("study", help=HELP, description=HELP)
    names = [*sorted(_SCENARIOS), _RECORDED, _TIME_TO_FLAG, *filter_command.STUDIES]
    parser.add_argument("name", choices=names, metavar="STUDY", help=", ".join(names))
    parser.add_argument("--runs", type=int, metavar="N", help="seeds and start phases (default 20)")
    parser.add_argument("--sigma", type=float, metavar="M", help="position noise of the fixes per axis [m]")
    parser.add_argument(
        "--set",
        dest="settings",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="override a key of the scenario, for example flight.table_set=paper_table1; may be repeated",
    )
    parser.add_argument("--jobs", type=int, metavar="N", help="processes to fly in (default: 2, or 1 on one processor)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every run and the summary to this file")
    filter_command.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Fly, print, return 0. Raises OperatorError for what cannot be flown."""
    if args.runs is not None and args.runs < 1:
        raise OperatorError(f"--runs {args.runs}: give 1 or more")
    if args.jobs is not None and args.jobs < 1:
        raise OperatorError(f"--jobs {args.jobs}: give 1 or more")
    if args.json is not None and not args.json.parent.is_dir():
        raise OperatorError(f"--json {args.json}: no such folder; make it, or name another file")
    if args.name in filter_command.STUDIES:
        return filter_command.run(args)
    filter_command.refuse(args)
    if args.name in (_RECORDED, _TIME_TO_FLAG):
        return _run_given(args)
    from ground.studies.flights import each, pool, progress_bar, usual_jobs
    from ground.studies.outage import as_document, fly_variant, summarise, variants

    settings = list(args.settings)
    if args.sigma is not None:
        settings.insert(0, f"gnss.sigma_position_m={args.sigma!r}")
    chosen = variants(_SCENARIOS[args.name], args.runs or 20, settings)
    jobs = usual_jobs() if args.jobs is None else args.jobs
    with progress_bar(f"flying {chosen[0].scenario}", len(chosen)) as advance, pool(min(jobs, len(chosen))) as workers:
        runs = each(workers, fly_variant, chosen, advance)
    _print(chosen[0].scenario, runs, summarise(runs))
    _write(args.json, as_document(args.name, chosen, runs))
    return 0


def _run_given(args: argparse.Namespace) -> int:
    """Studies whose flights are given: nothing of them is drawn."""
    for option, value in (("--runs", args.runs), ("--sigma", args.sigma)):
        if value is not None:
            raise OperatorError(f"{option} {value}: the flights of study {args.name} are given; leave {option} out")
    from ground.studies import graceb, time_to_flag
    from ground.studies.flights import each, pool, progress_bar, usual_jobs

    study: Any = graceb if args.name == _RECORDED else time_to_flag
    tasks = study.tasks(args.settings)
    jobs = usual_jobs() if args.jobs is None else args.jobs
    with progress_bar(f"flying {study.SCENARIO}", len(tasks)) as advance, pool(min(jobs, len(tasks))) as workers:
        found = each(workers, study.fly, tasks, advance)
    print(study.table(found))
    _write(args.json, study.as_document(found))
    return 0


def _write(path: Path | None, document: dict[str, Any]) -> None:
    if path is None:
        return
    try:
        path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise OperatorError(f"--json {path}: cannot be written: {error.strerror}") from error


def _print(scenario: str, runs: list[Any], summary: dict[str, Any]) -> None:
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    table = Table(box=box.SIMPLE, title=f"{scenario}: each run", title_justify="left")
    columns = ("seed", "phase [deg]", *(f"{name} [{unit}]" if unit else name for name, _, unit, _ in _LINES[:6]))
    for name in (*columns, "integrated [m]", "back [s]"):
        table.add_column(escape(name), justify="right")
    for one in runs:
        cells = [_number(getattr(one, key), digits) for _, key, _, digits in _LINES[:7]]
        table.add_row(str(one.seed), f"{one.phase_deg:.0f}", *cells, _number(one.back_in_service_s, 0))
    console.print(table)
    table = Table(box=box.SIMPLE, title=f"over {len(runs)} runs", title_justify="left")
    for name in ("", "min", "median", "max", "never"):
        table.add_column(name, justify="right" if name else "left")
    for name, key, unit, digits in _LINES:
        spread = summary[key]
        cells = [_number(spread[which], digits) for which in ("least", "median", "largest")]
        table.add_row(
            escape(f"{name} [{unit}]") if unit else name, *cells, str(spread["never"]) if spread["never"] else ""
        )
    console.print(table)
    n = len(runs)
    console.print(f"bound broken in {summary['outages_violated']} of {n} outages ({summary['violated_epochs']} epochs)")
    crossing = [one for one in runs if one.crossed_age_s is not None]
    in_time = sum(one.flag_in_time for one in crossing)
    console.print(f"error passed the limit in {len(crossing)} of {n} outages; flag before it in {in_time} of these")
    console.print(f"back in service after {summary['back_in_service']} of {n} outages")
    faults = [one.fault_of_table for one in runs if one.fault_of_table]
    if faults:
        console.print(f"fault of the table in {len(faults)}, for example: {faults[0]}")


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
