"""A reproduction ledger: what a paper says, what a study measured, and the test that holds it.

A claim judges itself: where a study does not bear its verdict, the ledger is not written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from ground.errors import OperatorError
from ground.studies.study_folder import held

Study = dict[str, Any]
REPRODUCED, QUALIFIED, CONTRADICTED = "REPRODUCED", "QUALIFIED", "CONTRADICTED"


class Claim(NamedTuple):
    """One claim. `ours` puts the measurement in words, `holds` says whether it bears the verdict."""

    claim: str
    where: str
    paper: str
    ours: Callable[[Study], str]
    verdict: str
    holds: Callable[[Study], bool]
    test: str  # file::function


class Ledger(Protocol):
    """A module of claims. NEEDED: parts of the study; render: Markdown, and the claims that do not hold, in words."""

    CLAIMS: tuple[Claim, ...]
    NEEDED: tuple[str, ...]

    def render(self, study: Study) -> tuple[str, list[str]]:
        """The ledger, and the claims whose verdict this study does not bear."""


def rendered(head: str, claims: Sequence[Claim], study: Study, tail: str) -> tuple[str, list[str]]:
    """Head, table and tail in Markdown, and the claims whose verdict this study does not bear, in words."""
    failing = [f"{one.verdict} does not hold: {one.claim}: {one.ours(study)}" for one in claims if not one.holds(study)]
    lines = ["| claim of the paper | where | the paper's figure | ours | verdict | test |", "|" + "---|" * 6]
    for one in claims:
        path, _, name = one.test.partition("::")
        cells = (one.claim, one.where, one.paper, one.ours(study), f"**{one.verdict}**", f"[`{name}`](../{path})")
        lines.append(f"| {' | '.join(cells)} |")
    return f"{head}\n" + "\n".join(lines) + f"\n\n{tail}\n", failing


def write(command: str, ledger: Ledger, study: Path, out: Path) -> int:
    """Write the ledger of `ground COMMAND` from a study.json; 0, or 1 where it does not hold. Raises OperatorError."""
    document = held(study)
    lacking = [part for part in ledger.NEEDED if part not in document]
    if lacking:
        raise OperatorError(
            f"{study}: has no {' and '.join(lacking)}; run ground {command} study --parts {' '.join(lacking)}"
        )
    text, failing = ledger.render(document)
    if failing:
        print(f"ground {command} ledger: not written, measurements and verdicts disagree:")
        print("\n".join(failing))
        return 1
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OperatorError(f"--out {out}: cannot be written: {error.strerror}") from error
    print(f"{out}: {len(ledger.CLAIMS)} claims")
    return 0
