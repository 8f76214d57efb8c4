"""The ledger of a certification: every attempt that was begun, with what came of it. None is ever removed."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from ground.errors import OperatorError

LEDGER = "attempts.json"
BEGUN, FINISHED, ABANDONED = "begun", "finished", "abandoned"


def read(folder: Path) -> list[dict[str, Any]]:
    """Attempts in the order they were begun. Raises OperatorError where the file is none of ours."""
    path = folder / LEDGER
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        raise OperatorError(f"{path}: cannot be read ({error}); restore it, an attempt is never forgotten") from error
    if not isinstance(held, list) or not all(isinstance(one, dict) and "attempt" in one for one in held):
        raise OperatorError(f"{path}: not a list of attempts; restore it, an attempt is never forgotten")
    return held


def begin(folder: Path, what: dict[str, Any], again: bool = False) -> dict[str, Any]:
    """The attempt to fly now: the last one if it is of the same things and not finished, or finished and not to be
    flown again; else the next, which is written down before anything is flown."""
    held = read(folder)
    last = held[-1] if held else None
    if last is not None and last["what"] == what and not (again and last["state"] == FINISHED):
        return last
    if last is not None and last["state"] == BEGUN:
        last["state"] = ABANDONED
    attempt = {"attempt": len(held) + 1, "state": BEGUN, "what": what}
    _write(folder, [*held, attempt])
    return attempt


def finish(folder: Path, attempt: int, result: dict[str, Any]) -> list[dict[str, Any]]:
    """Write down what came of an attempt; all attempts."""
    held = read(folder)
    held[attempt - 1] |= {"state": FINISHED, "result": result}
    _write(folder, held)
    return held


def _write(folder: Path, attempts: list[dict[str, Any]]) -> None:
    path = folder / LEDGER
    partial = path.with_suffix(f".{os.getpid()}.partial")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        partial.write_text(json.dumps(attempts, indent=2, sort_keys=True) + "\n", encoding="utf-8")
        os.replace(partial, path)
    except OSError as error:
        raise OperatorError(f"{path}: cannot be written: {error.strerror}") from error
