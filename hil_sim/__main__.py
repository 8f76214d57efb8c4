"""`hil_sim list | keys | show | run | hub | world | demo | soak`: arguments; exit codes 0 done, 1 failed, 2 refused."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path
from typing import Any

EXIT_FAILED, EXIT_REFUSED = 1, 2
MISSING_EXTRA = "is not installed; the simulator needs: pip install 'leonav[sim,ground]'"


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = _parser().parse_args(arguments)
    if arguments is None:  # a process of its own: SIGTERM ends it in order, too
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return int(options.action(options))
    except KeyboardInterrupt:
        print("hil_sim: stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:
        return 0
    except ModuleNotFoundError as error:
        # a missing extra is the user's to install; a missing module of our own is a defect and keeps its traceback
        if error.name is None or error.name.split(".")[0] in ("hil_sim", "flightsw", "ground"):
            raise
        print(f"hil_sim: {error.name} {MISSING_EXTRA}", file=sys.stderr)
        return EXIT_REFUSED
    except Exception as error:
        from hil_sim.errors import BusError, SimulationError

        if not isinstance(error, SimulationError):
            raise
        print(f"hil_sim: {error}", file=sys.stderr)
        return EXIT_FAILED if isinstance(error, BusError) else EXIT_REFUSED


def _list(options: argparse.Namespace) -> int:
    from hil_sim import scenario

    del options
    known = scenario.shipped()
    width = max(len(name) for name in known)
    for name in known:
        print(f"{name:<{width}}  {scenario.load(name).scenario.description}")
    return 0


def _keys(options: argparse.Namespace) -> int:
    from hil_sim import scenario_help

    del options
    print(scenario_help.describe_keys())
    return 0


def _show(options: argparse.Namespace) -> int:
    from hil_sim import scenario

    print(scenario.describe(scenario.load(options.scenario, options.set)))
    return 0


def _run(options: argparse.Namespace) -> int:
    from hil_sim import scenario

    loaded = scenario.load(options.scenario, options.set)
    out_dir = options.out if options.out is not None else Path("runs") / loaded.scenario.name
    from hil_sim import sil

    return int(sil.run(loaded, out_dir, options.link, options.speed) or 0)


def _hub(options: argparse.Namespace) -> int:
    from hil_sim import hub

    return hub.serve(options.port, lambda port: print(f"hub: ready {port}", flush=True))


def _world(options: argparse.Namespace) -> int:
    from hil_sim import live, scenario

    loaded = scenario.load(options.scenario, options.set)
    bus = live.open_bus(options.can)
    try:
        return live.fly(loaded, bus, options.shared_clock, lambda c: print(f"world: ready {c}", flush=True))
    finally:
        bus.shutdown()


def _demo(options: argparse.Namespace) -> int:
    from hil_sim import demo, scenario

    loaded = scenario.load(options.scenario, options.set)
    return demo.run(loaded, options.out, options.speed, options.plain, options.set, not options.no_real_time)


def _soak(options: argparse.Namespace) -> int:
    from hil_sim import scenario, soak

    return soak.run(scenario.load(options.scenario, options.set), options.out, options.ticks, options.expect)


def _ticks(text: str) -> int:
    try:
        ticks = round(float(text))
    except (ValueError, OverflowError):
        ticks = 0
    if not 1000 <= ticks <= 20_000_000:
        raise argparse.ArgumentTypeError(f"{text}: give a number from 1000 to 2e7, for example 1e6")
    return ticks


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not 0.01 <= speed <= 1e4:
        raise argparse.ArgumentTypeError(f"{text}: give a number from 0.01 to 10000, 1 for real time")
    return speed


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="hil_sim", description="Flies a satellite against the flight software.")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="list | keys | show | run | hub | world | demo | soak"
    )
    listing = commands.add_parser("list", help="scenarios that ship")
    listing.set_defaults(action=_list)
    keys = commands.add_parser("keys", help="every key a scenario may hold, with default and meaning")
    keys.set_defaults(action=_keys)
    hub = commands.add_parser("hub", help="a CAN bus between processes, on this machine's loopback")
    hub.add_argument("--port", type=int, default=0, metavar="PORT", help="default: any that is free")
    hub.set_defaults(action=_hub)
    for name, action, help_text in (
        ("world", _world, "the world of a scenario in real time, on a bus"),
        ("demo", _demo, "world, bus, flight and console as processes of their own, in real time"),
        ("show", _show, "every resolved key of a scenario and where its value comes from"),
        ("run", _run, "fly a scenario and leave its record in a folder"),
        ("soak", _soak, "fly a scenario lap after lap and see whether anything grows, slips or errs"),
    ):
        command = commands.add_parser(name, help=help_text)
        words: dict[str, Any] = {"nargs": "?", "default": name} if name in ("demo", "soak") else {}
        command.add_argument("scenario", help="name of a shipped scenario, or a TOML file", **words)
        command.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="KEY=VALUE",
            help="override a key, for example gnss.sigma_position_m=33 or outage.0.duration_s=600",
        )
        if name == "world":
            command.add_argument("--can", required=True, metavar="INTERFACE:CHANNEL", help="e.g. socketcan:vcan0")
            command.add_argument(
                "--shared-clock", required=True, type=Path, metavar="FILE", help="start by the clock of this file"
            )
        if name == "demo":
            command.add_argument(
                "--out", type=Path, default=Path("runs/live"), metavar="DIR", help="where to write (default runs/live)"
            )
            command.add_argument("--speed", type=_speed, default=1.0, metavar="X", help="times real time (default 1)")
            command.add_argument("--plain", action="store_true", help="the console prints lines; no terminal needed")
            command.add_argument(
                "--no-real-time", action="store_true", help="flight with ordinary scheduling and no locked memory"
            )
        if name == "soak":
            command.add_argument("--ticks", type=_ticks, default=10_000_000, metavar="N", help="default 1e7")
            command.add_argument(
                "--out", type=Path, default=Path("runs/soak"), metavar="DIR", help="where to write (default runs/soak)"
            )
            command.add_argument(
                "--expect",
                type=Path,
                metavar="FILE",
                help="soak.json of another soak, whose telemetry this must repeat",
            )
        if name == "run":
            command.add_argument("--out", type=Path, metavar="DIR", help="where to write (default runs/SCENARIO)")
            command.add_argument(
                "--link",
                metavar="udp:HOST:PORT",
                help="send MAVLink there too, for example to a console; logged always",
            )
            command.add_argument(
                "--speed",
                type=_speed,
                metavar="X",
                help="pace the run at X times real time (default: as fast as it goes)",
            )
        command.set_defaults(action=action)
    return parser


if __name__ == "__main__":
    sys.exit(main())
