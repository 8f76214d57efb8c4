"""The verdict of a run: the word must follow from the outages, and the screen must fit."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.reports.verdict import judge, render_verdict

OUTAGE: dict[str, Any] = {
    "start_s": 5580.0,
    "end_s": 7580.0,
    "eps_m": 2000.0,
    "error_crossed_eps_age_s": 816.2,
    "flag_raised_age_s": 513.0,
    "violations": 0,
    "epochs": 513,
    "bound_at_flag_m": 2003.2,
    "error_at_900_s_m": 2430.1,
    "error_at_2000_s_m": 11998.0,
    "bound_at_900_s_m": 6100.0,
    "back_in_service_s": 31.0,
}


def summary(*outages: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {
        "scenario": "paper_outage",
        "seed": 1,
        "simulated_s": 11160.0,
        "wall_s": 24.31,
        "realtime_factor": 459.1,
        "ticks": 111600,
        "slips": 0,
        "integrated": {
            "fix_rms_m": 1.72,
            "position_rms_m": 0.32,
            "position_max_m": 1.2,
            "velocity_rms_mps": 0.05,
        },
        "outages": list(outages),
        "bus": {"sent": 27480, "accepted": 27470, "rejected": 10},
        "mavlink": {"messages": 145000, "alerts": 6},
        "tables": {"set": "paper_1m", "crc32": 0x1234ABCD, "certificate": 0},
        "rejected_by_cause": {"BAD_CRC": 9, "GATE": 1, "SIGMA": 0},
    } | more


def test_the_screen_tells_what_flight_said_most_first() -> None:
    screen = render_verdict(summary(OUTAGE, said={"NOT_READY": 0.0004, "TRUSTED": 0.875, "DO_NOT_USE": 0.1246}))
    (line,) = [one for one in screen.replace("\u00a0", " ").splitlines() if "flight said" in one]
    assert line.split("flight said")[1].strip() == "TRUSTED 87.5 %, DO NOT USE 12.5 %, NOT READY 0.04 %"


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({}, "HELD"),
        ({"error_crossed_eps_age_s": None}, "HELD"),
        ({"error_crossed_eps_age_s": None, "flag_raised_age_s": None}, "HELD"),
        ({"flag_raised_age_s": 816.2}, "HELD"),
        ({"violations": 1}, "VIOLATED"),
        ({"violations": 1, "flag_raised_age_s": None, "error_crossed_eps_age_s": None}, "VIOLATED"),
        ({"flag_raised_age_s": 816.3}, "NOT FLAGGED IN TIME"),
        ({"flag_raised_age_s": None, "violations": 900}, "NOT FLAGGED IN TIME"),
        ({"epochs": 0}, "NO OUTAGE"),
    ],
)
def test_the_word_follows_from_the_outage(changes: dict[str, Any], word: str) -> None:
    assert judge(summary(OUTAGE | changes))[0] == word
    assert f"VERDICT: {word}  " in render_verdict(summary(OUTAGE | changes))


def test_a_run_that_lost_nothing_has_shown_nothing() -> None:
    assert judge(summary())[0] == "NO OUTAGE"


def test_a_run_too_short_to_settle_says_so() -> None:
    """GIVEN a run of four minutes THEN no error is quoted, and no "n/a" stands in a sentence."""
    short = {"fix_rms_m": 14.8, "position_rms_m": None, "position_max_m": None, "velocity_rms_mps": None}
    screen = render_verdict(summary(simulated_s=240.0, integrated=short)).replace("\u00a0", " ")
    assert "too short to say how good the position was with GNSS (fixes: 14.8 m)" in " ".join(screen.split())
    assert "not judged: it had not settled" in screen
    assert "n/a" not in screen


def test_one_bad_outage_among_good_ones_decides() -> None:
    word, reason = judge(summary(OUTAGE, OUTAGE | {"violations": 3}, OUTAGE))

    assert word == "VIOLATED"
    assert "1 of 3 outages" in reason
    assert "outage 2" in reason


def test_the_screen_names_the_figures() -> None:
    """GIVEN a run that held THEN margin 816.2 - 513 = 303 s, ratio 0.63, 1.72 / 0.32 = 5.4 are on the screen."""
    screen = render_verdict(summary(OUTAGE))

    for piece in (
        "paper_outage, seed 1",
        "+303 s (flag at 0.63 of the crossing)",
        "5.4 times better than",
        "0 of 513 epochs",
        "27,480 frames sent",
        "BAD_CRC 9, GATE 1",
        "145,000 messages, 6 alerts",
        "459 times real time",
        "CRC 0x1234abcd",
        "Back in service 31.0 s after GNSS returned",
    ):
        assert piece in screen


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"set": "x", "certificate": 0}, "UNCERTIFIED"),
        ({"set": "x", "certificate": "uncertified"}, "UNCERTIFIED"),
        ({"set": "x"}, "UNCERTIFIED"),
        ({}, "UNCERTIFIED"),
        ({"set": "x", "certificate": 77}, "UNCERTIFIED"),
        ({"set": "x", "certificate": 1}, "quick certificate"),
        ({"set": "x", "certificate": "full"}, "full certificate"),
    ],
)
def test_only_a_known_certificate_is_one(tables: dict[str, Any], said: str) -> None:
    screen = render_verdict(summary(OUTAGE, tables=tables))

    assert said in screen
    assert ("UNCERTIFIED" in screen) == (said == "UNCERTIFIED")


@pytest.mark.parametrize(
    "fault", ["bound saturates at 494 m", ["bound", "saturates at 494 m"], {"saturates": "at 494 m"}]
)
def test_a_fault_of_the_table_is_said(fault: Any) -> None:
    screen = render_verdict(summary(OUTAGE | {"flag_raised_age_s": None}, fault_of_table=fault))

    assert "FAULT OF THE TABLE" in screen
    assert "494 m" in screen
    assert "FAULT OF THE TABLE" not in render_verdict(summary(OUTAGE))


def test_a_run_that_ends_inside_the_outage_does_not_blame_flight() -> None:
    cut = OUTAGE | {"back_in_service_s": None}

    assert "ended before GNSS returned" in render_verdict(summary(cut, simulated_s=7000.0))
    assert "did NOT come back" in render_verdict(summary(cut))


VALUES = st.sampled_from([None, True, 0, 1, -1, 3.5, 816.2, 1e300, float("nan"), float("-inf"), "x" * 40, 10**15])


@given(
    outages=st.lists(st.fixed_dictionaries(dict.fromkeys(OUTAGE, VALUES)), max_size=6),
    more=st.fixed_dictionaries(dict.fromkeys(("seed", "simulated_s", "wall_s", "ticks", "slips"), VALUES)),
)
def test_any_summary_fits_one_screen(outages: list[dict[str, Any]], more: dict[str, Any]) -> None:
    lines = render_verdict(summary(*outages, **more)).split("\n")

    assert max(len(line) for line in lines) <= 100
    assert len(lines) <= 40


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_an_ordinary_screen_has_about_thirty_lines(count: int) -> None:
    assert len(render_verdict(summary(*[OUTAGE] * count)).split("\n")) <= 32
