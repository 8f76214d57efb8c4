"""`ground console`: the operator's screen, live from UDP or from a .tlog; `--plain` for logs."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ground.errors import OperatorError

DEFAULT_UDP = "127.0.0.1:14550"
HELP = "show whether the navigation may be trusted, live or from a log"


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground console`."""
    parser: argparse.ArgumentParser = subparsers.add_parser("console", help=HELP, description=HELP)
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--udp", default=DEFAULT_UDP, metavar="HOST:PORT", help=f"listen here (default {DEFAULT_UDP})")
    source.add_argument("--tlog", type=Path, metavar="FILE", help="replay a telemetry log: runs/*/link.tlog")
    parser.add_argument("--key", type=Path, metavar="FILE", help="verify flight's signatures and sign commands with it")
    parser.add_argument("--speed", type=float, metavar="N", help="replay N times as fast (with --tlog)")
    parser.add_argument(
        "--plain", action="store_true", help="one line a second on standard output; a log is printed at once"
    )


def run(args: argparse.Namespace) -> int:
    """Open the link and show it. Raises OperatorError for arguments or files that cannot be used."""
    speed = _speed(args)
    address = parse_address(args.udp)
    if args.key is not None and args.tlog is not None:
        raise OperatorError("--key: a log is not verified; leave it out with --tlog")
    from ground.console.authentication import Verifier, read_key
    from ground.console.link import UdpLink
    from ground.console.tlog import TlogLink

    link: TlogLink | UdpLink
    if args.tlog is not None:
        link = TlogLink(args.tlog, speed, time.monotonic)
    else:
        clock = anchored_clock()
        verifier = Verifier(read_key(args.key), clock) if args.key is not None else None
        link = UdpLink(*address, clock, verifier)
    try:
        if not args.plain:
            if not (sys.stdin.isatty() and sys.stdout.isatty()):
                raise OperatorError("console: this is not a terminal; add --plain for one line a second")
            from ground.console.view import ConsoleApp

            ConsoleApp(link).run()
            return 0
        from ground.console import plain

        if isinstance(link, TlogLink):
            _print(plain.replay_lines(link))
        else:
            print(f"listening on {link.name}; ctrl-C ends", file=sys.stderr)
            _print(plain.live_lines(link))
        return 0
    except KeyboardInterrupt:
        return 0
    finally:
        link.close()


def parse_address(text: str) -> tuple[str, int]:
    """`HOST:PORT` (IPv6 hosts in brackets) to its parts."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise OperatorError(f'--udp "{text}": give HOST:PORT, for example {DEFAULT_UDP}')
    return host.removeprefix("[").removesuffix("]"), int(port)


def anchored_clock() -> Callable[[], float]:
    """Unix seconds anchored once: a step of the wall clock must not make values look fresh or stale."""
    offset_s = time.time() - time.monotonic()
    return lambda: offset_s + time.monotonic()


def _speed(args: argparse.Namespace) -> float:
    if args.speed is None:
        return 1.0
    if args.tlog is None:
        raise OperatorError("--speed: only a replay has a speed; give --tlog FILE too")
    if not (math.isfinite(args.speed) and 0.0 < args.speed <= 1e4):
        raise OperatorError(f"--speed {args.speed:g}: give a number above 0, at most 10000")
    return float(args.speed)


def _print(lines: Iterable[str]) -> None:
    for line in lines:
        print(line, flush=True)
