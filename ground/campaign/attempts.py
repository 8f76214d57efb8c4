"""The ledger of a certification: every attempt that was begun, with what came of it. None is ever removed.

It lies in the folder of the campaign. Of a set that ships it lies beside the set, too, and a campaign of that set in a
new folder goes on from there: what failed on another machine, or with an earlier table, is not forgotten, and its
outages are not flown for a certificate again.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from ground.errors import OperatorError
from ground.tables.build import SETS

LEDGER = "attempts.json"
BEGUN, FINISHED, ABANDONED = "begun", "finished", "abandoned"


def read(folder: Path) -> list[dict[str, Any]]:
    """Attempts in the order they were begun. Raises OperatorError where the file is none of ours."""
    return _read(folder / LEDGER)


def _read(path: Path) -> list[dict[str, Any]]:
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        raise OperatorError(f"{path}: cannot be read ({error}); restore it, an attempt is never forgotten") from error
    if not isinstance(held, list) or not all(isinstance(one, dict) and "attempt" in one for one in held):
        raise OperatorError(f"{path}: not a list of attempts; restore it, an attempt is never forgotten")
    return held


def shipped(table_set: str, long: bool) -> Path:
    """Where the ledger of a set lies that ships; there may be none."""
    return SETS / f"{table_set}{'.long' if long else ''}.{LEDGER}"


def begin(folder: Path, what: dict[str, Any], again: bool = False, before: Path | None = None) -> dict[str, Any]:
    """The attempt to fly now: the last one if it is of the same things and not finished, or finished and not to be
    flown again; else the next, which is written down before anything is flown. before: what a new ledger begins with.
    """
    held = read(folder)
    if not held and before is not None:
        held = _read(before)
    last = held[-1] if held else None
    if last is not None and last["what"] == what and not (again and last["state"] == FINISHED):
        _write(folder, held)
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
