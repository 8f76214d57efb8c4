"""The console's page of pseudoranges, driven by Pilot, and its words in plain mode."""

from __future__ import annotations

import math
from typing import Any

import pytest
from console_story import heard, heartbeat, integrity

pytest.importorskip("textual")
pytest.importorskip("textual_plotext")

from test_console_view import ScriptedLink, drive, screen_text

from flightsw.icd import mavlink
from flightsw.icd.enums import GnssVerdict
from ground.console.gnss import names, of_message, page, verdict_word, words
from ground.console.model import State, reduce
from ground.console.plain import status_line
from ground.console.view import ConsoleApp


def check(**changes: Any) -> mavlink.MAVLink_leonav_gnss_check_message:
    """A LEONAV_GNSS_CHECK of an epoch with two faulty satellites, with changes."""
    values: dict[str, Any] = {
        "t_gps_ns": 10**18,
        "used": [0b1011, 1 << 23, 0b111, 0],
        "excluded": [1 << 16, 0, 1 << 35, 0],
        "age_s": 0.4,
        "statistic": 14.25,
        "threshold": 41.5,
        "protection_m": [3.0, 4.0, 33.0],
        "limit_m": [15.0, 15.0, 30.0],
        "sigma_m": [0.4, 0.5, 1.0],
        "epochs": 1234,
        "offered_count": 1230,
        "verdict": GnssVerdict.EXCLUDED,
        "refused": 2,
        "dof": 6,
        "available": 0,
        "offered": 1,
    }
    return mavlink.MAVLink_leonav_gnss_check_message(**(values | changes))


def test_the_page_names_who_is_out_and_what_is_beyond() -> None:
    """GIVEN an epoch with two satellites left out WHEN its page is turned to THEN their names, verdict, levels and the
    one beyond its limit are there; after silence it says STALE.
    """
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.say(heartbeat(), integrity(), check())
        app.step()
        await pilot.press("9")
        await pilot.pause()
        shown = screen_text(app)
        for wanted in (
            *("EXCLUDED", "G17 E36", "before the test 2", "handed to navigation", "1,230 of 1,234"),
            *("G01 G02 G04", "R24", "E01 E02 E03", "14.2 of at most 41.5, 6 degrees", "BEYOND"),
        ):
            assert wanted in shown, wanted
        assert shown.count("BEYOND") == 1
        assert "STALE" not in shown
        link.time_s += 30.0
        app.step()
        await pilot.pause()
        assert "STALE 30" in screen_text(app)

    drive(link, script)


def test_all_pages_fit_into_the_line_of_keys() -> None:
    """GIVEN 100 columns THEN every page's number and the help stand in the bottom line."""
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        app.step()
        await pilot.pause()
        last = screen_text(app).splitlines()[-1]
        assert "9 gnss" in last
        assert "? help" in last

    drive(link, script)


def test_a_flight_without_the_function_says_so() -> None:
    assert "no table of kind gnss" in page(None, "").plain


def test_plain_mode_has_the_verdict_and_the_names() -> None:
    """GIVEN the same epoch THEN the status line says it; once it is old, it says STALE."""
    state = State()
    for message in (integrity(), check()):
        state = reduce(state, heard(message), 100.0)
    assert "gnss EXCLUDED 7 used without G17 E36" in status_line(state, 100.0)
    assert "gnss EXCLUDED 7 used without G17 E36 STALE" in status_line(state, 110.0)


@pytest.mark.parametrize("verdict", [*GnssVerdict, 77])
def test_every_verdict_has_words(verdict: int) -> None:
    """GIVEN any verdict, also one of a newer flight, and no number in the rest THEN the page can be drawn."""
    nothing = [math.inf, math.nan, -math.inf]
    message = check(verdict=verdict, protection_m=nothing, sigma_m=nothing, statistic=math.nan, threshold=math.inf)
    text = page(of_message(heard(message)), "").plain
    assert verdict_word(verdict) in text
    assert "console older than flight" in text or verdict != 77
    assert words(of_message(heard(message))).startswith("gnss ")


def test_names_of_all_satellites() -> None:
    everyone = names(((1 << 64) - 1,) * 4)
    assert len(everyone.split()) == 256
    assert everyone.startswith("G01 G02")
    assert everyone.endswith("C64")
    assert names((0, 0, 0, 0)) == "none"
