"""`ground state send`: a state from the ground into a flight, signed, and what flight made of it."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ground.console.command import DEFAULT_UDP, anchored_clock, parse_address

HELP = "send flight a state with its covariance, to start from or to correct by"
_WAIT_S = 15.0
_POLL_S = 0.05


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground state`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "state",
        help=HELP,
        description=f"{HELP}. Exit status: 0 taken, 1 refused or no answer, 2 a mistake in the file.",
    )
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    send = actions.add_parser("send", help="a CCSDS OPM (KVN) with covariance; GCRF or ITRF; UTC, TAI, TT or GPS")
    send.add_argument("file", type=Path, metavar="FILE")
    send.add_argument("--udp", default=DEFAULT_UDP, metavar="HOST:PORT", help=f"listen here (default {DEFAULT_UDP})")
    send.add_argument("--key", type=Path, metavar="FILE", help="sign with it; without, a bench flight only obeys")


def run(args: argparse.Namespace) -> int:
    """Send, print what came of it. Raises OperatorError."""
    from ground.console.authentication import Verifier, read_key
    from ground.console.link import UdpLink
    from ground.console.opm import read_opm
    from ground.console.uplink import Operator

    given = read_opm(args.file)
    clock = anchored_clock()
    verifier = Verifier(read_key(args.key), clock) if args.key is not None else None
    link = UdpLink(*parse_address(args.udp), clock, verifier)
    try:
        operator = Operator(link.send, verifier, lambda severity, text: print(text))
        return 0 if send(link, operator, given) else 1
    finally:
        link.close()


def send(link: Any, operator: Any, given: Any, sleep: Callable[[float], None] = time.sleep) -> bool:
    """Whether flight has taken it; waits until flight is heard, and for its answer."""
    done: list[bool] = []
    asked = False
    end_s = link.now_s() + _WAIT_S
    while not done:
        for _, message in link.receive():
            operator.take(message)
            if not asked and message.get_type() == "HEARTBEAT":
                operator.upload_state(given, "state", done.append)
                asked = True
        operator.step(link.now_s())
        if link.now_s() > end_s and not asked:
            print(f"nothing was heard of flight in {_WAIT_S:g} s: nothing was sent")
            return False
        sleep(_POLL_S)
    return done[0]
