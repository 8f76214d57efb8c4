"""Pages of events and timing, differences between tables, signatures nobody verified: driven by their keys."""

from __future__ import annotations

import math
import re
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("textual")
pytest.importorskip("textual_plotext")

from console_story import START_GPS_NS, heard, heartbeat, integrity, second, write_tlog
from hypothesis import given, settings
from hypothesis import strategies as st
from test_console_view import ScriptedLink, drive, screen_text
from textual.widgets import Input

from flightsw.icd import mavlink
from flightsw.icd.table_file import TableRefused, decode, encode
from flightsw.kernels.histogram import BINS, bin_of
from flightsw.schedule import TIMING_OCTAVES, Member
from ground.console.event_log import LEVELS, Filter, events_page
from ground.console.link import UdpLink
from ground.console.model import Event, State, reduce
from ground.console.panels import header
from ground.console.pictures import SHOTS, Shot, take
from ground.console.plain import final_line, status_line
from ground.console.table_diff import table_diff
from ground.console.timing_page import bars
from ground.console.tlog import TlogLink
from ground.console.verdict import judge_link
from ground.console.view import ConsoleApp
from ground.tables.build import build_navigation

ALL = Filter()


class SendingLink(ScriptedLink):
    """A scripted link that can be answered on; what is sent is kept."""

    verifier = None

    def __init__(self) -> None:
        super().__init__()
        self.sent: list[bytes] = []

    def send(self, frame: bytes) -> None:
        self.sent.append(frame)


def timing(index: int, name: bytes, **changes: Any) -> mavlink.MAVLink_leonav_timing_message:
    histogram = [0] * TIMING_OCTAVES
    histogram[7], histogram[11] = 990, 10
    values: dict[str, Any] = {
        "t_gps_ns": START_GPS_NS,
        "runs": 1000,
        "over_budget": 0,
        "slips": 2,
        "budget_us": 500.0,
        "p50_us": 101.5,
        "p99_us": 130.0,
        "p999_us": 1800.0,
        "longest_us": 1999.0,
        "histogram": histogram,
    }
    return mavlink.MAVLink_leonav_timing_message(**(values | changes), name=name, index=index, count=3)


# -- events


LOG = (
    Event(0.0, 6, "alarm #3 acknowledged"),
    Event(1.0, 4, "GNSS lost: navigating alone [3] (OUTAGE_START)"),
    Event(2.0, 2, "Error bound above the limit (FLAG_RAISED)"),
    Event(3.0, 5, "console: parameter LNK_REPEAT_S = 3 sent"),
)


@pytest.mark.parametrize(
    ("chosen", "found"),
    [
        (ALL, [0, 1, 2, 3]),
        (Filter(5), [1, 2, 3]),
        (Filter(4), [1, 2]),
        (Filter(3), [2]),
        (Filter(7, "flag_raised"), [2]),
        (Filter(7, "Limit"), [2]),
        (Filter(7, "warning"), [1]),
        (Filter(7, "info"), [0]),
        (Filter(3, "gnss"), []),
    ],
)
def test_a_filter_selects_by_severity_and_by_word(chosen: Filter, found: list[int]) -> None:
    assert chosen.select(LOG) == tuple(LOG[index] for index in found)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 7), st.text(st.sampled_from("aBc é[]"), max_size=20)), max_size=30),
    st.sampled_from(LEVELS),
    st.text("aBc", max_size=3),
)
def test_a_stricter_filter_never_shows_more(log: list[tuple[int, str]], severity: int, word: str) -> None:
    events = tuple(Event(float(k), *entry) for k, entry in enumerate(log))
    shown = Filter(severity, word).select(events)
    assert set(shown) <= set(events)
    assert set(Filter(severity, word).next_level().select(events)) <= set(shown) or severity == LEVELS[-1]
    assert set(Filter(severity, word + word).select(events)) <= set(shown)
    assert events_page(events, Filter(severity, word), 0, 12).plain.count("\n") <= 12


