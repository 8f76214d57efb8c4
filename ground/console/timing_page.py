"""The page of timing: how long each member of flight's tick and slack takes, as flight tells it in turns."""

from __future__ import annotations

from rich.text import Text

from ground.console.model import State, age_s
from ground.console.text import seconds
from ground.console.told import Timing

STALE_TURNS_S = 60.0  # members take turns, one a second
FIRST_OCTAVE = 10  # the first element of the histogram ends at 2^10 ns
_HEIGHTS = " .:-=+*#%@"


def timing_page(state: State, now_s: float, rows: int) -> Text:
    """A line for each member: budget, percentiles, longest, how often beyond, and its histogram by octaves."""
    if not state.timing:
        return Text(
            "this flight has told no timing: it tells it where the ground may answer (--link), "
            "and runs as fast as it can in a simulation",
            style="dim",
        )
    newest_s = max(heard_s for _, heard_s in state.timing)
    told = state.timing[-1][0]
    text = Text()
    text.append(f"{len(state.timing)} of {told.members} members; ticks that began late: ", style="bold")
    slips = max(timing.slips for timing, _ in state.timing)
    text.append(f"{slips:,}", style="bold" if not slips else "bold yellow")
    silent_s = age_s(now_s, newest_s)
    if silent_s > STALE_TURNS_S / 10.0:
        text.append(f"  STALE {seconds(silent_s)}", style="bold yellow")
    text.append(
        f"\n\n{'microseconds':<16}{'budget':>8}{'p50':>9}{'p99':>9}{'p99.9':>9}{'longest':>10}{'beyond':>9}"
        "   1us  ..  1ms  .. 1s\n",
        style="bold",
    )
    for timing, heard_s in state.timing[: max(1, rows - 5)]:
        late = age_s(now_s, heard_s) > STALE_TURNS_S
        over = timing.over_budget > 0
        text.append(f"{timing.name:<16}", style="bold" if timing.place == 0 else "")
        text.append(f"{timing.budget_us:>8,.0f}")
        for value in (timing.p50_us, timing.p99_us, timing.p999_us):
            text.append(f"{_microseconds(value):>9}")
        text.append(f"{_microseconds(timing.longest_us):>10}")
        text.append(f"{timing.over_budget:>9,}", style="yellow" if over else "")
        text.append("  STALE: not told again" if late else f"  |{bars(timing)}|", style="bold yellow" if late else "")
        text.append("\n")
    text.append("\neach column is an octave; the taller the sign, the more runs ( .:-=+*#%@ , a decade in four)", "dim")
    return text


def bars(timing: Timing) -> str:
    """The histogram, one character an octave: by the logarithm of the share, so that one run in 10,000 is seen."""
    if not timing.runs:
        return " " * len(timing.histogram)
    signs = []
    for count in timing.histogram:
        height, share = 0, count / timing.runs
        while height < len(_HEIGHTS) - 1 and share > 10.0 ** ((height - len(_HEIGHTS) + 1) / 2.0):
            height += 1
        signs.append(_HEIGHTS[height] if count == 0 or height else _HEIGHTS[1])
    return "".join(signs)


def _microseconds(value: float) -> str:
    return "-" if value != value else f"{value:,.1f}" if value < 1000.0 else f"{value:,.0f}"
