"""The console without a screen: one line a second on standard output, fit for a log or a pipe.

A status line holds the link's time, the verdict, mode, bound, limit, fix age, the bound by axis and in space, time to
the flag, satellites, flag, table, alarms, ages of link and heartbeat, what stands behind the table, and the reason.
What is not renewed says STALE. Events stand on lines of their own as they are heard.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

from ground.console import gnss
from ground.console.crosslink_page import plain_words
from ground.console.link import Link
from ground.console.model import Event, State, age_s, reduce
from ground.console.panels import flag_words, governed, severity_word, time_left
from ground.console.text import metres, metres_each, seconds, utc_stamp
from ground.console.tlog import TlogLink
from ground.console.verdict import STALE_S, judge_link, mode_word

SILENT_LINES = 10  # of one silence in a replay; the rest of it is one line


def status_line(state: State, now_s: float, link: object = None) -> str:
    """The state at `now_s` on one line; link: where it came from, for what that knows of signatures."""
    judgement = judge_link(state, now_s, link)
    parts = [f"{utc_stamp(now_s)} {judgement.word:<17}"]
    i = state.integrity
    if i is not None:
        stale = _stale(now_s, state.integrity_s)
        parts.append(
            f"{mode_word(i.mode):<10} bound {metres(i.driving_bound_m):<8} limit {metres(i.limit_m):<7} "
            f"fix age {seconds(i.fix_age_s)}{stale}"
        )
    if state.protection is not None:
        each = metres_each(state.protection.level_m)
        parts.append(f"x y z {each}, 3-D {metres(state.protection.level_3d_m)}{_stale(now_s, state.protection_s)}")
    left = state.time_to_flag
    if left is not None:
        governs = f" ({governed(left)})" if governed(left) else ""
        parts.append(f"time left {time_left(left)}{governs}{_stale(now_s, state.time_to_flag_s)}")
    if state.satellites is not None:
        parts.append(f"{state.satellites} satellites{_stale(now_s, state.innovation_s or state.satellites_s)}")
    if state.gnss is not None:
        parts.append(f"{gnss.words(state.gnss)}{_stale(now_s, state.gnss_s)}")
    if i is not None:
        parts.append(f"flag {flag_words(i.flag_state, i.flag_age_s)}, table {i.table_crc32:08x}")
    waiting = sum(alarm.acknowledged_s is None for alarm in state.alarms)
    if waiting:
        parts.append(f"{waiting} ALARM{'S' if waiting > 1 else ''} TO ACKNOWLEDGE")
    if state.link is not None:
        parts += [
            word for word, holds in (("BENCH", state.link.bench), ("FLAG DISARMED", not state.link.armed)) if holds
        ]
    if state.crosslink is not None:
        parts.append(plain_words(state.crosslink, _stale(now_s, state.crosslink_s)))
    parts.append(f"link {seconds(age_s(now_s, state.heard_s))}, heartbeat {seconds(age_s(now_s, state.heartbeat_s))}")
    if judgement.certificate:
        parts.append(judgement.certificate)
    parts.append(judgement.reason)
    return " | ".join(parts)


def _stale(now_s: float, heard_s: float | None) -> str:
    silent_s = age_s(now_s, heard_s)
    return f" STALE {seconds(silent_s)}" if silent_s > STALE_S else ""


def event_line(event: Event) -> str:
    """An event on one line."""
    return f"{utc_stamp(event.t_s)} EVENT {severity_word(event.severity)} {event.text}"


def final_line(state: State, now_s: float, link: Link) -> str:
    """The last word: the verdict at `now_s`, and what the link went through."""
    judgement = judge_link(state, now_s, link)
    words = ", ".join(word for word in (judgement.word, judgement.certificate) if word)
    s = link.statistics
    return (
        f"FINAL {utc_stamp(now_s)} {words}: {judgement.reason} "
        f"[{s.frames} messages, {s.lost} lost, {s.damaged} damaged, {s.unknown} unknown, "
        f"{s.unauthenticated} not authentic, {s.unverified} signatures not verified, {state.alerts_lost} alerts lost]"
    )


def replay_lines(link: TlogLink) -> Iterator[str]:
    """A whole log at its own times, without waiting, and its final verdict."""
    state = State(started_s=link.start_s)
    for remark in link.remarks:
        yield f"{utc_stamp(link.start_s)} EVENT warning console: {remark}"
    due_s = math.ceil(link.start_s)
    now_s = link.start_s
    for time_s, message in link.everything():
        silent = 0
        while due_s < time_s:
            yield status_line(state, float(due_s))
            silent += 1
            if silent == SILENT_LINES and time_s - due_s > SILENT_LINES:
                yield f"{utc_stamp(due_s)} ... silent until {utc_stamp(time_s)}"
                due_s = math.ceil(time_s) - 1
            due_s += 1
        now_s = max(now_s, time_s)
        state, fresh = _take(state, message, time_s)
        yield from map(event_line, fresh)
    yield status_line(state, now_s)
    yield final_line(state, now_s, link)


def live_lines(
    link: Link, sleep: Callable[[float], None] = time.sleep, stop: Callable[[], bool] = lambda: False
) -> Iterator[str]:
    """Status every whole second of the link's time and events at once, until interrupted or `stop`."""
    state = State(started_s=link.now_s())
    due_s = math.floor(link.now_s()) + 1
    try:
        while not stop():
            for time_s, message in link.receive():
                state, fresh = _take(state, message, time_s)
                yield from map(event_line, fresh)
            now_s = link.now_s()
            if now_s >= due_s:
                yield status_line(state, now_s, link)
                due_s = math.floor(now_s) + 1
            sleep(min(0.1, max(0.0, due_s - link.now_s())))
    except KeyboardInterrupt:
        pass
    yield final_line(state, link.now_s(), link)


def _take(state: State, message: object, time_s: float) -> tuple[State, tuple[Event, ...]]:
    """The state after a message, and the events it added."""
    after = reduce(state, message, time_s)
    if after.events is state.events:
        return after, ()
    last = state.events[-1] if state.events else None
    fresh: list[Event] = []
    for event in reversed(after.events):
        if event is last:
            break
        fresh.append(event)
    return after, tuple(reversed(fresh))
