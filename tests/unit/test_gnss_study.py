"""Studies of the GNSS consistency test on few epochs: shares within limits of what theory has; files and commands."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from ground.__main__ import main
from ground.errors import OperatorError
from ground.gnss import peers, report, study
from ground.gnss.command import fly
from ground.gnss.ephemeris import NODES, Precise
from ground.gnss.files import troposphere_m
from ground.gnss.scene import LAWS, judge, noise

pytestmark = pytest.mark.compiled


def test_false_alarms_are_alpha() -> None:
    """GIVEN Gaussian noise WHEN counted THEN alpha is within the limits, and bounds Markov's test for all laws."""
    found = study.alarms_part(3, 4_000)
    gauss = found["laws"]["gauss"]
    assert gauss["chi2 .05"]["lower"] < 0.05 < gauss["chi2 .05"]["upper"]
    assert gauss["chi2 .001"]["lower"] < 0.001 < gauss["chi2 .001"]["upper"]
    assert all(found["laws"][law]["markov .05"]["rate"] < 0.05 for law in LAWS)
    assert 24.0 < found["mean_satellites"] < 25.2


def test_detection_is_that_of_noncentral_chi_square() -> None:
    """GIVEN biases by size WHEN detected THEN 50 and 99 % are where theory and the reference have them."""
    found = study.detection_part(3, 400)
    assert found["chi2 .05"]["half"] == pytest.approx(4.0, abs=0.4)
    assert found["theory"]["half"] == pytest.approx(4.0, abs=0.25)
    assert found["theory"]["nearly_all"] == pytest.approx(7.2, abs=0.7)
    assert found["markov .05"]["half"] == pytest.approx(22.0, abs=2.0)


def test_exclusion_beats_the_raw_rule_where_it_masks() -> None:
    """GIVEN several faults WHEN excluded by both rules THEN the flight rule names them exactly, far oftener."""
    found = {(c["mask_deg"], c["faults"], c["sigmas"]): c for c in study.exclusion_part(3, 150)["cases"]}
    assert found[5.0, 5, 20.0]["flight"]["upper"] > 0.98
    assert found[5.0, 5, 7.0]["flight"]["rate"] > found[5.0, 5, 7.0]["raw"]["rate"] + 0.25
    assert found[20.0, 3, 50.0]["flight"]["rate"] > found[20.0, 3, 50.0]["raw"]["rate"] + 0.05
    assert "wanted 0.95" in "\n".join(report.lines("exclusion", {"cases": list(found.values())}))


