"""The filter against equations (2) to (10) of the paper written out plainly: numpy for long runs, mpmath for digits."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import MU_M3PS2, circular_orbit, loaded_memory, phi_of, record, transition_at, two_body
from mpmath import mp, mpf

from flightsw.kernels import integrators
from flightsw.nav import filter as ekf

TAU_NS = 1_000_000_000
H = np.hstack((np.eye(6), np.zeros((6, 3))))
POLE = np.array([0.0, 0.0, 1.0])


def paper_gradient(r):
    size = np.linalg.norm(r)
    return MU_M3PS2 / size**5 * (3.0 * np.outer(r, r) - size**2 * np.eye(3))


def paper_step(x, p, q, tau=1.0):
    """(3), (6), (7)."""
    r, v, da = x[:3], x[3:6], x[6:9]
    phi = np.eye(9)
    phi[0:3, 3:6] = tau * np.eye(3)
    phi[3:6, 0:3] = tau * paper_gradient(r)
    phi[3:6, 6:9] = tau * np.eye(3)
    ahead = np.concatenate((r + tau * v, v + tau * (-MU_M3PS2 * r / np.linalg.norm(r) ** 3 + da), da))
    return ahead, phi @ p @ phi.T + np.diag(np.repeat(q, 3)), phi


def paper_update(x, p, z, noise):
    """(8), (9), (10) as printed: (E - K H) P."""
    gain = np.linalg.solve(H @ p @ H.T + noise, H @ p).T
    return x + gain @ (z - H @ x), (np.eye(9) - gain @ H) @ p


class FlightFilter:
    """The kernels, called as the chain calls them."""

    def __init__(self, name="paper", **overrides):
        self.memory = loaded_memory(name, **overrides)
        self.table, self.work, self.out = (record(getattr(self.memory, n)) for n in ("table", "work", "output"))
        self.x, self.p = np.zeros(9), np.zeros((9, 9))

    def predict(self, row=0):
        transition_at(self.table, self.x, 1.0, POLE, self.work)
        ekf.predict_covariance(self.table, row, 1.0, self.p, self.work, self.p)
        integrators.advance(self.table, self.x, 1.0, POLE, self.work.stages)

    def update(self, z, noise):
        self.work.z[:] = z
        self.work.R[:, :] = noise
        assert ekf.innovate(self.table, self.x, self.p, self.work, self.out)
        ekf.correct(self.x, self.p, self.work, self.out)


def start(flight):
    flight.x[:6] = circular_orbit(500e3) + np.array([3.0, -2.0, 1.0, 0.3, -0.2, 0.1])
    flight.p[:] = np.diag(np.repeat([33.0**2, 1.0, (0.02 / 3) ** 2], 3))
    return flight.x.copy(), flight.p.copy()


def scale_of(p):
    return np.sqrt(np.outer(np.diag(p), np.diag(p)))


def measurements(count, sigma_r, sigma_v):
    rng = np.random.default_rng(17)
    r, v = two_body(circular_orbit(500e3), np.arange(1, count + 1) * TAU_NS, t0_gps_ns=0)
    noise = np.hstack((sigma_r * rng.standard_normal((count, 3)), sigma_v * rng.standard_normal((count, 3))))
    return np.hstack((r, v)) + noise


@pytest.mark.parametrize(("sigma_r", "sigma_v"), [(1.0, 1.0), (33.0, 1.0), (10.0, 0.1)])
def test_four_hundred_steps_of_the_paper(sigma_r, sigma_v):
    """Every third second without a measurement: (11)."""
    flight = FlightFilter()
    x, p = start(flight)
    noise = np.diag(np.repeat([sigma_r**2, sigma_v**2], 3))
    for k, z in enumerate(measurements(400, sigma_r, sigma_v)):
        x, p, phi = paper_step(x, p, (1.0, 0.01, 1e-6))
        flight.predict()
        assert np.abs(phi_of(flight.work) - phi).max() <= 1e-15
        assert np.abs(flight.p - p).max() <= 1e-9 * np.abs(p).max()
        if k % 3:
            expected = z - x[:6]
            spread = H @ p @ H.T + noise
            x, p = paper_update(x, p, z, noise)
            flight.update(z, noise)
            np.testing.assert_allclose(flight.out.innovation, expected, atol=1e-6 * sigma_v)
            np.testing.assert_allclose(flight.out.innovation_sigma, np.sqrt(np.diag(spread)), rtol=1e-9)
            nis = expected @ np.linalg.solve(spread, expected)
            assert flight.out.nis == pytest.approx(nis, rel=1e-6, abs=1e-6)
        assert (np.abs(flight.p - p) <= 1e-9 * scale_of(p)).all()
        assert np.abs(flight.x - x)[:3].max() < 1e-6
        assert np.abs(flight.x - x)[3:6].max() < 1e-7
        assert np.abs(flight.x - x)[6:].max() < 1e-9


def test_thirty_steps_to_forty_digits():
    """The rounding of the flight filter itself: 1e-12 of the covariance, a nanometre of the state."""
    flight = FlightFilter()
    x0, p0 = start(flight)
    with mp.workdps(40):
        eye, zero = mp.eye(9), mp.matrix(9, 9)
        x, p = mp.matrix(x0.tolist()), mp.matrix(p0.tolist())
        mu = mpf(float(flight.table.mu_m3ps2))
        q = mp.diag([mpf(float(v)) for v in np.repeat([1.0, 0.01, 1e-6], 3)])
        h = mp.matrix(H.tolist())
        noise = mp.diag([mpf(v) for v in (1, 1, 1, 1, 1, 1)])
        for z in measurements(30, 1.0, 1.0):
            r = x[:3]
            size = mp.sqrt(sum(c * c for c in r))
            phi = eye + zero
            for i in range(3):
                phi[i, 3 + i] = phi[3 + i, 6 + i] = 1
                for j in range(3):
                    phi[3 + i, j] = mu / size**5 * (3 * r[i] * r[j] - (size**2 if i == j else 0))
            ahead = x.copy()
            for i in range(3):
                ahead[i] = x[i] + x[3 + i]
                ahead[3 + i] = x[3 + i] - mu * r[i] / size**3 + x[6 + i]
            p = phi * p * phi.T + q
            gain = p * h.T * mp.inverse(h * p * h.T + noise)
            x = ahead + gain * (mp.matrix(z.tolist()) - h * ahead)
            p = (eye - gain * h) * p
            flight.predict()
            flight.update(z, np.eye(6))
            exact_p = np.array(p.tolist(), dtype=float)
            assert (np.abs(flight.p - exact_p) <= 1e-12 * scale_of(exact_p)).all()
            # one unit in the last place of a radius is a nanometre
            assert max(abs(float(mpf(float(flight.x[i])) - x[i])) for i in range(3)) < 3e-8
            assert max(abs(float(mpf(float(flight.x[i])) - x[i])) for i in range(3, 9)) < 1e-8


@pytest.mark.parametrize("name", ["paper", "j2"])
def test_transition_is_the_derivative_of_the_step(name):
    """Central differences of the flight step; for RK4 Phi is of second order, the motion of the gradient is left."""
    flight = FlightFilter(name)
    start(flight)
    transition_at(flight.table, flight.x, 1.0, POLE, flight.work)
    step_of = np.repeat([10.0, 0.01, 1e-4], 3)
    for j in range(9):
        up, down = flight.x.copy(), flight.x.copy()
        up[j] += step_of[j]
        down[j] -= step_of[j]
        for x in (up, down):
            integrators.advance(flight.table, x, 1.0, POLE, flight.work.stages)
        column = (up - down) / (2.0 * step_of[j])
        # rounding of the difference; what the second order leaves out, G tau^3 / 6
        assert np.abs(phi_of(flight.work)[:, j] - column).max() < 3e-9 / step_of[j] + 5e-7


def test_transition_with_rk4_is_the_matrix_exponential_but_for_its_third_order():
    flight = FlightFilter("two_body")
    start(flight)
    transition_at(flight.table, flight.x, 1.0, POLE, flight.work)
    a = np.zeros((9, 9))
    a[0:3, 3:6] = a[3:6, 6:9] = np.eye(3)
    a[3:6, 0:3] = paper_gradient(flight.x[:3])
    with mp.workdps(40):
        exact = np.array(mp.expm(mp.matrix(a.tolist())).tolist(), dtype=float)
    third = a @ a @ a / 6.0
    assert np.abs(phi_of(flight.work) + third - exact).max() < 2e-7  # tau^4 / 24 of the gradient
    assert np.abs(phi_of(flight.work) - exact).max() < 4.1e-7
    assert np.abs(phi_of(flight.work) - exact)[:, :3].max() < 1e-12


def stand_still(work):
    """Phi = 1."""
    work.phi_pull[:, :] = 0.0
    work.phi_step_s = work.phi_square_s2 = 0.0


def test_noise_goes_with_the_share_of_a_step():
    flight = FlightFilter()
    stand_still(flight.work)
    p = np.zeros((9, 9))
    ekf.predict_covariance(flight.table, 1, 0.25, p, flight.work, p)
    np.testing.assert_allclose(np.diag(p), 0.25 * np.repeat([30.0, 0.01, 1e-6], 3), rtol=1e-15)


@pytest.mark.parametrize("integrator", [0, 1])
def test_propagation_is_the_product_of_the_matrices(integrator):
    """Phi P Phi' + Q for any covariance, symmetric to the last bit, in place as well."""
    rng = np.random.default_rng(5)
    flight = FlightFilter(integrator=integrator)
    start(flight)
    transition_at(flight.table, flight.x, 7.0, POLE, flight.work)
    root = rng.standard_normal((9, 9)) * np.repeat([1e3, 1.0, 1e-3], 3)[:, None]
    p, out = root @ root.T, np.full((9, 9), np.nan)
    p = 0.5 * (p + p.T)
    ekf.propagate(p, 3.0, 0.2, 1e-7, flight.work, out)
    phi = phi_of(flight.work)
    wanted = phi @ p @ phi.T + np.diag(np.repeat([3.0, 0.2, 1e-7], 3))
    assert (np.abs(out - wanted) <= 1e-13 * scale_of(wanted)).all()
    assert (out == out.T).all()
    ekf.propagate(p, 3.0, 0.2, 1e-7, flight.work, p)
    assert (p == out).all()


