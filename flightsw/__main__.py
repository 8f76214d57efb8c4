"""`flightsw run | replay`: arguments and exit codes. 0 done, 1 the run failed, 2 refused, 3 start again."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

EXIT_DIFFERENT, EXIT_REFUSED = 1, 2


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = _parser().parse_args(arguments)
    if arguments is None:  # a process of its own: a service manager's SIGTERM ends it in order, too
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return int(options.action(options))
    except KeyboardInterrupt:
        print("flightsw: stopped", file=sys.stderr)
        return 130


def _run(options: argparse.Namespace) -> int:
    from flightsw import onboard
    from flightsw.app import Checkpoints, PreflightFailed
    from flightsw.link_open import LinkOptions

    link = LinkOptions(tuple(options.link), options.link_key, options.link_state, options.bench)
    checkpoints = Checkpoints(options.checkpoint, options.checkpoint_period) if options.checkpoint else None
    try:
        return onboard.run(
            options.can,
            options.tables,
            link,
            options.out,
            options.ticks,
            checkpoints,
            options.resume,
            options.resume_max_age,
            options.table_key,
            options.allow_saturating,
            options.table_store,
            options.require_certificate,
            options.shared_clock,
            options.log_limit,
            not options.no_real_time,
        )
    except (PreflightFailed, onboard.Refused) as error:
        print(f"flightsw: {error}", file=sys.stderr)
        return EXIT_REFUSED


def _replay(options: argparse.Namespace) -> int:
    from flightsw import replay
    from flightsw.app import PreflightFailed

    try:
        differences = replay.check_versions(options.run_dir)
        for difference in differences:
            print(f"flightsw: {difference}", file=sys.stderr)
        if differences and not options.force:
            print("flightsw: refused; --force replays all the same", file=sys.stderr)
            return EXIT_REFUSED
        two_way = replay.is_two_way(replay.record_of(options.run_dir))
        outcome = replay.replay(options.run_dir, options.out or options.run_dir / "replay", _remark)
    except (PreflightFailed, replay.ReplayRefused) as error:
        print(f"flightsw: {error}", file=sys.stderr)
        return EXIT_REFUSED
    for name, offset in (("can.log", outcome.can_differs_at), ("link.tlog", outcome.link_differs_at)):
        same = "not compared: the ground could speak" if name == "link.tlog" and two_way else "identical"
        print(f"{name:<10} {same if offset is None else f'differs from byte {offset}'}")
    print(f"{outcome.ticks} ticks replayed: {'IDENTICAL' if outcome.identical else 'DIFFERENT'}")
    return 0 if outcome.identical else EXIT_DIFFERENT


def _remark(text: str) -> None:
    print(f"flightsw: {text}", file=sys.stderr)


def _megabytes(text: str) -> int:
    if not text.isdecimal() or not 2 <= int(text) <= 1_000_000:
        raise argparse.ArgumentTypeError(f"{text}: give whole megabytes from 2 to 1000000")
    return int(text) << 20


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: give a whole number from 1")
    return int(text)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.1 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text}: give seconds from 0.1 to 1000000")
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="flightsw", description="Navigation that bounds its own error.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="run | replay")

    run = commands.add_parser("run", help="fly in real time on a CAN bus")
    run.add_argument("--can", required=True, metavar="INTERFACE:CHANNEL", help="python-can bus, e.g. socketcan:can0")
    run.add_argument("--tables", required=True, type=Path, metavar="DIR", help="folder with the binary tables")
    run.add_argument(
        "--link",
        action="append",
        default=[],
        metavar="ADDRESS",
        help="an end of the ground link, any number: udp:HOST:PORT sends there and listens for answers, "
        "udpin:[HOST:]PORT and tcpin:[HOST:]PORT listen (127.0.0.1 unless named), serial:DEVICE:BAUD",
    )
    run.add_argument(
        "--link-key", type=Path, metavar="FILE", help="sign what is sent, obey what is signed; see `ground link key`"
    )
    run.add_argument(
        "--link-state", type=Path, metavar="DIR", help="parameters, uploads and what commands came before a restart"
    )
    run.add_argument(
        "--bench", action="store_true", help="take unsigned commands, on loopback only, for clients that cannot sign"
    )
    run.add_argument("--out", type=Path, metavar="DIR", help="folder for the logs, ready to be replayed; none without")
    run.add_argument(
        "--log-limit",
        type=_megabytes,
        default=2048 << 20,
        metavar="MB",
        help="largest size of can.log and of link.tlog, each with its older parts, of which the oldest go (2048)",
    )
    run.add_argument("--ticks", type=_count, metavar="N", help="stop after so many ticks")
    run.add_argument("--checkpoint", type=Path, metavar="FILE", help="keep the state here for a warm restart")
    run.add_argument(
        "--checkpoint-period", type=_seconds, default=60.0, metavar="S", help="seconds between checkpoints (60)"
    )
    run.add_argument(
        "--resume", type=Path, metavar="FILE", help="go on from this checkpoint; told and not used where unfit"
    )
    run.add_argument(
        "--resume-max-age", type=_seconds, default=7200.0, metavar="S", help="an older state is not used (7200)"
    )
    run.add_argument(
        "--table-key", type=Path, metavar="FILE", help="the navigation table must carry a certificate signed with it"
    )
    run.add_argument(
        "--allow-saturating", action="store_true", help="for a study: fly a bound that settles below its limit"
    )
    run.add_argument(
        "--table-store",
        type=Path,
        metavar="DIR",
        help="boot from the A/B navigation tables here; a file upload.tbl put here is validated, staged and tried",
    )
    run.add_argument(
        "--require-certificate", action="store_true", help="publish the state of an uncertified table as not valid"
    )
    run.add_argument(
        "--shared-clock",
        type=Path,
        metavar="FILE",
        help="when ready, wait for this file and run by the clock of the simulated world that wrote it",
    )
    run.add_argument(
        "--no-real-time", action="store_true", help="ordinary scheduling, memory not locked: on a bench, or to compare"
    )
    run.set_defaults(action=_run)

    replay = commands.add_parser("replay", help="fly the journal of a run again and compare, byte for byte")
    replay.add_argument("run_dir", type=Path, metavar="RUN_DIR", help="folder that a run left")
    replay.add_argument("--out", type=Path, metavar="DIR", help="where the replayed logs go (default RUN_DIR/replay)")
    replay.add_argument("--force", action="store_true", help="replay although code or tables differ from the run's")
    replay.set_defaults(action=_replay)
    return parser


if __name__ == "__main__":
    sys.exit(main())
