"""A condition that lasts: it begins after several epochs in a row, and ends after several without it."""

from __future__ import annotations


class Latch:
    """Whether a condition holds, with hysteresis: one epoch in a thousand must not ring a bell."""

    __slots__ = ("_after", "_run", "_until", "holds")

    def __init__(self, raise_epochs: int, clear_epochs: int) -> None:
        self._after = raise_epochs
        self._until = clear_epochs
        self._run = 0  # epochs in a row that speak against what holds
        self.holds = False

    def note(self, seen: bool) -> None:
        """One more epoch, with or without it."""
        if seen == self.holds:
            self._run = 0
            return
        self._run += 1
        if self._run >= (self._until if self.holds else self._after):
            self.holds = seen
            self._run = 0