def test_part_peers_needs_an_interpreter(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gnss", "study", "--parts", "peers"]) == 2
    assert "--peer-python" in capsys.readouterr().err


@pytest.mark.slow
def test_gnss_lib_py_stands_beside() -> None:
    """GIVEN an interpreter with gnss_lib_py WHEN a few cases of each kind are handed over THEN it finds single faults
    as we do and takes ten times as long."""
    named = os.environ.get("LEONAV_PEER_PYTHON")
    if not named:
        pytest.skip("LEONAV_PEER_PYTHON names no interpreter that has gnss_lib_py")
    found = peers.peers_part(3, 12, Path(named))
    assert len(found["cases"]) == len(study.CASES)
    single = found["cases"][1]
    assert single["faults"] == 1
    assert single["gnss_lib_py"]["rate"] >= 0.8
    assert single["flight"]["rate"] >= 0.8
    assert all(case["gnss_lib_py_us"] > 10.0 * case["flight_us"] for case in found["cases"])
    assert "gnss_lib_py" in "\n".join(report.lines("peers", found))


def test_one_clock_is_the_same_satellites() -> None:
    """GIVEN a case whose clocks agree THEN with one clock it is consistent too, and has two unknowns less."""
    batch = peers._case(3, 11, 0, 40)
    batch.epochs["range_m"] = batch.exact_m
    alone = peers._one_clock(batch)
    three, one = judge(batch, study.RULES["flight"]), judge(alone, study.RULES["flight"])
    assert (one["statistic"] < 1e-6).all()
    assert (one["dof"] - three["dof"] == 2).all()
    assert np.abs(one["r_m"] - batch.truth_m).max() < 1e-3


def test_protection_levels_hold_in_a_few_epochs() -> None:
    """GIVEN faults with their priors, and at the worst size THEN no level is broken oftener than allowed."""
    found = fly("protection", 3, 2_000)
    assert all(one["lower"] < 1e-3 for one in found["direct"]["axes"])
    for row in found["worst"]:
        for one, allowed in zip(row["axes"], row["allowed"], strict=True):
            assert row["prior"] * one["lower"] <= allowed < 1e-3
    assert found["availability"]["available"]["rate"] > 0.9
    assert "available" in "\n".join(report.lines("protection", found))


@pytest.mark.parametrize("law", LAWS)
def test_laws_have_unit_variance(law: str) -> None:
    """GIVEN a law WHEN drawn THEN mean and variance are 0 and 1."""
    drawn = noise(law, np.random.default_rng(1), (200_000,))
    assert drawn.mean() == pytest.approx(0.0, abs=0.01)
    assert drawn.var() == pytest.approx(1.0, abs=0.06)


def test_command_writes_what_it_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a quick study of two parts WHEN run THEN document and picture are there, and words are printed."""
    words = ["gnss", "study", "--quick", "--parts", "detection", "exclusion", "speed", "--out", str(tmp_path)]
    assert main(words) == 0
    document = json.loads((tmp_path / "study.json").read_text(encoding="utf-8"))
    assert {"detection", "exclusion", "speed"} <= set(document)
    assert (tmp_path / "figures" / "exclusion.png").stat().st_size > 10_000
    assert "Exact fault set" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["study", "--epochs", "0"], "--epochs 0"),
        (["study", "--seed", "-1"], "--seed -1"),
        (["check", "nothing.rnx", "--sp3", "nothing.sp3"], "no such file"),
        (["check", "nothing.rnx", "--sp3", "nothing.sp3", "--faults", "-2"], "--faults -2"),
    ],
)
def test_mistakes_are_named(words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a wrong argument WHEN run THEN status 2 and a line that names it."""
    assert main(["gnss", *words, "--out", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err


def sp3_file(path: Path, times: int = 24) -> Path:
    """A circular orbit in the rotating frame at 15-minute nodes, and a clock that drifts."""
    lines = [
        "#cP2020  6 25  0  0  0.00000000      96 TRACK IGb14 FIT TEST",
        "%c M  cc GPS ccc cccc cccc cccc cccc ccccc",
    ]
    for k in range(times):
        angle = 1.46e-4 * 900.0 * k
        x, y, z = 26_560.0 * np.array([np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)])
        lines.append(f"*  2020  6 25 {k // 4:2d} {15 * (k % 4):2d}  0.00000000")
        lines.append(f"PG07{x:14.6f}{y:14.6f}{z:14.6f}{100.0 + 0.01 * k:14.6f}")
    path.write_text("\n".join([*lines, "EOF"]) + "\n", encoding="ascii")
    return path


def test_orbits_between_nodes(tmp_path: Path) -> None:
    """GIVEN nodes of a circle WHEN interpolated THEN position to centimetres, and the clock."""
    orbits = Precise(sp3_file(tmp_path / "one.sp3"))
    seconds = np.array([[9_000.0], [9_417.0], [10_333.3]])
    t_ns = orbits.t_ns[0] + np.rint(seconds * 1e9).astype(np.int64)
    r, clock = orbits.states(("G07",), t_ns)
    angle = 1.46e-4 * seconds[:, 0]
    expected = 26_560e3 * np.stack((np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)), axis=1)
    np.testing.assert_allclose(r[:, 0], expected, atol=0.02)
    np.testing.assert_allclose(clock[:, 0], (100.0 + 0.01 * seconds[:, 0] / 900.0) * 1e-6, atol=1e-12)
    unknown, _ = orbits.states(("G08", "G07"), np.full((1, 2), orbits.t_ns[0] - 10**12))
    assert np.isnan(unknown).all()


def test_too_short_a_file_is_refused(tmp_path: Path) -> None:
    """GIVEN fewer nodes than the polynomial has WHEN read THEN the file is named."""
    with pytest.raises(OperatorError, match=r"short\.sp3"):
        Precise(sp3_file(tmp_path / "short.sp3", NODES - 1))


def test_troposphere() -> None:
    """GIVEN a standard atmosphere THEN 2.3 to 2.5 m at the zenith, ten times that at 5 degrees, nothing in orbit."""
    assert 2.3 < troposphere_m(np.array(0.0), np.array(1.0)) < 2.5
    assert 9.0 < troposphere_m(np.array(0.0), np.array(np.sin(np.radians(5.0)))) / 2.4 < 11.0
    assert troposphere_m(np.array(500e3), np.array(1.0)) == 0.0
