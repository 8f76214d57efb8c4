"""The velocity check: its run length against the recursion itself, refusals, a bias, a spike, a gap."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from flightsw.derivative.check import check_fix
from flightsw.derivative.setup import Check, CheckSettings
from flightsw.icd.table_file import decode
from flightsw.icd.velocity_check_schema import VELOCITY_CHECK
from ground.derivative import figures, monitor, report
from ground.derivative.limit import deflection, most_found
from ground.derivative.run_length import mean_run_length, threshold_for
from ground.tables.function_sets import build_function

TEN, TENTH = np.full(3, 10.0), np.full(3, 0.1)
# derivative known at once and exactly: positions without noise, of a still object
SHARP = CheckSettings(q_m2ps3=1e-14, start_sigma_mps=1e-3)


def fixes(check: Check, velocities: np.ndarray, start: int = 0) -> list[int]:
    zero = np.zeros(3)
    return [
        check_fix(check.table, check.state, float(start + k), zero, v, TEN, TENTH) for k, v in enumerate(velocities)
    ]


def crosier(u: np.ndarray, k: float) -> np.ndarray:
    """Lengths of Crosier's sum, as printed in his paper."""
    s, lengths = np.zeros(3), []
    for one in u:
        c = float(np.linalg.norm(s + one))
        s = np.zeros(3) if c <= k else (s + one) * (1.0 - k / c)
        lengths.append(float(np.linalg.norm(s)))
    return np.array(lengths)


def test_the_sum_is_crosiers() -> None:
    """GIVEN steps of known size WHEN fixes come THEN the statistic is that of the printed recursion."""
    check = Check(SHARP)
    v = 0.1 * np.random.default_rng(1).standard_normal((60, 3))
    found = []
    zero = np.zeros(3)
    for k, one in enumerate(v):
        check_fix(check.table, check.state, float(k), zero, one, TEN, TENTH)
        found.append(float(check.state[0]["statistic"]))
    np.testing.assert_allclose(found[1:], crosier(v[1:] / 0.1, 0.3), atol=2e-3)


@pytest.mark.parametrize(("reference", "threshold"), [(0.3, 6.0), (0.5, 4.0)])
def test_the_mean_run_length_is_that_of_the_recursion(reference: float, threshold: float) -> None:
    """GIVEN white steps WHEN the recursion is run until it alarms, 400 times THEN the mean is the integral equation's
    within four standard errors."""
    rng = np.random.default_rng(7)
    s, lengths = np.zeros((400, 3)), np.zeros(400)
    going = np.ones(400, bool)
    while going.any():
        lengths += going
        s += rng.standard_normal((400, 3))
        c = np.linalg.norm(s, axis=1)
        s *= np.maximum(0.0, 1.0 - reference / np.maximum(c, 1e-12))[:, None]
        going &= np.linalg.norm(s, axis=1) <= threshold
    error = lengths.std() / math.sqrt(400)
    assert mean_run_length(reference, threshold) == pytest.approx(lengths.mean(), abs=4.0 * error)


def test_the_default_threshold_is_that_of_45_days() -> None:
    """GIVEN the table's defaults THEN white errors alarm once in 45 days, and settings and schema agree."""
    settings = CheckSettings()
    assert threshold_for(settings.reference, 45 * 86_400.0) == pytest.approx(settings.threshold, abs=0.05)
    assert mean_run_length(settings.reference, settings.threshold) / 86_400.0 == pytest.approx(45.0, rel=0.05)
    for field in VELOCITY_CHECK.fields:
        assert getattr(settings, field.name) == field.default
    with pytest.raises(ValueError, match="no threshold"):
        threshold_for(0.01, 1e12)


def test_the_set_for_coloured_errors_is_the_one_studied() -> None:
    """GIVEN the shipped set THEN its fields are those of the study; white errors of as much would alarm oftener."""
    aware = monitor.AWARE
    assert aware.threshold < threshold_for(aware.reference, 45 * 86_400.0)
    built = build_function("velocity_check", "velocity_check_coloured")
    values = decode(built).values
    for name in values.dtype.names:
        assert values[name][0] == getattr(aware, name), name


def test_errors_that_last_weigh_as_in_a_long_sum() -> None:
    """GIVEN a Gauss-Markov error of 10 s drawn 4000 times WHEN summed over 400 s THEN the check's variance of a step
    is that of the sum over its length, within four standard errors and the end effect."""
    rng, tau_s, n = np.random.default_rng(2), 10.0, 400
    keep = math.exp(-1.0 / tau_s)
    slow, total = rng.standard_normal(4000), np.zeros(4000)
    for _ in range(n):
        slow = keep * slow + math.sqrt(1.0 - keep * keep) * rng.standard_normal(4000)
        total += slow
    settings = CheckSettings(q_m2ps3=1e-14, start_sigma_mps=1e-3, coloured_v_mps=0.2, coloured_s=tau_s)
    check = Check(settings)
    fixes(check, np.full((2, 3), 0.1))
    plain = Check(SHARP)
    fixes(plain, np.full((2, 3), 0.1))
    ratio = (plain.state[0]["step"][0] / check.state[0]["step"][0]) ** 2  # (0.1^2 + slow) / 0.1^2
    assert ratio - 1.0 == pytest.approx(4.0 * total.var() / n, rel=4.0 * math.sqrt(2.0 / 4000) + 2.0 * tau_s / n)


