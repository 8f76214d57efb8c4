"""The page of the crosslinks at 100 x 30, and the same in a plain line."""

from __future__ import annotations

import math
from typing import Any

import pytest

pytest.importorskip("textual")
pytest.importorskip("textual_plotext")

from console_story import heard
from test_console_view import ScriptedLink, drive, screen_text

from flightsw.icd import mavlink
from flightsw.icd.enums import CrosslinkMajority, CrosslinkState
from ground.console.crosslink_page import crosslink_page
from ground.console.model import State, active_alerts, reduce
from ground.console.plain import status_line
from ground.console.view import ConsoleApp

USUAL: dict[str, Any] = {
    "t_gps_ns": 1_230_000_000_000_000_000,
    "faulty": 0,
    "named": 0,
    "own_statistic": 3.25,
    "own_threshold": 36.5,
    "network_statistic": 9.5,
    "network_threshold": 43.2,
    "weakest_m": 66.0,
    "epoch_age_s": 0.4,
    "links": 228,
    "own_links": 18,
    "rank": 89,
    "parameters": 96,
    "incomplete": 2,
    "own_state": CrosslinkState.CLEAR,
    "majority": CrosslinkMajority.RELIABLE,
    "own": 0,
    "satellites": 24,
    "network_worst": 16,
    "own_peer": 255,
    "weakest": 8,
}


def message(**changes: Any) -> Any:
    values = {**USUAL, **changes}
    return mavlink.MAVLink_leonav_crosslink_message(**{k: int(v) if "_state" in k else v for k, v in values.items()})


def page(now_s: float = 0.0, **changes: Any) -> str:
    return crosslink_page(reduce(State(), heard(message(**changes)), 0.0), now_s).plain


def test_the_page_names_who_is_excluded_and_sets_statistics_against_thresholds() -> None:
    shown = page(faulty=(1 << 8) | (1 << 23), network_statistic=51.0)
    for words in (
        "satellite 1 of 24",
        "own message   CLEAR",
        "excluded      satellites 9, 24",
        "majority      reliable",
        "own links     3.2 of 36.5\n",
        "network       51.0 of 43.2  ABOVE   satellite 17",
        "links         228 of the last epoch, 18 of them its own",
        "incomplete    2 epochs",
        "rank 89 of 96: errors in 7 common directions stretch no link",
        "a jump of 66.0 m is certain to be found, even of satellite 9",
    ):
        assert words in shown, f"{words}\n{shown}"


def test_a_doubt_says_whose_it_may_be_as_well() -> None:
    shown = page(own_state=CrosslinkState.SUSPECT, own_peer=4)
    assert "own message   IN DOUBT   or that of satellite 5, which explains the links as well" in shown


def test_silence_must_not_look_like_health() -> None:
    """GIVEN no epoch, an old epoch, or no message any more THEN the page says so in words."""
    assert "last epoch    none yet" in page(epoch_age_s=math.nan, own_state=CrosslinkState.NOT_JUDGED)
    assert "own message   NOT MONITORED" in page(epoch_age_s=math.nan, own_state=CrosslinkState.NOT_JUDGED)
    assert "last epoch    12.0 s ago   SILENT" in page(epoch_age_s=12.0)
    late = page(now_s=20.0)
    assert "STALE 20.0 s" in late
    assert "last epoch    20.4 s ago   SILENT" in late
    assert "not judged" in page(network_statistic=-1.0)
    assert "not monitored satellite 5\n" in page(unmonitored=1 << 4)
    assert "not monitored none\n" in page()
    assert "said nothing of crosslinks" in crosslink_page(State(), 0.0).plain


def test_numbers_that_this_console_does_not_know_stay_visible() -> None:
    assert "own message   STATE 9" in page(own_state=9)
    assert active_alerts(1 << 35 | 1 << 62) == ["CROSSLINK_OWN_FAULT", "ALERT_62"]


def test_the_page_is_turned_to_by_its_key() -> None:
    """GIVEN a message that names satellite 9 WHEN key 0, of page ten, is pressed THEN it is shown; the keys fit."""
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.time_s = 5.0
        link.say(message(faulty=1 << 8, own_state=CrosslinkState.FAULT))
        app.step()
        await pilot.press("0")
        await pilot.pause()
        text = screen_text(app)
        assert "excluded      satellite 9" in text
        assert "own message   WRONG: DO NOT USE" in text
        assert "0 xlink" in text.splitlines()[-1]
        assert "? help q quit" in text.splitlines()[-1]

    drive(link, script)


def test_the_plain_line_tells_it_too() -> None:
    state = reduce(State(), heard(message(faulty=1 << 8)), 0.0)
    words = "crosslinks: own message CLEAR, excluded satellite 9, 9.5 of 43.2"
    assert words in status_line(state, 1.0)
    assert f"{words} STALE 20.0 s" in status_line(state, 20.0)
    quiet = reduce(State(), heard(message(epoch_age_s=math.nan, own_state=CrosslinkState.NOT_JUDGED)), 0.0)
    assert "own message NOT MONITORED, 9.5 of 43.2, no epoch yet" in status_line(quiet, 0.0)
    silent = reduce(State(), heard(message(unmonitored=1 << 4 | 1 << 6)), 0.0)
    assert "own message CLEAR, not monitored satellites 5, 7, 9.5 of" in status_line(silent, 0.0)
    assert "crosslinks" not in status_line(State(), 0.0)
