"""The bound axis by axis on the console, and what goes with an alert: as flight says them, and no more."""

from __future__ import annotations

import math
from typing import Any

import pytest

pytest.importorskip("textual")
pytest.importorskip("textual_plotext")

from console_story import OUTAGE_START_S, START_GPS_NS, alert, heard, integrity, protection, second
from hypothesis import given
from hypothesis import strategies as st
from test_console_view import ScriptedLink, drive, screen_text

from flightsw.icd import mavlink
from flightsw.icd.alerts import ALERTS, BOUND, QUANTITIES, AlertId
from flightsw.icd.enums import Certificate, Verdict
from ground.console.model import State, alert_text, reduce
from ground.console.pages import filter_page
from ground.console.plain import status_line
from ground.console.text import metres_each
from ground.console.verdict import judge
from ground.console.view import ConsoleApp


def after(*messages: Any, now_s: float = 0.0) -> State:
    state = State()
    for message in messages:
        state = reduce(state, heard(message), now_s)
    return state


def test_every_axis_stands_on_the_overview_with_the_limit_and_the_time_left() -> None:
    """GIVEN an outage 300 s old WHEN the screen of 100 x 30 is drawn THEN the bound with its limit and share, the three
    axes, the error in space, the time left and what governs it, and the heartbeat all stand on it."""
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.tell(0, OUTAGE_START_S + 300)
        app.step()
        await pilot.pause()
        text = screen_text(app)
        for piece in (
            "bound      686 m of 2000 m  34 %",
            "x, y, z    343  686  172 m",
            "bound 3-D  823 m",
            "fix age    300 s, 0 in a row",
            "time left  213 s",
            "governs    bound, 12.0 s old",
            "heartbeat  0.0 s ago",
        ):
            assert piece in text, f"{piece!r} is not on the screen:\n{text}"

    drive(link, script)


def test_x_plots_the_axes_each_in_its_letter_and_the_bound_again() -> None:
    link = ScriptedLink()

    def letters(text: str) -> set[str]:
        plotted = "".join(line[:60] for line in text.split("\n")[6:20])
        return {letter for letter in "xyz3" if plotted.count(letter) > 5}

    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.tell(0, OUTAGE_START_S + 300)
        app.step()
        await pilot.pause()
        assert "⠒ bound" in screen_text(app)
        assert letters(screen_text(app)) == set()
        await pilot.press("x")
        await pilot.pause()
        assert "x y z axes  3 in space" in screen_text(app)
        assert letters(screen_text(app)) == {"x", "y", "z", "3"}, screen_text(app)
        await pilot.press("x")
        await pilot.pause()
        assert letters(screen_text(app)) == set()

    drive(link, script)


def test_levels_go_stale_like_everything_else() -> None:
    """GIVEN a flight that goes on to speak of its bound but not of the axes THEN only those say STALE."""
    state = after(integrity(), protection(START_GPS_NS, 2.0))
    state = reduce(state, heard(integrity()), 60.0)
    line = status_line(state, 60.0)
    assert "x y z 1.00  2.00  0.50 m, 3-D 2.40 m STALE 60.0 s" in line
    assert "bound 2.00 m" in line


def test_the_filter_page_holds_each_level_against_its_limit() -> None:
    state = after(*second(100), now_s=100.0)
    text = filter_page(reduce(state, heard(integrity(t_gps_ns=START_GPS_NS + 100 * 10**9)), 100.0), 100.0).plain
    for piece in ("axis x", "axis y", "axis z", "in space", "radial, along, cross-track"):
        assert piece in text, text
    assert text.count("not what the flag looks at") == 1  # that of this table looks at the axes
    spherical = after(integrity(driver=1), protection(START_GPS_NS, 2.0, driver=1))
    assert filter_page(spherical, 0.0).plain.count("no fix") == 1  # nothing is judged before a fix was


