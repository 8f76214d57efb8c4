"""Whether the bound of a navigation table can ever reach its limit: the saturation linter.

Equation (17) is a Riccati recursion and may settle below the limit while the error grows: a flag that can never come.
A table is sound where the largest bound of each orbit exceeds that of the orbit before, until twice the limit or the
certified age. On a circular orbit, in axes that turn with it, the recursion has constant coefficients; it is carried on
as a linear fractional map, P = X Y^-1, ten steps at a time. The bound is the one over the worst direction.

Sources: the recursion is (7), (12), (17) of the paper; Kailath, Sayed, Hassibi, Linear Estimation (2000), chapter E
for the map; Hill-Clohessy-Wiltshire equations and Van Loan (1978) for the flight filter's physical process noise.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator

import numpy as np

GROWTH_MIN = 1e-4  # of an orbit's largest bound over that of the orbit before, relative
HORIZON_S = 30 * 86_400.0
_RADIUS_M = 6.878e6
_MU_M3PS2 = 3.986004415e14
_RATE_RADPS = math.sqrt(_MU_M3PS2 / _RADIUS_M**3)
_ORBIT_S = 2.0 * math.pi / _RATE_RADPS
_STRIDE = 10  # steps at a time: more would mix directions that decay at very different rates beyond double precision
_AIDED_STEPS = 600
_SLICE = 50  # points judged at a turn
_FLIGHT_STEP_S = 60.0
_START_SIGMA_V_MPS = 1e-3
_RK4 = 1
_FLIGHT = 1
_RADIUS_DRIVES = 1


def saturation(values: np.ndarray, certified_age_s: float = 0.0) -> list[str]:
    """Why the bound of a navigation table settles too low, a sentence for each tuning row that does; empty if none.

    values: (1,), dtype of the schema, within its ranges. certified_age_s: where proof ends, 0 for no certificate.
    """
    work = saturation_in_slices(values, certified_age_s)
    while True:
        try:
            next(work)
        except StopIteration as end:
            return list(end.value)


def saturation_in_slices(values: np.ndarray, certified_age_s: float = 0.0) -> Generator[None, None, list[str]]:
    """As `saturation`, a few milliseconds of work at each turn."""
    record = values[0]
    end_s = min(certified_age_s, HORIZON_S) if certified_age_s > 0.0 else HORIZON_S
    if int(record["filter_model"]) == _FLIGHT:
        found = yield from _judge(record, _flight_bounds(record), end_s)
        return [f"{found}: the process noise of [flight_filter] is too small; raise it"] if found else []
    said = []
    for row in range(int(record["tuning_rows"])):
        if found := (yield from _judge(record, _paper_bounds(record, row), end_s)):
            said.append(
                f"tuning row {row}: {found}: noise and pseudo-update of (17) balance; raise bound_q_* or bound_s_* "
                "of this row"
            )
    return said


def _judge(record: np.void, bounds_m: Iterator[tuple[float, float]], end_s: float) -> Generator[None, None, str]:
    """Empty, or how the bound fails to grow. bounds_m: (age [s], bound [m]) in order of age."""
    limit_m = float(record["limit_m"])
    before_m, largest_m, orbit = 0.0, 0.0, 1
    for count, (age_s, bound_m) in enumerate(bounds_m):
        if count % _SLICE == 0:
            yield
        if not math.isfinite(bound_m):
            return f"the bound cannot be computed at an age of {age_s:.0f} s"
        if age_s > orbit * _ORBIT_S:
            if largest_m <= before_m * (1.0 + GROWTH_MIN):
                return (
                    f"the bound settles at {largest_m:.0f} m, no higher in orbit {orbit} of an outage than in orbit "
                    f"{orbit - 1}, and never reaches twice limit_m = {limit_m:g} m"
                )
            before_m, largest_m, orbit = largest_m, 0.0, orbit + 1
        largest_m = max(largest_m, bound_m)
        if bound_m >= 2.0 * limit_m or age_s >= end_s:
            return ""
    return ""


def _bound_m(record: np.void, p_rr: np.ndarray) -> float:
    factor = record["k_radius"] if int(record["flag_driver"]) == _RADIUS_DRIVES else record["k_axis"]
    if not np.isfinite(p_rr).all():
        return math.nan
    largest = float(np.linalg.eigvalsh(0.5 * (p_rr + p_rr.T))[-1])
    return float(factor) * math.sqrt(largest) if largest >= 0.0 else math.nan


def _turning(dt_s: float) -> np.ndarray:
    """Rotation (3, 3) from the axes of the orbit at one instant to those dt later."""
    c, s = math.cos(_RATE_RADPS * dt_s), math.sin(_RATE_RADPS * dt_s)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _paper_transition(record: np.void, dt_s: float) -> np.ndarray:
    """The filter's Phi (9, 9) over one step, from the axes of the orbit at its begin to those at its end."""
    gradient = _RATE_RADPS**2 * np.diag([2.0, -1.0, -1.0])
    second = 0.5 * dt_s * dt_s if int(record["integrator"]) == _RK4 else 0.0
    one = np.eye(3)
    phi = np.block(
        [
            [one + second * gradient, dt_s * one, second * one],
            [dt_s * gradient, one + second * gradient, dt_s * one],
            [np.zeros((3, 6)), one],
        ]
    )
    return np.kron(one, _turning(dt_s)) @ phi


