"""`ground timing`: what a tick, a kernel and a start cost on this machine."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from ground.errors import OperatorError
from ground.exit_status import STOPPED

PARTS = ("kernels", "lanes", "ticks", "instructions", "start", "realtime", "link")
USUAL_OUT = Path("runs/timing")
QUICK_S = 1500.0  # of a scenario in lockstep
QUICK_REAL_S = 10.0
_SAME = ("processor", "processors", "python", "numba", "numpy", "quick")
HELP = "measure what a tick, a kernel and a start cost on this machine"


def add_arguments(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `timing` to the dispatcher."""
    parser = subparsers.add_parser("timing", help=HELP, description=HELP)
    parser.add_argument("--parts", nargs="*", choices=PARTS, default=list(PARTS), metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--quick", action="store_true", help="short flights, whether all works")
    parser.add_argument("--out", type=Path, default=USUAL_OUT, metavar="DIR", help=f"folder (default {USUAL_OUT})")
    parser.add_argument("--resume", action="store_true", help="measure only the parts that DIR has no figures of yet")
    parser.add_argument("--soak", type=Path, metavar="FILE", help="tell of this soak, too: soak.json of `hil_sim soak`")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here, too")
    parser.add_argument("--doc", type=Path, metavar="FILE", help="write the report here, too, as docs/timing.md is")


def run(args: argparse.Namespace) -> int:
    """Measure, print, write; returns 0."""
    from ground.timing import report

    figures = args.out / "timing.json"
    found: dict[str, Any] = _measured(figures, args.quick) if args.resume else {"machine": _machine(args.quick)}
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        for part in args.parts:
            if part not in found:
                found[part] = _MEASURES[part](args)
                _keep(figures, found)
        if args.soak is not None:
            found["soak"] = _soak(args.soak)
        text = report.render(found)
        (args.out / "timing.md").write_text(text, encoding="utf-8")
        _keep(figures, found)
        if args.json is not None:
            args.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
        if args.doc is not None:
            args.doc.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OperatorError(f"{error.filename}: cannot be written ({error.strerror})") from error
    except KeyboardInterrupt:
        print(f"\nstopped; parts measured are in {figures}, --resume goes on from there", file=sys.stderr)
        return STOPPED
    print(text)
    return 0


def _measured(path: Path, quick: bool) -> dict[str, Any]:
    """Figures of an earlier call, where they are of this machine and these versions, and as quick."""
    now = _machine(quick)
    try:
        found = dict(json.loads(path.read_text(encoding="utf-8")))
        then = dict(found["machine"])
    except FileNotFoundError:
        return {"machine": now}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OperatorError(f"{path}: no figures to go on from ({error!r}); leave --resume out") from error
    other = [f"{name} {then.get(name)}, now {now[name]}" for name in _SAME if then.get(name) != now[name]]
    if other:
        raise OperatorError(
            f"{path}: measured elsewhere ({'; '.join(other)}); leave --resume out, or name another --out"
        )
    return found


def _keep(path: Path, found: dict[str, Any]) -> None:
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    partial.replace(path)


def _soak(path: Path) -> dict[str, Any]:
    """What is told of a soak: its account without the digests, marks of the first lap and the last."""
    try:
        account = json.loads(path.read_text(encoding="utf-8"))
        laps = account.pop("laps")
        return {
            **account,
            "flown_laps": len(laps),
            "first": laps[0],
            "last": laps[-1],
            "grown": _sum(laps[1:], "grown"),
        }
    except OSError as error:
        raise OperatorError(f"--soak {path}: cannot be read ({error.strerror})") from error
    except (ValueError, KeyError, IndexError) as error:
        raise OperatorError(f"--soak {path}: not the account of a soak ({error!r})") from None


def _sum(laps: list[dict[str, Any]], name: str) -> int:
    return sum(lap[name] for lap in laps)


def _machine(quick: bool) -> dict[str, Any]:
    import os
    import platform
    from datetime import UTC, datetime
    from importlib import metadata

    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
        name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), name)
    return {
        "processor": name,
        "processors": os.cpu_count(),
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
        "numba": metadata.version("numba"),
        "numpy": metadata.version("numpy"),
        "day": datetime.now(UTC).date().isoformat(),
        "quick": quick,
    }