def test_events_are_filtered_sought_and_scrolled_by_keys() -> None:
    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.tell(0, 5)
        link.tell(299, 305)
        link.tell(811, 815)
        app.step()
        for _ in range(60):
            app._say(6, "console: something small")
        await pilot.press("7")
        assert "small" in screen_text(app)
        await pilot.press("f", "f")
        shown = screen_text(app)
        assert "warning and graver" in shown
        assert "small" not in shown
        assert "FLAG_RAISED" in shown or "Error bound above the limit" in shown
        await pilot.press("slash", *"gnss", "enter")
        shown = screen_text(app)
        assert 'with "gnss"' in shown
        assert "GNSS lost" in shown
        assert "Error bound" not in shown
        await pilot.press("slash", *["backspace"] * 4, "enter", "f", "f")
        assert app.filter == ALL
        await pilot.press(*["up"] * 5)
        assert "5 newer below" in screen_text(app)
        await pilot.press("down")
        assert "4 newer below" in screen_text(app)
        await pilot.press("slash", "escape")
        assert app.filter == ALL

    link = ScriptedLink()
    drive(link, script)


# -- timing


def test_the_page_of_timing_shows_every_member_slips_and_what_is_stale() -> None:
    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.tell(0, 10)
        app.step()
        await pilot.press("8")
        assert "told no timing" in screen_text(app)
        link.say(timing(1, b"navigate"), timing(0, b"tick", over_budget=7), timing(2, b"bad\x1b[31m"))
        app.step()
        lines = screen_text(app).splitlines()
        (tick,) = [line for line in lines if "tick " in line and "500" in line]
        assert "7" in tick
        assert "1,999" in tick
        assert "1,800" in tick
        assert any("navigate" in line and "101.5" in line for line in lines)
        assert not any("\x1b" in line for line in lines)
        assert any("began late: 2" in line for line in lines)
        assert "STALE" not in "".join(lines)
        link.time_s += 100.0
        link.say(heartbeat(), integrity())
        app.step()
        lines = screen_text(app).splitlines()
        assert all("STALE" in line for line in lines if "navigate" in line)
        assert any("began late" in line and "STALE" in line for line in lines)

    link = ScriptedLink()
    drive(link, script)


def test_one_run_in_ten_thousand_is_seen_in_the_bars() -> None:
    state = State()
    for index, counts in enumerate(([9999, 1] + [0] * 18, [0] * 20, [5000, 5000] + [0] * 18)):
        message = timing(index, b"m", runs=sum(counts), histogram=counts)
        state = reduce(state, heard(message), 0.0)
    one, none, equal = (bars(told) for told, _ in state.timing)
    assert one[0] == "@"
    assert one[1] not in " @"
    assert one[2:] == " " * 18
    assert none == " " * 20
    assert equal[0] == equal[1] != " "


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 2**42), max_size=60))
def test_octaves_count_every_run_once_by_its_duration(durations: list[int]) -> None:
    """Against the definition: element 0 below 2^10 ns, element i from 2^(i+9) to 2^(i+10) ns, the last all longer."""
    member = Member("m", 1, 1.0, lambda: None)
    expected = [0] * TIMING_OCTAVES
    for duration in durations:
        member.account(duration)
        place = 0 if duration < 1024 else min(int(math.log2(duration)) - 9, TIMING_OCTAVES - 1)
        expected[place] += 1
        assert bin_of(duration) < BINS
    assert member.octaves() == expected


# -- tables


def test_differences_between_tables_are_named_with_units() -> None:
    flies = build_navigation("paper")
    image = decode(flies)
    values = image.values.copy()
    name = next(n for n in values.dtype.names if values[n].ndim == 2 and np.any(values[n]))
    values["limit_m"], values[name][0, 0] = 777.0, values[name][0, 0] * 2.0
    other = encode(image.kind, "another", values)
    lines = table_diff(flies, other)
    assert lines[0] == "set: paper -> another"
    (limit,) = [line for line in lines if line.startswith("limit_m: ")]
    assert limit.endswith("-> 777 m")
    assert [line for line in lines if line.startswith(f"{name}: [0] ")]
    assert len(lines) == 3
    assert table_diff(flies, flies) == []
    with pytest.raises(TableRefused, match="the file: "):
        table_diff(flies, b"no table")