def test_what_no_test_can_find() -> None:
    """GIVEN 0.05 m/s in 120 fixes of 0.1 m/s THEN the limits are those of a simulated Neyman-Pearson test at the same
    share of alarms, and knowing the direction helps."""
    sigmas = deflection(0.05, 0.1, 0.0, 300.0, 120)
    assert sigmas == pytest.approx(0.5 * math.sqrt(120.0), rel=1e-12)
    assert 4.5 < deflection(0.05, 0.1, 0.005, 300.0, 120) < sigmas
    known, unknown = most_found(sigmas, 120.0, 30 * 86_400.0)
    assert known == pytest.approx(0.9416, abs=5e-4)  # Phi(5.4772 - 3.9093), tables of the normal distribution
    share = 120.0 / (30 * 86_400.0)
    rng = np.random.default_rng(1)
    x = rng.standard_normal((400_000, 3))
    length = np.linalg.norm(x + np.array([sigmas, 0.0, 0.0]), axis=1)
    r = np.linspace(3.0, 7.0, 4001)
    tail = [math.erfc(a / math.sqrt(2.0)) + math.sqrt(2.0 / math.pi) * a * math.exp(-a * a / 2.0) for a in r]
    limit = r[int(np.argmin(np.abs(np.array(tail) - share)))]
    assert unknown == pytest.approx(float((length > limit).mean()), abs=3e-3)
    assert unknown < known < 0.95


def test_a_spike_is_no_bias_and_a_bias_is_found_and_over() -> None:
    check = Check(SHARP)
    v = np.zeros((60, 3))
    v[20] = 1e9
    assert fixes(check, v) == [0] * 60
    found = fixes(check, np.full((30, 3), [0.3, 0.0, 0.0]), 60)
    assert 8 <= found.index(1) <= 14
    assert check.state[0]["difference_mps"][0] == pytest.approx(0.3, abs=1e-3)
    assert check.state[0]["bias_mps"][0] > 0.1
    assert check.state[0]["alarms"][()] == 1
    over = fixes(check, np.zeros((200, 3)), 90)
    assert over[0] == 1
    assert over[-1] == 0


def test_a_gap_begins_anew() -> None:
    check = Check(SHARP)
    fixes(check, np.full((30, 3), 0.5))
    assert check.state[0]["fault"] == 1
    assert fixes(check, np.zeros((1, 3)), 200) == [0]
    assert check.state[0]["fixes"] == 1


@pytest.mark.parametrize("place", range(5))
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_fix_is_refused_and_changes_nothing(place: int, value: float) -> None:
    check = Check(SHARP)
    fixes(check, np.zeros((5, 3)))
    told = [5.0, np.zeros(3), np.zeros(3), TEN.copy(), TENTH.copy()]
    if place == 0:
        told[0] = value
    else:
        told[place][1] = value  # type: ignore[index]
    before = check.state.tobytes()
    assert check_fix(check.table, check.state, *told) == -1
    told = [4.0, np.zeros(3), np.zeros(3), TEN, TENTH]  # not later than the last
    assert check_fix(check.table, check.state, *told) == -1
    assert check_fix(check.table, check.state, 5.0, np.zeros(3), np.zeros(3), TEN, np.zeros(3)) == -1
    assert check.state.tobytes() == before


def test_nothing_is_tested_before_the_derivative_is_known() -> None:
    check = Check(CheckSettings())
    fixes(check, np.full((60, 3), 5.0))
    assert check.state[0]["armed"] == 0
    assert check.state[0]["statistic"] == 0.0


@pytest.mark.compiled
def test_the_study_counts_and_is_resumed(tmp_path: Path) -> None:
    """GIVEN a campaign of two runs WHEN it is asked for again THEN nothing is flown; the document, its words and its
    picture say what was counted."""
    told: list[int] = []
    found = monitor.monitor_part(tmp_path / "runs", 3, 2, told.append, days=0.05)
    assert sum(told) == 2
    assert monitor.monitor_part(tmp_path / "runs", 3, 2, told.append, days=0.05) == found
    assert told[-1] == 2
    white = found["alarms"]["white errors"]
    assert white["days"] == pytest.approx(0.1)
    assert white["lower"] <= white["per_30_days"] <= white["upper"]
    assert found["exact_days"] == pytest.approx(45.0, rel=0.05)
    large = found["delays"]["every axis"][-1]
    assert large["bias_mps"] == 0.5
    assert large["q95_s"] <= 10.0
    assert large["within"] == 1.0
    assert any("0.05 m/s, one axis" in line for line in report.lines("monitor", found))
    (drawn,) = figures.draw({"monitor": found}, None, tmp_path / "figures")
    assert drawn.name == "velocity_check.png"


@pytest.mark.compiled
def test_the_orbits_error_drops_out_and_biases_are_found_in_time() -> None:
    """GIVEN fixes of 10 m and 0.1 m/s WHEN velocity is biased by 0.05 m/s THEN half of the runs find it within 120 s if
    it is on one axis, all of them if it is on every axis; a day of healthy fixes gives at most one alarm."""
    settings, noise = CheckSettings(), monitor.Noise()
    one = [monitor.delay(settings, noise, np.random.default_rng([3, k]), np.array([0.05, 0.0, 0.0])) for k in range(60)]
    every = [monitor.delay(settings, noise, np.random.default_rng([4, k]), np.full(3, 0.05)) for k in range(30)]
    assert 0.4 < np.mean(np.array(one) <= 120.0) < 0.8
    assert max(every) <= 120.0
    assert monitor.alarms(settings, noise, np.random.default_rng(5), 1.0) <= 1