@given(
    first=st.lists(st.floats(1e-3, 1e6), min_size=3, max_size=3),
    then=st.lists(st.floats(1e-3, 1e6), min_size=3, max_size=3),
)
def test_what_is_plotted_of_merged_instants_is_the_worst(first: list[float], then: list[float]) -> None:
    """GIVEN two instants within a step of the plot WHEN they become one point THEN no axis has less than it had."""
    state = State()
    for k, levels in enumerate(([1e9] * 3, first, then)):  # a point is merged until it is a step from the one before
        t_gps_ns = START_GPS_NS + (0, 100_000_000, 200_000_000)[k]
        for message in (integrity(t_gps_ns=t_gps_ns), protection(t_gps_ns, 1.0, level_m=levels)):
            state = reduce(state, heard(message), float(k))
    assert len(state.history) == 2
    worst = [max(a, b) for a, b in zip(first, then, strict=True)]
    assert list(state.history[-1].levels_m[:3]) == pytest.approx(worst)


def test_a_state_withheld_outside_the_envelope_says_so() -> None:
    """GIVEN a certified table that does not cover here and now, its state not valid THEN the reason names that."""
    told = integrity(verdict=Verdict.NOT_CERTIFIED, certificate=Certificate.FULL)
    withheld = mavlink.MAVLink_leonav_nav_state_message(START_GPS_NS, [7e6, 0.0, 0.0], [0.0, 7e3, 0.0], 1, 4, 0)
    judged = judge(after(told, withheld), 0.0)
    assert judged.word == "DO NOT USE"
    assert judged.reason == "flight publishes its state as not valid: outside what its certificate covers"


def test_levels_of_another_instant_are_not_plotted_with_it() -> None:
    state = after(integrity(t_gps_ns=START_GPS_NS), protection(START_GPS_NS - 10**9, 9.0))
    assert state.history[-1].levels_m == ()


def test_an_unknown_level_stays_unknown() -> None:
    state = after(integrity(bound_m=math.nan), protection(START_GPS_NS, 2.0, level_m=[math.nan] * 3))
    assert "x y z ?  ?  ? m" in status_line(state, 0.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((2.0, 0.514, 12.3456), "2.00  0.51  12.3 m"),
        ((343.0, 686.2, 99.95), "343  686  100 m"),
        ((12_345.0, 900.0, math.inf), "12.3  0.90  inf km"),
        ((math.nan, 1.0, 2.0), "?  1.00  2.00 m"),
        ((1e12, 1.0, 2.0), "1.0e+09  0.00  0.00 km"),
    ],
)
def test_lengths_in_one_unit(values: tuple[float, ...], words: str) -> None:
    assert metres_each(values) == words


def test_every_alert_says_what_its_value_is_or_has_none() -> None:
    """GIVEN all alerts THEN each has a quantity; the bound is never the value of an alert that is not navigation's."""
    assert set(QUANTITIES) == {int(alert) for alert in AlertId} == set(ALERTS)
    for alert_id in range(int(AlertId.GNSS_EXCLUDED), int(AlertId.RECEIVER_VELOCITY_FAULT) + 1):
        assert QUANTITIES[alert_id] is not BOUND


@pytest.mark.parametrize(
    ("alert_id", "value", "words"),
    [
        (AlertId.OUTAGE_START, 12.25, "[bound 12.25 m]"),
        (AlertId.GNSS_EXCLUDED, 2.0, "[satellites left out 2]"),
        (AlertId.GNSS_PROTECTION, 61.5, "[protection level 61.5 m]"),
        (AlertId.CROSSLINK_NEIGHBOUR_FAULTY, 9.0, "[satellite 9]"),
        (AlertId.CROSSLINK_OWN_FAULT, 3.25, "[statistic over threshold 3.25]"),
        (AlertId.RECEIVER_VELOCITY_FAULT, 0.5, "[velocity error 0.5 m/s]"),
        (AlertId.LINK_REFUSED, 12.25, ""),
        (AlertId.GNSS_EXCLUDED, math.nan, ""),
        (AlertId.GNSS_PROTECTION, math.inf, ""),
    ],
)
def test_the_value_of_an_alert_is_named_with_its_unit(alert_id: AlertId, value: float, words: str) -> None:
    text = alert_text(int(alert_id), 1, value)
    assert text == f"{ALERTS[int(alert_id)].text} {words}".rstrip() + f" ({alert_id.name})"


def test_the_value_of_an_alert_that_this_console_does_not_know_stays_visible() -> None:
    state = after(alert(1, 62, 3, value=7.0))
    assert "[7]" in state.events[-1].text