def test_a_file_is_compared_with_the_table_read_back_by_keys(tmp_path: Path) -> None:
    async def script(pilot: Any, app: ConsoleApp) -> None:
        link.tell(0, 5)
        app.step()
        await pilot.press("5", "d")
        assert any("read the table that flies back first" in event.text for event in app.state.events)
        assert app.operator is not None
        app.operator.table_read = build_navigation("paper")
        for text, words in (
            (tmp_path / "absent.tbl", "cannot be read"),
            (tmp_path / "bad.tbl", "bad.tbl: the file: "),
        ):
            (tmp_path / "bad.tbl").write_bytes(b"x" * 100)
            app._compare(str(text))
            assert words in app.state.events[-1].text
        (tmp_path / "new.tbl").write_bytes(build_navigation("paper", {"limit_m": 777.0}))
        await pilot.press("d")
        app.screen.query_one(Input).value = str(tmp_path / "new.tbl")
        await pilot.press("enter")
        await pilot.pause()
        app.step()
        shown = screen_text(app)
        assert "3 differences: the table that flies -> new.tbl" in shown
        assert "limit_m: 2000 -> 777 m" in shown

    link = SendingLink()
    drive(link, script)


# -- signatures


def signed(message: Any, stamp: int = 1) -> bytes:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sender.signing.secret_key, sender.signing.sign_outgoing, sender.signing.timestamp = bytes(32), True, stamp
    return bytes(message.pack(sender))


@pytest.mark.parametrize("is_signed", [True, False])
def test_a_signature_that_nobody_verifies_is_never_a_green_verdict(is_signed: bool) -> None:
    """GIVEN a console without a key WHEN flight signs THEN UNAUTHENTICATED, with the remedy; else TRUSTED."""
    link = UdpLink("127.0.0.1", 0, lambda: 100.0)
    state = State(started_s=100.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flight:
        for message in second(60):
            frame = signed(message) if is_signed else bytes(message.pack(mavlink.MAVLink(None, 1, 1)))
            flight.sendto(frame, ("127.0.0.1", link.port))
    for time_s, message in link.receive():
        state = reduce(state, message, time_s)
    judgement = judge_link(state, 100.0, link)
    link.close()
    assert judgement.word == ("UNAUTHENTICATED" if is_signed else "TRUSTED")
    assert ("--key" in judgement.reason) is is_signed
    assert judgement.word in status_line(state, 100.0, link)
    assert judgement.word in final_line(state, 100.0, link)


def test_a_log_of_signed_messages_says_that_nobody_verified_them(tmp_path: Path) -> None:
    plain = TlogLink(write_tlog(tmp_path / "plain.tlog", 20), 1.0, lambda: 0.0)
    path = tmp_path / "signed.tlog"
    stamp_us = 1_600_000_000_000_000
    path.write_bytes(b"".join((stamp_us + k).to_bytes(8, "big") + signed(m, k + 1) for k, m in enumerate(second(60))))
    verified_by_nobody = TlogLink(path, 1.0, lambda: 0.0)
    for link, says in ((plain, False), (verified_by_nobody, True)):
        assert list(link.everything())
        assert ("SIGNATURES NOT VERIFIED" in header(link, State(), link.now_s(), False, "").plain) is says


# -- pictures of the guide


def test_pictures_show_the_moments_and_pages_they_are_of(tmp_path: Path) -> None:
    """GIVEN the story as a log WHEN pictures are taken of it THEN each is SVG with the words of its moment."""
    log = write_tlog(tmp_path / "link.tlog", 330)
    shots = (Shot("console_fixes", 60.0), Shot("console_alarms", 320.0, ("2",)))
    fixes, lost = (path.read_text(encoding="utf-8") for path in take(log, tmp_path, shots))
    assert fixes.startswith("<svg")
    assert "TRUSTED" in fixes
    assert "COASTING" not in fixes
    assert "COASTING" in lost
    assert "GNSS&#160;lost" in lost
    assert "ACKNOWLEDGED" in lost


def test_the_guide_shows_the_pictures_that_the_script_makes() -> None:
    docs = Path(__file__).parents[2] / "docs"
    shown = set(re.findall(r"images/(console_\w+)\.svg", (docs / "operators_guide.md").read_text(encoding="utf-8")))
    assert shown == {path.stem for path in (docs / "images").glob("console_*.svg")} == {shot.name for shot in SHOTS}
