"""`ground link key FILE`: make a key for flight and console."""

from __future__ import annotations

import argparse
import os
import secrets
from pathlib import Path

from ground.console.authentication import KEY_LENGTH
from ground.errors import OperatorError

HELP = "make a key with which flight and console sign what they send"


def add_arguments(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """The parser of `ground link`."""
    parser = subparsers.add_parser("link", help=HELP, description=HELP)
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    key = actions.add_parser("key", help="write a new key to a file that only you may read")
    key.add_argument("file", type=Path, metavar="FILE")


def run(args: argparse.Namespace) -> int:
    """Make the key; an existing file is never overwritten."""
    try:
        fd = os.open(args.file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise OperatorError(f"{args.file}: is there already; name another file") from None
    except OSError as error:
        raise OperatorError(f"{args.file}: cannot be written ({error.strerror})") from None
    with os.fdopen(fd, "w") as file:
        file.write(secrets.token_hex(KEY_LENGTH) + "\n")
    print(f"{args.file}: new key, for flightsw run --link-key and ground console --key")
    return 0
