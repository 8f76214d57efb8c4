"""The flight filter's process model against the matrix exponential: Van Loan's method in 40 digits, all 20 states."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from flight_bench import T0_GPS_NS
from mpmath import mp
from process_bench import (
    DRAG_MPS2,
    NO_GRADIENT,
    PROCESS,
    Bench,
    X,
    difference,
    gradient,
    rate_radps,
    rtn,
    whole,
)

from flightsw.icd.table_file import decode
from flightsw.kernels import udu
from flightsw.nav import flight_model, flight_start
from flightsw.records import DYNAMIC_STATES, STATES
from ground.tables.build import build_navigation
from hil_sim.truth.high_degrees import acceleration_itrf

STEPS_S = [0.1, 1.0, 10.0, 60.0]


def some_factors(seed: int) -> np.ndarray:
    """Factors of a covariance in which all states are correlated, each of a size that occurs."""
    rng = np.random.default_rng(seed)
    sigma = np.repeat([3.0, 3e-3, 5e-8, 0.3, 3.0], [3, 3, 3, 2, 9])
    root = rng.standard_normal((STATES, STATES + 4)) * sigma[:, None]
    ud = np.zeros((STATES, STATES))
    assert udu.factorise(root @ root.T, STATES, ud)
    return ud


def linear_model(settings: dict[str, float], g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F and the density of G w of dx = F x + G w, all 20 states."""
    f, q = np.zeros((STATES, STATES)), np.zeros((STATES, STATES))

    def markov(places: Any, sigma: str, tau: str) -> None:
        for k in places:
            f[k, k] = -1.0 / settings[tau]
            q[k, k] = 2.0 * settings[sigma] ** 2 / settings[tau]

    f[0:3, 3:6], f[3:6, 0:3], f[3:6, 6:9] = np.eye(3), g, rtn()
    f[3:6, 9] = f[3:6, 10] = DRAG_MPS2
    white = [settings[f"white_{axis}_m2ps3"] for axis in ("radial", "along", "cross")]
    q[3:6, 3:6] = rtn() @ np.diag(white) @ rtn().T
    markov(range(6, 9), "empirical_sigma_mps2", "empirical_tau_s")
    markov([9], "drag_sigma", "drag_tau_s")
    markov([10], "drag_slow_sigma", "drag_slow_tau_s")
    markov(range(11, 14), "gnss_bias_sigma_m", "gnss_bias_tau_s")
    markov(range(14, 20), "gnss_periodic_sigma_m", "gnss_periodic_tau_s")
    for c in (14, 16, 18):
        f[c, c + 1], f[c + 1, c] = rate_radps(), -rate_radps()
    return f, q


@cache
def van_loan(dt_s: float, curved: bool, **changed: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact transition and noise of dx = F x + G w over dt (C. F. Van Loan, IEEE Trans. AC-23 (1978) 395).

    In two blocks, as the GNSS states and the others do not act on each other.
    """
    f, q = linear_model({**PROCESS, **changed}, gradient() if curved else NO_GRADIENT)
    phi, noise = np.zeros((STATES, STATES)), np.zeros((STATES, STATES))
    assert not f[:DYNAMIC_STATES, DYNAMIC_STATES:].any()
    assert not f[DYNAMIC_STATES:, :DYNAMIC_STATES].any()
    for block in (slice(0, DYNAMIC_STATES), slice(DYNAMIC_STATES, STATES)):
        n = block.stop - block.start
        with mp.workdps(40):
            both = mp.zeros(2 * n)
            for i in range(n):
                for j in range(n):
                    both[i, j] = -mp.mpf(f[block, block][i, j]) * dt_s
                    both[n + i, n + j] = mp.mpf(f[block, block][j, i]) * dt_s
                    both[i, n + j] = mp.mpf(q[block, block][i, j]) * dt_s
            power = mp.expm(both, method="taylor")
            exact_phi = power[n:, n:].T
            exact_noise = exact_phi * power[:n, n:]
            phi[block, block] = np.array(exact_phi.tolist(), dtype=float)
            noise[block, block] = np.array(exact_noise.tolist(), dtype=float)
    return phi, noise


def transition_of(bench: Bench, dt_s: float, g: np.ndarray) -> np.ndarray:
    """Phi (20, 20) as the kernel holds it: what it does to r and v, and how the others decay and turn."""
    flight_model.set_transition(bench.table, X, dt_s, DRAG_MPS2, g, bench.work)
    phi = np.zeros((STATES, STATES))
    phi[:6, :DYNAMIC_STATES] = bench.work.motion
    phi[6:14, 6:14] = np.diag(bench.work.decay[6:14])
    cos, sin = bench.work.turn_cos, bench.work.turn_sin
    for c in (14, 16, 18):
        phi[c : c + 2, c : c + 2] = [[cos, sin], [-sin, cos]]
    return phi


def test_rtn_basis_is_a_right_handed_rotation() -> None:
    basis = np.zeros((3, 3))
    flight_model.rtn_basis(X, basis)
    np.testing.assert_allclose(basis, rtn(), atol=1e-15)
    assert np.linalg.det(basis) == pytest.approx(1.0, abs=1e-15)
    assert flight_model.orbital_rate_radps(X) == pytest.approx(rate_radps(), rel=1e-15)


def test_the_number_of_states_follows_the_table() -> None:
    """20 with both GNSS errors or with the periodic one alone, 14 with the lasting one, 11 without."""
    counts = {(3.0, 2.0): 20, (0.0, 2.0): 20, (3.0, 0.0): 14, (0.0, 0.0): 11}
    for (bias, periodic), n in counts.items():
        bench = Bench(gnss_bias_sigma_m=bias, gnss_periodic_sigma_m=periodic)
        assert flight_model.states(bench.table) == n


@pytest.mark.parametrize("dt_s", STEPS_S)
def test_transition_without_gravity_is_the_matrix_exponential(dt_s: float) -> None:
    """GIVEN no gravity gradient THEN Phi equals exp(F dt) to 12 digits of every element, whatever the step."""
    phi, _ = van_loan(dt_s, curved=False)
    got = transition_of(Bench(), dt_s, NO_GRADIENT)
    assert ((phi == 0.0) == (got == 0.0)).all()
    np.testing.assert_allclose(got, phi, rtol=1e-11)


@pytest.mark.parametrize("dt_s", STEPS_S)
def test_transition_with_gravity_is_that_to_second_order(dt_s: float) -> None:
    """What is left out is of the order (omega dt)^3 of a rotation, (omega dt)^2 / 12 of what accelerations do."""
    phi, _ = van_loan(dt_s, curved=True)
    error = np.abs(transition_of(Bench(), dt_s, gradient()) - phi)
    turned = 1.12e-3 * dt_s * np.sqrt(2.0)  # the gradient's largest eigenvalue is 2 omega^2
    assert error[:3, :3].max() <= turned**4 / 24.0 + 1e-15
    assert error[:3, 3:6].max() <= dt_s * (turned**4 / 120.0 + 1e-15)
    assert error[3:6, :3].max() <= (turned**4 / 6.0 + 1e-15) / dt_s
    assert error[3:6, 3:6].max() <= turned**4 / 24.0 + 1e-15
    for row, share in ((slice(0, 3), 12.0), (slice(3, 6), 6.0)):
        size = np.linalg.norm(phi[row, 6:11], axis=0)
        assert (error[row, 6:11] <= (turned**2 / share + 1e-11) * size).all()
    assert error[6:].max() <= 1e-15


@pytest.mark.parametrize("dt_s", STEPS_S)
def test_noise_of_a_step_is_exact(dt_s: float) -> None:
    """GIVEN no gravity gradient WHEN a step is taken from a state without error THEN P is Van Loan's Q: to 13 digits of
    the sigmas for steps of up to 1 s, to nine for 10 s, to six for 60 s, a tenth of a correlation time."""
    _, noise = van_loan(dt_s, curved=False)
    assert difference(Bench().noise(dt_s), noise) <= {0.1: 1e-13, 1.0: 1e-13, 10.0: 1e-9, 60.0: 1e-6}[dt_s]


@pytest.mark.parametrize("dt_s", STEPS_S)
def test_noise_leaves_out_what_gravity_makes_of_it_within_a_step(dt_s: float) -> None:
    """The share is of the order (omega dt)^2 / 3: 4e-7 for a step of 1 s, 1e-3 for one of 60 s."""
    _, noise = van_loan(dt_s, curved=True)
    assert difference(Bench().noise(dt_s, gradient()), noise) <= 0.35 * (1.12e-3 * dt_s) ** 2


@pytest.mark.parametrize(("ratio", "allowed"), [(0.1, 5e-6), (0.3, 5e-5), (1.0, 3e-4), (3.0, 1e-2)])
def test_noise_of_a_step_as_long_as_a_correlation_time(ratio: float, allowed: float) -> None:
    """The quadrature's limit, nothing but empirical accelerations: 5e-6 of the sigmas for a step of a tenth of the
    correlation time, 3e-4 for one of all of it, a hundredth for three of it. Beyond, noise is lost."""
    alone = {f"white_{axis}_m2ps3": 0.0 for axis in ("radial", "along", "cross")}
    alone |= {"drag_sigma": 0.0, "drag_slow_sigma": 0.0, "empirical_tau_s": 60.0 / ratio}
    _, noise = van_loan(60.0, curved=False, **alone)
    assert difference(Bench(**alone).noise(60.0)[:9, :9], noise[:9, :9]) <= allowed


@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("dt_s", STEPS_S)
def test_prediction_carries_any_covariance(dt_s: float, curved: bool) -> None:
    """GIVEN 20 correlated states WHEN predicted THEN P is Phi P Phi' + Q with the kernel's Phi, which the tests above
    hold, and Van Loan's Q; into other factors or in place."""
    g = gradient() if curved else NO_GRADIENT
    for seed in range(3):
        bench, ud = Bench(), some_factors(seed)
        phi = transition_of(bench, dt_s, g)
        expected = phi @ whole(ud) @ phi.T + van_loan(dt_s, curved=False)[1]
        before = ud.copy()
        out = bench.predict(ud, dt_s, g)
        np.testing.assert_array_equal(ud, before)
        assert difference(whole(out), expected) <= 1e-10
        flight_model.predict(bench.nav, bench.table, T0_GPS_NS, ud, dt_s, DRAG_MPS2, bench.work, ud)
        np.testing.assert_array_equal(ud, out)


@pytest.mark.parametrize("n", [11, 14])
def test_fewer_states_are_the_same_states(n: int) -> None:
    """Without GNSS states the others go on as with them, to the rounding, and nothing beyond n is touched."""
    bench = Bench(gnss_periodic_sigma_m=0.0, gnss_bias_sigma_m=3.0 if n == 14 else 0.0)
    full = some_factors(4)
    full[:n, n:] = 0.0
    expected = whole(Bench().predict(full, 1.0, gradient()))[:n, :n]
    ud = full.copy()
    ud[n:, n:] = np.nan
    ud[:n, n:] = np.nan
    out = bench.predict(ud, 1.0, gradient())
    assert difference(whole(out, n), expected) <= 1e-13
    assert np.isnan(out[n:, :]).all()


@pytest.mark.parametrize(("parts", "dt_s"), [(2, 0.2), (10, 1.0), (60, 60.0)])
def test_steps_compose(parts: int, dt_s: float) -> None:
    """GIVEN no gravity gradient THEN many short steps give the covariance of one step of their length."""
    ud = some_factors(9)
    bench = Bench()
    for k in range(parts):
        ud = bench.predict(ud, dt_s / parts, at_s=k * dt_s / parts)
    assert difference(whole(ud), whole(Bench().predict(some_factors(9), dt_s))) <= 1e-10


def test_processes_keep_their_steady_sigma() -> None:
    """GIVEN each Gauss-Markov state at its steady sigma WHEN a day of steps has gone by THEN it still has it."""
    bench, ud = Bench(), np.zeros((STATES, STATES))
    names = ("empirical_sigma_mps2", "drag_sigma", "drag_slow_sigma", "gnss_bias_sigma_m", "gnss_periodic_sigma_m")
    sigma = np.repeat([PROCESS[name] for name in names], [3, 1, 1, 3, 6])
    np.fill_diagonal(ud[6:, 6:], sigma**2)
    for _ in range(90):
        ud = bench.predict(ud, 10.0)
    np.testing.assert_allclose(np.diag(whole(ud))[6:], sigma**2, rtol=1e-9)


def test_what_the_field_leaves_out_fades_as_a_field_does() -> None:
    """GIVEN sets that fly gravity to degree 70 WHEN their sigma of omitted gravity is held against the field of degrees
    71 to 110 of EGM96, sampled over the sphere THEN from 350 to 800 km it is one and the same share of it, within 15 %:
    an acceleration that changes sign within a minute weighs less than one that lasts."""
    points = np.random.default_rng(3).standard_normal((300, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    for name in ("flight", "flight_coloured"):
        values = decode(build_navigation(name)).values
        fields = ("empirical_sigma_mps2", "omitted_gravity_sigma_mps2", "omitted_gravity_degree", "equatorial_radius_m")
        table = Bench(**{field: float(values[field][0]) for field in fields}).table
        share = []
        for altitude_m in (350e3, 400e3, 500e3, 600e3, 800e3):
            radius = 6_378_136.3 + altitude_m
            x = np.array([radius, 0.0, 0.0, 0.0, 0.0, 0.0])
            sigma2 = flight_model.empirical_sigma_mps2(table, x) ** 2 - table.empirical_sigma_mps2**2
            field = acceleration_itrf(radius * points, 71, 110)
            share.append(np.sqrt(sigma2 / np.mean(np.sum(field**2, axis=1))))
        assert 0.1 < np.mean(share) < 0.2
        np.testing.assert_allclose(share, np.mean(share), rtol=0.15)


def test_omitted_gravity_drives_the_empirical_accelerations() -> None:
    """GIVEN a state that is known WHEN predicted for a long time THEN the empirical accelerations have the sigma of
    this radius; without omitted gravity that of the table."""
    radius = float(np.linalg.norm(X[:3]))
    for omitted, degree in ((0.0, 75.0), (1e-7, 75.0), (1e-7, 40.0)):
        bench = Bench(
            omitted_gravity_sigma_mps2=omitted, omitted_gravity_degree=degree, equatorial_radius_m=6_378_136.3
        )
        expected = PROCESS["empirical_sigma_mps2"] ** 2
        expected += omitted**2 * (6_878_136.3 / radius) ** (2.0 * (degree + 2.0))
        p = whole(bench.predict(np.zeros((STATES, STATES)), 60.0))
        kept = 1.0 - math.exp(-120.0 / PROCESS["empirical_tau_s"])
        np.testing.assert_allclose(np.diag(p)[6:9], expected * kept, rtol=1e-6)


def test_other_states_of_the_mean_follow_the_same_transition() -> None:
    """carry_others does to a state what Phi does to its covariance."""
    bench, x = Bench(), X.copy()
    x[6:] = np.random.default_rng(1).standard_normal(14)
    expected = transition_of(bench, 60.0, NO_GRADIENT) @ x
    flight_model.set_decays(bench.table, X, 60.0, bench.work)
    flight_model.carry_others(bench.work, x)
    np.testing.assert_allclose(x[6:], expected[6:], rtol=1e-14)
    np.testing.assert_array_equal(x[:6], X[:6])


def test_a_periodic_error_returns_after_an_orbit() -> None:
    """GIVEN a pair that does not decay WHEN the orbit has turned by a quarter four times THEN in phase goes to
    quadrature, and back."""
    bench, x = Bench(gnss_periodic_tau_s=1e20), X.copy()
    x[14] = 5.0
    quarter_s = np.pi / 2.0 / rate_radps()
    seen = []
    for _ in range(4):
        flight_model.set_decays(bench.table, X, quarter_s, bench.work)
        flight_model.carry_others(bench.work, x)
        seen.append(x[14:16].copy())
    np.testing.assert_allclose(seen, [[0.0, -5.0], [-5.0, 0.0], [0.0, 5.0], [5.0, 0.0]], atol=1e-12)


# -- start


@pytest.mark.parametrize(("bias", "periodic", "n"), [(3.0, 2.0, 20), (3.0, 0.0, 14), (0.0, 0.0, 11)])
def test_start_from_a_fix(bias: float, periodic: float, n: int) -> None:
    """GIVEN z = r + B (b + c) + noise WHEN a state starts from z THEN P is that of r = z - B (b + c) - noise: what the
    fix has of lasting errors is in r with the opposite sign."""
    bench, ud = Bench(gnss_bias_sigma_m=bias, gnss_periodic_sigma_m=periodic), np.zeros((STATES, STATES))
    assert flight_start.start(bench.table, X, 10.0, 0.1, 0.0, bench.work, ud)
    # columns: noise of r, of v, the eleven to twenty states beside them
    own = np.repeat([5e-8, 0.4, 0.3, bias, periodic], [3, 1, 1, 3, 6])
    root = np.zeros((STATES, STATES))
    root[:, :] = np.diag(np.concatenate([np.full(3, 10.0), np.full(3, 0.1), own]))
    root[:3, 11:14] = -rtn() * bias
    root[:3, 14:20:2] = -rtn() * periodic
    expected = (root @ root.T)[:n, :n]
    assert difference(whole(ud, n), expected) <= 1e-14
    error_of_z = np.zeros((3, n))
    error_of_z[:, :3] = np.eye(3)
    if n >= 14:
        error_of_z[:, 11:14] = rtn()
    if n >= 20:
        error_of_z[:, 14:20:2] = rtn()
    np.testing.assert_allclose(error_of_z @ whole(ud, n) @ error_of_z.T, np.eye(3) * 100.0, atol=1e-11)


def test_start_from_an_arc_of_positions() -> None:
    """GIVEN a velocity from two positions a minute apart, whose lasting error has changed meanwhile, WHEN a state
    starts from it THEN P is that of r = z - B b - noise, v = (z - z') / arc: r, v and b know of the change."""
    bias, tau_s, arc_s, ud = 5.0, 300.0, 60.0, np.zeros((STATES, STATES))
    bench = Bench(gnss_bias_sigma_m=bias, gnss_bias_tau_s=tau_s, gnss_periodic_sigma_m=0.0)
    assert flight_start.start(bench.table, X, 0.5, 0.02, arc_s, bench.work, ud)
    p = whole(ud, 14)
    # columns: noise of r, of v; b now in RTN, and what is new of b since the arc began: b' = keep b + fresh w
    keep = math.exp(-arc_s / tau_s)
    root = np.zeros((14, 12))
    root[:6, :6] = np.diag(np.repeat([0.5, 0.02], 3))
    root[11:14, 6:9] = bias * np.eye(3)
    root[:3, 6:9] = -bias * rtn()
    root[3:6, 6:9] = -bias * (1.0 - keep) / arc_s * rtn()
    root[3:6, 9:12] = bias * math.sqrt(1.0 - keep**2) / arc_s * rtn()
    expected = root @ root.T
    chosen = np.r_[0:6, 11:14]
    np.testing.assert_allclose(p[np.ix_(chosen, chosen)], expected[np.ix_(chosen, chosen)], rtol=1e-9, atol=1e-12)
    assert math.sqrt(p[3, 3]) == pytest.approx(0.0537, abs=0.0005)  # where white noise of 0.5 m alone would be 0.02
