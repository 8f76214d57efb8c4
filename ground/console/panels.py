"""What stands in each panel of the screen, as styled text made from the state: no widgets here.

Colour only repeats what words already say: a stale value carries the word STALE and its age.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from rich.text import Text

from flightsw.icd.alerts import Severity
from flightsw.icd.enums import DaSource, FlagState, Governing
from ground.console.link import Link, Statistics
from ground.console.model import Event, State, active_alerts, age_s, cause_name
from ground.console.text import gps_stamp, metres, metres_each, percent, seconds, utc_clock
from ground.console.told import Integrity, TimeToFlag
from ground.console.verdict import LINK_TIMEOUT_S, STALE_S, Judgement, mode_word

LABEL = 11
PAGE_NAMES = (
    *("overview", "alarms", "filter", "link", "tables", "parameters", "events", "timing", "gnss", "crosslink"),
)
SHORT_NAMES = {
    "overview": "view",
    "parameters": "param",
    "timing": "time",
    "crosslink": "xlink",
}  # for the line of keys
SEVERITY_STYLES: dict[int, str] = {
    Severity.EMERGENCY: "bold red",
    Severity.ALERT: "bold red",
    Severity.CRITICAL: "bold red",
    Severity.ERROR: "red",
    Severity.WARNING: "yellow",
    Severity.NOTICE: "cyan",
}
SHORT_SEVERITIES = {0: "EMERG", 1: "ALERT", 2: "CRIT", 3: "error", 4: "warn", 5: "note", 6: "info", 7: "debug"}
HELP_TEXT = """\
The verdict is flight's own, withdrawn where another value disagrees.

  TRUSTED             fixes are accepted, the bound is within the limit
  TRUSTED, COASTING   no fix for a while; the bound still covers the error
  DO NOT USE          flag up, bound beyond the limit, or a contradiction
  NOT READY           no state yet
  NO LINK             silence for 3 s: nothing is known, whatever stood here
  NO INTEGRITY DATA   messages come, but none about the error
  UNAUTHENTICATED     messages come, but no key here has verified them

Uncertified table: no probability stands behind the bound.
STALE and an age mark every value not renewed for 3 s.
Plot: bound in dots, limit as a line; ░ coasting, ▒ failed. Key x: the levels
of the GCRF axes x, y, z, and 3 of the error in space, each in its letter.

  q quit   ? this help   p pause (live: of plot and events)   x plot the axes
  1-9, 0 pages, tab the next     up, down choose a line or scroll
  a acknowledge the alarm that is marked      o orders (each is confirmed)
  l list parameters   s set the marked one    n send a state
  f events by severity   / search in events
  u upload a table   r read it back   d differences from a file
  left, right -+1 min   + - speed (replay)

