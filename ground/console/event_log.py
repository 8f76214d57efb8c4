"""The page of events: all that is held, the newest last, filtered by severity and by a word."""

from __future__ import annotations

from typing import NamedTuple

from rich.text import Text

from ground.console.model import Event
from ground.console.panels import SHORT_SEVERITIES, events, severity_word
from ground.console.text import safe

LEVELS = (7, 5, 4, 3)  # MAV_SEVERITY: all, from notice, from warning, from error


class Filter(NamedTuple):
    """What is shown: events of this severity or graver whose line holds the word, capitals or not."""

    severity: int = LEVELS[0]
    word: str = ""

    def next_level(self) -> Filter:
        """The next severity, after the last the first again."""
        return self._replace(severity=LEVELS[(LEVELS.index(self.severity) + 1) % len(LEVELS)])

    def select(self, log: tuple[Event, ...]) -> tuple[Event, ...]:
        """The events that are shown, in order. A word finds text, and severity as it is written."""
        word = self.word.casefold()
        return tuple(
            event
            for event in log
            if event.severity <= self.severity
            and (
                word in event.text.casefold()
                or word in (severity_word(event.severity), SHORT_SEVERITIES.get(event.severity, "").casefold())
            )
        )


def events_page(log: tuple[Event, ...], chosen: Filter, back: int, rows: int) -> Text:
    """The newest events that the filter lets through; back: lines scrolled to older ones."""
    shown = chosen.select(log)
    what = "all" if chosen.severity == LEVELS[0] else f"{severity_word(chosen.severity)} and graver"
    text = Text()
    text.append(f"{len(shown)} of {len(log)} events: {what}", style="bold")
    if chosen.word:
        text.append(f', with "{safe(chosen.word, 40)}"', style="bold")
    last = max(0, len(shown) - back)
    if back:
        text.append(f"   {len(shown) - last} newer below", style="bold yellow")
    text.append("\nf severity   / search   up, down scroll\n", style="dim")
    room = max(1, rows - 3)
    for event in shown[max(0, last - room) : last]:
        text.append("\n")
        text.append_text(events((event,), 1))
    if not shown:
        text.append("\nno event is like that" if log else "\nno events yet", style="dim")
    return text
