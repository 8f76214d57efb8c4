"""`ground stimulus`: the stimulus that a certificate of a table carries."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `stimulus` to the dispatcher."""
    parser = subparsers.add_parser(
        "stimulus",
        description="Make the stimulus of a navigation table: inputs of the navigation step through every mode, with "
        "what the step answers. `ground table sign` attaches it, flight replays it before it starts.",
    )
    parser.add_argument("file", metavar="TABLE", help="binary navigation table")
    parser.add_argument("--out", metavar="FILE", required=True, help="stimulus to write")


def run(args: argparse.Namespace) -> int:
    """Carry out `ground stimulus ...`; returns the exit status."""
    from flightsw.icd.table_schema import NAVIGATION
    from flightsw.kernels import registry
    from flightsw.tables.stimulus import encode
    from ground.campaign.stimulus import make
    from ground.errors import OperatorError
    from ground.tables.command import write_whole
    from ground.tables.show import read_table

    table = read_table(args.file)
    if table.kind != NAVIGATION.name:
        raise OperatorError(f"{args.file}: a table of kind {table.kind}; a stimulus belongs to a navigation table")
    registry.warm_up()
    inputs, outputs = make(table)
    image = encode(inputs, outputs)
    write_whole(Path(args.out), image)
    print(f"{args.out}: {len(inputs)} steps through every mode, {len(image)} bytes")
    return 0
