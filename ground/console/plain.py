"""The console without a screen: one line a second on standard output, fit for a log or a pipe.

A status line holds the link's time, the verdict, what stands behind the table, mode, bound, limit, fix age,
link age and the reason. Events stand on lines of their own as they are heard.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

from ground.console.link import Link
from ground.console.model import Event, State, age_s, reduce
from ground.console.panels import severity_word
from ground.console.text import metres, seconds, utc_stamp
from ground.console.tlog import TlogLink
from ground.console.verdict import STALE_S, judge, mode_word

SILENT_LINES = 10  # of one silence in a replay; the rest of it is one line


def status_line(state: State, now_s: float) -> str:
    """The state at `now_s` on one line."""
    judgement = judge(state, now_s)
    parts = [f"{utc_stamp(now_s)} {judgement.word:<17}"]
    i = state.integrity
    if i is not None:
        silent_s = age_s(now_s, state.integrity_s)
        stale = f" STALE {seconds(silent_s)}" if silent_s > STALE_S else ""
        parts.append(
            f"{mode_word(i.mode):<10} bound {metres(i.driving_bound_m):<8} limit {metres(i.limit_m):<7} "
            f"fix age {seconds(i.fix_age_s)}{stale}"
        )
    parts.append(f"link {seconds(age_s(now_s, state.heard_s))}")
    if judgement.certificate:
        parts.append(judgement.certificate)
    parts.append(judgement.reason)
    return " | ".join(parts)


def event_line(event: Event) -> str:
    """An event on one line."""
    return f"{utc_stamp(event.t_s)} EVENT {severity_word(event.severity)} {event.text}"


def final_line(state: State, now_s: float, link: Link) -> str:
    """The last word: the verdict at `now_s`, and what the link went through."""
    judgement = judge(state, now_s)
    words = ", ".join(word for word in (judgement.word, judgement.certificate) if word)
    s = link.statistics
    return (
        f"FINAL {utc_stamp(now_s)} {words}: {judgement.reason} "
        f"[{s.frames} messages, {s.lost} lost, {s.damaged} damaged, {s.unknown} unknown, "
        f"{state.alerts_lost} alerts lost]"
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
                yield status_line(state, now_s)
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
