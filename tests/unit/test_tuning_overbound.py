"""The consistent tuning: k from order statistics, the shape of a bound, and a campaign of a dozen outages end to
end."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightsw.icd.table_file import decode
from flightsw.icd.table_saturation import saturation
from ground.__main__ import main
from ground.campaign import seeds
from ground.campaign.ensemble import Ensemble, draw
from ground.campaign.outage import ages_s
from ground.campaign.statistics import upper_limit
from ground.tables.build import build_navigation
from ground.tuning.factors import allowed, factor
from ground.tuning.overbound import chosen
from ground.tuning.shape import better, shape


@pytest.mark.parametrize(("trials", "failures"), [(997, -1), (998, 0), (1579, 0), (1580, 1), (2583, 3), (5651, 10)])
def test_how_many_may_fail(trials: int, failures: int) -> None:
    """Clopper-Pearson for 0.003 at 95 %: the counts of docs/integrity.md and of the literature's tables."""
    assert allowed(trials, 0.003) == failures


@given(st.integers(0, 2**32), st.integers(998, 1700), st.floats(0.1, 3.0))
def test_k_proves_the_rate_and_no_smaller_one_does(seed: int, count: int, scale: float) -> None:
    """GIVEN what a thousand outages needed WHEN k is fitted THEN no more need more than may, and 0.02 less would break
    the rate or be below one."""
    needed = scale * np.abs(np.random.default_rng(seed).standard_normal(count))
    one = factor("all", needed, 0.003, 3.5)
    assert one.proven
    assert one.upper_limit_95 <= 0.003
    assert one.beyond == np.sum(needed > one.k)
    fewer = int(np.sum(needed > one.k - 0.02))
    assert one.k <= 1.02 or upper_limit(fewer, len(needed)) > 0.003


def test_few_outages_prove_nothing_and_k_is_carried_on() -> None:
    """GIVEN 48 outages drawn as a perfectly known covariance would have them, rate = m exp(-k^2 / 2) WHEN fitted many
    times THEN k is larger than any of them needed, never said to be proven, and beyond the true 0.997 in most cases."""
    rng = np.random.default_rng(2)
    m = 0.003 * np.exp(0.5 * 3.5**2)
    fits = []
    for _ in range(200):
        needed = np.sqrt(2.0 * np.log(m / rng.uniform(0.0, min(1.0, m), 48)))
        one = factor("all", np.nan_to_num(needed), 0.003, 3.5)
        assert not one.proven
        assert one.k > needed.max()
        fits.append(one.k)
    assert np.mean(np.array(fits) > 3.5) > 0.9
    assert factor("all", np.array([1.0, np.inf] * 600), 0.003, 3.5).k == np.inf


def test_what_too_few_revolutions_need_does_not_choose_k() -> None:
    """GIVEN outages that prove 4 and 60 revolutions that needed 5 WHEN k is chosen THEN 4; with 1200 revolutions 5."""
    outages = factor("all", np.full(1000, 4.0), 0.003, 3.5)
    few, many = (factor("INTEGRATED", np.full(1000, 5.0), 0.003, 3.5, orbits) for orbits in (60, 1200))
    assert (few.proven, many.proven) == (False, True)
    assert chosen([outages, few]) == pytest.approx(4.0)
    assert chosen([outages, many]) == pytest.approx(5.0)


def figures(drag_error: float, runs: int = 240) -> dict[str, np.ndarray]:
    """Errors of sigma 1 that are as large as their sigma, but for the lowest bands after some minutes."""
    rng = np.random.default_rng(3)
    ages = ages_s(2000.0)
    cell = np.arange(runs) % 12
    scale = np.where((cell[:, None] < 3) & (ages > 600.0), drag_error, 1.0)
    return {
        "run": np.arange(runs),
        "cell": cell,
        "started": np.ones(runs, bool),
        "error_m": (scale * rng.standard_normal((runs, len(ages))))[..., None] * np.array([1.0, 0.1, 0.1]),
        "sigma_m": np.ones((runs, len(ages), 3)),
    }


def test_a_bound_of_the_errors_shape_loses_nothing() -> None:
    """GIVEN errors twice too large in one band and half of the ages WHEN shapes are compared THEN the loss is that
    factor's share, and the one without it is better by more than chance; equal ones are not."""
    right, wrong = shape(figures(1.0), Ensemble()), shape(figures(2.0), Ensemble())
    assert right.loss < 0.12
    # 2 of 4 x 5 fields have 2, the others 1: mean of the logarithm is 18 / 20 ln 2
    assert wrong.loss == pytest.approx(0.9 * np.log(2.0), abs=0.12)
    assert better(right, wrong)
    assert not better(wrong, right)
    assert not better(right, right)
    assert 0.0 < wrong.sigma < 0.1


def test_gravity_beyond_the_field_is_in_the_truth_of_low_orbits() -> None:
    """GIVEN runs of the ensemble WHEN drawn THEN the truth goes to degree 110 below 450 km, 100 to 600 km, 70 above."""
    for run in range(24):
        one = draw(Ensemble(), seeds.tuning(1), run, "flight")
        perigee_km = one.drawn["perigee_km"]
        degree = 110 if perigee_km < 450.0 else 100 if perigee_km < 600.0 else 0
        assert one.tree["truth"]["gravity_beyond"] == degree


@pytest.mark.compiled
def test_a_dozen_outages_make_a_set_that_builds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN twelve short outages WHEN tuned twice THEN set, report and evidence are there, the set passes the linter
    and says that it is quick, nothing was flown the second time, and figures are the same."""
    words = ["tune", "--quick", "--runs", "12", "--jobs", "1", "--out", str(tmp_path)]
    assert main(words) == 0
    path = tmp_path / "flight_tuned.toml"
    first = path.read_bytes()
    chunk = next((tmp_path / "runs" / "base" / "chunks").iterdir())
    flown = chunk.stat().st_mtime_ns
    built = decode(build_navigation(path))
    assert saturation(built.values) == []
    evidence = json.loads((tmp_path / "tuning.json").read_text())
    assert evidence["grade"] == "quick"
    assert evidence["evidence"]["proven"] is False
    assert evidence["changes"]["bound.k_axis"] == pytest.approx(float(built.values["k_axis"][0]))
    assert (tmp_path / "figures" / "1_needed.png").exists()
    report = (tmp_path / "report.md").read_text()
    assert "carried on from the largest" in report
    assert f"flight.table_set={path}" in capsys.readouterr().out
    assert main(words) == 0
    assert path.read_bytes() == first
    assert chunk.stat().st_mtime_ns == flown


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--runs", "1"], "--runs 1"),
        (["--jobs", "0"], "--jobs 0"),
        (["--set", "paper"], "flies the paper's filter"),
        (["--set", "nothing"], 'no set named "nothing"'),
    ],
)
def test_mistakes_are_named(words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", "--quick", *words, "--out", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err
