"""The console's reducer and verdict: no message raises, and no doubt is shown as trust."""

from __future__ import annotations

import math
from functools import reduce as fold
from typing import Any

import pytest
from console_story import FLAG_AGE_S, OUTAGE_START_S, OUTAGE_STOP_S, alert, heard, heartbeat, integrity, second
from hypothesis import given
from hypothesis import strategies as st

from flightsw.icd import mavlink
from flightsw.icd.enums import Certificate, FlagState, Governing, Mode, RejectCause, Uncovered, Verdict
from ground.console.model import MAX_EVENTS, MAX_HISTORY, State, active_alerts, age_s, alert_text, cause_name, reduce
from ground.console.panels import governed, time_left
from ground.console.text import gps_stamp, metres, safe, seconds
from ground.console.told import TimeToFlag
from ground.console.verdict import LINK_TIMEOUT_S, STALE_S, judge

START = State(started_s=0.0)


def after(*messages: Any, state: State = START, now_s: float = 10.0) -> State:
    return fold(lambda s, m: reduce(s, heard(m), now_s), messages, state)


def told(stop_s: int) -> State:
    """The story up to and including second `stop_s`."""
    state = START
    for t_s in range(stop_s + 1):
        for message in second(t_s):
            state = reduce(state, heard(message), float(t_s))
    return state


@pytest.mark.parametrize(
    ("t_s", "word"),
    [
        (2, "NOT READY"),
        (OUTAGE_START_S - 1, "TRUSTED"),
        (OUTAGE_START_S + 60, "TRUSTED, COASTING"),
        (OUTAGE_START_S + FLAG_AGE_S - 1, "TRUSTED, COASTING"),
        (OUTAGE_START_S + FLAG_AGE_S, "DO NOT USE"),
        (OUTAGE_STOP_S + 5, "DO NOT USE"),
        (OUTAGE_STOP_S + 40, "TRUSTED"),
    ],
)
def test_an_outage_is_told_as_it_happens(t_s: int, word: str) -> None:
    """GIVEN the story of an outage WHEN second t has been heard THEN the verdict is the one of that second."""
    judgement = judge(told(t_s), float(t_s))

    assert judgement.word == word
    assert judgement.certificate == "uncertified table"


def test_the_reason_names_the_numbers() -> None:
    judgement = judge(told(OUTAGE_START_S + FLAG_AGE_S), OUTAGE_START_S + FLAG_AGE_S)

    assert judgement.reason == "failure flag raised 513 s after the last fix: bound 2002 m, limit 2000 m"


def test_what_the_certificate_does_not_cover_is_named() -> None:
    """GIVEN a certified table, not covered here and now THEN its cause stands beside NOT CERTIFIED, no two alike; one
    that this console does not know reads as none named."""
    changes = {"verdict": Verdict.NOT_CERTIFIED, "certificate": Certificate.FULL}
    judgements = [judge(after(integrity(uncovered=one, **changes)), 10.0) for one in (*Uncovered, 99)]
    assert {one.word for one in judgements} == {"NOT CERTIFIED"}
    *named, unknown = (one.reason for one in judgements)
    assert len(set(named)) == len(Uncovered)
    assert not any("no certificate" in reason for reason in named)
    assert unknown == named[Uncovered.NOTHING]


def test_silence_takes_the_verdict_away() -> None:
    """GIVEN a healthy flight WHEN nothing more is heard THEN NO LINK after three missed heartbeats."""
    state = after(heartbeat(), integrity(), now_s=100.0)

    assert judge(state, 100.0 + LINK_TIMEOUT_S).word == "TRUSTED"
    lost = judge(state, 100.0 + LINK_TIMEOUT_S + 0.1)
    assert lost.word == "NO LINK"
    assert "3.1 s" in lost.reason
    assert judge(START, 7.0).word == "NO LINK"
    assert "waiting" in judge(START, 7.0).reason


def test_heartbeats_alone_are_not_health() -> None:
    """GIVEN heartbeats without integrity THEN nothing is known of the error, and the console says so."""
    state = after(integrity(), now_s=100.0)
    for k in range(20):
        state = after(heartbeat(), state=state, now_s=101.0 + k)

    assert judge(state, 120.0).word == "NO INTEGRITY DATA"
    assert judge(after(heartbeat()), 10.0).word == "NO INTEGRITY DATA"


def test_a_clock_that_steps_back_makes_nothing_negative() -> None:
    assert age_s(5.0, 9.0) == 0.0
    assert age_s(5.0, None) == math.inf


@pytest.mark.parametrize(
    "changes",
    [
        {"flag_state": FlagState.RAISED},
        {"flag_state": FlagState.STALE},
        {"flag_state": 9},
        {"bound_m": math.nan},
        {"bound_m": math.inf},
        {"bound_m": 2000.1},
        {"limit_m": math.nan},
        {"bound_3d_m": 2000.1, "driver": 1},
        {"mode": Mode.FAILED},
        {"mode": Mode.INIT},
        {"mode": 200},
        {"verdict": 77},
        {"verdict": Verdict.DO_NOT_USE},
    ],
)
def test_a_contradiction_is_never_shown_as_trust(changes: dict[str, Any]) -> None:
    for verdict in (Verdict.TRUSTED, Verdict.TRUSTED_COASTING):
        state = after(integrity(**({"verdict": verdict} | changes)))

        assert judge(state, 10.0).word == "DO NOT USE"


def test_a_state_published_as_invalid_is_not_trusted() -> None:
    nav = mavlink.MAVLink_leonav_nav_state_message(0, [7e6, 0, 0], [0, 7e3, 0], Mode.INTEGRATED, 4, 0)

    assert judge(after(integrity(), nav), 10.0).word == "DO NOT USE"


def test_autonomous_mode_is_called_coasting_whatever_flight_calls_it() -> None:
    state = after(integrity(mode=Mode.AUTONOMOUS, verdict=Verdict.TRUSTED, fix_age_s=213.0))

    assert judge(state, 10.0).word == "TRUSTED, COASTING"


@pytest.mark.parametrize(
    ("code", "words"),
    [(0, "uncertified table"), (1, "table with quick certificate"), (2, "certified table")],
)
def test_the_certificate_is_said(code: int, words: str) -> None:
    assert judge(after(integrity(certificate=code)), 10.0).certificate == words


def test_an_unknown_certificate_is_none() -> None:
    assert judge(after(integrity(certificate=9)), 10.0).certificate.startswith("uncertified table")


def test_alerts_are_worded_on_the_ground_and_repeats_shown_once() -> None:
    state = after(alert(0, 1, 2, value=2003.2), alert(0, 1, 2, value=2003.2))

    assert [event.text for event in state.events] == [
        "Error bound above the limit: do not use the state [bound 2003.2 m] (FLAG_RAISED)"
    ]
    assert state.events[0].severity == 2


def test_the_words_of_an_alert_are_shown_once_but_not_lost_with_it() -> None:
    """GIVEN flight's alert and its STATUSTEXT THEN one line; GIVEN the text alone THEN that line."""
    words = mavlink.MAVLink_statustext_message(4, b"GNSS lost: navigating alone")

    assert len(after(alert(0, 4, 4), words).events) == 1
    assert after(words).events[0].text == "flight says: GNSS lost: navigating alone"


def test_a_repeated_innovation_does_not_look_fresh() -> None:
    def innovation(t_gps_ns: int) -> Any:
        return mavlink.MAVLink_leonav_innovation_message(t_gps_ns, [0] * 6, [1] * 6, 5.0, 22.0, 6.0, 1, 255)

    state = after(innovation(5), now_s=10.0)
    assert after(innovation(5), state=state, now_s=60.0).innovation_s == 10.0
    assert after(innovation(6), state=state, now_s=60.0).innovation_s == 60.0


def test_lost_alerts_are_noticed() -> None:
    state = after(alert(3, 11, 5), alert(4, 7, 6), alert(7, 1, 2))

    assert state.alerts_lost == 2
    assert "2 alerts lost" in state.events[-2].text


def test_the_sequence_may_wrap_and_may_start_again() -> None:
    wrapped = after(alert(2**32 - 1, 11, 5), alert(0, 7, 6))
    again = after(alert(900, 11, 5), alert(0, 7, 6))

    assert wrapped.alerts_lost == again.alerts_lost == 0
    assert len(wrapped.events) == 2
    assert "start again" in again.events[1].text


def test_an_unknown_alert_stays_visible() -> None:
    assert "unknown alert 4711" in alert_text(4711, 1, math.nan)
    assert alert_text(4, 0, 0.0).startswith("ended: GNSS lost")
    assert active_alerts(1 << 1 | 1 << 32 | 1 << 60) == ["FLAG_RAISED", "GNSS_INCONSISTENT", "ALERT_60"]
    assert cause_name(RejectCause.GATE) == "GATE"
    assert cause_name(99) == "CAUSE_99"


def test_others_on_the_link_do_not_speak_for_flight() -> None:
    """GIVEN a healthy integrity from another system THEN it is counted and the link stays silent."""
    state = reduce(START, heard(integrity(), system=255, component=190), 10.0)

    assert state.foreign == 1
    assert judge(state, 10.0).word == "NO LINK"


def test_text_from_the_link_cannot_reach_the_terminal() -> None:
    state = after(mavlink.MAVLink_statustext_message(2, b"\x1b[2Jall \x9b1m\x07 well"))

    assert state.events[0].text.startswith("flight says: \\x1b[2Jall ")
    assert state.events[0].text.isprintable()


@given(st.text(max_size=80) | st.binary(max_size=80))
def test_safe_text_is_printable_and_short(text: str | bytes) -> None:
    assert safe(text, 40).isprintable()
    assert len(safe(text, 40)) <= 40


