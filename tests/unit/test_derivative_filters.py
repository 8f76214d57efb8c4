"""Kernels of derivative estimation against what they must equal: exponentials, batch least squares, a plain IMM."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightsw.derivative.bank import bank_epoch
from flightsw.derivative.chain import driven, transition
from flightsw.derivative.lagged import lagged_epoch, lagged_look
from flightsw.derivative.records import LAG
from flightsw.derivative.setup import Bank, BankSettings, Lagged, LagSettings, Model, Tuned, TunedSettings, norms
from flightsw.derivative.tuned import tuned_epoch

ONE = np.ones(1)
START = (50.0, 2.0, 0.2, 0.02, 0.002)


def van_loan(n: int, dt: float, q: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and noise by a series of the block matrix (C. F. Van Loan, IEEE Trans. AC-23 (1978) 395)."""
    a, g = np.eye(n, k=1), np.zeros((n, n))
    g[-1, -1] = q
    block = np.block([[-a, g], [np.zeros((n, n)), a.T]]) * dt
    power, total = np.eye(2 * n), np.eye(2 * n)
    for k in range(1, 60):
        power = power @ block / k
        total += power
    phi = total[n:, n:].T
    return phi, phi @ total[:n, n:]


@pytest.mark.parametrize("n", [2, 4, 6])
@pytest.mark.parametrize("dt", [0.2, 3.0])
def test_transition_and_noise_are_those_of_the_continuous_chain(n: int, dt: float) -> None:
    phi, noise = np.zeros((n, n)), np.zeros((n, n))
    transition(n, dt, phi)
    driven(n, dt, 0.7, noise)
    expected = van_loan(n, dt, 0.7)
    np.testing.assert_allclose(phi, expected[0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(noise, expected[1], rtol=1e-11)


def batch(n: int, q: float, t: np.ndarray, z: np.ndarray, r: float, at: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the state at one epoch given all positions: the whole trajectory at once."""
    start = np.diag([1e4 * r, *np.square(START[: n - 1])])
    prior = np.zeros((n * len(t), n * len(t)))
    mean = np.zeros(n * len(t))
    p = start
    mean[0] = z[0]
    steps = []
    for k in range(len(t)):
        if k > 0:
            phi, noise = van_loan(n, t[k] - t[k - 1], q)
            steps.append(phi)
            p = phi @ p @ phi.T + noise
            mean[n * k : n * k + n] = phi @ mean[n * k - n : n * k]
        block = p
        prior[n * k : n * k + n, n * k : n * k + n] = p
        for j in range(k - 1, -1, -1):  # cov(x_k, x_j) = phi_k ... phi_{j+1} P_j
            through = np.eye(n)
            for step in steps[j:k]:
                through = step @ through
            block = through @ prior[n * j : n * j + n, n * j : n * j + n]
            prior[n * k : n * k + n, n * j : n * j + n] = block
            prior[n * j : n * j + n, n * k : n * k + n] = block.T
    picked = prior[:, ::n]
    s = prior[::n, ::n] + r * np.eye(len(t))
    gain = np.linalg.solve(s, picked.T).T
    whole = mean + gain @ (z - mean[::n])
    covariance = prior - gain @ picked.T
    part = slice(n * at, n * at + n)
    return whole[part], covariance[part, part]


@pytest.mark.parametrize("n", [2, 3, 5])
def test_the_smoother_is_batch_estimation(n: int) -> None:
    """GIVEN irregular epochs WHEN the fixed-lag smoother answers for each of them THEN mean and covariance are those of
    all positions taken at once."""
    rng = np.random.default_rng(n)
    t = np.cumsum(rng.uniform(0.3, 2.0, 14))
    z = 3.0 * t - 0.2 * t**2 + rng.standard_normal(14)
    smoother = Lagged(LagSettings(n, 0.05, 1e6, gap_s=100.0, start_sigma=START))
    for k in range(14):
        assert lagged_epoch(smoother.table, smoother.state, t[k], z[k : k + 1], ONE) == 0
    for age in (0, 1, 6, 13):
        assert lagged_look(smoother.table, smoother.state, age) == 1
        mean, covariance = batch(n, 0.05, t, z, 1.0, 13 - age)
        np.testing.assert_allclose(smoother.state[0]["mean"][0, :n], mean, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(smoother.state[0]["covariance"][0, :n, :n], covariance, rtol=1e-6, atol=1e-9)
    assert lagged_look(smoother.table, smoother.state, 14) == 0


def test_the_smoother_answers_at_its_lag_and_forgets_a_gap() -> None:
    smoother = Lagged(LagSettings(3, 0.1, 2.0, gap_s=10.0))
    outcomes = [lagged_epoch(smoother.table, smoother.state, 0.5 * k, np.zeros(1), ONE) for k in range(8)]
    assert outcomes == [0, 0, 0, 0, 1, 1, 1, 1]
    assert smoother.state[0]["t_answer_s"] == 1.5
    assert lagged_epoch(smoother.table, smoother.state, 100.0, np.zeros(1), ONE) == 0
    assert smoother.state[0]["count"] == 1


def test_a_lag_of_more_epochs_than_are_held_is_shortened() -> None:
    smoother = Lagged(LagSettings(2, 0.1, 1e6, gap_s=10.0))
    smoother.state[0]["count"], smoother.state[0]["newest"] = LAG, 0
    smoother.state[0]["t_s"] = np.concatenate(([0.0], np.arange(1 - LAG, 0)))
    smoother.state[0]["variance"] = 1.0
    assert lagged_epoch(smoother.table, smoother.state, 1.0, np.zeros(1), ONE) == 1
    assert smoother.state[0]["t_answer_s"] == 2 - LAG


def kalman(n: int, q: float, x: np.ndarray, p: np.ndarray, z: float, dt: float) -> tuple[np.ndarray, np.ndarray, float]:
    phi, noise = van_loan(n, dt, q)
    x, p = phi @ x, phi @ p @ phi.T + noise
    s = p[0, 0] + 1.0
    gain = p[:, 0] / s
    misfit = z - x[0]
    likelihood = math.exp(-0.5 * misfit**2 / s) / math.sqrt(2.0 * math.pi * s)
    return x + gain * misfit, p - np.outer(gain, gain) * s, likelihood


def test_models_of_one_length_are_the_textbooks_imm() -> None:
    """GIVEN two models of three states WHEN ten epochs pass THEN states, covariances and weights are those of the
    recursion as Blom and Bar-Shalom print it."""
    models = (Model(3, 1e-4, 20.0), Model(3, 0.5, 5.0))
    bank = Bank(BankSettings(models, start_sigma=START))
    rng = np.random.default_rng(1)
    z = rng.standard_normal(10) + np.arange(10.0) ** 2
    bank_epoch(bank.table, bank.state, 0.0, z[:1], ONE)
    x = [np.array([z[0], 0.0, 0.0])] * 2
    p = [np.diag([1.0, START[0] ** 2, START[1] ** 2])] * 2
    weight = np.array([0.5, 0.5])
    leave = 1.0 - np.exp(-0.7 / np.array([20.0, 5.0]))
    jump = np.array([[1.0 - leave[0], leave[0]], [leave[1], 1.0 - leave[1]]])
    for k in range(1, 10):
        assert bank_epoch(bank.table, bank.state, 0.7, z[k : k + 1], ONE) == 0
        ahead = weight @ jump
        mixing = jump * weight[:, None] / ahead
        mixed = [sum(mixing[i, j] * x[i] for i in range(2)) for j in range(2)]
        spread = [
            sum(mixing[i, j] * (p[i] + np.outer(x[i] - mixed[j], x[i] - mixed[j])) for i in range(2)) for j in range(2)
        ]
        found = [kalman(3, models[j].q, mixed[j], spread[j], z[k], 0.7) for j in range(2)]
        x, p = [f[0] for f in found], [f[1] for f in found]
        weight = ahead * [f[2] for f in found]
        weight /= weight.sum()
    state = bank.state[0]
    np.testing.assert_allclose(state["weight"][:2], weight, rtol=1e-9)
    np.testing.assert_allclose(state["x"][:2, 0, :3], x, rtol=1e-8)
    np.testing.assert_allclose(state["P"][:2, 0, :3, :3], p, rtol=1e-7)
    mean = weight @ np.array(x)
    np.testing.assert_allclose(state["mean"][0, :3], mean, rtol=1e-8)
    whole = sum(weight[i] * (p[i] + np.outer(x[i] - mean, x[i] - mean)) for i in range(2))
    np.testing.assert_allclose(state["covariance"][0, :3, :3], whole, rtol=1e-7)


@given(
    st.lists(st.tuples(st.floats(-1e4, 1e4), st.floats(1e-3, 20.0), st.floats(0.01, 100.0)), min_size=2, max_size=15)
)
def test_whatever_comes_weights_are_probabilities_and_covariances_positive(
    epochs: list[tuple[float, float, float]],
) -> None:
    bank = Bank(BankSettings())
    for z, dt, sigma in epochs:
        assert bank_epoch(bank.table, bank.state, dt, np.array([z]), np.array([sigma])) in (0, 1)
        state = bank.state[0]
        assert abs(state["weight"].sum() - 1.0) < 1e-12
        for i, model in enumerate(BankSettings().models):
            n = model.order
            p = state["P"][i, 0, :n, :n]
            d = 1.0 / np.sqrt(np.diag(p))
            assert np.linalg.eigvalsh(p * d * d[:, None]).min() > -1e-9


@pytest.mark.parametrize(
    ("dt", "z", "sigma"),
    [(0.2, np.nan, 1.0), (0.2, np.inf, 1.0), (0.2, 0.0, 0.0), (0.2, 0.0, np.nan), (0.0, 0.0, 1.0), (np.nan, 0.0, 1.0)],
)
def test_what_is_no_epoch_is_refused_and_changes_nothing(dt: float, z: float, sigma: float) -> None:
    bank, smoother = Bank(BankSettings()), Lagged(LagSettings())
    for k in range(3):
        bank_epoch(bank.table, bank.state, 0.2, np.array([float(k)]), ONE)
        lagged_epoch(smoother.table, smoother.state, 0.2 * k, np.array([float(k)]), ONE)
    for state, refuse in (
        (bank.state, lambda: bank_epoch(bank.table, bank.state, dt, np.array([z]), np.array([sigma]))),
        (
            smoother.state,
            lambda: lagged_epoch(smoother.table, smoother.state, 0.4 + dt, np.array([z]), np.array([sigma])),
        ),
    ):
        before = state.tobytes()
        assert refuse() == -1
        assert state.tobytes() == before


def test_the_papers_algorithm_freezes_the_gain_of_the_least_cost() -> None:
    """GIVEN three Q and a still object WHEN the time of tuning is over THEN the gain is constant, the least Q's."""
    q = tuple((0.0, 0.0, value) for value in (1e-2, 1e-8, 1e2))
    tuned = Tuned(TunedSettings(3, 1.0, q=q, settle_s=5.0, tune_s=30.0))
    rng = np.random.default_rng(3)
    outcomes = [tuned_epoch(tuned.table, tuned.state, float(z)) for z in rng.standard_normal(60)]
    assert outcomes == [0] * 30 + [1] * 30
    assert tuned.state[0]["chosen"] == 1
    gain = tuned.state[0]["gain_now"].copy()
    tuned_epoch(tuned.table, tuned.state, 5.0)
    np.testing.assert_array_equal(tuned.state[0]["gain_now"], gain)
    assert tuned_epoch(tuned.table, tuned.state, math.nan) == -1


def test_a_chain_in_radians_is_the_chain_in_metres() -> None:
    """GIVEN rho = 1/R WHEN positions are angles THEN velocities are those of positions in metres."""
    radius = 6_371_000.0
    q = ((0.0, 0.0, 1e-3),)
    metres = Tuned(TunedSettings(3, 0.5, q=q))
    angle = Tuned(TunedSettings(3, 0.5, scale=1.0 / radius, sigma=1.0 / radius, q=q))
    rng = np.random.default_rng(4)
    for k in range(50):
        z = 7.0 * k + rng.standard_normal()
        tuned_epoch(metres.table, metres.state, z)
        tuned_epoch(angle.table, angle.state, z / radius)
    np.testing.assert_allclose(angle.state[0]["mean"][1:3], metres.state[0]["mean"][1:3], rtol=1e-6)


def test_norms_of_the_second_stage() -> None:
    np.testing.assert_allclose(norms(5), [2.23607, 7.41620, 31.2890, 143.2306, 680.4256], rtol=2e-6)


@pytest.mark.parametrize(
    "make",
    [
        lambda: BankSettings(models=()),
        lambda: BankSettings((Model(7, 1.0, 1.0),)),
        lambda: BankSettings((Model(2, -1.0, 1.0),)),
        lambda: BankSettings((Model(2, 1.0, 0.0),)),
        lambda: BankSettings(axes=4),
        lambda: BankSettings(start_sigma=(1.0,)),
        lambda: BankSettings(gap_s=0.0),
        lambda: LagSettings(lag_s=-1.0),
        lambda: TunedSettings(q=()),
        lambda: TunedSettings(q=((0.0,) * 5,)),
        lambda: TunedSettings(gain=(1.0,)),
        lambda: TunedSettings(q=((0.0, 0.0, 0.0, 0.0, 1.0),), step_s=0.0),
    ],
)
def test_settings_that_make_no_estimator_are_named(make: object) -> None:
    with pytest.raises(ValueError, match="derivative:"):
        make()  # type: ignore[operator]
