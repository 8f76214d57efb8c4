"""The paper's scenario: what the study reports, the claims of the ledger, a track from a file."""

from __future__ import annotations

import csv
import importlib.util
import json
import os
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightsw.derivative.setup import BankSettings, TunedSettings
from ground.__main__ import main
from ground.derivative import figures, ledger, paper, peers, report, scenario, study, track_file, tracks
from ground.derivative.tuning import CAUSAL_LIMITS, LAG_S, SMOOTHED_LIMITS, tune
from ground.errors import OperatorError
from ground.peers.interpreter import PeerAbsent

pytestmark = pytest.mark.compiled


@lru_cache(maxsize=1)
def one_run() -> dict[str, np.ndarray]:
    return study.fly_run(study.Estimators(1), 0)


def positions(run: int = 0) -> np.ndarray:
    true = scenario.truth()
    return true.y_m + scenario.errors(scenario.tuning_stream(1, run), len(true.t_s))


def test_the_course_jumps_twice() -> None:
    """GIVEN the scenario THEN velocity jumps by +3.02 and +5.86 m/s, and position is its integral."""
    true = scenario.truth()
    jumps = [float(true.v_mps[k] - true.v_mps[k - 1]) for k in (5000, 10400)]
    assert jumps == pytest.approx([3.02, 5.86], abs=0.05)
    inside = np.abs(np.diff(true.v_mps)) < 1.0
    slope = np.diff(true.y_m) / scenario.STEP_S
    middle = 0.5 * (true.v_mps[1:] + true.v_mps[:-1])
    assert np.abs(slope - middle)[inside].max() < 1e-4
    assert (
        np.abs(np.diff(true.v_mps) / scenario.STEP_S - 0.5 * (true.a_mps2[1:] + true.a_mps2[:-1]))[inside].max() < 1e-4
    )


def test_the_limits_are_met_on_unseen_seeds() -> None:
    """GIVEN a run of the reporting branch THEN causal and smoothed estimates meet every limit together, with one
    tuning, and the estimate that looks ahead is better than the local polynomial of best width."""
    found = one_run()
    assert all(found["causal"][:4] <= CAUSAL_LIMITS)
    assert all(found["smoothed"][:4] <= SMOOTHED_LIMITS)
    assert all(found["smoothed"][:4] < found["savitzky_golay"][:4])
    assert all(found["within"] > 0.93)


def test_reported_runs_cannot_be_tuning_runs() -> None:
    """GIVEN any seeds THEN roots and branches of tuning and of reported runs differ, and so do two settings' runs."""
    usual, other = BankSettings(), BankSettings(gap_s=31.0)
    for run in range(3):
        tuned, told = scenario.tuning_stream(1, run), scenario.reported_stream(usual, 1, run)
        assert told.entropy >= 1 << 256 > tuned.entropy  # type: ignore[operator]
        assert told.spawn_key[0] != tuned.spawn_key[0]
        assert scenario.reported_stream(other, 1, run).entropy != told.entropy


def test_the_printed_gain_is_stable_in_si_units_only() -> None:
    assert paper.radius(paper.PRINTED_GAIN) == pytest.approx(0.9965, abs=1e-4)
    assert paper.radius(paper.printed(normalised=True).gain) > 1.0


def test_the_printed_gain_misses_the_yawing_leg() -> None:
    """GIVEN the printed gain in SI units THEN yawing it misses the paper's 0.090 m/s fifteen times."""
    assert scenario.judge(tracks.tuned(paper.printed(), positions()).mean).v_yawing == pytest.approx(
        15.2 * 0.09, rel=0.02
    )
    assert paper.printed_late(1) < 0.05


def test_no_constant_gain_serves_both_legs() -> None:
    """GIVEN every other gain of the family near its best THEN one of the two claims is missed at least twofold."""
    true = scenario.truth()
    z = positions()
    for q in np.logspace(-13.0, -8.0, 11):
        settings = TunedSettings(5, scenario.STEP_S, q=((0.0, 0.0, 0.0, 0.0, float(q)),), tune_s=900.0)
        found = scenario.judge(tracks.tuned(settings, z).mean)
        assert max(found.v_straight / 0.019, found.v_yawing / 0.090) > 2.0
    assert len(true.t_s) == len(z)


def test_the_printed_criterion_of_one_epoch_is_degenerate() -> None:
    assert paper.literal_gain(1, 10) > 0.999


