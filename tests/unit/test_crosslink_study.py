"""The studies of the inter-satellite monitor: what they count, print, write and refuse; the paper's printed tables."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import numpy as np
import pytest

from flightsw.crosslink.thresholds import chi2_tail
from ground.__main__ import main
from ground.campaign.statistics import trials_needed, upper_limit
from ground.crosslink import ledger, paper, real_day, roc, tail, uploads
from ground.crosslink.judge import judge, judge_each, mask_of
from ground.crosslink.scene import Setting, mean_neighbours, ready

pytestmark = pytest.mark.compiled  # matrices of 96 by 96: plain Python would take minutes an epoch

ROOT = Path(__file__).resolve().parents[2]
RAMPS = {8: (5040.0, 0.01), 9: (1148.0, 0.05)}


def printed(number: int) -> paper.PrintedTable:
    return next(table for table in paper.printed() if table.number == number)


@pytest.mark.parametrize("number", [5, 6, 7])
def test_the_scalar_model_gives_the_printed_seconds(number: int) -> None:
    """GIVEN a printed jump WHEN compared with |noise| + jump THEN both are found in second 50; no dR is less."""
    found = paper.compare(printed(number), Setting(), np.random.default_rng(number), 20)
    assert found.first_printed_s == 50.0
    assert found.first_model_s[0] == 50.0
    assert found.excess_least_m >= 0.0
    assert found.healthy_rms_m == pytest.approx(found.model_rms_m, rel=0.2)


@pytest.mark.parametrize("number", [5, 6, 7])
def test_columns_that_are_copies(number: int) -> None:
    """GIVEN a printed jump THEN two pairs of its columns are equal after it, and were not before."""
    found = paper.compare(printed(number), Setting(), np.random.default_rng(1), 2)
    assert found.equal_columns == ((9, 10), (17, 18))
    before = np.array(printed(number).rows)[1]
    assert before[3] != before[4]


@pytest.mark.parametrize("number", RAMPS)
def test_first_majorities_of_the_printed_ramps(number: int) -> None:
    """GIVEN a printed ramp THEN its own rows have a majority long before the paper's time, and the model's before."""
    first_s, rate = RAMPS[number]
    found = paper.compare(printed(number), Setting(), np.random.default_rng(1), 40)
    assert found.first_printed_s == first_s
    assert found.first_model_s[2] < first_s
    assert first_s * rate < 59.7


def test_our_own_table_has_the_printed_shape() -> None:
    table = printed(5)
    ours = paper.reproduced(Setting(), table, np.random.default_rng(5))
    assert ours.shape == (len(table.rows), 1 + len(table.neighbours))
    assert (ours[ours[:, 0] >= 50.0, 1:] >= 70.0).all()


def test_large_jumps_are_seen_by_the_papers_rule() -> None:
    """GIVEN true geometry WHEN satellites jump by 700 m THEN the paper's rule sees it in every direction; 70 m it does
    not, but for the clock, while the network monitor names the satellite."""
    setting = Setting(both=True)
    sigma = np.tile(setting.errors.sigma_m, 24)
    rng = np.random.default_rng(7)
    memory, pairs = ready(setting, 0.0, own=2)
    errors = rng.standard_normal((200, 96)) * sigma
    noise = 11.8 * rng.standard_normal((200, len(pairs)))
    for direction in range(4):
        for jump, seen in ((700.0, True), (70.0, direction == 3)):
            faulty = errors.copy()
            faulty[:, 8 + direction] += jump
            judged = judge(memory, faulty, noise)
            share = ((judged["beyond"] >> 2) & 1).mean()
            assert share > 0.85 if seen else share < 0.15
            assert (judged["named"] == mask_of((2,))).mean() > 0.98
    assert (judge(memory, errors, noise)["named"] == 0).all()


@pytest.mark.parametrize("both", [True, False])
def test_uploads_in_bulk_are_judged_as_one_by_one(both: bool) -> None:
    """GIVEN healthy and faulty uploads, and thresholds that some healthy ones exceed WHEN judged by the thousand THEN
    every finding is that of the flight kernels, and every statistic theirs but for rounding."""
    memory, pairs = ready(Setting(both=both, p_false_alarm=0.05), 1234.0, own=5)
    rng = np.random.default_rng(11)
    errors = rng.standard_normal((900, 96)) * np.tile(Setting().errors.sigma_m, 24)
    errors[300:600, 4 * rng.integers(24) + rng.integers(4)] += 45.0
    errors[600:, 4 * 5 + 3] += 90.0
    noise = 11.8 * rng.standard_normal((900, len(pairs)))
    bulk, each = judge(memory, errors, noise), judge_each(memory, errors, noise)
    for name in ("beyond", "worst", "named", "own", "code"):
        mine = bulk[name] if name != "code" else np.where(bulk["code"] == 0, each["code"], bulk["code"])
        assert np.array_equal(mine, each[name]), name
    for name in ("statistic", "own_statistic", "largest_m"):
        np.testing.assert_allclose(bulk[name], each[name], rtol=1e-9, atol=1e-9)
    assert 0.3 < (bulk["code"] == 0).mean() < 0.9  # of both kinds
    assert (each["named"][:300] != 0).any()
    assert (each["beyond"] >> 5 & 1).any()


def test_ten_million_runs_do_not_show_2e_7() -> None:
    """GIVEN no miss in 1e7 runs THEN the exact 95 % limit, 1 - 0.05^(1/n), is 3.0e-7; 2e-7 takes 1.5e7 runs."""
    assert upper_limit(0, 10_000_000) == pytest.approx(1.0 - 0.05 ** (1.0 / 1e7), rel=1e-6)
    assert upper_limit(0, 10_000_000) > 2e-7
    assert trials_needed(0, 2e-7) == pytest.approx(1.5e7, rel=0.01)


def test_a_run_counts_what_it_drew() -> None:
    """GIVEN a small run WHEN flown twice THEN the same counts; as many as asked; statistics as chi-square says."""
    flight = uploads.Uploads(healthy=4000, faulty=20)
    first, again = uploads.one(flight, 3), uploads.one(flight, 3)
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["own_histogram"], uploads.one(flight, 4)["own_histogram"])
    assert first["healthy"] == first["own_histogram"].sum() == first["network_histogram"].sum() == 4000
    assert (first["faulty"] == 20).all()
    assert (first["exact"] <= first["named"]).all()
    assert first["dof"] == 4
    beyond = first["own_histogram"][20:].sum() / 4000.0  # statistics of 10 and more
    assert beyond == pytest.approx(chi2_tail(10.0, 4), abs=0.012)


def test_the_family_rate_is_below_its_bound() -> None:
    """GIVEN a monitor with a false-alarm rate that can be counted WHEN estimated by importance sampling THEN it is what
    counting finds, and below the sum of the tails."""
    memory, pairs = ready(Setting(p_false_alarm=0.09), 0.0)
    rng = np.random.default_rng(4)
    found = tail.family_rate(memory, rng, 3000)
    errors = rng.standard_normal((8000, 96)) * np.tile(Setting().errors.sigma_m, 24)
    counted = (judge(memory, errors, 11.8 * rng.standard_normal((8000, len(pairs))))["named"] != 0).mean()
    assert found.rate < found.bound
    assert counted == pytest.approx(found.rate, abs=4.0 * (found.error + np.sqrt(found.rate / 8000.0)))


def test_detection_rises_with_the_false_alarms() -> None:
    """GIVEN curves THEN detection falls with the rate asked for, rises with the jump; the own rate has no end."""
    found = roc.curves(Setting(), 1, 1)
    network = np.array(found["network"])
    assert (np.diff(network, axis=2) <= 0.0).all()
    assert (np.diff(network[:, :, 5], axis=0) >= -0.02).all()
    assert found["majority"][0][0][-1] is None
    assert found["majority"][0][0][0] is not None


def test_neighbours_on_average() -> None:
    assert mean_neighbours(Setting(), 90) == pytest.approx(9.3, abs=0.1)


def test_parts_are_written_and_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN quick parts WHEN studied THEN they are printed and in study.json; another part is added to it."""
    out = tmp_path / "x"
    assert main(["crosslink", "study", "--quick", "--no-figures", "--out", str(out), "--parts", "paper"]) == 0
    assert "threshold 59.70 m" in capsys.readouterr().out
    assert main(["crosslink", "study", "--quick", "--no-figures", "--out", str(out), "--parts", "special"]) == 0
    assert "rank 89 of 96" in capsys.readouterr().out
    document = json.loads((out / "study.json").read_text(encoding="utf-8"))
    assert document["paper"]["neighbours_of_1"] == [2, 8, 9, 10, 11, 16, 17, 18, 19]
    assert document["special"]["rank"]["two ways"] == {"links": 114, "rank": 66, "parameters": 72, "undetectable": 6}
    assert max(document["special"]["common"].values()) < 0.1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["study", "--runs", "0"], "--runs 0: give 1 or more"),
        (["study", "--jobs", "0"], "--jobs 0: give 1 or more"),
        (["study", "--seed", "-1"], "--seed -1"),
        (["ledger", "--study", "no/such.json"], "has no paper and uploads; run ground crosslink study --parts"),
    ],
)
def test_mistakes_are_told_in_one_line(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["crosslink", *words]) == 2
    assert told in capsys.readouterr().err


def test_absent_data_are_named(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="LEONAV_DATA"):
        real_day.load_day(tmp_path)


@pytest.mark.parametrize("claim", ledger.CLAIMS, ids=lambda claim: claim.claim)
def test_every_claim_names_a_test_that_exists(claim: ledger.Claim) -> None:
    """GIVEN a claim WHEN its test is looked up THEN the file has a function of that name."""
    path, _, name = claim.test.partition("::")
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    assert name in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_the_ledger_has_exactly_the_claims_of_the_code() -> None:
    """GIVEN docs/crosslink_ledger.md WHEN its table is read THEN claims, figures, verdicts and tests are the code's."""
    text = (ROOT / "docs" / "crosslink_ledger.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if "](../" in line]
    assert [(r[0], r[1], r[2], r[4].strip("*")) for r in rows] == [
        (one.claim, one.where, one.paper, one.verdict) for one in ledger.CLAIMS
    ]
    found = [re.fullmatch(r"\[`(\w+)`\]\(\.\./(.+)\)", r[5]) for r in rows]
    assert [f"{one[2]}::{one[1]}" for one in found if one] == [one.test for one in ledger.CLAIMS]
    assert all("nan" not in r[3] for r in rows)
