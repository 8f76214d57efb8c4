"""`ground`: the people's side. Dispatches to one room; only the room that is called is imported.

A room is one line in ROOMS and a module with two functions:

    add_arguments(subparsers) -> None   adds its parser under its own name
    run(args) -> int                    does the work, returns the exit status; imports heavy things inside

A mistake of the operator is an OperatorError: one line on stderr, exit status 2.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import NoReturn

from ground.errors import OperatorError, did_you_mean

# name -> (module, line in --help)
ROOMS: dict[str, tuple[str, str]] = {
    "table": ("ground.tables.command", "build and show the binary tables that flight loads"),
    "stimulus": ("ground.campaign.stimulus_command", "make what flight replays before it trusts a certified table"),
    "icd": ("ground.icdgen.command", "generate and export the interface"),
    "console": ("ground.console.command", "show whether the navigation may be trusted, live or from a log"),
    "status": ("ground.console.status_command", "say once whether the navigation may be trusted, for scripts"),
    "state": ("ground.console.state_command", "send flight a state with its covariance"),
    "link": ("ground.console.link_command", "make a key with which flight and console sign what they send"),
    "report": ("ground.reports.command", "make the figures of a run again and print its verdict"),
    "compare": ("ground.reports.compare_command", "put the figures of two runs beside each other"),
    "mcap": ("ground.console.mcap_command", "write a run's telemetry as MCAP, for Foxglove and other viewers"),
    "study": ("ground.studies.command", "fly an outage from many start phases and summarise error, flag and bound"),
    "accuracy": ("ground.accuracy.command", "measure the flight models against real orbits, and what they cost"),
    "tune": ("ground.tuning.command", "make a table set from flown errors, with the evidence"),
    "crosslink": ("ground.crosslink.command", "study integrity by ranging between the satellites of a constellation"),
    "gnss": ("ground.gnss.command", "study the consistency test of GNSS satellites, check a receiver's file with it"),
    "derivative": ("ground.derivative.command", "velocity and acceleration from positions: conditioning, any track"),
    "certify": ("ground.campaign.command", "fly a fresh ensemble of outages and say what it proves of a set's bound"),
    "timing": ("ground.timing.command", "measure what a tick, a kernel and a start cost on this machine"),
    "ledger": ("ground.studies.ledger_command", "measure the paper's claims and write the reproduction ledger"),
}

# what an ImportError of these means: the extra that brings them
_EXTRAS = {
    "cantools": "ground",
    "erfa": "ground",
    "astropy_iers_data": "ground",
    "matplotlib": "ground",
    "textual": "ground",
    "textual_plotext": "ground",
    "rich": "ground",
    "satkit": "sim",
    "satkit_data": "sim",
    "msgspec": "sim",
    "distributed": "cluster",
    "georinex": "rinex",
    "mcap": "mcap",
}


class _Parser(argparse.ArgumentParser):
    """Says a usage error on one line, without repeating the whole usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message}; see {self.prog} --help\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one `ground` command; returns the exit status (2: mistake in what was asked)."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser = _Parser(prog="ground", description="leonav ground segment: tables, interface, console, reports.")
    subparsers = parser.add_subparsers(dest="room", metavar="COMMAND", required=True)
    called = next((word for word in words if not word.startswith("-")), None)
    if called is not None and called not in ROOMS:
        print(
            f'ground: error: unknown command "{called}"{did_you_mean(called, ROOMS)}; commands: {", ".join(ROOMS)}',
            file=sys.stderr,
        )
        return 2
    try:
        room = None
        for name, (module, line) in ROOMS.items():
            if name == called:
                room = importlib.import_module(module)
                room.add_arguments(subparsers)
            else:
                subparsers.add_parser(name, help=line)
        args = parser.parse_args(words)
        return room.run(args) if room is not None else 2
    except OperatorError as error:
        print(f"ground: error: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get((error.name or "").partition(".")[0])
        if extra is None:
            raise
        print(
            f"ground: error: {called} needs {error.name}; install it: pip install 'leonav[{extra}]'",
            file=sys.stderr,
        )
        return 2
    except BrokenPipeError:  # `ground ... | head`
        sys.stderr.close()
        return 0


if __name__ == "__main__":
    sys.exit(main())
