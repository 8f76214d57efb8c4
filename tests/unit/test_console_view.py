"""The screen at 100 x 30 driven by Pilot on a scripted clock: words, not colours."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from console_story import FLAG_AGE_S, OUTAGE_START_S, STOP_S, alert, heard, integrity, second, write_tlog

from flightsw.icd import mavlink

pytest.importorskip("textual")
pytest.importorskip("textual_plotext")

from ground.console.link import Received, Statistics
from ground.console.tlog import TlogLink
from ground.console.view import ConsoleApp

SIZE = (100, 30)
NEVER_S = 1e6  # the timer stays out of the way: tests step the console themselves


class ScriptedLink:
    """A live link whose time and messages the test sets."""

    name, live = "scripted", True

    def __init__(self) -> None:
        self.time_s = 0.0
        self.waiting: list[Received] = []
        self.statistics = Statistics()

    def say(self, *messages: Any) -> None:
        self.waiting += [Received(self.time_s, heard(message)) for message in messages]

    def tell(self, start_s: int, stop_s: int) -> None:
        for t_s in range(start_s, stop_s + 1):
            self.time_s = float(t_s)
            self.say(*second(t_s))

    def now_s(self) -> float:
        return self.time_s

    def receive(self) -> list[Received]:
        messages, self.waiting = self.waiting, []
        return messages

    def pause(self, paused: bool) -> None:
        pass

    def finished(self) -> bool:
        return False

    def close(self) -> None:
        pass


def screen_text(app: ConsoleApp) -> str:
    """What the terminal shows, line by line."""
    strips = app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip).rstrip() for strip in strips)


def drive(link: Any, script: Callable[[Any, ConsoleApp], Awaitable[None]]) -> ConsoleApp:
    """Run the app without a terminal and let the script press its keys."""
    app = ConsoleApp(link, period_s=NEVER_S)

    async def session() -> None:
        async with app.run_test(size=SIZE) as pilot:
            await pilot.pause()
            await script(pilot, app)

    asyncio.run(session())
    return app


def test_everything_an_operator_needs_stands_on_one_screen() -> None:
    """GIVEN an outage 600 s old WHEN the screen is drawn THEN verdict, reason, values, plot and events show."""
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.tell(0, OUTAGE_START_S + 600)
        app.step()
        await pilot.pause()
        text = screen_text(app)
        lines = text.split("\n")
        assert len(lines) == 30
        assert max(map(len, lines)) <= 100
        for piece in (
            "DO NOT USE   uncertified table",
            "failure flag raised 513 s after the last fix: bound 2738 m, limit 2000 m",
            "mode       FAILED",
            "fix age    600 s",
            "flag       RAISED at 513 s",
            "90 % of orbit, stored",
            "link 0.0 s",
            "Error bound above the limit",
            "GNSS lost: navigating alone",
            "BAD_CRC",
            "GATE",
            "active: FLAG_RAISED, OUTAGE_START, TABLE_UNCERTIFIED",
            "NIS        STALE 600 s",
            "limit┤",
            "100 m┤",
            "░░░",
            "▒▒▒",
            "? help q quit",
        ):
            assert piece in text, f"{piece!r} is not on the screen:\n{text}"

    drive(link, script)


def test_silence_does_not_look_like_health() -> None:
    """GIVEN TRUSTED on the screen WHEN 4 s pass without a word THEN NO LINK, and every value says STALE."""
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        assert "NO LINK" in screen_text(app)
        link.tell(0, 200)
        app.step()
        await pilot.pause()
        assert " TRUSTED   uncertified table" in screen_text(app)
        link.time_s += 4.0
        app.step()
        await pilot.pause()
        text = screen_text(app)
        assert "NO LINK" in text
        assert "silent for 4.0 s" in text
        assert "TRUSTED " not in text
        assert "bound      STALE 4.0 s 2.00 m" in text
        assert "link 4.0 s SILENT" in text
        assert "STALE bound 2.00 m against limit 2000 m" in text

    drive(link, script)


def test_the_flag_is_on_the_screen_at_the_next_redraw() -> None:
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.tell(0, OUTAGE_START_S + FLAG_AGE_S - 1)
        app.step()
        await pilot.pause()
        assert "TRUSTED, COASTING" in screen_text(app)
        link.tell(OUTAGE_START_S + FLAG_AGE_S, OUTAGE_START_S + FLAG_AGE_S)
        app.step()
        await pilot.pause()
        assert "DO NOT USE" in screen_text(app)

    drive(link, script)


def test_help_opens_and_any_key_closes_it() -> None:
    async def script(pilot: Any, app: ConsoleApp) -> None:
        await pilot.press("question_mark")
        await pilot.pause()
        assert "TRUSTED, COASTING   no fix for a while" in screen_text(app)
        await pilot.press("x", "y")
        await pilot.pause()
        assert "no fix for a while" not in screen_text(app)

    drive(ScriptedLink(), script)


def test_pause_holds_events_and_plot_but_never_the_verdict() -> None:
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.tell(0, 100)
        app.step()
        await pilot.press("p")
        link.say(alert(50, 14, 1), integrity(flag_state=1, verdict=3, mode=3))
        app.step()
        await pilot.pause()
        text = screen_text(app)
        assert " PAUSED " in text
        assert "Earth orientation" not in text
        assert "DO NOT USE" in text
        await pilot.press("p")
        await pilot.pause()
        assert "Earth orientation" in screen_text(app)

    drive(link, script)


@pytest.mark.parametrize("key", ["q", "ctrl+c"])
def test_keys_that_end_it(key: str) -> None:
    async def script(pilot: Any, app: ConsoleApp) -> None:
        await pilot.press(key)

    assert drive(ScriptedLink(), script).return_code == 0


def test_text_from_the_link_is_neither_markup_nor_escape_sequence() -> None:
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.say(mavlink.MAVLink_statustext_message(2, b"[reverse]\x1b[31m [/] all well"))
        app.step()
        await pilot.pause()
        assert r"flight says: [reverse]\x1b[31m [/]" in screen_text(app)

    drive(link, script)


def test_a_log_shows_the_same_verdicts_as_the_live_link(tmp_path: Path) -> None:
    """GIVEN one story live and as a .tlog WHEN both have told it to second t THEN the verdicts are equal."""
    clock = [0.0]
    log = TlogLink(write_tlog(tmp_path / "link.tlog"), 1.0, lambda: clock[0])
    words: dict[str, list[str]] = {"live": [], "log": []}
    stops = [3, 100, OUTAGE_START_S + 100, OUTAGE_START_S + 520, STOP_S]
    link = ScriptedLink()

    async def live(pilot: Any, app: ConsoleApp) -> None:
        for start_s, stop_s in zip([-1, *stops], stops, strict=False):
            link.tell(start_s + 1, stop_s)
            app.step()
            words["live"].append(str(app.judgement))

    async def replay(pilot: Any, app: ConsoleApp) -> None:
        for stop_s in stops:
            clock[0] = float(stop_s)
            for _ in range(3):
                app.step()
            words["log"].append(str(app.judgement))
        await pilot.pause()
        assert "END OF LOG" in screen_text(app)

    drive(link, live)
    drive(log, replay)
    assert words["live"] == words["log"]


def test_the_name_of_a_table_goes_with_its_crc() -> None:
    """GIVEN integrity under another CRC than the last table status THEN the old name is not shown with it."""
    link = ScriptedLink()

    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.tell(0, 10)
        app.step()
        await pilot.pause()
        assert "table      paper_1m 1234abcd" in screen_text(app)
        link.say(integrity(table_crc32=0xFEEDF00D))
        app.step()
        await pilot.pause()
        assert "table      name unknown feedf00d" in screen_text(app)

    drive(link, script)


def test_hostile_messages_do_not_break_the_drawing() -> None:
    """GIVEN values at the ends of their types WHEN drawn THEN no exception, and no trust."""
    link = ScriptedLink()
    extremes = [
        integrity(bound_m=b, limit_m=v, bound_3d_m=b, fix_age_s=f, flag_age_s=f, t_gps_ns=t, mode=255, driver=255)
        for b, v, f in ((1e308, 1e-308, 3e38), (float("inf"),) * 3, (-1.0, -1.0, -1.0), (0.0, 0.0, 0.0))
        for t in (-(2**63), 0, 2**63 - 1)
    ]

    async def script(pilot: Any, app: ConsoleApp) -> None:
        for message in extremes:
            link.time_s += 1.0
            link.say(message)
            app.step()
            await pilot.pause()
            assert "DO NOT USE" in screen_text(app)

    drive(link, script)
