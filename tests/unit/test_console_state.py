"""A state sent from the console, driven by Pilot against a real flight on a wire."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("textual")
pytest.importorskip("textual_plotext")

import numpy as np
from harness import Flight
from link_bench import Linked
from test_console_opm import opm
from test_console_pages import drive

from flightsw.icd.enums import Mode
from ground.console.view import ConsoleApp
from ground.tables.gps_time import format_gps

SETTINGS = ("flight.table_set=flight", "time.duration_s=900", "outage=[{start_s=60.0, duration_s=600.0}]")


def written(flight: Flight, path: Path, off_m: float) -> None:
    """The state of a second ago, as an orbit parameter message."""
    t_ns = int(flight.loop.memory.output["t_gps_ns"][0]) - 10**9
    t_ns -= t_ns % 10**9
    r, v = flight.world.truth.state_gcrf(np.array([t_ns]))
    state = np.concatenate((r[0], v[0])) + np.array([off_m, 0, 0, 0, 0, 0])
    epoch = format_gps(t_ns).removesuffix(" GPS").replace(" ", "T")
    covariance = np.diag([9.0, 9.0, 9.0, 1e-4, 1e-4, 1e-4])
    path.write_text(opm(state.tolist(), covariance, TIME_SYSTEM="GPS", EPOCH=epoch))


@pytest.mark.compiled
def test_a_state_is_sent_confirmed_and_its_fate_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN an outage WHEN n is pressed, a message named and confirmed THEN flight corrects by it and the events say
    so; one that does not fit is refused by name; a file that is none is told and nothing sent; escape sends nothing."""
    monkeypatch.chdir(tmp_path)  # every key that is pressed takes 50 ms
    fits, astray, none = (Path(name) for name in ("fits.opm", "astray.opm", "none.opm"))
    none.write_text("hello\n")

    async def story(app: ConsoleApp, pilot: Any, fly: Any) -> None:
        await fly(120.0)
        written(app.link.flight, fits, 0.0)  # type: ignore[attr-defined]
        written(app.link.flight, astray, 5e4)  # type: ignore[attr-defined]

        async def name(path: Path, answer: str) -> str:
            count = len(app.state.events)
            await pilot.press("n")
            await pilot.pause()
            await pilot.press(*str(path), "enter")
            await pilot.pause()
            await pilot.press(answer)
            await pilot.pause()
            await fly(1.5)
            return " | ".join(event.text for event in app.state.events[count:])

        memory = app.link.flight.loop.memory  # type: ignore[attr-defined]
        before_m = float(memory.output["bound_m"][0])
        assert "taken, NIS" in await name(fits, "y")
        assert memory.output["bound_m"][0] < before_m
        assert memory.output["mode"][0] == Mode.AUTONOMOUS
        assert "refused: GATE" in await name(astray, "y")
        assert "line 1: KEYWORD = value" in await name(none, "escape")
        assert "sent" not in await name(fits, "escape")

    with Linked(*SETTINGS) as flight:
        drive(flight, story)