@pytest.mark.parametrize("ratio", [1.0, 1e6, 1e12])
def test_update_keeps_its_digits_where_the_gain_is_almost_one(ratio):
    """(10) in 60 digits, for noise of turned axes and covariances up to 12 decades above it; in place as well."""
    rng = np.random.default_rng(4)
    flight = FlightFilter()
    root = rng.standard_normal((9, 9))
    p = root @ root.T
    p, noise = 0.5 * (p + p.T), np.zeros((6, 6))
    for block in (slice(0, 3), slice(3, 6)):
        axes, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        noise[block, block] = axes @ np.diag(rng.uniform(0.3, 3.0, 3)) @ axes.T / ratio
    noise = 0.5 * (noise + noise.T)
    with mp.workdps(60):
        exact_p, h = mp.matrix(p.tolist()), mp.matrix(H.tolist())
        spread = h * exact_p * h.T + mp.matrix(noise.tolist())
        gain = exact_p * h.T * spread**-1
        wanted = np.array(((mp.eye(9) - gain * h) * exact_p).tolist(), dtype=float)
        gain = np.array(gain.tolist(), dtype=float)
    assert ekf.gain(p, noise, flight.work)
    np.testing.assert_allclose(np.array(flight.work.gain).T, gain, rtol=1e-10, atol=1e-11)
    out = np.full((9, 9), np.nan)
    ekf.condition(p, noise, flight.work, out)
    assert (np.abs(out - wanted) <= 1e-9 * scale_of(wanted)).all()
    assert (out == out.T).all()
    ekf.condition(p, noise, flight.work, p)
    assert (p == out).all()


