"""`ground console`: the operator's screen, live from UDP or from a .tlog; `--plain` for logs."""

from __future__ import annotations

import argparse
import math
import os
import shlex
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
    parser.add_argument("--read-only", action="store_true", help="show everything, order nothing")
    parser.add_argument("--web", type=int, metavar="PORT", help="serve it to browsers of this machine; read only")
    parser.add_argument("--token", type=Path, metavar="FILE", help="with --web: sessions that give it may order")
    # a session of --web: where it gets its feed, and whom it ends with
    source.add_argument("--relay", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--served-by", type=int, help=argparse.SUPPRESS)


def run(args: argparse.Namespace) -> int:
    """Open the link and show it. Raises OperatorError for arguments or files that cannot be used."""
    speed = _speed(args)
    address = parse_address(args.udp)
    if args.key is not None and args.tlog is not None:
        raise OperatorError("--key: a log is not verified; leave it out with --tlog")
    if args.web is not None:
        return _serve(args, address)
    if args.token is not None:
        raise OperatorError("--token: only a served console has one; give --web PORT too")
    from ground.console.authentication import Verifier, read_key
    from ground.console.link import UdpLink
    from ground.console.relay import ReadOnly, RelayLink
    from ground.console.tlog import TlogLink

    if args.served_by is not None:
        from ground.workers import serve

        serve(args.served_by)
    link: TlogLink | UdpLink | ReadOnly
    if args.tlog is not None:
        link = TlogLink(args.tlog, speed, time.monotonic)
    else:
        clock = anchored_clock()
        verifier = Verifier(read_key(args.key), clock) if args.key is not None else None
        link = RelayLink(args.relay, clock, verifier) if args.relay else UdpLink(*address, clock, verifier)
        if args.read_only:
            link = ReadOnly(link)
    try:
        if not args.plain:
            if args.served_by is None and not (sys.stdin.isatty() and sys.stdout.isatty()):
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


def _serve(args: argparse.Namespace, address: tuple[str, int]) -> int:
    """`--web`: consoles for browsers until Ctrl-C."""
    if not 1 <= args.web <= 65535:
        raise OperatorError(f"--web {args.web}: give a port from 1 to 65535")
    if args.plain:
        raise OperatorError("--plain: a browser shows the whole console; leave it out with --web")
    try:
        from ground.console.web import HOST, ConsoleServer, read_token
    except ModuleNotFoundError as error:
        raise OperatorError(f"--web: {error.name} is not installed; pip install leonav[web]") from None
    from ground.console.relay import Relay

    if args.read_only and args.token is not None:
        raise OperatorError("--token: with --read-only nobody may order; leave one of them out")
    token = read_token(args.token) if args.token is not None else None
    if args.tlog is not None:
        if token is not None:
            raise OperatorError("--token: a log cannot be commanded; leave it out with --tlog")
        if not args.tlog.is_file():
            raise OperatorError(f"--tlog {args.tlog}: no such file")
        speed = [] if args.speed is None else ["--speed", repr(args.speed)]
        session = ["--tlog", str(args.tlog.resolve()), *speed]
        ConsoleServer(args.web, _session(*session)).serve()
        return 0
    key = ["--key", str(args.key.resolve())] if args.key is not None else []
    try:
        relay = Relay(*address, ordering=token is not None)
    except OSError as error:
        raise OperatorError(f"--udp {args.udp}: cannot listen ({error.strerror or error})") from None
    relay.start()
    try:
        reading = _session("--relay", str(relay.reading), "--read-only", *key)
        ordering = _session("--relay", str(relay.ordering), *key) if relay.ordering is not None else None
        print(f"http://{HOST}:{args.web}/ reads", file=sys.stderr)
        if token is not None:
            print(f"http://{HOST}:{args.web}/?token={token} may order", file=sys.stderr)
        ConsoleServer(args.web, reading, ordering, token).serve()
    except OSError as error:
        raise OperatorError(f"--web {args.web}: cannot listen ({error.strerror or error}); give another port") from None
    finally:
        relay.close()
    return 0


def _session(*arguments: str) -> str:
    """Command of a session, for a shell; in its place, so that the session is a child of the server."""
    command = shlex.join((sys.executable, "-m", "ground", "console", *arguments, "--served-by", str(os.getpid())))
    return f"exec {command}" if os.name == "posix" else command


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
