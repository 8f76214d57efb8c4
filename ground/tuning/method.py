"""What every method of tuning is: from a base set to changes of it, with the evidence for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from matplotlib.figure import Figure

Advance = Callable[[int], None]  # so many more are done
Bar = Callable[[str, int], AbstractContextManager[Advance]]  # what is done, of how many


class Effort(NamedTuple):
    """How much is flown, in how many processes, and from which root of random numbers."""

    quick: bool = False
    jobs: int = 1
    seed: int = 1
    runs: int | None = None  # None: what the method takes for usual


class Tuned(NamedTuple):
    """What a method found. changes: keys of `build_navigation`'s overrides; evidence: for tuning.json, plain values;
    lines: of the report, in Markdown; drawings: file name and what draws it."""

    changes: Mapping[str, float]
    summary: str
    evidence: Mapping[str, Any]
    lines: list[str]
    drawings: tuple[tuple[str, Callable[[], Figure]], ...] = ()


class Method(Protocol):
    """A way to tune. What it has flown lies in the folder: the same call goes on where it was interrupted."""

    @property
    def help(self) -> str:
        """One line for the operator."""

    @property
    def usual_set(self) -> str:
        """The set that it starts from where none is named."""

    def tune(self, table_set: str, folder: Path, effort: Effort, bar: Bar) -> Tuned:
        """Raises OperatorError where the set is none for this method or nothing can be found."""


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    """A table in Markdown."""
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
