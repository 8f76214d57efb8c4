"""The verdict of a run on one screen: what happened, the figures behind it, and one plain word.

    HELD                 in every outage the bound covered the error until the flag, and the flag came first
    NOT FLAGGED IN TIME  the error passed the limit before, or without, the flag
    VIOLATED             at some epoch before the flag the bound was smaller than the error
    NO OUTAGE            nothing was put to the test

A late flag is the graver fault (a user acted on a state beyond its limit), so it is named first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from textwrap import wrap
from typing import Any

from ground.reports.crosslinks import crosslink_story
from ground.reports.pseudoranges import fix_words, pseudorange_story

WIDTH = 100
MAX_OUTAGES_SHOWN = 3
MAX_CAUSES_SHOWN = 6
NO_BREAK = "\u00a0"
LABEL = 26  # width of the first column of the table

HELD, VIOLATED, NOT_IN_TIME, NO_OUTAGE = "HELD", "VIOLATED", "NOT FLAGGED IN TIME", "NO OUTAGE"
CERTIFICATES = {0: "UNCERTIFIED", 1: "quick certificate", 2: "full certificate"}


def render_verdict(summary: Mapping[str, Any]) -> str:
    """The screen for a `summary.json`: at most 100 columns, about 30 lines, no colour, ends without newline.

    Absent keys are shown as unknown; nothing is invented for them.
    """
    word, reason = judge(summary)
    lines = [*_heading(summary), ""]
    lines += _paragraphs(_story(summary))
    lines += ["", *_table(summary), "", *_footing(summary), ""]
    fault = _fault(summary)
    if fault:
        lines += _hanging("FAULT OF THE TABLE  ", fault)
    lines += _hanging("TABLE               ", _certificate_sentence(summary))
    lines += _hanging(f"VERDICT: {word}  ", reason)
    lines.append("=" * WIDTH)
    return "\n".join(line.rstrip() for line in lines)


def judge(summary: Mapping[str, Any]) -> tuple[str, str]:
    """The verdict and its reason, from the outages of the summary."""
    outages = _outages(summary)
    judged = [o for o in outages if (_number(o, "epochs") or 0.0) > 0.0]
    if not outages:
        return NO_OUTAGE, "GNSS was never lost in this run; it shows nothing about the bound in an outage."
    late = [i for i, o in enumerate(outages, 1) if _flag_is_late(o)]
    if late:
        o = outages[late[0] - 1]
        crossed_s, flag_s = _number(o, "error_crossed_eps_age_s"), _number(o, "flag_raised_age_s")
        what = "no flag was raised" if flag_s is None else f"the flag came only at {_seconds(flag_s)}"
        return NOT_IN_TIME, (
            f"{_which(late, outages)}the error passed {_metres(_number(o, 'eps_m'))} at "
            f"{_seconds(crossed_s)} and {what}; bound below error at {_violations(o)} epochs."
        )
    violated = [i for i, o in enumerate(outages, 1) if (_number(o, "violations") or 0.0) > 0.0]
    if violated:
        o = outages[violated[0] - 1]
        return VIOLATED, (
            f"{_which(violated, outages)}the bound was smaller than the error at {_violations(o)} epochs "
            "between the last accepted fix and the flag."
        )
    if not judged:
        return NO_OUTAGE, "GNSS was lost, but the summary holds no judged epoch; nothing was shown."
    epochs = sum(int(_number(o, "epochs") or 0) for o in judged)
    flagged = [o for o in judged if _number(o, "error_crossed_eps_age_s") is not None]
    ending = (
        "the flag came before the error passed the limit."
        if len(flagged) == len(judged)
        else "the error never passed the limit."
        if not flagged
        else "the flag came first wherever the error passed the limit."
    )
    return HELD, f"the bound covered the error at all {epochs} epochs before the flag, and {ending}"


def _heading(summary: Mapping[str, Any]) -> list[str]:
    scenario = str(summary.get("scenario", "unknown scenario"))
    seed = summary.get("seed")
    left = f"leonav run  {scenario}" + ("" if seed is None else f", seed {seed}")
    right = _certificate_words(summary)
    return ["=" * WIDTH, f"{left}{right:>{max(1, WIDTH - len(left))}}"]


def _story(summary: Mapping[str, Any]) -> Iterator[str]:
    """What happened, in sentences."""
    simulated_s = _number(summary, "simulated_s")
    integrated = summary.get("integrated") or {}
    fix_m, own_m = _number(integrated, "fix_rms_m"), _number(integrated, "position_rms_m")
    ratio = f", {fix_m / own_m:.1f} times better than the fix" if fix_m and own_m else ""
    fixes = fix_words(summary.get("pseudoranges")) or f"fixes: {_metres(fix_m)}"
    if own_m is None:
        yield f"Flew {_duration(simulated_s)}: too short to say how good the position was with GNSS ({fixes})."
    else:
        good = f"With GNSS the position was good to {_metres(own_m)} rms ({fixes}){ratio}."
        yield f"Flew {_duration(simulated_s)}. {good}"
    outages = _outages(summary)
    if not outages:
        yield "GNSS was never lost."
    for i, outage in enumerate(outages[:MAX_OUTAGES_SHOWN], 1):
        yield _outage_story(outage, f"Outage {i}: " if len(outages) > 1 else "", simulated_s)
    if len(outages) > MAX_OUTAGES_SHOWN:
        yield f"{len(outages) - MAX_OUTAGES_SHOWN} more outages: see summary.json."
    yield from pseudorange_story(summary.get("pseudoranges"))
    yield from crosslink_story(summary.get("crosslinks"))


def _outage_story(outage: Mapping[str, Any], prefix: str, simulated_s: float | None) -> str:
    start_s, end_s = _number(outage, "start_s"), _number(outage, "end_s")
    length_s = None if start_s is None or end_s is None else end_s - start_s
    flag_s, crossed_s = _number(outage, "flag_raised_age_s"), _number(outage, "error_crossed_eps_age_s")
    eps = _metres(_number(outage, "eps_m"))
    text = f"{prefix}GNSS was lost at {_seconds(start_s)} for {_seconds(length_s)}. "
    if flag_s is None:
        text += "No flag was raised"
    else:
        bound_m = _number(outage, "bound_at_flag_m")
        reached = "" if bound_m is None else f"the bound reached {_metres(bound_m)} and "
        text += f"After {_seconds(flag_s)} {reached}the flag was raised"
    if crossed_s is None:
        text += f"; the error never passed {eps}."
    elif flag_s is None:
        text += f", yet the error passed {eps} after {_seconds(crossed_s)}."
    elif flag_s <= crossed_s:
        text += f", {_seconds(crossed_s - flag_s)} before the error passed {eps}."
    else:
        text += f", {_seconds(flag_s - crossed_s)} AFTER the error had passed {eps}."
    back_s = _number(outage, "back_in_service_s")
    if back_s is not None:
        return f"{text} Back in service {_seconds(back_s)} after GNSS returned."
    if end_s is not None and simulated_s is not None and end_s >= simulated_s:
        return f"{text} The run ended before GNSS returned."
    return f"{text} The state did NOT come back into service."


def _table(summary: Mapping[str, Any]) -> list[str]:
    integrated = summary.get("integrated") or {}
    rows: list[tuple[str, str]] = [
        (
            "integrated error",
            "not judged: it had not settled"
            if _number(integrated, "position_rms_m") is None
            else f"rms {_metres(_number(integrated, 'position_rms_m'))}, largest "
            f"{_metres(_number(integrated, 'position_max_m'))}, velocity rms "
            f"{_speed(_number(integrated, 'velocity_rms_mps'))}",
        ),
        _fixes_row(summary, integrated),
    ]
    outages = _outages(summary)
    for i, outage in enumerate(outages[:MAX_OUTAGES_SHOWN], 1):
        suffix = f" ({i})" if len(outages) > 1 else ""
        rows += [(name + suffix, value) for name, value in _outage_rows(outage, brief=len(outages) > 1)]
    return [line for name, value in rows for line in _hanging(f"  {name:<{LABEL}}", value)]


def _fixes_row(summary: Mapping[str, Any], integrated: Mapping[str, Any]) -> tuple[str, str]:
    """Their error where the world has made them; where flight has, which epochs they come from."""
    found = summary.get("pseudoranges")
    if not isinstance(found, Mapping):
        return "fix error", f"rms {_metres(_number(integrated, 'fix_rms_m'))}"
    verdicts = found.get("verdicts") or {}
    return "epochs", ", ".join(f"{count:,}{NO_BREAK}{name}" for name, count in verdicts.items()) or "none"


def _outage_rows(outage: Mapping[str, Any], brief: bool) -> Iterator[tuple[str, str]]:
    flag_s, crossed_s = _number(outage, "flag_raised_age_s"), _number(outage, "error_crossed_eps_age_s")
    eps = _metres(_number(outage, "eps_m"))
    if brief:
        crossing = f"error passes {eps}" + ("" if crossed_s is None else " at") + f" {_seconds(crossed_s)}"
        flag = f"flag {'at ' if flag_s is not None else ''}{_seconds(flag_s)}"
        yield "outage", f"{crossing}, {flag}, broken {_violations(outage)}"
        return
    yield f"error passes {eps}", _seconds(crossed_s)
    yield "flag raised", _seconds(flag_s)
    if flag_s is not None and crossed_s is not None:
        share = f" (flag at {flag_s / crossed_s:.2f} of the crossing)" if crossed_s > 0.0 else ""
        yield "margin", f"{crossed_s - flag_s:+.0f} s{share}"
    else:
        yield "margin", "none: " + ("no flag" if flag_s is None else "no crossing")
    yield "bound below error", f"{_violations(outage)} epochs from the last accepted fix to the flag"
    yield (
        "at 900 s",
        (f"error {_metres(_number(outage, 'error_at_900_s_m'))}, bound {_metres(_number(outage, 'bound_at_900_s_m'))}"),
    )
    yield "at 2000 s", f"error {_metres(_number(outage, 'error_at_2000_s_m'))}"
    yield "back in service", _seconds(_number(outage, "back_in_service_s"))


def _footing(summary: Mapping[str, Any]) -> Iterator[str]:
    """What flight said, bus, link and speed: one line each."""
    said = summary.get("said")
    if isinstance(said, Mapping):
        shares = sorted(((share, word) for word, share in said.items()), reverse=True)
        words = ", ".join(
            f"{word.replace('_', NO_BREAK)}{NO_BREAK}{100.0 * share:.3g}{NO_BREAK}%" for share, word in shares
        )
        yield from _hanging(f"  {'flight said':<{LABEL}}", words)
    bus, link = summary.get("bus") or {}, summary.get("mavlink") or {}
    causes = summary.get("rejected_by_cause") or {}
    yield (
        f"  {'bus':<{LABEL}}{_count(bus, 'sent')} frames sent, {_count(bus, 'accepted')} accepted, "
        f"{_count(bus, 'rejected')} rejected"
    )
    if isinstance(causes, Mapping):
        counted = sorted(((n, c) for c, n in causes.items() if isinstance(n, int) and n > 0), reverse=True)
        if counted:
            named = ", ".join(f"{c}{NO_BREAK}{n:,}" for n, c in counted[:MAX_CAUSES_SHOWN])
            rest = f", {len(counted) - MAX_CAUSES_SHOWN} more" if len(counted) > MAX_CAUSES_SHOWN else ""
            yield from _hanging(f"  {'rejected by cause':<{LABEL}}", named + rest)
    yield f"  {'MAVLink':<{LABEL}}{_count(link, 'messages')} messages, {_count(link, 'alerts')} alerts"
    factor, wall_s = _number(summary, "realtime_factor"), _number(summary, "wall_s")
    yield from _hanging(
        f"  {'speed':<{LABEL}}",
        f"{'unknown' if factor is None else f'{factor:.0f} times real time'}, "
        f"{_seconds(wall_s) if wall_s is not None else 'unknown'} wall; {_count(summary, 'ticks')} ticks, "
        f"{_count(summary, 'slips')} slips",
    )


def _fault(summary: Mapping[str, Any]) -> str:
    """Text of `fault_of_table`, at the top of the summary or in an outage; empty when there is none."""
    found = [summary.get("fault_of_table")]
    if not found[0]:
        found = [outage.get("fault_of_table") for outage in _outages(summary)]
    return " ".join(dict.fromkeys(_sentence(item) for item in found if item))


def _sentence(item: Any) -> str:
    if item is True:
        return "the bound of this table settles below the limit and can never raise the flag."
    if isinstance(item, Sequence) and not isinstance(item, str):
        return " ".join(str(part) for part in item)
    if isinstance(item, Mapping):
        return ", ".join(f"{key} {value}" for key, value in item.items())
    return str(item)


def _certificate_words(summary: Mapping[str, Any]) -> str:
    tables = summary.get("tables") or {}
    if not tables.get("set"):
        return "table unknown: UNCERTIFIED"
    return f"table {tables['set']}: {_certificate(tables.get('certificate'))}"


def _certificate(value: Any) -> str:
    """Anything not known to be a certificate is none."""
    if isinstance(value, str) and value.strip() and value.strip().upper() not in ("UNCERTIFIED", "NONE"):
        return f"{value.strip().lower()} certificate"
    return CERTIFICATES.get(value, "UNCERTIFIED") if isinstance(value, int) else "UNCERTIFIED"


def _certificate_sentence(summary: Mapping[str, Any]) -> str:
    tables = summary.get("tables") or {}
    words, crc = _certificate(tables.get("certificate")), tables.get("crc32")
    name = str(tables.get("set") or "unknown")
    number = "" if crc is None else f", CRC {crc:#010x}" if isinstance(crc, int) else f", CRC {crc}"
    meaning = (
        "UNCERTIFIED: one run proves nothing about the next; no probability stands behind its bound."
        if words == "UNCERTIFIED"
        else f"{words}."
    )
    allowed = tables.get("saturation") or ()
    if allowed:
        meaning += " SATURATES, flown by express permission only: " + "; ".join(str(text) for text in allowed) + "."
    return f"{name}{number}. {meaning}"


def _outages(summary: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [o for o in summary.get("outages") or [] if isinstance(o, Mapping)]


def _flag_is_late(outage: Mapping[str, Any]) -> bool:
    flag_s, crossed_s = _number(outage, "flag_raised_age_s"), _number(outage, "error_crossed_eps_age_s")
    return crossed_s is not None and (flag_s is None or flag_s > crossed_s)


def _which(numbers: list[int], outages: list[Mapping[str, Any]]) -> str:
    if len(outages) == 1:
        return ""
    return f"in {len(numbers)} of {len(outages)} outages; in outage {numbers[0]} "


def _violations(outage: Mapping[str, Any]) -> str:
    return f"{_count(outage, 'violations')} of {_count(outage, 'epochs')}"


def _number(record: Mapping[str, Any], key: str) -> float | None:
    """A finite number, or None for anything else (null, absent, NaN, text, beyond anything physical)."""
    value = record.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) and abs(value) < 1e15 else None


def _count(record: Mapping[str, Any], key: str) -> str:
    value = _number(record, key)
    if value is None:
        return "unknown"
    return f"{value:,.0f}" if abs(value) < 1e12 else f"{value:.3g}"


def _metres(value: float | None) -> str:
    if value is None:
        return "n/a"
    if abs(value) >= 1e8:
        return f"{value:.3g} m"
    if abs(value) >= 9999.5:
        return f"{value / 1e3:.1f} km"
    return f"{value:.0f} m" if abs(value) >= 99.5 else f"{value:.3g} m"


def _speed(value: float | None) -> str:
    if value is None:
        return "n/a"
    return f"{value:.3g} m/s" if abs(value) >= 1.0 else f"{value * 1e3:.3g} mm/s"


def _seconds(value: float | None) -> str:
    if value is None:
        return "never"
    if abs(value) >= 1e9:
        return f"{value:.3g} s"
    return f"{value:.0f} s" if abs(value) >= 99.5 else f"{value:.1f} s"


def _duration(seconds: float | None) -> str:
    if seconds is None or not 0.0 <= seconds < 1e9:
        return "an unknown time"
    hours, rest = divmod(round(seconds), 3600)
    minutes, left = divmod(rest, 60)
    parts = [f"{hours} h"] * bool(hours) + [f"{minutes} min"] * bool(minutes) + [f"{left} s"] * bool(left)
    return " ".join(parts) or "0 s"


def _paragraphs(sentences: Iterator[str]) -> list[str]:
    return [line for sentence in sentences for line in wrap(sentence, WIDTH)]


def _hanging(head: str, text: str) -> list[str]:
    """`head` followed by the text, wrapped and indented under its start."""
    lines = wrap(text, WIDTH, initial_indent=head, subsequent_indent=" " * len(head))
    return [line.replace(NO_BREAK, " ") for line in lines]
