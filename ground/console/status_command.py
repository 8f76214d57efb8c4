"""`ground status`: the verdict once, for scripts; exit 0 where the navigation may be trusted, 1 where it may not."""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ground.console.command import DEFAULT_UDP, anchored_clock, parse_address
from ground.errors import OperatorError

HELP = "say once whether the navigation may be trusted, for scripts"
HEALTHY = ("TRUSTED", "TRUSTED, COASTING")
UNCERTIFIED = "NOT CERTIFIED"
LISTEN_S = 5.0  # without --wait-healthy: as long as it takes to hear what flight sends once a second
_POLL_S = 0.05


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground status`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "status", help=HELP, description=f"{HELP}. Exit status: 0 healthy, 1 not, 2 a mistake in what was asked."
    )
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--udp", default=DEFAULT_UDP, metavar="HOST:PORT", help=f"listen here (default {DEFAULT_UDP})")
    source.add_argument("--tlog", type=Path, metavar="FILE", help="the last word of a telemetry log: runs/*/link.tlog")
    parser.add_argument("--key", type=Path, metavar="FILE", help="verify flight's signatures with it")
    parser.add_argument(
        "--wait-healthy",
        type=float,
        metavar="S",
        help=f"wait so long to be trusted (else listen {LISTEN_S:g} s)",
    )
    parser.add_argument(
        "--accept-uncertified", action="store_true", help="a healthy bound without a certificate behind it will do"
    )
    parser.add_argument("--json", action="store_true", help="all of it as JSON on one line")


def run(args: argparse.Namespace) -> int:
    """Listen, print, and return the exit status. Raises OperatorError."""
    if args.wait_healthy is not None and not 0.0 < args.wait_healthy <= 86_400.0:
        raise OperatorError(f"--wait-healthy {args.wait_healthy:g}: give seconds above 0, at most 86400")
    if args.tlog is not None and (args.key is not None or args.wait_healthy is not None):
        raise OperatorError("--tlog: a log is neither verified nor waited for; leave out --key and --wait-healthy")
    from ground.console.authentication import Verifier, read_key
    from ground.console.link import UdpLink
    from ground.console.tlog import TlogLink

    words = (*HEALTHY, UNCERTIFIED) if args.accept_uncertified else HEALTHY
    if args.tlog is not None:
        told = of_log(TlogLink(args.tlog, 1.0, time.monotonic), words)
    else:
        address, clock = parse_address(args.udp), anchored_clock()
        link = UdpLink(*address, clock, Verifier(read_key(args.key), clock) if args.key is not None else None)
        try:
            wait_s = args.wait_healthy if args.wait_healthy is not None else LISTEN_S
            told = watch(link, words, wait_s, args.wait_healthy is None)
        finally:
            link.close()
    print(json.dumps(told, allow_nan=False) if args.json else sentence(told))
    return 0 if told["healthy"] else 1


def watch(
    link: Any, words: tuple[str, ...], wait_s: float, whole: bool, sleep: Callable[[float], None] = time.sleep
) -> dict[str, Any]:
    """The status as soon as it is healthy, or after the wait. whole: only once the slower messages are there too."""
    from ground.console.model import State, reduce

    state = State(started_s=link.now_s())
    end_s = link.now_s() + wait_s
    while True:
        for time_s, message in link.receive():
            state = reduce(state, message, time_s)
        told = status(state, link.now_s(), link, words)
        complete = state.time_to_flag is not None and state.link is not None
        if link.now_s() >= end_s or (told["healthy"] and (complete or not whole)):
            return told
        sleep(_POLL_S)


def of_log(link: Any, words: tuple[str, ...]) -> dict[str, Any]:
    """The status at the end of a log."""
    from ground.console.model import State, reduce

    state = State(started_s=link.start_s)
    for time_s, message in link.everything():
        state = reduce(state, message, time_s)
    return status(state, link.stop_s, link, words)


def status(state: Any, now_s: float, link: Any, words: tuple[str, ...] = HEALTHY) -> dict[str, Any]:
    """Everything that the console's first page says, as plain values; None for what is not known or not a number.

    words: verdicts that count as healthy. Lengths in metres, times in seconds.
    """
    from ground.console.model import active_alerts, age_s
    from ground.console.verdict import STALE_S, judge_link, mode_word

    judgement = judge_link(state, now_s, link)
    told: dict[str, Any] = {
        "healthy": judgement.word in words,
        "verdict": judgement.word,
        "reason": judgement.reason,
        "certificate": judgement.certificate,
        "link_age_s": age_s(now_s, state.heard_s),
        "heartbeat_age_s": age_s(now_s, state.heartbeat_s),
        "messages": link.statistics.frames,
        "lost": link.statistics.lost,
        "not_authentic": link.statistics.unauthenticated,
        "signatures_not_verified": link.statistics.unverified,
        "alarms_to_acknowledge": sum(alarm.acknowledged_s is None for alarm in state.alarms),
    }
    i = state.integrity
    if i is not None:
        told |= {
            "stale": age_s(now_s, state.integrity_s) > STALE_S,
            "mode": mode_word(i.mode),
            "bound_m": i.bound_m,
            "bound_3d_m": i.bound_3d_m,
            "limit_m": i.limit_m,
            "fix_age_s": i.fix_age_s,
            "outage_age_s": i.outage_age_s,
            "alerts": active_alerts(i.alerts),
            "table_crc32": f"{i.table_crc32:08x}",
        }
    if state.time_to_flag is not None:
        told |= {"time_to_flag_s": state.time_to_flag.time_to_flag_s, "in_outage": bool(state.time_to_flag.in_outage)}
    if state.link is not None:
        told |= {"flag_armed": bool(state.link.armed), "bench": bool(state.link.bench)}
    unknown = {name for name, value in told.items() if isinstance(value, float) and not math.isfinite(value)}
    return {name: None if name in unknown else value for name, value in told.items()}


def sentence(told: dict[str, Any]) -> str:
    """The status on one line for people."""
    words = ", ".join(word for word in (told["verdict"], told["certificate"]) if word)
    return f"{words}: {told['reason']}"
