"""`ground derivative`: how well positions give velocity and acceleration, and both of them of any track."""

from __future__ import annotations

import argparse
import math
from fractions import Fraction
from pathlib import Path
from typing import Any

from ground.errors import OperatorError
from ground.exit_status import STOPPED
from ground.studies.study_folder import check_counts, fly_parts, make_folder, progress

HELP = "velocity and acceleration from positions: conditioning, studies, any track"
USUAL = Path("runs/derivative")
PARTS = ("paper", "scenario", "monitor")
USUAL_RUNS = {"paper": 4, "scenario": 24, "monitor": 400}
QUICK_RUNS = {"paper": 1, "scenario": 2, "monitor": 4}


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground derivative`."""
    parser = subparsers.add_parser("derivative", help=HELP, description=HELP)
    words = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    table = words.add_parser("conditioning", help="condition numbers of the chain, exactly, and what can be solved")
    table.add_argument(
        "--n", type=int, nargs="+", default=[5], metavar="N", help="integrators of the chain (default 5)"
    )
    table.add_argument("--tau", default="0.2", metavar="S", help="step [s] (default 0.2)")
    table.add_argument("--rho", default="1/6371000", metavar="RHO", help="scale of the first state (default 1/6371000)")
    study = words.add_parser("study", help="fly the paper's scenario and the velocity check, write study.json, figures")
    study.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART", help=", ".join(PARTS))
    study.add_argument("--runs", type=int, metavar="N", help="runs of each part (default 4, 24, 400)")
    study.add_argument(
        "--peer-python", type=Path, metavar="PATH", help="interpreter that has pynumdiff, to stand beside"
    )
    study.add_argument("--quick", action="store_true", help="a few runs, whether all works")
    study.add_argument("--seed", type=int, default=1, metavar="N", help="root of all random numbers (default 1)")
    study.add_argument("--out", type=Path, default=USUAL, metavar="DIR", help=f"folder (default {USUAL})")
    study.add_argument("--jobs", type=int, default=1, metavar="N", help="processes to fly in (default 1)")
    study.add_argument("--no-figures", action="store_true", help="draw nothing")
    tune = words.add_parser("tune", help="seek settings of the causal filter on the paper's scenario, print them")
    tune.add_argument("--seed", type=int, default=1, metavar="N", help="root of the tuning runs (default 1)")
    tune.add_argument("--runs", type=int, default=4, metavar="N", help="runs of each trial (default 4)")
    tune.add_argument("--trials", type=int, default=300, metavar="N", help="trials (default 300)")
    track = words.add_parser("run", help="velocity and acceleration of a track of positions")
    track.add_argument(
        "file", type=Path, metavar="TRACK.csv", help="t_s and one to three positions [m], or lat_deg ..."
    )
    track.add_argument(
        "--sigma", type=float, metavar="M", help="sigma of a position [m]; else the file's or its scatter"
    )
    track.add_argument("--lag", type=float, default=30.0, metavar="S", help="how late the smoothed answer may be (30)")
    track.add_argument("--agility", type=float, default=1.0, metavar="X", help="how many times livelier it moves (1)")
    track.add_argument("--out", type=Path, default=USUAL / "run", metavar="DIR", help="folder for track.csv, picture")
    track.add_argument("--no-figures", action="store_true", help="draw nothing")
    ledger = words.add_parser("ledger", help="write what the paper claims, beside what a study measured")
    ledger.add_argument("--study", type=Path, default=USUAL / "study.json", metavar="FILE", help="study.json to use")
    ledger.add_argument(
        "--out", type=Path, default=Path("docs/derivative_ledger.md"), metavar="FILE", help="docs/derivative_ledger.md"
    )


def run(args: argparse.Namespace) -> int:
    """Do it, print it, return 0; of a study that misses what is wanted, or a ledger that does not hold, 1."""
    return {"conditioning": _table, "study": _study, "tune": _tune, "run": _track, "ledger": _ledger}[args.action](args)


def _fraction(name: str, text: str) -> Fraction:
    try:
        value = Fraction(text)
    except (ValueError, ZeroDivisionError):
        raise OperatorError(f"--{name} {text}: give a number, for example 0.2 or 1/5") from None
    if not Fraction(1, 10**12) <= value <= 10**12:
        raise OperatorError(f"--{name} {text}: give 1e-12 to 1e12")
    return value


def _table(args: argparse.Namespace) -> int:
    from ground.derivative import conditioning

    tau_s, rho = _fraction("tau", args.tau), _fraction("rho", args.rho)
    for n in args.n:
        if not 2 <= n <= conditioning.LARGEST:
            raise OperatorError(f"--n {n}: give 2 to {conditioning.LARGEST}")
    found = [conditioning.condition(n, tau_s, rho) for n in args.n]
    print("\n".join(conditioning.lines(found, float(tau_s), float(rho))))
    return 0


def _study(args: argparse.Namespace) -> int:
    check_counts(args, "runs", "jobs")
    make_folder(args.out)
    from ground.derivative import report

    parts = [part for part in PARTS if part in args.parts]
    document, stopped = fly_parts(args.out, args.seed, parts, lambda part: _fly(part, args), report.lines)
    if stopped:
        return STOPPED
    if not args.no_figures:
        from ground.derivative import figures, study

        example = study.example(study.Estimators(args.seed)) if "scenario" in args.parts else None
        for drawn in figures.draw(document, example, args.out / "figures"):
            print(f"drawn: {drawn}")
    flown = document.get("scenario", {})
    missed = "scenario" in args.parts and not (flown["causal_met"] and flown["smoothed_met"])
    return 1 if missed else 0


def _fly(part: str, args: argparse.Namespace) -> dict[str, Any]:
    from flightsw.kernels.registry import warm_up
    from ground.derivative import monitor, study

    warm_up()
    runs = args.runs or (QUICK_RUNS if args.quick else USUAL_RUNS)[part]
    if part == "paper":
        return study.paper_part(args.seed, runs)
    folder = args.out / (f"{part}-quick" if args.quick else part)
    with progress(part, runs) as advance:
        if part == "monitor":
            return monitor.monitor_part(folder, args.seed, runs, advance, jobs=args.jobs, chunk_runs=4)
        how: dict[str, Any] = {"peer_python": args.peer_python, "jobs": args.jobs, "chunk_runs": 1}
        return study.scenario_part(folder, study.Estimators(args.seed), runs, advance, **how)[0]


def _tune(args: argparse.Namespace) -> int:
    check_counts(args, "runs", "trials")
    from flightsw.kernels.registry import warm_up
    from ground.derivative import tuning

    warm_up()
    with progress("tune", args.trials) as advance:
        found, shares = tuning.tune(args.seed, args.runs, args.trials, advance)
    for word, model in zip(("quiet", "turning", "jumping"), found.models, strict=True):
        print(f"{word:8} order {model.order} q {model.q:.3g} stay {model.stay_s:.3g} s, entered {model.enter:.3g}")
    print("shares of the limits: " + ", ".join(f"{share:.3f}" for share in shares))
    return 0


def _track(args: argparse.Namespace) -> int:
    for name, low, high in (("sigma", 1e-9, 1e9), ("lag", 0.0, 1e6), ("agility", 1e-3, 1e6)):
        value = getattr(args, name)
        if value is not None and not (math.isfinite(value) and low <= value <= high):
            raise OperatorError(f"--{name} {value}: give {low:g} to {high:g}")
    make_folder(args.out)
    from ground.derivative import track_file

    positions = track_file.read(args.file, args.sigma)
    from flightsw.kernels.registry import warm_up

    warm_up()
    result = track_file.estimate(positions, args.lag, args.agility)
    written = args.out / "track.csv"
    track_file.write(result, written)
    sigmas = ", ".join(
        f"{name} {s:.3g} m" for name, s in zip(positions.names, positions.sigma_m.mean(axis=0), strict=True)
    )
    print(f"{len(positions.t_s)} positions, {positions.left_out} rows left out")
    print(f"sigma from {positions.sigma_from}: {sigmas}")
    print(f"median NIS of the causal filter {result.nis:.2f} (about 0.5 to 0.8 where the models fit)")
    if result.nis > 2.0:
        print("the positions scatter more than the models allow: give a larger --agility or --sigma")
    print(f"written: {written}")
    if not args.no_figures:
        from ground.derivative import figures

        print(f"drawn: {figures.draw_track(result, args.out / 'track.png')}")
    return 0


def _ledger(args: argparse.Namespace) -> int:
    from ground.derivative import ledger
    from ground.studies import paper_ledger

    return paper_ledger.write("derivative", ledger, args.study, args.out)