@pytest.mark.parametrize("variance", [-1e6, np.nan, np.inf])
def test_a_covariance_that_is_not_definite_gives_no_gain(variance):
    flight = FlightFilter()
    start(flight)
    flight.p[2, 2] = variance
    flight.work.R[:, :] = np.eye(6)
    assert not ekf.gain(flight.p, flight.work.R, flight.work)


def test_soundness():
    flight = FlightFilter()
    x, p = start(flight)
    p[0, 3] = p[3, 0] = 0.999 * np.sqrt(p[0, 0] * p[3, 3])
    assert ekf.is_sound(flight.table, x, p)
    for value in (np.nan, np.inf, -np.inf):
        for i in range(9):
            bad = x.copy()
            bad[i] = value
            assert not ekf.is_sound(flight.table, bad, p)
            for j in range(9):
                bad_p = p.copy()
                bad_p[i, j] = value
                assert not ekf.is_sound(flight.table, x, bad_p)
    for i in range(9):
        for variance in (0.0, -1e-30):
            bad_p = p.copy()
            bad_p[i, i] = variance
            assert not ekf.is_sound(flight.table, x, bad_p)
        for j in range(i):
            bad_p = p.copy()
            bad_p[i, j] = bad_p[j, i] = 1.001 * np.sqrt(p[i, i] * p[j, j])
            assert not ekf.is_sound(flight.table, x, bad_p)


@pytest.mark.parametrize("sigma_r", [1.0, 10.0])
def test_da_converges_to_an_injected_acceleration(sigma_r):
    """Truth: two-body plus a constant 4e-4 m/s2, integrated by the test at a tenth of the step."""
    flight = FlightFilter("two_body", tuning__0__q_a_m2ps4=1e-14)
    mu = float(flight.table.mu_m3ps2)
    da = np.array([4e-4, -3e-4, 2e-4])
    rng = np.random.default_rng(23)

    def slope(s):
        return np.concatenate((s[3:], -mu * s[:3] / np.linalg.norm(s[:3]) ** 3 + da))

    truth = circular_orbit(500e3)
    flight.x[:6] = truth
    flight.p[:] = np.diag(np.repeat([sigma_r**2, 0.1**2, (1e-3 / 3) ** 2], 3))
    noise = np.diag(np.repeat([sigma_r**2, 0.1**2], 3))
    for _ in range(900):
        for _ in range(2):
            k1 = slope(truth)
            k2 = slope(truth + 0.25 * k1)
            k3 = slope(truth + 0.25 * k2)
            k4 = slope(truth + 0.5 * k3)
            truth = truth + 0.5 / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
        flight.predict()
        flight.update(truth + np.concatenate((sigma_r * rng.standard_normal(3), 0.1 * rng.standard_normal(3))), noise)
    error, sigma = np.abs(flight.x[6:9] - da), np.sqrt(np.diag(flight.p)[6:9])
    assert sigma.max() < 0.1 * np.abs(da).min()
    assert (error < 3.5 * sigma).all()