def _kernels(args: argparse.Namespace) -> list[dict[str, Any]]:
    from ground.timing import nine_states

    _tell("kernels: the nine-state filter, by all ways there are here")
    return [way._asdict() for way in nine_states.compare(rounds=3 if args.quick else 15)]


def _lanes(args: argparse.Namespace) -> list[dict[str, Any]]:
    from ground.timing import lanes

    _tell("lanes: the ensemble of (17) and its means")
    return [way._asdict() for way in lanes.compare(rounds=10 if args.quick else 100)]


def _instructions(args: argparse.Namespace) -> dict[str, Any]:
    from ground.timing import instructions

    if (why := instructions.missing()) is not None:
        _tell(f"instructions: {why}")
        return {"missing": why}
    counted = dict(list(instructions.SCENARIOS.items())[: 1 if args.quick else None])
    return {
        name: instructions.count(*what, lambda text: _tell(f"instructions: {text}")) for name, what in counted.items()
    }


def _ticks(args: argparse.Namespace) -> dict[str, Any]:
    from ground.timing import flights

    found = {}
    for number, (name, (scenario, settings)) in enumerate(flights.LOCKSTEP.items()):
        _tell(f"ticks: {scenario} in lockstep")
        shorter = (f"time.duration_s={QUICK_S}", *flights.NOTHING_WRONG) if args.quick else ()
        found[name] = flights.lockstep(scenario, (*settings, *shorter), args.out / f"lockstep_{number}")
    return found


def _start(args: argparse.Namespace) -> dict[str, float]:
    import tempfile

    from ground.timing import flights

    with tempfile.TemporaryDirectory() as folder:
        flights.start(Path(folder), cold=False)  # compiles what is not compiled yet
        _tell("start: with compiled kernels")
        found = {"with compiled kernels": min(flights.start(Path(folder), cold=False) for _ in range(3))}
        if not args.quick:
            _tell("start: compiling every kernel, a minute or two")
            found["compiling every kernel"] = flights.start(Path(folder), cold=True)
    return found


def _real_time(args: argparse.Namespace) -> dict[str, Any]:
    from ground.timing import flights

    found = {}
    for number, (name, (period_ns, duration_s, fifo)) in enumerate(flights.REAL_TIME.items()):
        lasting_s = QUICK_REAL_S if args.quick else duration_s
        _tell(f"realtime: {lasting_s:.0f} s at {name}")
        found[name] = flights.real_time(period_ns, lasting_s, fifo, args.out / f"realtime_{number}")
    return found


def _link(args: argparse.Namespace) -> dict[str, Any]:
    import tempfile

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from ground.timing import link_work

    ticks = link_work.QUICK_TICKS if args.quick else link_work.TICKS
    _tell(f"link: {ticks:,} ticks with the ground link open")
    columns = (TextColumn("link"), BarColumn(), MofNCompleteColumn(), TextColumn("ticks"), TimeRemainingColumn())
    with (
        tempfile.TemporaryDirectory() as folder,
        Progress(*columns, console=Console(file=sys.stderr), transient=True) as progress,
    ):
        task = progress.add_task("link", total=ticks)
        return link_work.fly(ticks, Path(folder), lambda flown: progress.update(task, completed=flown))


_MEASURES = {
    "kernels": _kernels,
    "lanes": _lanes,
    "ticks": _ticks,
    "instructions": _instructions,
    "start": _start,
    "realtime": _real_time,
    "link": _link,
}


def _tell(text: str) -> None:
    print(f"timing: {text}", file=sys.stderr, flush=True)
