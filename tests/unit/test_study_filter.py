"""`ground study consistency`, `recovery`, `manoeuvres`: flown quickly, their figures, and what they refuse."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ground.__main__ import main
from ground.exit_status import STOPPED
from ground.studies import announced, consistency, false_fixes, manoeuvres, recovery
from ground.studies.filter_studies import fly


def quick(name: str, folder: Path, *words: str) -> dict[str, Any]:
    """The document of a quick run in this process."""
    file = folder / "out.json"
    pictures = folder / "pictures"
    assert main(["study", name, "--quick", "--jobs", "1", "--json", str(file), "--figures", str(pictures), *words]) == 0
    found = json.loads(file.read_text(encoding="utf-8"))
    for path in pictures.glob("*.png"):
        assert path.read_bytes()[:4] == b"\x89PNG"
    assert list(pictures.glob("*.png"))
    return dict(found)


def test_a_quick_study_of_consistency(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a few short runs WHEN studied THEN ensemble and orbit have figures, and a filter told too little fails."""
    found = quick("consistency", tmp_path, "--set", "flight.table_set=flight")
    (drawn,) = found["drawn"]
    assert [series["name"] for series in drawn["series"]] == [
        "NEES with fixes",
        "NEES without",
        "NIS position",
        "NIS velocity",
    ]
    for series in drawn["series"]:
        assert all(0.2 < value < 3.0 for value in series["mean"])
        assert series["low"] < 1.0 < series["high"]
    (along,) = found["along"]
    assert along["beyond"] == 0.0
    assert along["rms_3d_m"] < 3.0
    printed = capsys.readouterr().out
    assert "truth drawn from the filter's own model, 4 runs" in printed
    assert "inside at" in printed


def test_a_filter_that_is_told_too_little_is_found_out() -> None:
    """GIVEN a truth pushed far harder than the filter is told WHEN flown THEN the NEES is far outside its band."""
    plan = consistency.QUICK
    numbers = tuple(range(6))
    right = fly(consistency.Task("flight", plan, numbers))
    hard = (("empirical_sigma_mps2", 2e-4), ("empirical_tau_s", 100.0))
    honest = fly(consistency.Task("flight", plan, numbers, None, hard))
    assert 0.5 < right.nees.mean() / 6.0 < 1.6
    assert 0.5 < honest.nees.mean() / 6.0 < 1.6
    with pytest.MonkeyPatch.context() as patch:
        draw = consistency.draw

        def pushed(sky: Any, memory: Any, *others: Any) -> Any:
            return draw(sky, sky.memory("flight", dict(hard)), *others)

        patch.setattr(consistency, "draw", pushed)
        wrong = fly(consistency.Task("flight", plan, numbers))
    assert wrong.nees.mean() / 6.0 > 3.0


