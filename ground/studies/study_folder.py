"""The folder of a study of several parts: study.json grows part by part, what is flown is kept, progress is shown."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ground.errors import OperatorError


def held(path: Path) -> dict[str, Any]:
    """A study.json; empty where there is none. Raises OperatorError for one that cannot be read."""
    try:
        document = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except (OSError, ValueError) as error:
        raise OperatorError(f"{path}: cannot be read ({error}); remove it") from None
    return document if isinstance(document, dict) else {}


def make_folder(path: Path) -> None:
    """Make the folder of --out. Raises OperatorError."""
    if path.exists() and not path.is_dir():
        raise OperatorError(f"--out {path}: is a file; name a folder")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OperatorError(f"--out {path}: cannot be made: {error.strerror}") from error


def check_counts(args: argparse.Namespace, *names: str) -> None:
    """Refuse counts below 1 and a seed that no root can be. Raises OperatorError."""
    for name in names:
        value = getattr(args, name)
        if value is not None and value < 1:
            raise OperatorError(f"--{name.replace('_', '-')} {value}: give 1 or more")
    if not 0 <= args.seed < 1 << 62:
        raise OperatorError(f"--seed {args.seed}: give 0 to 2^62 - 1")


def fly_parts(
    folder: Path,
    seed: int,
    parts: Sequence[str],
    fly: Callable[[str], dict[str, Any]],
    lines: Callable[[str, dict[str, Any]], list[str]],
) -> tuple[dict[str, Any], bool]:
    """Fly parts, write and print each when it is done; study.json, and whether it was stopped before the last."""
    path = folder / "study.json"
    document = held(path)
    document["seed"] = seed
    try:
        for part in parts:
            document[part] = fly(part)
            path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
            print("\n".join(lines(part, document[part])), flush=True)
    except KeyboardInterrupt:
        print("\nstopped; finished runs are kept, the same command goes on from there", file=sys.stderr)
        return document, True
    return document, False


@contextmanager
def progress(label: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar on the terminal; call what it yields with the count that came in."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as shown:
        task = shown.add_task(label, total=total)
        yield lambda count: shown.advance(task, count)
