"""`ground study` and `ground ledger`: what they print, write and refuse."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ground.__main__ import main
from ground.studies.ledger import ROWS


def test_a_study_prints_and_writes_its_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN one run of the paper's outage with Table 1's row WHEN studied THEN figures are printed and written."""
    file = tmp_path / "study.json"
    settings = ["--set", "flight.table_set=paper_table1", "--set", "orbit.argument_of_latitude_deg=90"]
    assert main(["study", "paper", "--runs", "1", "--jobs", "1", "--sigma", "1", *settings, "--json", str(file)]) == 0
    printed = capsys.readouterr().out
    assert "bound broken in 1 of 1 outages" in printed
    assert "error passes the limit [s]" in printed
    assert "fault of the table in 1" in printed
    document = json.loads(file.read_text(encoding="utf-8"))
    assert document["scenario"] == "paper_outage"
    (run,) = document["runs"]
    assert (run["seed"], run["phase_deg"], run["flag_age_s"], run["flag_in_time"]) == (1, 90.0, None, False)
    assert document["summary"]["crossed_age_s"]["median"] == run["crossed_age_s"]
    assert document["summary"]["flag_age_s"]["never"] == 1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["study", "paper", "--runs", "0"], "--runs 0: give 1 or more"),
        (["study", "paper", "--jobs", "0"], "--jobs 0: give 1 or more"),
        (["study", "paper", "--json", "no/such/folder/x.json"], "no such folder"),
        (["study", "graceb", "--runs", "3"], "--runs 3: the flights of study graceb are given; leave --runs out"),
        (["study", "graceb", "--sigma", "5"], "--sigma 5.0: the flights of study graceb are given"),
        (["study", "graceb", "--jobs", "1", "--set", "orbit.file=none.sp3"], "orbit.file: no file"),
        (["study", "paper", "--runs", "1", "--jobs", "1", "--set", "gnss.rate=1"], "unknown key"),
        (["study", "paper", "--runs", "1", "--jobs", "1", "--set", "outage=[]"], "exactly one [[outage]]"),
        (["ledger", "--out", "no/such/folder/x.md"], "no such folder"),
        (["ledger", "--jobs", "-1"], "--jobs -1: give 1 or more"),
    ],
)
def test_mistakes_are_told_in_one_line(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a mistake WHEN the command runs THEN it says what and what to do, and exits with 2."""
    assert main(words) == 2
    assert told in capsys.readouterr().err


def test_a_ledger_that_is_not_so_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN measurements that do not bear a verdict WHEN the ledger is asked for THEN it is not written; status 1."""
    from ground.studies import ledger, measurement

    wrong = ROWS[0]._replace(holds=lambda _: False, ours=lambda _: "something else")
    monkeypatch.setattr(ledger, "ROWS", (wrong,))
    monkeypatch.setattr(measurement, "measure", lambda *_: None)
    assert main(["ledger", "--out", str(tmp_path / "ledger.md")]) == 1
    assert f"REPRODUCED does not hold: {wrong.claim}: something else" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []
