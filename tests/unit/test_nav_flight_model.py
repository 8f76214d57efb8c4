"""The flight filter's process model against the matrix exponential: Van Loan's method in 40 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from flightsw.icd.table_schema import SCHEMAS
from flightsw.kernels import registry
from flightsw.kernels.registry import MATRIX, VECTOR, entry, records
from flightsw.nav import flight_model
from flightsw.records import STATES, TABLE, WORK

R_M = np.array([4.1e6, -3.9e6, 3.7e6])
V_MPS = np.array([5.1e3, 5.2e3, -0.9e3])


@entry(records(TABLE), VECTOR, registry.F8, records(WORK))
def _transition(table, x, dt_s, work):
    flight_model.transition(table[0], x, dt_s, work[0])


@entry(VECTOR, MATRIX)
def _basis(x, out):
    flight_model.rtn_basis(x, out)


def _table(**fields: float) -> np.ndarray:
    table = np.zeros(1, TABLE)
    for field in SCHEMAS["navigation"].fields:
        if field.default is not None:
            table[field.name] = field.default
    for name, value in fields.items():
        table[name] = value
    return table


def _gradient() -> np.ndarray:
    r = np.linalg.norm(R_M)
    return 3.986004415e14 / r**5 * (3.0 * np.outer(R_M, R_M) - r * r * np.eye(3))


def _rtn() -> np.ndarray:
    radial = R_M / np.linalg.norm(R_M)
    cross = np.cross(R_M, V_MPS)
    cross /= np.linalg.norm(cross)
    return np.column_stack([radial, np.cross(cross, radial), cross])


def _van_loan(table: np.ndarray, dt_s: float, gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exact transition and noise of dx = F x + G w over dt (C. F. Van Loan, IEEE Trans. AC-23 (1978) 395)."""
    f = np.zeros((STATES, STATES))
    f[0:3, 3:6] = np.eye(3)
    f[3:6, 0:3] = gradient
    f[3:6, 6:9] = _rtn()
    tau = float(table["empirical_tau_s"][0])
    f[6:9, 6:9] = -np.eye(3) / tau
    q = np.zeros((STATES, STATES))
    white = np.diag([float(table[f"white_{axis}_m2ps3"][0]) for axis in ("radial", "along", "cross")])
    q[3:6, 3:6] = _rtn() @ white @ _rtn().T
    q[6:9, 6:9] = np.eye(3) * 2.0 * float(table["empirical_sigma_mps2"][0]) ** 2 / tau
    with mpmath.workdps(40):
        block = np.block([[-f, q], [np.zeros((STATES, STATES)), f.T]]) * dt_s
        power = mpmath.expm(mpmath.matrix(block.tolist()))
        phi = power[STATES:, STATES:].T
        noise = phi * power[:STATES, STATES:]
        to_array = lambda m: np.array([[float(m[i, j]) for j in range(STATES)] for i in range(STATES)])  # noqa: E731
        return to_array(phi), to_array(noise)


@pytest.fixture
def table() -> np.ndarray:
    return _table(
        empirical_sigma_mps2=5e-8,
        empirical_tau_s=600.0,
        white_radial_m2ps3=1e-14,
        white_along_m2ps3=4e-14,
        white_cross_m2ps3=9e-14,
    )


def _fly(table: np.ndarray, dt_s: float, gradient: np.ndarray) -> np.ndarray:
    registry.warm_up()
    work = np.zeros(1, WORK)
    work["gradient"] = gradient
    x = np.zeros(STATES)
    x[0:3], x[3:6] = R_M, V_MPS
    _transition(table, x, dt_s, work)
    return work


def test_rtn_basis_is_a_right_handed_rotation() -> None:
    registry.warm_up()
    x = np.zeros(STATES)
    x[0:3], x[3:6] = R_M, V_MPS
    basis = np.zeros((3, 3))
    _basis(x, basis)
    np.testing.assert_allclose(basis, _rtn(), atol=1e-15)
    assert np.linalg.det(basis) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("dt_s", [0.1, 1.0, 10.0])
def test_transition_is_the_matrix_exponential(table: np.ndarray, dt_s: float) -> None:
    """GIVEN the linear model WHEN a step is taken THEN Phi is exp(F dt) up to the order that gravity is taken to."""
    work = _fly(table, dt_s, _gradient())
    phi, _ = _van_loan(table, dt_s, _gradient())
    error = np.abs(work["phi"][0] - phi)
    # gravity enters to second order in dt: what is left is of the order (omega dt)^3, omega = 1.1e-3 rad/s
    scale = np.ones((STATES, STATES))
    scale[0:3, 3:9] = dt_s
    scale[3:6, 0:3] = 1.1e-3**2 * dt_s
    assert np.all(error <= 3.0 * (1.1e-3 * dt_s) ** 2 * scale + 1e-15)


@pytest.mark.parametrize("dt_s", [0.1, 1.0, 30.0])
def test_noise_of_a_step_is_exact(table: np.ndarray, dt_s: float) -> None:
    """GIVEN no gravity gradient WHEN a step is taken THEN Q equals Van Loan's to ten digits, whatever the step."""
    work = _fly(table, dt_s, np.zeros((3, 3)))
    _, noise = _van_loan(table, dt_s, np.zeros((3, 3)))
    scale = np.sqrt(np.outer(np.diag(noise), np.diag(noise)))
    np.testing.assert_allclose(work["noise"][0] / scale, noise / scale, atol=1e-10)


def test_noise_of_two_steps_is_that_of_one_of_their_length(table: np.ndarray) -> None:
    """GIVEN an exact noise THEN Phi Q(dt) Phi' + Q(dt) = Q(2 dt): the length of a step does not matter."""
    one, two = _fly(table, 5.0, np.zeros((3, 3))), _fly(table, 10.0, np.zeros((3, 3)))
    phi, noise = one["phi"][0], one["noise"][0]
    composed = phi @ noise @ phi.T + noise
    scale = np.sqrt(np.outer(np.diag(composed), np.diag(composed)))
    np.testing.assert_allclose(composed / scale, two["noise"][0] / scale, atol=1e-9)