any key closes this help"""


def header(link: Link, state: State, now_s: float, paused: bool, progress: str) -> Text:
    """One line: what must not be missed, how the link does, what time it is; the name last, it may be cut off."""
    text = Text()
    text.append("leonav ", style="bold")
    waiting = sum(alarm.acknowledged_s is None for alarm in state.alarms)
    marks = (
        (paused, "PAUSED"),
        (waiting, f"{waiting} ALARM{'S' if waiting > 1 else ''} TO ACKNOWLEDGE"),
        (state.link is not None and state.link.bench, "BENCH"),
        (state.link is not None and not state.link.armed, "FLAG DISARMED"),
        (link.statistics.unauthenticated, f"{link.statistics.unauthenticated:,} NOT AUTHENTIC"),
        (not link.live and link.statistics.unverified, "SIGNATURES NOT VERIFIED"),
    )
    for holds, words in marks:
        if holds:
            text.append(f" {words} ", style="bold reverse yellow")
            text.append(" ")
    silent_s = age_s(now_s, state.heard_s)
    if math.isinf(silent_s):
        text.append(" link: nothing heard", style="bold red")
    else:
        late = silent_s > LINK_TIMEOUT_S
        text.append(f" link {seconds(silent_s)}{' SILENT' if late else ''}", style="bold red" if late else "green")
    kind = "LIVE" if link.live else "END OF LOG" if link.finished() else "REPLAY"
    text.append(f"  {kind}{' ' + progress if progress else ''}", style="bold cyan")
    text.append(f"  {utc_clock(now_s)} UTC  {link.name}")
    return text


def stale_mark(now_s: float, heard_s: float | None, limit_s: float = STALE_S) -> str:
    """`  STALE 12 s` for a value that was not renewed, else nothing."""
    silent_s = age_s(now_s, heard_s)
    return f"  STALE {seconds(silent_s)}" if silent_s > limit_s else ""


def keys(page: int, commands: bool, live: bool) -> Text:
    """The bottom line: pages, the one that is shown marked, and the keys that do something here."""
    text = Text()
    for number, name in enumerate(PAGE_NAMES, 1):
        text.append(
            f"{number % 10} {SHORT_NAMES.get(name, name)}", style="bold reverse" if number - 1 == page else "bold"
        )
        text.append(" ")
    text.append(" ? help", style="bold")
    text.append(" o orders" if commands else " q quit", style="bold")
    if not live:
        text.append(" ←/→", style="bold")
    return text


def verdict(judgement: Judgement) -> Text:
    """Two lines: the words, and the reason."""
    text = Text()  # a style given here would be that of the reason too
    text.append(f" {judgement.word} ", style="bold reverse")
    if judgement.certificate:
        text.append("  ")
        text.append(judgement.certificate, style="bold")
    text.append(f"\n {judgement.reason}")
    return text


def values(state: State, now_s: float) -> Text:
    """Label and value, one a line, each with its age when it is stale."""
    text = Text()
    for i, (label, value, heard_s) in enumerate(_rows(state, now_s)):
        text.append(("\n" if i else "") + f"{label:<{LABEL}}", style="dim")
        silent_s = age_s(now_s, heard_s)
        if heard_s is None:
            text.append("not received", style="dim italic")
        elif silent_s > STALE_S:
            # The mark stands first: it must not be what a narrow panel cuts off.
            text.append(f"STALE {seconds(silent_s)}", style="bold yellow")
            text.append(f" {value}", style="dim")
        else:
            text.append(value)
    return text


def _rows(state: State, now_s: float) -> Iterator[tuple[str, str, float | None]]:
    i, heard_s = state.integrity, state.integrity_s
    if i is None:
        for label in ("mode", "bound", "x, y, z", "bound 3-D", "fix age", "flag"):
            yield label, "", None
    else:
        q = state.protection
        yield "mode", mode_word(i.mode), heard_s
        yield "bound", metres(i.bound_m) + ("" if i.driver == 1 else _of_limit(i)), heard_s
        yield "x, y, z", "" if q is None else metres_each(q.level_m), state.protection_s
        yield "bound 3-D", metres(i.bound_3d_m) + (_of_limit(i) if i.driver == 1 else ""), heard_s
        yield "fix age", f"{seconds(i.fix_age_s)}, {i.accepted_streak} in a row", heard_s
        yield "flag", flag_words(i.flag_state, i.flag_age_s), heard_s
    t = state.time_to_flag
    yield "time left", "" if t is None else time_left(t), state.time_to_flag_s
    if t is not None and governed(t):
        yield "governs", governed(t), state.time_to_flag_s
    # The name comes once a minute, the CRC with every integrity: a name of another CRC is out of date.
    named = state.table is not None and i is not None and state.table.crc32 == i.table_crc32
    name = state.table.set_name if named and state.table else "name unknown"
    crc = "" if i is None else f"{name[:12]} {i.table_crc32:08x}"
    yield "table", crc, heard_s
    yield "heartbeat", f"{seconds(age_s(now_s, state.heartbeat_s))} ago", state.heartbeat_s
    n = state.innovation
    words = "" if n is None else f"{_plain(n.nis)} of {_plain(n.gate)}, mean {_plain(n.mean_nis)}"
    if n is not None and not n.used:
        words = f"{_plain(n.nis)}, refused: {cause_name(n.cause)}"
    yield "NIS", words, state.innovation_s
    # GPS_RAW_INT is repeated like the innovation and carries no time of its own.
    fix_s = state.satellites_s if n is None else state.innovation_s
    yield "satellites", "" if state.satellites is None else str(state.satellites), fix_s
    if i is not None:
        yield "stored dA", f"{i.stored_da_coverage_pct} % of orbit, {_da_source(i.da_source)}", heard_s
    nav = state.nav
    yield "GPS time", "" if nav is None else gps_stamp(nav.t_gps_ns), state.nav_s


def _of_limit(i: Integrity) -> str:
    """What a bound is compared with, and the share of it."""
    words = f" of {metres(i.limit_m)}"
    if i.limit_m > 0.0 and math.isfinite(i.driving_bound_m) and i.driving_bound_m < 1e4 * i.limit_m:
        words += f"  {percent(i.driving_bound_m / i.limit_m)}"
    return words


def time_left(told: TimeToFlag) -> str:
    """How long until the flag."""
    if told.governing == Governing.FLAG:
        return "none: the flag is up"
    if not governed(told):
        return "not predicted yet"
    least = "> " if told.governing == Governing.HORIZON else ""
    return f"{least}{seconds(told.time_to_flag_s)}{'' if told.in_outage else ' without GNSS'}"


def governed(told: TimeToFlag) -> str:
    """What ends that time, and how old the prediction is; nothing where none was made."""
    if told.governing in (Governing.FLAG, Governing.NOT_READY) or not math.isfinite(told.time_to_flag_s):
        return ""
    known = told.governing in Governing._value2member_map_
    governs = Governing(told.governing).name.lower().replace("_", " ") if known else f"cause {told.governing}"
    return f"{governs}, {seconds(told.prediction_age_s)} old"


def flag_words(flag_state: int, flag_age_s: float) -> str:
    """The failure flag, and at which outage age it was raised."""
    known = FlagState(flag_state).name if flag_state in FlagState._value2member_map_ else f"FLAG {flag_state}"
    return f"{known} at {seconds(flag_age_s)}" if math.isfinite(flag_age_s) else known


def _da_source(source: int) -> str:
    return DaSource(source).name.lower() if source in DaSource._value2member_map_ else f"source {source}"


def _plain(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "?"


def events(log: tuple[Event, ...], rows: int) -> Text:
    """The newest `rows` events, the newest last; severity as a word."""
    text = Text()
    if not log:
        text.append("no events yet", style="dim")
    for i, event in enumerate(log[-rows:] if rows > 0 else ()):
        text.append(("\n" if i else "") + f"{utc_clock(event.t_s)} ", style="dim")
        text.append(f"{SHORT_SEVERITIES.get(event.severity, '?'):<6}", style=SEVERITY_STYLES.get(event.severity, ""))
        text.append(event.text)
    return text


def severity_word(severity: int) -> str:
    """MAV_SEVERITY as a lower-case word; unknown numbers stay visible."""
    known = severity in Severity._value2member_map_
    return Severity(severity).name.lower() if known else f"sev {severity}"


def counters(state: State, statistics: Statistics, now_s: float, rows: int) -> Text:
    """Counts of flight's inputs by cause, and of the link's own troubles."""
    text = Text()
    c = state.counters
    if c is None:
        text.append("flight: not received", style="dim italic")
    else:
        text.append(f"accepted {c.accepted:,} of {c.received:,}")
        if age_s(now_s, state.counters_s) > 4 * STALE_S:
            text.append(f" STALE {seconds(age_s(now_s, state.counters_s))}", style="bold yellow")
        text.append(f"\nslips {c.slips:,}, journal lost {c.journal_dropped:,}")
        ranked = sorted(((n, k) for k, n in enumerate(c.rejected) if n), reverse=True)
        shown = max(1, rows - 3) if ranked else 1
        if not ranked:
            text.append("\nnothing rejected", style="green")
        for n, k in ranked[:shown]:
            text.append(f"\n{cause_name(k):<17} {n:>9,}", style="yellow")
        if len(ranked) > shown:
            text.append(f"  +{len(ranked) - shown} more", style="yellow")
    s = statistics
    text.append(f"\nlink: lost {s.lost:,} bad {s.damaged:,} unknown {s.unknown:,}", style="dim")
    return text


def alerts_line(state: State) -> str:
    """Names of the alerts active now, and how many were lost on the way."""
    if state.integrity is None:
        return ""
    active = active_alerts(state.integrity.alerts)
    lost = f"; {state.alerts_lost} lost on the link" if state.alerts_lost else ""
    return ("active: " + ", ".join(active) if active else "none active") + lost