def _map(phi: np.ndarray, q: np.ndarray, information: np.ndarray) -> np.ndarray:
    """One step of the recursion as a matrix on (X, Y): predict with Phi and Q, then an update of this information."""
    back = np.linalg.solve(phi.T, np.eye(len(phi)))
    ahead = np.hstack((phi, q @ back))
    return np.vstack((ahead, np.hstack((np.zeros_like(phi), back)) + information @ ahead))


def _apply(matrix: np.ndarray, p: np.ndarray) -> np.ndarray:
    n = len(p)
    x = matrix[:n, :n] @ p + matrix[:n, n:]
    y = matrix[n:, :n] @ p + matrix[n:, n:]
    p = np.linalg.solve(y.T, x.T).T
    return 0.5 * (p + p.T)


def _information(sigma_r_m: float, sigma_v_mps: float) -> np.ndarray:
    return np.diag([sigma_r_m**-2] * 3 + [sigma_v_mps**-2] * 3 + [0.0] * 3)


def _paper_bounds(record: np.void, row: int) -> Iterator[tuple[float, float]]:
    """Age and bound of an outage under (17), from the covariance that fixes of the row's quality have left."""

    def cell(name: str) -> float:
        return float(record[f"tuning_{name}"][row])

    def noise(prefix: str) -> np.ndarray:
        return np.diag([cell(f"{prefix}{name}") for name in ("q_r_m2", "q_v_m2ps2", "q_a_m2ps4") for _ in range(3)])

    dt_s = int(record["nav_step_ns"]) * 1e-9
    phi = _paper_transition(record, dt_s)
    sigma_r_m = max(min(cell("sigma_fix_m"), float(record["sigma_r_max_m"])), cell("sigma_r_floor_m"))
    sigma_v_mps = cell("sigma_v_floor_mps")
    p = np.diag([sigma_r_m**2] * 3 + [sigma_v_mps**2] * 3 + [(float(record["da_max_mps2"]) / 3.0) ** 2] * 3)
    with np.errstate(all="ignore"):
        try:
            aided = np.linalg.matrix_power(_map(phi, noise(""), _information(sigma_r_m, sigma_v_mps)), _STRIDE)
            for _ in range(_AIDED_STEPS // _STRIDE):
                p = _apply(aided, p)
            alone = _map(phi, noise("bound_"), _information(cell("bound_s_r_m"), cell("bound_s_v_mps")))
            alone = np.linalg.matrix_power(alone, _STRIDE)
            age_s = 0.0
            while True:
                p = _apply(alone, p)
                age_s += _STRIDE * dt_s
                yield age_s, _bound_m(record, p[:3, :3])
        except np.linalg.LinAlgError:
            yield 0.0, math.nan


def _flight_bounds(record: np.void) -> Iterator[tuple[float, float]]:
    """Age and bound of an outage of the flight filter, without drag: what drag adds makes the bound grow faster."""
    tau_s, sigma_mps2 = float(record["empirical_tau_s"]), float(record["empirical_sigma_mps2"])
    n = _RATE_RADPS
    rate = np.zeros((9, 9))
    rate[0:3, 3:6] = np.eye(3)
    rate[3, 0], rate[3, 4], rate[4, 3], rate[5, 2] = 3.0 * n * n, 2.0 * n, -2.0 * n, -n * n
    rate[3:6, 6:9] = np.eye(3)
    rate[6:9, 6:9] = -np.eye(3) / tau_s
    white = [float(record[f"white_{axis}_m2ps3"]) for axis in ("radial", "along", "cross")]
    density = np.diag([0.0] * 3 + white + [2.0 * sigma_mps2**2 / tau_s] * 3)
    phi, q = _van_loan(rate, density, _FLIGHT_STEP_S)
    sigma_r_m = float(record["tuning_sigma_r_floor_m"][0])
    p = np.diag([sigma_r_m**2] * 3 + [_START_SIGMA_V_MPS**2] * 3 + [sigma_mps2**2] * 3)
    age_s = 0.0
    while True:
        p = phi @ p @ phi.T + q
        age_s += _FLIGHT_STEP_S
        yield age_s, _bound_m(record, p[:3, :3])


def _van_loan(rate: np.ndarray, density: np.ndarray, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and process noise over dt of dx/dt = rate x + w; Van Loan, IEEE Trans. Automatic Control 23 (1978)."""
    n = len(rate)
    exponent = np.block([[-rate, density], [np.zeros((n, n)), rate.T]]) * dt_s
    halvings = max(0, math.ceil(math.log2(max(float(np.abs(exponent).sum(axis=1).max()), 1e-300)))) + 4
    small = exponent / 2.0**halvings
    term = total = np.eye(2 * n)
    for k in range(1, 12):
        term = term @ small / k
        total = total + term
    total = np.linalg.matrix_power(total, 2**halvings)
    phi = total[n:, n:].T
    return phi, phi @ total[:n, n:]