def test_a_quick_study_of_recovery(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN short outages, a jump and a ramp WHEN studied THEN fixes come back, the jump is refused, the ramp named."""
    found = quick("recovery", tmp_path)
    assert {one["kind"] for one in found["returns"]["summary"]} == {"as it is", "drawn"}
    assert all(one["taken"] == one["runs"] > 0 for one in found["returns"]["summary"])
    (frames,) = found["false_fixes"]["frames"]
    assert frames["used"] == 0
    assert frames["largest_error_m"] < 10.0
    (ramp,) = found["false_fixes"]["ramps"]
    assert ramp["found_in_time"] == ramp["runs"]
    assert 0.0 < ramp["absorbed_m"]["largest"] < 5.0
    assert "fixes return after an outage" in capsys.readouterr().out


def test_a_quick_study_of_manoeuvres(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN burns in six directions WHEN studied THEN they are found, announced ones are borne, the arm is gone."""
    found = quick("manoeuvres", tmp_path)
    small, large = found["unannounced"]["burns"]
    assert (small["speed_mps"], large["speed_mps"]) == (0.1, 2.0)
    assert small["named"] == large["named"] == 6
    assert large["alert_s"]["largest"] < small["alert_s"]["median"]
    by_case = {one["case"]: one for one in found["announced"]["announced"]}
    assert set(by_case) == {announced.WITH_FIXES, announced.IN_OUTAGE, announced.LATE, announced.TOO_LATE}
    assert by_case[announced.TOO_LATE]["refused"] == 6
    assert by_case[announced.IN_OUTAGE]["largest_m"] > 10.0
    assert by_case[announced.IN_OUTAGE]["worst"] < 1.3
    (lever,) = found["announced"]["levers"]
    assert lever["left_m"] < 0.05
    assert lever["unknown_m"][0] == pytest.approx(1.0, abs=0.1)
    assert "lever arm of 1 m" in capsys.readouterr().out


def test_an_interrupt_leaves_the_figures_of_what_was_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN Ctrl-C after the first part WHEN it stops THEN that part's figures are printed and written; status 130."""
    flown: list[Any] = []
    true_fly = recovery.fly

    def fly_once(task: Any) -> Any:
        if flown:
            raise KeyboardInterrupt
        flown.append(task)
        return true_fly(task)

    monkeypatch.setattr(recovery, "fly", fly_once)
    monkeypatch.setattr(false_fixes, "fly_ramps", fly_once)
    file = tmp_path / "out.json"
    assert main(["study", "recovery", "--quick", "--jobs", "1", "--runs", "1", "--json", str(file)]) == 130
    document = json.loads(file.read_text(encoding="utf-8"))
    assert (document["parts"], document["of"]) == (1, 3)
    captured = capsys.readouterr()
    assert "stopped: 1 of 3 parts flown" in captured.err
    assert "fixes return after an outage" in captured.out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["consistency", "--sigma", "5"], "the study consistency has its own fixes; leave --sigma out"),
        (["recovery", "--set", "gnss.rate_hz=2"], "takes flight.table_set and flight.table.FIELD only"),
        (["recovery", "--set", "flight.table.k_axes=2"], 'did you mean "k_axis"?'),
        (["manoeuvres", "--set", "flight.table_set=fligth"], 'did you mean "flight"?'),
        (["manoeuvres", "--orbits", "moon"], "--orbits moon: none of sentinel3a"),
        (["consistency", "--runs", "0"], "--runs 0: give 1 or more"),
        (["paper", "--quick"], "--quick: the study paper has none; it is for consistency, recovery, manoeuvres"),
        (["graceb", "--orbits", "gracefo"], "--orbits: the study graceb has none"),
    ],
)
def test_mistakes_are_told_in_one_line(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a mistake WHEN the command runs THEN one line says what and what to do; status 2."""
    assert main(["study", *words]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1


def test_orbits_without_data_are_left_out_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN no real orbits WHEN the usual ones are asked for THEN those are named and left out; by name: refused."""
    monkeypatch.setenv("LEONAV_DATA", str(tmp_path))

    def stop(*_: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(recovery, "fly", stop)
    assert main(["study", "recovery", "--jobs", "1"]) == STOPPED
    printed = capsys.readouterr().out
    assert "left out: gracefo" in printed
    assert "left out: sentinel3a" in printed
    assert main(["study", "recovery", "--orbits", "gracefo"]) == 2
    assert "set LEONAV_DATA to the folder of real orbits" in capsys.readouterr().err


# -- figures


FOUND = manoeuvres.Found("gracefo", 10.0, 0.1, "+T", 6000, 40.0, 90.0, math.inf, 9.0, 1.9, 0.7, 3, 300.0, 200.0, False)


def test_what_a_test_of_the_fixes_can_know() -> None:
    """GIVEN fixes of 10 m, 0.1 m/s and a change of 0.1 m/s WHEN 60 s passed THEN 30 nats and 0.36 are known."""
    (nats,) = manoeuvres.information_nats(0.1, 10.0, 0.1, np.array([60.0]))
    assert nats == pytest.approx(0.5 * 60.0 + 0.5 * 1e-4 * 60.0**3 / 3.0)
    at = manoeuvres.limit_s(0.1, 10.0, 0.1, 40.0)
    assert 3.0 + at + 1e-4 * at**3 / 3.0 == pytest.approx(40.0, rel=1e-3)


def test_excesses_close_together_are_one() -> None:
    over = np.zeros(2000, bool)
    assert manoeuvres.rises(over) == 0
    over[[10, 11, 200, 1000, 1299]] = True
    assert manoeuvres.rises(over) == 2


def test_figures_of_burns_and_their_misses() -> None:
    """GIVEN three burns, one never found, one called a fault WHEN summed up THEN each is counted and said."""
    late = replace(FOUND, alert_s=math.inf, named_s=math.inf, steady_s=700.0)
    wrong = replace(FOUND, wrong_s=50.0)
    (row,) = manoeuvres.summarise([FOUND, late, wrong])
    assert (row["runs"], row["alert_in_time"], row["named"], row["wrong"], row["never"]) == (3, 2, 2, 1, 1)
    assert row["alert_s"] == {"median": 40.0, "q95": None, "largest": None}
    said = manoeuvres.shortfalls([row])
    assert said[0].startswith("0.1 m/s, fixes of 10 m: alert within 120 s in 2 of 3")
    assert said[1:] == [
        "0.1 m/s, fixes of 10 m: steady within 600 s in 2 of 3",
        "0.1 m/s, fixes of 10 m: called a fault of the receiver in 1 of 3",
    ]
    assert manoeuvres.shortfalls(manoeuvres.summarise([FOUND])) == []
    assert "-" in manoeuvres.table([row], [])


def test_figures_of_returns_and_their_misses() -> None:
    good = recovery.Return("gracefo", 600, "drawn", 6000, 2.0, 0.4, 0.0, 0.0, 100.0, 1.0, 2.0, 0, False, False)
    assert recovery.shortfalls(recovery.summarise([good])) == []
    bad = [replace(good, near_s=61.0), replace(good, steady_s=math.inf), replace(good, restarted=True), good]
    (one,) = recovery.summarise(bad)
    assert (one.runs, one.good, one.near, one.steady, one.taken) == (4, 1, 3, 2, 4)
    assert recovery.shortfalls([one]) == ["after 600 s, error drawn: 3 of 4 not back as wanted"]
    assert json.loads(json.dumps(recovery.as_document(bad)))["runs"][1]["steady_s"] is None


def test_figures_of_ramps_and_their_misses() -> None:
    ramp = false_fixes.Ramp("gracefo", "position_ramp", 0.1, 6000, 80.0, 120.0, math.inf, 2.0, 0.5, 3.0, 0.9, 0)
    assert false_fixes.shortfalls(false_fixes.summarise_ramps([ramp]), []) == []
    missed = [ramp, replace(ramp, found_s=math.inf, misnamed_s=200.0, absorbed_m=20.0)]
    (row,) = false_fixes.summarise_ramps(missed)
    assert (row["found_in_time"], row["misnamed_first"], row["neither"], row["little_absorbed"]) == (1, 1, 0, 1)
    assert false_fixes.shortfalls([row], [{"fault": "jump", "used": 2}]) == [
        "jump: 2 wrong fixes used",
        "ramp of 0.1 m/s: named within 300 s in 1 of 2",
        "ramp of 0.1 m/s: <= 5 m absorbed in 1 of 2",
    ]


def test_consistency_is_judged_by_the_mean_of_flights() -> None:
    """GIVEN one flight above 1.1 and one below WHEN their mean is inside THEN nothing is missed; past the bound is."""
    flight = consistency.Along(
        "flight_coloured", "gracefo", 0, 2.0, 1.4, 1.3, 1.3, 1.0, 1.0, 0.0, 80, {"60": 1.4}, {"60": 1.0}, {"60": 2.0},
        0.9, 0.0, 0.001, 0,
    )  # fmt: skip
    other = replace(flight, seed=1, nees_fixes=0.7, nees_outage={"60": 0.6})
    assert consistency.shortfalls([], [flight, other]) == []
    said = consistency.shortfalls([], [flight, replace(other, beyond=0.01)])
    assert said == ["flight_coloured, gracefo: past the bound for 0.55 % of the time"]
    assert any("NEES/n 1.40 with fixes" in text for text in consistency.shortfalls([], [flight]))