def test_history_keeps_a_whole_day_in_bounded_memory_and_never_loses_the_peak() -> None:
    state = START
    for k in range(4 * MAX_HISTORY):
        bound_m = 1234.5 if k == 777 else 2.0
        state = after(integrity(t_gps_ns=k * 1_000_000_000, bound_m=bound_m), state=state, now_s=float(k))

    assert len(state.history) <= MAX_HISTORY
    assert state.history[0].t_gps_s <= 16.0
    assert state.history[-1].t_gps_s == 4 * MAX_HISTORY - 1
    assert max(sample.bound_m for sample in state.history) == 1234.5


def test_a_jump_of_flight_time_starts_the_plot_again() -> None:
    state = after(integrity(t_gps_ns=10**18), integrity(t_gps_ns=10**17))

    assert len(state.history) == 1
    assert "jumped" in state.events[-1].text


FIELDS: dict[str, st.SearchStrategy[Any]] = {
    "int8_t": st.integers(-(2**7), 2**7 - 1),
    "uint8_t": st.integers(0, 2**8 - 1),
    "uint16_t": st.integers(0, 2**16 - 1),
    "int16_t": st.integers(-(2**15), 2**15 - 1),
    "int32_t": st.integers(-(2**31), 2**31 - 1),
    "uint32_t": st.integers(0, 2**32 - 1),
    "uint64_t": st.integers(0, 2**64 - 1),
    "int64_t": st.integers(-(2**63), 2**63 - 1),
    "float": st.floats(width=32),
    "double": st.floats(),
    "char": st.binary(min_size=0, max_size=32),
}


@st.composite
def any_message(draw: st.DrawFn) -> Any:
    """Any message of the dialect with any content its wire format can carry."""
    kind = draw(st.sampled_from(sorted(mavlink.mavlink_map.values(), key=lambda k: k.id)))
    values = []
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    for name, type_name in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        strategy = FIELDS[type_name]
        if lengths[name] and type_name != "char":
            strategy = st.lists(strategy, min_size=lengths[name], max_size=lengths[name])
        values.append(draw(strategy))
    return kind(*values)


@given(st.lists(st.tuples(any_message(), st.floats(-1e6, 1e6)), max_size=12))
def test_no_sequence_of_messages_raises_or_is_trusted_without_grounds(steps: list[tuple[Any, float]]) -> None:
    state = START
    for message, now_s in steps:
        state = reduce(state, heard(message), now_s)
        judgement = judge(state, now_s)
        if judgement.word.startswith("TRUSTED"):
            i = state.integrity
            assert i is not None
            assert i.flag_state == FlagState.CLEAR
            assert i.driving_bound_m <= i.limit_m
            assert i.verdict in (Verdict.TRUSTED, Verdict.TRUSTED_COASTING)
            assert now_s - (state.integrity_s or 0.0) <= STALE_S
        assert judgement.reason.isprintable()
    assert len(state.events) <= MAX_EVENTS


@pytest.mark.parametrize(
    ("value", "text"),
    [(2.0, "2.00 m"), (12.34, "12.3 m"), (812.4, "812 m"), (12345.0, "12.3 km"), (math.nan, "unknown")],
)
def test_metres(value: float, text: str) -> None:
    assert metres(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.44, "0.4 s"), (213.0, "213 s"), (7500.0, "2 h 05 min"), (math.nan, "never"), (math.inf, "never")],
)
def test_seconds(value: float, text: str) -> None:
    assert seconds(value) == text


def test_gps_time_is_counted_without_leap_seconds() -> None:
    """2008-12-31 23:59:46 UTC is 1230768000 - 14 s; GPS ran 14 s ahead: 914803200 s is midnight on its scale."""
    assert gps_stamp(914_803_200 * 10**9) == "2009-01-01 00:00:00"
    assert gps_stamp(2**63 - 1) == "2272-04-15 23:47:16"


def test_time_left_is_shown_with_what_governs_it_and_its_age():
    """GIVEN predictions of every kind THEN their words say how long, why, how old; never more than is known."""
    words = {
        ("4 h 59 min without GNSS", "bound, 12.0 s old"): TimeToFlag(0, 17971.0, 12.0, Governing.BOUND, 0),
        ("300 s", "earth orientation, 3.0 s old"): TimeToFlag(0, 300.0, 3.0, Governing.EARTH_ORIENTATION, 1),
        ("> 27 h 46 min", "horizon, 3.0 s old"): TimeToFlag(0, 1e5, 3.0, Governing.HORIZON, 1),
        ("none: the flag is up", ""): TimeToFlag(0, 0.0, 0.0, Governing.FLAG, 1),
        ("not predicted yet", ""): TimeToFlag(0, math.nan, math.nan, Governing.BOUND, 0),
        ("50.0 s", "cause 77, 1.0 s old"): TimeToFlag(0, 50.0, 1.0, 77, 1),
    }
    assert [(time_left(told), governed(told)) for told in words.values()] == list(words)
    assert time_left(TimeToFlag(0, 10.0, 1.0, Governing.NOT_READY, 0)) == "not predicted yet"
