"""`ground timing --parts link`, shortened: a flight, a socket, a station, and an account of the link alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from ground.timing import command, link_work, report


def test_the_link_is_flown_and_accounted_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN 600 ticks with the link open WHEN they are flown THEN every order of the station was taken, what flight
    said was heard, the link's work is a part of the tick's, and the report says its share of the tick."""
    monkeypatch.setattr(link_work, "_LOOKS", 1)
    monkeypatch.setattr(link_work, "_LOOK_TICKS", 5)
    flown: list[int] = []
    found = link_work.fly(600, tmp_path, flown.append)
    assert flown
    assert found["orders_taken"] == found["orders_sent"] > 100
    assert found["refused"] == 0
    assert found["heard"] > 1000
    assert len(found["held"]) == 11
    for clock in ("", "_cpu"):
        link, whole = found[f"link{clock}"], found[f"whole{clock}"]
        assert link["runs"] == whole["runs"] >= 540
        assert 0.0 < link["mean_us"] < whole["mean_us"]
    text = report.render({"machine": {**command._machine(False), "load": 0.5}, "link": found})
    assert f"| the link's share of the tick, processor | {found['link_cpu']['mean_us'] / 1e5:.2%} | " in text
    assert "| blocks | +0 | " in text
