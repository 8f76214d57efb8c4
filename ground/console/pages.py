"""The pages behind the overview, as styled text made from the state: alarms, filter, link, tables, parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.text import Text

from flightsw.icd.alerts import ALERTS
from ground.console.alarms import Alarm, standing
from ground.console.link import Statistics
from ground.console.model import State, active_alerts, age_s, cause_name
from ground.console.panels import PAGE_NAMES, SEVERITY_STYLES, SHORT_SEVERITIES, events, stale_mark
from ground.console.text import metres, metres_each, percent, seconds, utc_clock
from ground.console.told import Integrity
from ground.console.uplink import Operator
from ground.console.verdict import STALE_S, certificate_words

PAGES = PAGE_NAMES
REFUSALS = (
    *("damaged", "unknown kind", "wrong target", "unsigned", "bad signature", "replayed", "too old", "from the future"),
    *("too many senders", "flood", "unknown address"),
)
_WORDS = ("", "a table is staged: activate it", "the new table is on trial")


def alarms(state: State, chosen: int, rows: int) -> Text:
    """Alarms that stand, gravest first, the chosen one marked; below them the newest events."""
    shown = standing(state.alarms)
    text = Text()
    text.append(f"  {'':<6}{'RAISED':<9}{'NOW':<14}{'ACKNOWLEDGED':<20}ALARM\n", style="bold")
    if not shown:
        text.append("  no alarm stands\n", style="green")
    for i, alarm in enumerate(shown[: max(1, rows - 6)]):
        text.append("> " if i == chosen else "  ", style="bold")
        text.append(f"{SHORT_SEVERITIES.get(alarm.severity, '?'):<6}", style=SEVERITY_STYLES.get(alarm.severity, ""))
        text.append(f"{utc_clock(alarm.raised_s):<9}")
        now = "ACTIVE" if alarm.ended_s is None else f"over {utc_clock(alarm.ended_s)}"
        text.append(f"{now:<14}", style="bold" if alarm.ended_s is None else "")
        seen = "NO: press a" if alarm.acknowledged_s is None else f"{utc_clock(alarm.acknowledged_s)} {alarm.by}"
        text.append(f"{seen[:19]:<20}", style="bold yellow" if alarm.acknowledged_s is None else "")
        known = ALERTS.get(alarm.alert_id)
        text.append(f"{known.text if known else f'unknown alert {alarm.alert_id}'} (#{alarm.sequence})\n")
    left = rows - text.plain.count("\n") - 2
    if left > 0:
        text.append("\n")
        text.append_text(events(state.events, left))
    return text


def chosen_alarm(state: State, chosen: int) -> Alarm | None:
    """The alarm that is marked."""
    shown = standing(state.alarms)
    return shown[chosen] if 0 <= chosen < len(shown) else None


def filter_page(state: State, now_s: float) -> Text:
    """What the last fix looked like to the filter."""
    text = Text()
    i = state.innovation
    if i is None:
        return Text("no fix has been judged yet", style="dim")
    stale = age_s(now_s, state.innovation_s)
    text.append(f"last fix judged {seconds(stale)} ago{'  STALE' if stale > STALE_S else ''}\n", style="bold")
    text.append(f"outcome      {'used' if i.used else f'refused: {cause_name(i.cause)}'}\n")
    text.append(f"NIS          {_number(i.nis)} of at most {_number(i.gate)}   {_bar(i.nis, i.gate)}\n")
    text.append(f"mean NIS     {_number(i.mean_nis)} per degree of freedom over the streak (1 is consistent)\n")
    told = state.integrity
    if told is not None:
        text.append(f"streak       {told.accepted_streak} fixes accepted in a row\n")
        text.append_text(_levels(state, told, now_s))
        text.append(f"1-sigma      {_sigmas(state)}")
        text.append(stale_mark(now_s, state.sigma_rtn_s) + "\n", style="bold yellow")
        text.append(f"alerts       {', '.join(active_alerts(told.alerts)) or 'none'}\n")
    text.append("\nrejected since start, by cause", style="bold")
    text.append(stale_mark(now_s, state.counters_s, 4 * STALE_S) + "\n", style="bold yellow")
    counts = state.counters.rejected if state.counters is not None else ()
    ranked = sorted(((n, k) for k, n in enumerate(counts) if n), reverse=True)
    for n, k in ranked:
        text.append(f"  {cause_name(k):<20}{n:>10,}\n")
    if not ranked:
        text.append("  nothing\n", style="green")
    return text


def _levels(state: State, told: Integrity, now_s: float) -> Text:
    """Protection level against alert limit: of each axis, of the whole error, and along the orbit."""
    text = Text()
    rows: list[tuple[str, float, float]] = []
    q, heard_s = state.protection, state.protection_s
    if q is not None:
        rows = [
            (f"axis {name}", *pair) for name, pair in zip("xyz", zip(q.level_m, q.limit_m, strict=True), strict=True)
        ]
    else:
        rows.append(("any axis", told.bound_m, told.limit_m))
        heard_s = state.integrity_s
    rows.append(("in space", told.bound_3d_m, told.limit_m))
    for i, (name, level_m, limit_m) in enumerate(rows):
        judged = told.driver == 1 if name == "in space" else told.driver != 1
        share = percent(level_m / limit_m) if limit_m > 0.0 and math.isfinite(level_m) else ""
        text.append(
            f"{'protection' if i == 0 else '':<13}{name:<10}{metres(level_m):>9} of {metres(limit_m):<9}{share:>7}"
        )
        text.append(f"  {_bar(level_m, limit_m)}" if judged else "  not what the flag looks at", "")
        text.append((stale_mark(now_s, heard_s) if i == 0 else "") + "\n", style="bold yellow")
    if q is not None:
        text.append(f"{'':<13}radial, along, cross-track  {metres_each(q.level_rtn_m)} (for reading)\n")
    return text


def _sigmas(state: State) -> str:
    if state.sigma_rtn_m is None:
        return "unknown"
    radial, along, cross = (metres(value) for value in state.sigma_rtn_m)
    return f"radial {radial}, along-track {along}, cross-track {cross} (the filter's own, no bound)"


def link_page(state: State, statistics: Statistics, operator: Operator | None, now_s: float) -> Text:
    """The link in both directions."""
    text = Text()
    s = statistics
    text.append("heard by the console\n", style="bold")
    text.append(f"  {s.frames:,} messages, {s.lost:,} lost, {s.damaged:,} damaged, {s.unknown:,} of unknown kind\n")
    text.append(f"  {s.unauthenticated:,} not authenticated and not believed\n")
    text.append(f"  heartbeat {seconds(age_s(now_s, state.heartbeat_s))} ago\n")
    text.append("\nheard by flight\n", style="bold")
    told = state.link
    if told is None:
        text.append("  this flight has said nothing of a two-way link\n", style="dim")
    else:
        stale = age_s(now_s, state.link_s)
        mark = f"  STALE {seconds(stale)}" if stale > STALE_S else ""
        text.append(f"  {told.accepted:,} messages taken, {told.lost:,} of its own lost{mark}\n")
        for name, count in zip(REFUSALS, told.refused, strict=False):
            if count:
                text.append(f"  refused, {name:<18}{count:>8,}\n", style="yellow")
        text.append(f"  failure flag {'armed' if told.armed else 'DISARMED: the state is not guarded'}\n")
        if told.bench:
            text.append("  BENCH PROFILE: unsigned commands are taken\n", style="bold reverse yellow")
    text.append("\n")
    if operator is None:
        text.append("this console only listens", style="dim")
    return text


def tables_page(state: State, operator: Operator | None, now_s: float, diff: Sequence[str], rows: int) -> Text:
    """The navigation table, what is under way with another, and how that differs. diff: lines, the first a heading."""
    text = Text()
    i, t = state.integrity, state.table
    text.append("navigation table in force\n", style="bold")
    if i is None:
        text.append("  not received\n", style="dim")
    else:
        name = t.set_name if t is not None and t.crc32 == i.table_crc32 else "name not received yet"
        text.append(f"  {name}, CRC-32 {i.table_crc32:08x}, {certificate_words(state)}")
        text.append(stale_mark(now_s, state.integrity_s) + "\n", style="bold yellow")
    if state.link is not None and state.link.table_staged:
        text.append(f"  {_WORDS[min(state.link.table_staged, 2)]}\n", style="bold yellow")
    if operator is None:
        return text
    text.append("\nfile transfer\n", style="bold")
    moving = operator.transfer
    if moving is None:
        text.append("  none under way\n", style="dim")
    else:
        share = moving.moved / moving.total if moving.total else 0.0
        text.append(f"  {moving.moved:,} of {moving.total:,} bytes  {_bar(share, 1.0)}\n")
    if operator.table_read:
        text.append(f"  read back: {len(operator.table_read):,} bytes\n")
    text.append("\n  u upload, validate and stage   o orders: activate, roll back\n", style="dim")
    text.append("  r read back                    d differences from a file\n", style="dim")
    if diff:
        text.append(f"\n{diff[0]}\n", style="bold")
        room = max(1, rows - text.plain.count("\n") - 1)
        for line in diff[1 : room + 1]:
            text.append(f"  {line}\n")
        if len(diff) - 1 > room:
            text.append(f"  and {len(diff) - 1 - room} more", style="yellow")
    return text


def parameters_page(operator: Operator | None, chosen: int, rows: int) -> Text:
    """All parameters; those that begin with T_ are the table's and change by upload alone."""
    if operator is None:
        return Text("this console only listens", style="dim")
    held = sorted(operator.parameters.items(), key=lambda item: item[1][0])
    text = Text()
    text.append(f"  {len(held)} of {operator.parameter_count or '?'} received; l asks for all, s sets the chosen one\n")
    first = max(0, min(chosen - rows // 2, len(held) - rows + 2))
    for i, (name, (_, value)) in enumerate(held[first : first + max(1, rows - 2)], first):
        text.append("> " if i == chosen else "  ", style="bold")
        text.append(f"{name:<18}{value:>16.7g}")
        text.append("   table: read only\n" if name.startswith("T_") else "   may be set\n", style="dim")
    return text


def parameter_names(operator: Operator) -> Sequence[str]:
    """Names in the order of the page."""
    return [name for name, _ in sorted(operator.parameters.items(), key=lambda item: item[1][0])]


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "unknown"


def _bar(value: float, full: float) -> str:
    if not (math.isfinite(value) and full > 0.0):
        return ""
    filled = round(20 * min(1.0, max(0.0, value / full)))
    return "[" + "#" * filled + "." * (20 - filled) + "]"
