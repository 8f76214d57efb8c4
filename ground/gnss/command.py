"""`ground gnss`: study the consistency test of navigation satellites, and run it on files of real receivers."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ground.errors import OperatorError
from ground.peers import interpreter

HELP = "study the consistency test of GNSS satellites, or check a receiver's file with it"
USUAL = Path("runs/gnss")
PARTS = ("alarms", "detection", "exclusion", "protection", "speed", "inputs")
USUAL_EPOCHS = {
    "alarms": 100_000,
    "detection": 2_000,
    "exclusion": 2_000,
    "protection": 100_000,
    "speed": 400,
    "peers": 1_000,
}
WITH_PEERS = (*PARTS, "peers")  # the last only where it is named: it needs another library
QUICK_EPOCHS = {"alarms": 2_000, "detection": 100, "exclusion": 100, "protection": 1_000, "speed": 50, "peers": 20}


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground gnss`."""
    parser = subparsers.add_parser("gnss", help=HELP, description=HELP)
    words = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    study = words.add_parser("study", help="run the Monte Carlo studies and write study.json and figures")
    study.add_argument(
        "--parts",
        nargs="+",
        choices=WITH_PEERS,
        default=list(PARTS),
        metavar="PART",
        help=", ".join(PARTS) + "; or peers",
    )
    study.add_argument("--epochs", type=int, metavar="N", help="epochs (cases) of each part")
    study.add_argument(
        "--peer-python", type=Path, metavar="PATH", help="interpreter that has gnss_lib_py, for the part peers"
    )
    study.add_argument("--quick", action="store_true", help="a few epochs, whether all works")
    study.add_argument("--seed", type=int, default=1, metavar="N", help="root of all random numbers (default 1)")
    study.add_argument("--out", type=Path, default=USUAL, metavar="DIR", help=f"folder (default {USUAL})")
    study.add_argument("--no-figures", action="store_true", help="draw nothing")
    check = words.add_parser("check", help="test the pseudoranges of a RINEX observation file")
    check.add_argument("file", type=Path, metavar="FILE", help="observations, RINEX 2 or 3, also .gz and Hatanaka")
    check.add_argument("--sp3", type=Path, metavar="FILE", help="precise orbits of the day")
    check.add_argument(
        "--nav", type=Path, nargs="+", default=[], metavar="FILE", help="or broadcast ones, RINEX 2 or 3"
    )
    check.add_argument(
        "--offset-enu",
        type=float,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("E", "N", "U"),
        help="what the header's position lacks to ITRF [m]: 0.51 0.56 0.02 for an ETRS89 one of 2020 in Denmark",
    )
    check.add_argument("--faults", type=int, default=0, metavar="N", help="inject 1, 2 and 3 faults N times each")
    check.add_argument("--seed", type=int, default=1, metavar="N", help="of the injected faults (default 1)")
    check.add_argument("--out", type=Path, default=USUAL / "check", metavar="DIR", help="folder for check.json, figure")
    check.add_argument("--no-figures", action="store_true", help="draw nothing")


def run(args: argparse.Namespace) -> int:
    """Do it, print it, return 0; of a check in which an epoch is left without a consistent fix, 1."""
    if not 0 <= args.seed < 1 << 62:
        raise OperatorError(f"--seed {args.seed}: give 0 to 2^62 - 1")
    if args.out.exists() and not args.out.is_dir():
        raise OperatorError(f"--out {args.out}: is a file; name a folder")
    return _check(args) if args.action == "check" else _study(args)


def _write(folder: Path, name: str, document: dict[str, Any]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise OperatorError(f"--out {folder}: cannot be written: {error.strerror}") from error


def _study(args: argparse.Namespace) -> int:
    if args.epochs is not None and args.epochs < 1:
        raise OperatorError(f"--epochs {args.epochs}: give 1 or more")
    if "peers" in args.parts and args.peer_python is None:
        raise OperatorError(f"part peers: name an interpreter with --peer-python; {interpreter.HOW}")
    from ground.gnss import report

    path = args.out / "study.json"
    try:
        document = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except (OSError, ValueError) as error:
        raise OperatorError(f"{path}: cannot be read ({error}); remove it") from None
    for part in WITH_PEERS:
        if part in args.parts:
            epochs = args.epochs or (QUICK_EPOCHS if args.quick else USUAL_EPOCHS).get(part, 1)
            document[part] = fly(part, args.seed, epochs, args.peer_python)
            _write(args.out, "study.json", document | {"seed": args.seed})
            print("\n".join(report.lines(part, document[part])), flush=True)
    if not args.no_figures:
        from ground.gnss import figures

        for drawn in figures.draw(document, args.out / "figures"):
            print(f"drawn: {drawn}")
    return 0


def fly(part: str, seed: int, epochs: int, peer_python: Path | None = None) -> dict[str, Any]:
    """One part of the study, as a document."""
    from ground.gnss import peers, protection, speed, study

    if part == "peers":
        assert peer_python is not None
        return peers.peers_part(seed, epochs, peer_python)
    if part == "speed":
        return speed.measure(seed, epochs)
    if part == "inputs":
        return study.inputs_part(seed)
    if part == "protection":
        return protection.protection_part(seed, epochs)
    parts = {"alarms": study.alarms_part, "detection": study.detection_part, "exclusion": study.exclusion_part}
    return parts[part](seed, epochs)


def _check(args: argparse.Namespace) -> int:
    if args.faults < 0:
        raise OperatorError(f"--faults {args.faults}: give 0 or more")
    import numpy as np

    from flightsw.gnss.setup import Settings
    from ground.gnss import check, report

    observed, orbits = check.load(args.file, args.sp3, args.nav)
    settings = Settings(protect=True)
    checked = check.check(observed, orbits, settings)
    reference = None
    if observed.place_m is not None:
        axes = checked.result["axes"][np.flatnonzero(np.isfinite(checked.result["axes"][:, 0, 0]))[0]]
        east, north, up = args.offset_enu
        reference = observed.place_m + axes.T @ np.array([east, north, up + observed.height_m])
    orbits_of = [path.name for path in (*([args.sp3] if args.sp3 else []), *args.nav)]
    document = {"file": args.file.name, "orbits": orbits_of, **check.describe(checked, reference)}
    if args.faults:
        document["injected"] = check.inject(checked, settings, args.seed, args.faults)
    _write(args.out, "check.json", document)
    print("\n".join(report.check_lines(document)), flush=True)
    if not args.no_figures:
        from ground.gnss import figures

        print(f"drawn: {figures.draw_check(checked, reference, document, args.out)}")
    return 0 if set(document["verdicts"]) <= {"CONSISTENT", "EXCLUDED"} else 1