def test_physical_and_normalised_variables_give_the_same() -> None:
    q = paper.CANDIDATES[30:31]
    z = positions()[:6000]
    found = [tracks.tuned(TunedSettings(5, 0.2, q=q, normalised=n), z).mean[:, 1] for n in (False, True)]
    np.testing.assert_allclose(found[0][50:], found[1][50:], atol=1e-6)


def test_the_algorithm_as_described() -> None:
    """GIVEN Q tuned by J on the straight leg and held THEN the yawing leg is missed."""
    found = one_run()
    assert found["paper"][1] > 2.0 * 0.09
    assert 0.0 < found["paper_gain"][0] < 0.1


def test_a_local_polynomial_differentiates_polynomials() -> None:
    t = np.arange(60) * 0.2
    found = peers.savitzky_golay(1.0 + 2.0 * t - 3.0 * t**2, 0.2, 10)
    np.testing.assert_allclose(found[10:50, 1], (2.0 - 6.0 * t)[10:50], atol=1e-9)
    np.testing.assert_allclose(found[10:50, 2], -6.0, atol=1e-9)
    assert np.isnan(found[:10]).all()


def peer_python() -> Path:
    """An interpreter that has the peers: LEONAV_PEER_PYTHON names it."""
    named = os.environ.get("LEONAV_PEER_PYTHON")
    if not named:
        pytest.skip("LEONAV_PEER_PYTHON names no interpreter that has pynumdiff")
    return Path(named)


@pytest.mark.slow
def test_pynumdiff_stands_beside() -> None:
    """GIVEN an interpreter with pynumdiff WHEN asked THEN it follows both legs, and neither beats the lag."""
    flight = study.Estimators(1)
    found = peers.pynumdiff(peer_python(), 1, study.positions(flight, 0)[None])
    assert set(found.figures) == set(peers.METHODS)
    for name, rms in found.figures.items():
        assert 0.002 < rms[0, 0] < 0.05, name
        assert 0.002 < rms[0, 1] < 0.05, name
    assert max(one_run()["smoothed"][:2]) < min(rms[0, :2].max() for rms in found.figures.values())


def test_an_interpreter_without_the_library_is_named() -> None:
    """GIVEN this interpreter, or none WHEN pynumdiff is asked for THEN the operator is told which and how to get it."""
    if importlib.util.find_spec("pynumdiff") is None:
        with pytest.raises(PeerAbsent, match="pynumdiff cannot be imported"):
            peers.pynumdiff(Path(sys.executable), 1, np.zeros((1, 4)))
    with pytest.raises(OperatorError, match="cannot be run"):
        peers.pynumdiff(Path("no/such/python"), 1, np.zeros((1, 4)))


def test_tuning_finds_what_meets_the_limits() -> None:
    """GIVEN a start that misses WHEN a few trials are made on one run THEN the worst share does not grow."""
    told: list[int] = []
    _, first = tune(3, 1, 0, told.append)
    _, later = tune(3, 1, 6, told.append)
    assert max(later) <= max(first)
    assert len(told) == 6


def study_document() -> dict[str, Any]:
    found = one_run()
    names = ("causal", "smoothed", "paper", "printed", "savitzky_golay")
    named = {name: dict(zip(study.NAMES, found[name].tolist(), strict=True)) for name in names}
    return {
        "paper": study.paper_part(1, 1),
        "scenario": {
            "runs": 1,
            "estimators": {name: {"rms": one, "worst_run": one} for name, one in named.items()},
            "causal_met": True,
            "smoothed_met": True,
            "pynumdiff": None,
        },
    }


def test_the_ledger_holds_and_names_tests_that_exist(tmp_path: Path) -> None:
    """GIVEN a study WHEN the ledger is rendered THEN no verdict fails; with a contradicting one, one does."""
    document = study_document()
    text, failing = ledger.render(document)
    assert failing == []
    assert text.count("\n| ") == len(ledger.CLAIMS) + 1
    root = Path(__file__).resolve().parents[2]
    for claim in ledger.CLAIMS:
        path, _, name = claim.test.partition("::")
        assert f"def {name}(" in (root / path).read_text(encoding="utf-8")
    assert any("K1" in line for line in report.lines("paper", document["paper"]))
    figures.draw(document, study.example(study.Estimators(1)), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"scenario.png", "gains.png"}
    document["scenario"]["causal_met"] = False
    assert len(ledger.render(document)[1]) == 1


