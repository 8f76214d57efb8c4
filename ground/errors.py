"""The one exception that an operator sees: a sentence that names the place and the remedy."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class OperatorError(Exception):
    """A mistake in what the operator gave. `python -m ground` prints it on one line and exits with 2."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """' (did you mean "x"?)' for a close match among the known words, else an empty string."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f' (did you mean "{close[0]}"?)' if close else ""
