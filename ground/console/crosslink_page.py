"""The page of the crosslinks: who is named, what the links say of the own message, what no range can show."""

from __future__ import annotations

import math

from rich.text import Text

from flightsw.icd.enums import CrosslinkMajority, CrosslinkState
from ground.console.crosslink_told import Crosslink
from ground.console.model import State, age_s
from ground.console.panels import stale_mark
from ground.console.text import metres, seconds

EPOCH_STALE_S = 5.0
_STYLES: dict[int, str] = {
    CrosslinkState.CLEAR: "bold green",
    CrosslinkState.SUSPECT: "bold yellow",
    CrosslinkState.FAULT: "bold red",
}
_WORDS: dict[int, str] = {
    CrosslinkState.NOT_JUDGED: "NOT MONITORED",
    CrosslinkState.CLEAR: "CLEAR",
    CrosslinkState.SUSPECT: "IN DOUBT",
    CrosslinkState.FAULT: "WRONG: DO NOT USE",
}
_MAJORITY: dict[int, str] = {
    CrosslinkMajority.NO_VERDICT: "no verdict",
    CrosslinkMajority.RELIABLE: "reliable",
    CrosslinkMajority.UNRELIABLE: "UNRELIABLE",
}
_NOBODY = 255


def crosslink_page(state: State, now_s: float) -> Text:
    """State, statistics against thresholds, links, and the limits of the method."""
    told = state.crosslink
    if told is None:
        return Text("this flight has said nothing of crosslinks: it flies no table of that kind", style="dim")
    text = Text()
    text.append(f"satellite {told.own + 1} of {told.satellites}", style="bold")
    text.append(stale_mark(now_s, state.crosslink_s), style="bold yellow")
    text.append("\n\nown message   ")
    text.append(own_words(told.own_state), style=_STYLES.get(told.own_state, "bold"))
    if told.own_peer != _NOBODY:
        text.append(f"   or that of satellite {told.own_peer + 1}, which explains the links as well")
    text.append(f"\nexcluded      {named_words(told.faulty)}", style="bold red" if told.faulty else "")
    text.append(f"\nnot monitored {named_words(told.unmonitored)}", style="bold yellow" if told.unmonitored else "")
    text.append(f"\nmajority      {_known(_MAJORITY, told.majority)}\n\n")
    text.append(f"own links     {_against(told.own_statistic, told.own_threshold)}\n")
    worst = "" if told.network_worst == _NOBODY else f"   satellite {told.network_worst + 1}"
    text.append(f"network       {_against(told.network_statistic, told.network_threshold)}{worst}\n")
    text.append(f"links         {told.links} of the last epoch, {told.own_links} of them its own\n")
    age = told.epoch_age_s + (0.0 if state.crosslink_s is None else age_s(now_s, state.crosslink_s))
    text.append("last epoch    ")
    if not math.isfinite(age):
        text.append("none yet\n", style="bold yellow")
    else:
        text.append(f"{seconds(age)} ago", style="bold yellow" if age > EPOCH_STALE_S else "")
        text.append("   SILENT\n" if age > EPOCH_STALE_S else "\n", style="bold yellow")
    text.append(f"incomplete    {told.incomplete:,} epochs\n")
    text.append("\nwhat no range can show\n", style="bold")
    hidden = told.parameters - told.rank
    text.append(f"  rank {told.rank} of {told.parameters}: errors in {hidden} common directions stretch no link\n")
    if told.weakest != _NOBODY:
        text.append(
            f"  a jump of {metres(told.weakest_m)} is certain to be found, even of satellite {told.weakest + 1}\n"
        )
    return text


def own_words(own_state: int) -> str:
    """The own message in words; unknown numbers stay visible."""
    return _known(_WORDS, own_state)


def named_words(faulty: int) -> str:
    """Numbers, from 1, of the satellites in a mask."""
    numbers = [str(bit + 1) for bit in range(32) if faulty >> bit & 1]
    return f"satellite{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}" if numbers else "none"


def plain_words(told: Crosslink, stale: str) -> str:
    """All of it in a few words, for a line. stale: mark of a message that is not renewed."""
    excluded = f", excluded {named_words(told.faulty)}" if told.faulty else ""
    unmonitored = f", not monitored {named_words(told.unmonitored)}" if told.unmonitored else ""
    epoch = "" if told.epoch_age_s <= EPOCH_STALE_S else f", no epoch for {seconds(told.epoch_age_s)}"
    if math.isnan(told.epoch_age_s):
        epoch = ", no epoch yet"
    statistic = f", {_against(told.network_statistic, told.network_threshold)}"
    return f"crosslinks: own message {own_words(told.own_state)}{excluded}{unmonitored}{statistic}{epoch}{stale}"


def _known(words: dict[int, str], number: int) -> str:
    return words.get(number, f"STATE {number}")


def _against(statistic: float, threshold: float) -> str:
    if statistic < 0.0 or math.isnan(statistic):
        return "not judged"
    mark = "  ABOVE" if statistic > threshold else ""
    return f"{statistic:.1f} of {threshold:.1f}{mark}"