def test_a_study_is_resumed_where_it_was_stopped(tmp_path: Path) -> None:
    """GIVEN a campaign with one run WHEN two are asked for THEN only the second is flown, and both are counted."""
    told: list[int] = []
    flight = study.Estimators(1)
    study.store.open_folder(
        tmp_path,
        {
            "format": "leonav derivative campaign 1",
            "flight": repr(flight),
            "code_sha256": study.source_hash(),
            "study_sha256": study._code(),
        },
    )
    study.store.save_chunk(tmp_path, 0, 0, study.store.stacked([one_run()]))
    document, _ = study.scenario_part(tmp_path, flight, 1, told.append)
    assert told == [1]
    assert document["causal_met"]
    assert document["smoothed_met"]
    assert "pynumdiff_rts" not in document["estimators"]
    said = "\n".join(report.lines("scenario", document))
    assert said.count(": met") == 2
    assert "pynumdiff was not asked" in said


def write(path: Path, header: str, columns: np.ndarray) -> Path:
    path.write_text("# a comment\n" + header + "\n" + "\n".join(",".join(f"{v:.6f}" for v in row) for row in columns))
    return path


def test_a_track_of_any_vehicle_gives_velocity_with_honest_sigmas(tmp_path: Path) -> None:
    """GIVEN noisy positions of a turning vehicle, a gap, bad rows WHEN they are run THEN velocities are good to their
    own sigmas and the rows left out are counted."""
    rng = np.random.default_rng(9)
    t = np.arange(0.0, 300.0, 0.5)
    t = t[(t < 100.0) | (t > 180.0)]
    true = np.column_stack([500.0 * np.sin(t / 60.0), 500.0 * np.cos(t / 60.0)])
    z = true + 2.0 * rng.standard_normal(true.shape)
    path = write(tmp_path / "track.csv", "t_s,east_m,north_m", np.column_stack([t, z]))
    with path.open("a") as stream:
        stream.write("\nnan,1,2\n299.0,1,2\n300.0,x,2\n")
    out = tmp_path / "out"
    assert main(["derivative", "run", str(path), "--out", str(out)]) == 0
    with (out / "track.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == len(t)
    assert (out / "track.png").exists()
    late = (t > 40.0) & (t < 100.0) | (t > 220.0)
    for name, expected in (("east_m", true[:, 1] / 60.0), ("north_m", -true[:, 0] / 60.0)):
        velocity = np.array([float(row[f"smoothed_velocity_{name}_mps"]) for row in rows])
        sigma = np.array([float(row[f"smoothed_sigma_velocity_{name}_mps"]) for row in rows])
        assert np.sqrt(np.mean((velocity - expected)[late] ** 2)) < 0.25
        assert np.mean(np.abs(velocity - expected)[late] < 3.0 * sigma[late]) > 0.9
    found = track_file.read(path, None)
    assert found.left_out == 3
    np.testing.assert_allclose(found.sigma_m[0], 2.0, rtol=0.15)


def test_geodetic_tracks_become_east_north_up() -> None:
    """GIVEN a degree of latitude and of longitude at 45 degrees THEN they are as long as the WGS 84 tables say."""
    found = track_file.local(np.array([45.0, 45.0, 45.001]), np.array([7.0, 7.001, 7.0]), np.zeros(3))
    assert found[1, 0] == pytest.approx(78.847, abs=0.01)
    assert found[2, 1] == pytest.approx(111.131, abs=0.01)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "0 rows"),
        ("a,b\n" + "1,2\n" * 12, "no column t_s"),
        ("t_s\n" + "1\n" * 12, "0 columns of positions"),
        ("t_s,x,sigma_y\n" + "1,2,3\n" * 12, "sigma_y belongs to no position"),
        ("t_s,x\n" + "1,2\n" * 12, "1 rows of numbers"),
        ("t_s,lat_deg,x\n" + "\n".join(f"{k},1,2" for k in range(12)), ""),
    ],
)
def test_files_that_are_no_track_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, says: str
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    status = main(["derivative", "run", str(path), "--out", str(tmp_path / "out"), "--no-figures"])
    assert status == (2 if says else 0)
    assert says in capsys.readouterr().err


def test_mistakes_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in (
        ["study", "--runs", "0"],
        ["study", "--seed", "-1"],
        ["run", "none.csv"],
        ["run", "none.csv", "--sigma", "0"],
        ["ledger", "--study", str(tmp_path / "none.json")],
        ["tune", "--trials", "0"],
    ):
        assert main(["derivative", *words]) == 2
        assert "ground: error" in capsys.readouterr().err
    assert json.dumps(LAG_S) == "30.0"
