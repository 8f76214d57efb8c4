"""The consistency test of navigation satellites against dense algebra, brute force and the paper's own conditions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from gnss_oracle import Dense, protection_m
from hypothesis import given, settings
from hypothesis import strategies as st

from flightsw.gnss.records import EPOCH, SATELLITES, Consistency, Row, Rule, Verdict
from flightsw.gnss.setup import Settings, build_table, thresholds
from ground.gnss.scene import SIGMA_M, Batch, User, add_faults, draw, excluded, judge, of_epochs
from ground.gnss.study import bad_inputs

SPARSE = User(mask_deg=20.0)


def one(user: User, seed: int, least: int = 0) -> Batch:
    """One epoch of at least so many satellites."""
    rng = np.random.default_rng(seed)
    batch = draw(user, rng, 1)
    while batch.count[0] < least:
        batch = draw(user, rng, 1)
    return batch


def rows_of(result: np.ndarray) -> set[int]:
    """Rows that a result leaves out."""
    return set(np.flatnonzero(excluded(result[None])[0]).tolist())


def without_rows(epochs: np.ndarray, rows: set[int]) -> np.ndarray:
    """The same epoch with some rows gone."""
    kept = [i for i in range(int(epochs["count"][0])) if i not in rows]
    less = np.zeros(1, EPOCH)
    less["count"] = len(kept)
    for name in ("satellite", "constellation", "range_m", "sigma_m", "r_m"):
        less[name][0, : len(kept)] = epochs[name][0, kept]
    return less


@pytest.mark.parametrize("constellations", [(0,), (0, 1), (1, 2), (0, 1, 2)])
def test_fix_is_that_of_dense_least_squares(constellations: tuple[int, ...]) -> None:
    """GIVEN any mix of constellations WHEN solved from nothing THEN fix, covariance, clocks, statistic are numpy's."""
    batch = one(User(constellations=constellations), 4, least=6)
    batch.epochs["sigma_m"][0, : batch.count[0]] = np.linspace(3.0, 9.0, batch.count[0])
    result, dense = judge(batch, Settings())[0], Dense(batch.epochs[0])
    np.testing.assert_allclose(result["r_m"], dense.r, atol=1e-3)
    np.testing.assert_allclose(result["covariance_m2"], dense.cofactor[:3, :3], rtol=1e-6)
    np.testing.assert_allclose(result["clock_m"][dense.present], dense.clock, atol=1e-3)
    assert np.isnan(np.delete(result["clock_m"], dense.present)).all()
    assert result["statistic"] == pytest.approx(dense.rss, rel=1e-6)
    assert result["unknowns"] == 3 + len(constellations)
    assert result["dof"] == dense.dof
    hat = dense.a @ dense.cofactor @ dense.a.T
    np.testing.assert_allclose(result["redundancy"][: batch.count[0]], 1.0 - np.diag(hat), atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_the_set_found_is_the_most_probable_of_all(seed: int) -> None:
    """GIVEN faults among few satellites WHEN excluded THEN it is the set that looking at every set finds."""
    batch = one(SPARSE, seed, least=11)
    add_faults(batch, np.random.default_rng(seed), 1 + seed % 2, 9.0 * SIGMA_M)
    wanted = Settings(faulty_max=3, local_alpha=0.0, further=1)
    result = judge(batch, wanted)[0]
    expected = Dense(batch.epochs[0]).most_probable(3, np.array(thresholds(wanted)), wanted.isolate_odds, 1)
    assert expected
    assert rows_of(result) == expected


@pytest.mark.parametrize("rule", list(Rule))
def test_what_is_left_out_leaves_no_trace(rule: Rule) -> None:
    """GIVEN faults of kilometres WHEN excluded THEN fix and statistic are those of an epoch without these rows."""
    batch = one(User(), 8, least=20)
    add_faults(batch, np.random.default_rng(3), 3, 300.0 * SIGMA_M)
    batch.epochs["range_m"][0, np.flatnonzero(batch.fault[0])[0]] += 80_000.0
    result = judge(batch, Settings(rule=rule))[0]
    assert rows_of(result) == set(np.flatnonzero(batch.fault[0]).tolist())
    less = without_rows(batch.epochs, rows_of(result))
    alone = judge(of_epochs(less), Settings())[0]
    assert result["verdict"] == Verdict.EXCLUDED
    assert alone["verdict"] == Verdict.CONSISTENT
    np.testing.assert_allclose(result["r_m"], alone["r_m"], atol=1e-3)
    assert result["statistic"] == pytest.approx(alone["statistic"], rel=1e-6)


@pytest.mark.parametrize(
    ("bias_m", "prior", "wide"),
    [(0.0, 1e-5, {2: 1e-5}), (0.75, 1e-5, {2: 1e-5}), (0.5, 3e-3, {2: 1e-5}), (0.0, 3e-3, {1: 2e-5, 2: 1e-5})],
    ids=["usual", "bias", "pairs", "pairs of constellations"],
)
def test_levels_are_those_of_solutions_solved_anew(bias_m: float, prior: float, wide: dict[int, float]) -> None:
    """GIVEN priors of satellites and constellations WHEN levels are made THEN they are the oracle's, mode by mode:
    never below it but by rounding, and above it by twice a hundred thousandth at most.
    """
    batch = one(SPARSE, 12, least=13)
    wanted = Settings(
        protect=True,
        bias_m=bias_m,
        p_satellite=(prior,) * 4,
        p_constellation=tuple(wide.get(j, 0.0) for j in range(4)),
        p_hmi=(2e-4, 2e-4, 1e-4),
        p_unmonitored=0.01,
    )
    result, dense = judge(batch, wanted)[0], Dense(batch.epochs[0])
    n = len(dense.rows)
    systems = batch.epochs["constellation"][0, :n]
    of = {j: tuple(np.flatnonzero(systems == j).tolist()) for j in wide}
    modes = [(prior, (i,)) for i in range(n)] + [(wide[j], of[j]) for j in wide]
    singles = list(modes)
    pairs = prior > 1e-3
    if pairs:
        modes += [
            (p * q, (*one_out, *other))
            for k, (p, one_out) in enumerate(singles)
            for q, other in singles[:k]
            if not set(one_out) & set(other)
        ]
    assert result["modes"] == len(modes) + 1
    every = sum(p for p, _ in singles)
    twice = sum(p * q for k, (p, _) in enumerate(singles) for q, _ in singles[:k])
    unmonitored = every**3 / 6.0 + (0.0 if pairs else twice)
    sigmas = math.sqrt(float(build_table(wanted)["local_threshold"][0]))
    for q in range(3):
        expected = protection_m(dense, result["axes"][q], modes, wanted.p_hmi[q] - unmonitored, sigmas, bias_m)
        assert -1e-6 <= result["protection_m"][q] / expected - 1.0 <= 2e-5


def test_two_of_a_constellation_cannot_be_told_apart() -> None:
    """GIVEN two GLONASS satellites, one faulty WHEN judged THEN it is AMBIGUOUS, and both explanations are named."""
    batch = one(User(), 21, least=22)
    systems = batch.epochs["constellation"][0, : batch.count[0]]
    some = np.flatnonzero(systems == 1)
    less = without_rows(batch.epochs, set(some[2:].tolist()))
    two = np.flatnonzero(less["constellation"][0, : less["count"][0]] == 1)
    less["range_m"][0, two[0]] += 60.0 * SIGMA_M
    result = judge(of_epochs(less), Settings(protect=True))[0]
    assert result["verdict"] == Verdict.AMBIGUOUS
    assert {int(result["excluded"]), int(result["rival"])} == {1 << int(two[0]), 1 << int(two[1])}
    assert result["unknowns"] == 6
    assert result["lone"] == (1 << int(two[0])) + (1 << int(two[1])) - int(result["excluded"])
    assert result["available"] == 0


def test_a_lone_satellite_is_told() -> None:
    """GIVEN one Galileo satellite, wrong by 10 km THEN nothing contradicts it, it moves nothing, and it is told."""
    batch = one(User(), 22, least=20)
    some = np.flatnonzero(batch.epochs["constellation"][0, : batch.count[0]] == 2)
    less = without_rows(batch.epochs, set(some[1:].tolist()))
    lone = int(np.flatnonzero(less["constellation"][0, : less["count"][0]] == 2)[0])
    before = judge(of_epochs(less), Settings())[0]
    less["range_m"][0, lone] += 10_000.0
    after = judge(of_epochs(less), Settings())[0]
    assert before["lone"] == after["lone"] == 1 << lone
    assert after["redundancy"][lone] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(after["r_m"], before["r_m"], atol=1e-3)


@pytest.mark.parametrize("rule", list(Rule))
def test_dof_decides_what_can_be_said(rule: Rule) -> None:
    """GIVEN 4, 5 and 7 satellites, one wrong THEN too few, untested, and at one degree of freedom inconsistent only."""
    batch = one(User(), 30, least=22)
    systems = batch.epochs["constellation"][0, : batch.count[0]]
    first = [np.flatnonzero(systems == j)[:n].tolist() for j, n in enumerate((4, 2, 2))]
    order = first[0][:3] + first[1] + first[2][:1] + [first[0][3]] + [first[2][1]]
    verdicts = []
    for count in (4, 5, 7):
        less = without_rows(batch.epochs, set(range(batch.count[0])) - set(order[:count]))
        less["range_m"][0, 0] += 5_000.0
        wanted = Settings(rule=rule, alpha=0.05, local_alpha=0.0)
        verdicts.append(int(judge(of_epochs(less), wanted)[0]["verdict"]))
    assert verdicts == [Verdict.TOO_FEW, Verdict.UNTESTED, Verdict.INCONSISTENT]


def test_six_unknowns_are_too_many_where_a_constellation_is_absent() -> None:
    """GIVEN GPS and Galileo only THEN the paper's six unknowns have rank 5, and flight solves for 5."""
    batch = one(User(constellations=(0, 2)), 50, least=12)
    epoch, dense = batch.epochs[0], Dense(batch.epochs[0])
    n = int(epoch["count"])
    clocks = (epoch["constellation"][:n, None] == np.arange(3)).astype(float)
    six = np.concatenate((dense.a[:, :3] * dense.sigma[:, None], clocks), axis=1)
    assert np.linalg.matrix_rank(six) == 5
    result = judge(batch, Settings())[0]
    assert (result["unknowns"], result["dof"]) == (5, n - 5)


def test_thresholds() -> None:
    """GIVEN alpha THEN thresholds are those of printed tables, and n - p over alpha where the law is unknown."""
    chi2 = thresholds(Settings(alpha=0.05))
    assert chi2[0] == math.inf
    np.testing.assert_allclose([chi2[1], chi2[10], chi2[30]], [3.8415, 18.3070, 43.7730], atol=1e-4)
    markov = thresholds(Settings(alpha=0.05, test=Consistency.MARKOV))
    np.testing.assert_allclose([markov[1], markov[10]], [20.0, 200.0])


@pytest.mark.parametrize("budget", [0, 40, 500])
def test_the_budget_bounds_the_search(budget: int) -> None:
    """GIVEN 64 satellites with six faults WHEN the budget is small THEN it is kept, told, and the verdict is honest."""
    batch = one(User(), 33, least=20)
    epoch = dict(bad_inputs(batch, np.random.default_rng(1)))["64 satellites"]
    epoch["range_m"][0, ::11] += 500.0
    wide = of_epochs(epoch)
    result = judge(wide, Settings(candidates_max=budget))[0]
    assert result["candidates"] <= budget
    assert result["out_of_budget"] == 1
    assert result["verdict"] == Verdict.INCONSISTENT
    assert judge(wide, Settings())[0]["candidates"] <= Settings().candidates_max


BAD = {
    "a good epoch": Verdict.CONSISTENT,
    "zero satellites": Verdict.TOO_FEW,
    "three satellites": Verdict.TOO_FEW,
    "a negative count": Verdict.TOO_MANY,
    "more rows than there is room": Verdict.TOO_MANY,
    "64 satellites": Verdict.CONSISTENT,
    "NaN in a range": Verdict.CONSISTENT,
    "NaN in all ranges": Verdict.TOO_FEW,
    "infinite ranges": Verdict.TOO_FEW,
    "missing ephemerides": Verdict.TOO_FEW,
    "an ephemeris of NaN": Verdict.CONSISTENT,
    "a wrong constellation": Verdict.CONSISTENT,
    "wrong constellations throughout": Verdict.TOO_FEW,
    "a duplicate number": Verdict.CONSISTENT,
    "all numbers equal": Verdict.TOO_FEW,
    "a sigma of zero": Verdict.CONSISTENT,
    "negative sigmas": Verdict.TOO_FEW,
    "all satellites in one place": Verdict.NO_SOLUTION,
    "all faulty, by kilometres": Verdict.INCONSISTENT,
    "random bits": Verdict.TOO_FEW,
}


def test_every_bad_input_has_its_verdict() -> None:
    """GIVEN each kind of bad input WHEN judged THEN its verdict is what it should be, and rows say why."""
    good = one(User(), 40, least=22)
    for name, epoch in bad_inputs(good, np.random.default_rng(2)):
        result = judge(of_epochs(epoch), Settings(protect=True))[0]
        if name in BAD:
            assert result["verdict"] == BAD[name], name
        else:
            assert result["verdict"] in (Verdict.INCONSISTENT, Verdict.NO_SOLUTION), name
        if name == "a duplicate number":
            assert (result["row_state"] == Row.DUPLICATE).sum() == 2


@pytest.mark.compiled
@settings(max_examples=30, deadline=None)
@given(st.binary(min_size=64, max_size=64), st.integers(-2, SATELLITES + 2), st.integers(0, 2**32 - 1))
def test_nothing_that_comes_in_raises(noise: bytes, count: int, seed: int) -> None:
    """GIVEN bytes for numbers here and there WHEN judged THEN there is a verdict, the same again, finite with a fix."""
    rng = np.random.default_rng(seed)
    batch = draw(User(), rng, 1)
    raw = batch.epochs.view(np.uint8).reshape(-1)
    raw[rng.integers(0, raw.size, 64)] = np.frombuffer(noise, np.uint8)
    batch.epochs["count"] = count
    first, again = judge(batch, Settings(protect=True)), judge(batch, Settings(protect=True))
    assert first.tobytes() == again.tobytes()
    verdict = Verdict(int(first["verdict"][0]))
    if verdict <= Verdict.INCONSISTENT:
        assert np.isfinite(first["r_m"]).all()
        assert (np.diag(first["covariance_m2"][0]) > 0.0).all()


@pytest.mark.compiled
def test_an_epoch_allocates_nothing() -> None:
    """GIVEN 1 and 50 epochs with faults and levels THEN the allocator gives the same: the call's handles."""
    from numba.core.runtime import _nrt_python, rtsys

    batch = draw(User(), np.random.default_rng(3), 50)
    add_faults(batch, np.random.default_rng(3), 3, 20.0 * SIGMA_M)
    judge(batch, Settings(protect=True))
    given = []
    _nrt_python.memsys_enable_stats()
    try:
        for epochs in (batch.epochs[:1], batch.epochs):
            before = rtsys.get_allocation_stats().alloc
            judge(of_epochs(epochs), Settings(protect=True))
            given.append(rtsys.get_allocation_stats().alloc - before)
    finally:
        _nrt_python.memsys_disable_stats()
    assert given[0] == given[1] <= 4  # one handle for each of the four arrays of the call


@pytest.mark.parametrize(
    "changed",
    [{"alpha": 0.0}, {"faulty_max": 9}, {"p_satellite": (0.1,)}, {"p_hmi": (0.0, 1e-7, 1e-7)}, {"sigma_factor": -1.0}],
)
def test_impossible_settings_are_refused(changed: dict) -> None:
    """GIVEN a setting out of its range WHEN a test is set up THEN it is named."""
    with pytest.raises(ValueError, match=next(iter(changed))):
        replace(Settings(), **changed)
