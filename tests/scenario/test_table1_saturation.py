"""Table 1 as printed: its autonomous row settles below the limit, so the flag can never come; the run says so."""

import json
from pathlib import Path

from hil_sim.__main__ import main


def test_saturation_is_reported_as_a_fault_of_the_table(tmp_path: Path, capsys) -> None:
    """GIVEN paper_outage with Table 1's autonomous row WHEN GNSS is lost for 2000 s THEN the bound settles near 494 m
    (the ledger's figure) while the error passes 2000 m; no flag is raised, and summary and verdict name the table.
    """
    out = tmp_path / "run"
    status = main(
        [
            *("run", "paper_outage", "--out", str(out), "--set", 'flight.table_set="paper_table1"'),
            *("--set", "flight.allow_saturating=true"),
            # a tick a second is enough here and ten times as fast
            *("--set", "flight.table.tick_period_ns=1000000000", "--set", "flight.table.latency_max_s=3.0"),
            *("--set", "time.duration_s=7700"),
        ]
    )
    said = capsys.readouterr().out
    assert status == 0
    summary = json.loads((out / "summary.json").read_text())
    (outage,) = summary["outages"]
    assert outage["flag_raised_age_s"] is None
    assert outage["error_crossed_eps_age_s"] is not None
    assert outage["violations"] > 0
    assert 450.0 < outage["bound_at_900_s_m"] < 550.0
    assert "can never be raised" in outage["fault_of_table"]
    assert summary["fault_of_table"] == outage["fault_of_table"]
    assert "FAULT OF THE TABLE" in said.upper()
    assert "SATURATES, flown by express permission only" in " ".join(said.split())
    assert json.loads((out / "run.json").read_text())["allow_saturating"] is True
    assert (out / "figures").is_dir()


def test_without_permission_the_run_is_refused_with_the_reason(tmp_path: Path, capsys) -> None:
    """GIVEN the same WHEN nothing permits it THEN flight refuses the table, naming row, orbit, bound and limit."""
    words = ["run", "paper_outage", "--out", str(tmp_path / "run"), "--set", 'flight.table_set="paper_table1"']
    assert main(words) != 0
    said = capsys.readouterr().err
    assert "navigation.tbl: refused: tuning row 0: the bound settles at 495 m" in said
    assert "--allow-saturating" in said
