"""Pages, orders and replay keys of the console, driven by Pilot at 100 x 30 against a real flight on a wire."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("textual")
pytest.importorskip("textual_plotext")

from console_story import START_UNIX_S, write_tlog
from link_bench import KEY, Linked
from test_console_view import NEVER_S, SIZE, screen_text

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import Mode
from ground.console.authentication import EPOCH_UNIX_S, UNITS_PER_S, Verifier, read_key
from ground.console.link import FrameDecoder, Received
from ground.console.model import State
from ground.console.tlog import TlogLink
from ground.console.verdict import judge
from ground.console.view import ConsoleApp
from ground.errors import OperatorError

OUTAGE = "outage=[{start_s=10.0, duration_s=8.0}]"


class WireLink:
    """A console's live link to a flight on a wire; `fly` is the passing of time for both."""

    name, live = "wire", True

    def __init__(self, flight: Linked, key: bytes = KEY) -> None:
        self.flight = flight
        self.verifier: Verifier | None = Verifier((key,), self.now_s)
        self.decoder = FrameDecoder(self.verifier)
        self.statistics = self.decoder.statistics
        self.forged_s: float | None = None

    def now_s(self) -> float:
        return self.flight.loop.unix_ns() * 1e-9

    def send(self, frame: bytes) -> None:
        self.flight.wire.up.append(frame)

    def receive(self) -> list[Received]:
        down, self.flight.wire.down = self.flight.wire.down, []
        heard = [message for frame in down for message in self.decoder.datagram(frame)]
        if self.decoder.forged:
            self.decoder.forged, self.forged_s = False, self.now_s()
        return [Received(self.now_s(), message) for message in heard]

    def pause(self, paused: bool) -> None:
        pass

    def finished(self) -> bool:
        return False

    def close(self) -> None:
        pass


def drive(
    flight: Linked, story: Callable[[ConsoleApp, Any, Callable[[float], Awaitable[None]]], Awaitable[None]]
) -> None:
    """Run a story against a console and its flight; `fly(seconds)` ticks flight and steps the console five times a
    second."""

    async def run() -> None:
        app = ConsoleApp(WireLink(flight), NEVER_S)  # type: ignore[arg-type]
        async with app.run_test(size=SIZE) as pilot:

            async def fly(seconds: float) -> None:
                for _ in range(round(seconds * 10)):
                    flight.tick()
                    if flight.k % 2 == 0:
                        app.step()
                await pilot.pause()

            await story(app, pilot, fly)

    asyncio.run(run())


def test_every_page_is_turned_to_by_its_key_and_shows_what_it_is_for() -> None:
    async def story(app: ConsoleApp, pilot: Any, fly: Any) -> None:
        await fly(8.0)
        for key, words in (
            ("2", ("no alarm stands", "ACKNOWLEDGED")),
            ("3", ("mean NIS", "streak", "rejected since start")),
            ("4", ("heard by flight", "failure flag armed", "0 not authenticated")),
            ("5", ("navigation table in force", "none under way")),
            ("6", ("LNK_REPEAT_S", "may be set", "read only")),
            ("1", ("limit", "bound", "rejected by cause")),
        ):
            await pilot.press(key)
            await fly(1.5)
            shown = screen_text(app)
            for word in words:
                assert word in shown, f"page {key}: {word}\n{shown}"
            assert "NOT CERTIFIED" in shown  # the verdict stands above every page
        await pilot.press("tab")
        assert app.page == 1

    with Linked() as flight:
        drive(flight, story)


def test_an_alarm_stays_until_it_is_acknowledged_and_shows_who_and_when() -> None:
    """GIVEN an outage that has ended WHEN nobody has acknowledged its alarm THEN it stands, said to be over; WHEN the
    operator presses a THEN flight repeats it no more and it is gone; the event log keeps who did it."""

    async def story(app: ConsoleApp, pilot: Any, fly: Any) -> None:
        await fly(15.0)
        await pilot.press("2")
        await fly(0.2)
        assert "GNSS lost: navigating alone" in screen_text(app)
        assert "ACTIVE" in screen_text(app)
        await fly(10.0)
        shown = screen_text(app)
        assert re.search(r"over \d\d:\d\d:\d\d", shown)
        assert "NO: press a" in shown
        assert "TO ACKNOWLEDGE" in shown
        assert flight.ground.alerts.bits & 1 << AlertId.OUTAGE_START
        for _ in app.state.alarms:
            await pilot.press("a")
            await fly(1.0)
        assert not flight.ground.alerts.bits & 1 << AlertId.OUTAGE_START
        shown = screen_text(app)
        assert "no alarm stands" in shown
        assert "acknowledged: accepted" in shown
        assert {alarm.by for alarm in app.state.alarms} == {"operator"}
        assert all(alarm.acknowledged_s is not None for alarm in app.state.alarms)

    with Linked(OUTAGE) as flight:
        drive(flight, story)


def test_an_order_is_confirmed_before_it_leaves_and_its_answer_is_told() -> None:
    async def story(app: ConsoleApp, pilot: Any, fly: Any) -> None:
        await fly(8.0)
        for keys, armed in ((("o", "9", "n"), True), (("o", "escape"), True), (("o", "9", "y"), False)):
            for key in keys:
                await pilot.press(key)
                await pilot.pause()
            await fly(1.0)
            assert flight.loop.armed is armed
        await pilot.press("2")
        await fly(0.2)
        assert "disarm the flag: accepted" in screen_text(app)
        for key in ("o", "7", "y"):
            await pilot.press(key)
            await pilot.pause()
        await fly(0.3)
        assert flight.out["mode"][0] == Mode.INIT
        for key in ("o", "2", "y"):  # the paper's filter edits nothing
            await pilot.press(key)
            await pilot.pause()
        await fly(0.5)
        assert any("mode AUTONOMOUS: not supported" in event.text for event in app.state.events)

    with Linked() as flight:
        drive(flight, story)


def test_a_parameter_is_set_from_its_page(tmp_path: Path) -> None:
    async def story(app: ConsoleApp, pilot: Any, fly: Any) -> None:
        await fly(1.0)
        await pilot.press("6")
        await fly(3.0)
        await pilot.press("s")
        await pilot.pause()
        await pilot.press("backspace", "4", "enter")
        await fly(1.0)
        assert flight.ground.parameters.value("LNK_REPEAT_S") == 4.0
        assert app.operator is not None
        assert app.operator.parameters["LNK_REPEAT_S"][1] == 4.0
        await pilot.press("s")
        await pilot.pause()
        await pilot.press("backspace", "x", "enter")
        await fly(0.5)
        assert any("is no number" in event.text for event in app.state.events)

    with Linked(folder=tmp_path) as flight:
        drive(flight, story)


def test_a_flight_that_falls_silent_is_said_to_be_within_three_heartbeats() -> None:
    async def story(app: ConsoleApp, pilot: Any, fly: Any) -> None:
        await fly(8.0)
        assert "NOT CERTIFIED" in screen_text(app)
        link = app.link
        frozen_s = link.now_s()
        for tenth in range(40):  # frozen: time goes on, nothing is said
            link.now_s = lambda tenth=tenth: frozen_s + tenth * 0.1  # type: ignore[method-assign]
            app.step()
            assert app.judgement is not None
            if app.judgement.word == "NO LINK":
                break
        await pilot.pause()
        print(f"said to be silent after {tenth * 0.1:.1f} s")
        assert tenth <= 31
        assert "NO LINK" in screen_text(app)

    with Linked() as flight:
        drive(flight, story)


def test_messages_of_another_key_are_not_believed() -> None:
    """GIVEN a flight that signs with another key WHEN it speaks THEN nothing of it is shown but that this is so."""
    with Linked() as flight:
        link = WireLink(flight, bytes(32))
        state = State(started_s=link.now_s())
        flight.fly(until_s=5.0)
        assert link.receive() == []
        assert link.statistics.unauthenticated > 50
        assert judge(state, link.now_s(), link.forged_s).word == "UNAUTHENTICATED"


def test_a_recorded_message_is_not_believed_twice() -> None:
    with Linked() as flight:
        link = WireLink(flight)
        flight.fly(until_s=3.0)
        recorded = list(flight.wire.down)
        assert len(link.receive()) == len(recorded)
        flight.wire.down = recorded
        assert link.receive() == []


def test_stamps_stay_beyond_what_was_heard_and_never_repeat() -> None:
    verifier = Verifier((KEY,), lambda: EPOCH_UNIX_S + 100.0)
    first = verifier.next_stamp()
    assert first == 100 * UNITS_PER_S
    assert verifier.next_stamp() == first + 1
    verifier.heard = first + 5000
    assert verifier.next_stamp() == first + 5001


@pytest.mark.parametrize(("text", "mode", "says"), [("00" * 32, 0o644, "chmod 600"), ("zz", 0o600, "64 hexadecimal")])
def test_an_unfit_key_is_refused_in_words(tmp_path: Path, text: str, mode: int, says: str) -> None:
    path = tmp_path / "key"
    path.write_text(text)
    path.chmod(mode)
    with pytest.raises(OperatorError, match=says):
        read_key(path)


def test_a_log_is_sought_in_and_shows_the_same_verdict_as_when_played(tmp_path: Path) -> None:
    """GIVEN a log WHEN it is sought on and back THEN at one time of it the verdict is that of playing."""
    path = write_tlog(tmp_path / "link.tlog", 700)
    time_s = 0.0
    link = TlogLink(path, 1.0, lambda: time_s)

    async def run() -> None:
        nonlocal time_s
        app = ConsoleApp(link, NEVER_S)
        async with app.run_test(size=SIZE) as pilot:
            seen = {}
            for minute in range(1, 9):
                time_s = minute * 60.0
                for _ in range(4):
                    app.step()
                seen[round(link.now_s() - START_UNIX_S)] = app.judgement
            assert app.operator is None
            await pilot.press("o", "a")
            for _ in range(5):
                await pilot.press("left")
                for _ in range(6):
                    app.step()
                at = round(link.now_s() - START_UNIX_S)
                assert app.judgement == seen[at]
            for _ in range(3):
                await pilot.press("right")
                for _ in range(6):
                    app.step()
                assert app.judgement == seen[round(link.now_s() - START_UNIX_S)]
            await pilot.press("plus")
            assert any("2 times real time" in event.text for event in app.state.events)

    asyncio.run(run())


def test_a_key_is_made_once_for_its_owner_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from ground.__main__ import main

    path = tmp_path / "link.key"
    assert main(["link", "key", str(path)]) == 0
    first = read_key(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert len(first[0]) == 32
    assert main(["link", "key", str(path)]) == 2
    assert "already" in capsys.readouterr().err
    assert read_key(path) == first
