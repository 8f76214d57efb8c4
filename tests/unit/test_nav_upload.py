"""A state from the ground in the navigation step: what it is held against, what it changes, what it never does.

Truth is Kepler's; uploads are drawn from their own covariance around it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flight_bench import NS, T0_GPS_NS, itrf_from_gcrf_oracle
from flight_filter_bench import fixes_every_second, fly, flying_memory, kepler, rtn

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import Mode, RejectCause, StateFrame, Verdict
from flightsw.memory import Memory
from flightsw.nav.chain import CATCH_UP

pytestmark = pytest.mark.compiled

TRUTH = kepler()
FIXED_S, LOST_S = 1200, 3000
TAKEN, ABSENT = -1, -2
UPLOADED = 1 << int(AlertId.STATE_UPLOADED)
REFUSED = 1 << int(AlertId.UPLOAD_REFUSED)
SIGMAS = np.array([3.0, 8.0, 2.0, 0.008, 0.003, 0.002])  # RTN


def inputs_until(stop_s: int, seed: int = 1) -> np.ndarray:
    """Fixes for 1200 s, then pulses only."""
    inputs = fixes_every_second(0, stop_s, TRUTH, np.random.default_rng(seed))
    inputs["fix_present"][FIXED_S:] = 0
    return inputs


def covariance_at(age_s: float, correlated: bool = True) -> np.ndarray:
    """A covariance (6, 6) in GCRF with correlations as orbits have them."""
    r, v = TRUTH(T0_GPS_NS + round(age_s * NS))
    turn = np.kron(np.eye(2), rtn(r[0], v[0]))
    p = np.diag(SIGMAS**2)
    if correlated:
        p[0, 4] = p[4, 0] = -0.9 * SIGMAS[0] * SIGMAS[4]
        p[1, 3] = p[3, 1] = -0.8 * SIGMAS[1] * SIGMAS[3]
    return turn @ p @ turn.T


def put(inputs: np.ndarray, at: int, t_s: float, offset: Any = 0.0, p: np.ndarray | None = None) -> np.ndarray:
    """An upload with call `at`, of the state at t_s, off by offset (6). Returns the state."""
    t_ns = T0_GPS_NS + round(t_s * NS)
    r, v = TRUTH(t_ns)
    state = np.concatenate((r[0], v[0])) + offset
    inputs["upload_present"][at] = 1
    inputs["upload_gps_ns"][at] = t_ns
    inputs["upload_frame"][at] = int(StateFrame.GCRF)
    inputs["upload_x"][at] = state
    inputs["upload_covariance"][at] = covariance_at(t_s) if p is None else p
    return state


def drawn(seed: int, t_s: float) -> np.ndarray:
    return np.linalg.cholesky(covariance_at(t_s)) @ np.random.default_rng(seed).standard_normal(6)


def full_covariance(memory: Memory, n: int) -> np.ndarray:
    ud = memory.nav["UD"][0][:n, :n]
    u = np.triu(ud, 1) + np.eye(n)
    return u @ np.diag(np.diag(ud)) @ u.T


def test_it_is_a_kalman_update_of_the_whole_state() -> None:
    """GIVEN an outage WHEN a state of this very epoch is uploaded THEN state and covariance are those of the textbook's
    update with its six components at once, cross-covariances included; and the age of the last fix runs on."""
    inputs = inputs_until(2401)
    memory = flying_memory(coast_step_ns=0)
    fly(memory, inputs[:2400])
    x, p = memory.nav["x"][0].copy()[:9], full_covariance(memory, 9)  # the bench knows no drag
    epoch_s = (int(memory.nav["t_gps_ns"][0]) - T0_GPS_NS) / 1e9
    state = put(inputs, 2400, epoch_s, drawn(1, epoch_s))
    last = inputs[2400:2401].copy()
    last["counter_now_ns"] = inputs["counter_now_ns"][2399]
    out = fly(memory, last)[0]
    assert out["upload_cause"] == TAKEN
    assert out["events"] & UPLOADED
    r = covariance_at(epoch_s)
    s = p[:6, :6] + r
    gain = np.linalg.solve(s, p[:6]).T
    d = state - x[:6]
    expected_x, expected_p = x + gain @ d, p - gain @ p[:6]
    sigma = np.sqrt(np.diag(expected_p))
    assert out["upload_nis"] == pytest.approx(d @ np.linalg.solve(s, d), rel=1e-6)
    np.testing.assert_allclose((memory.nav["x"][0][:9] - expected_x) / sigma, 0.0, atol=1e-6)
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(full_covariance(memory, 9) / scale, expected_p / scale, atol=1e-6)
    assert out["mode"] == Mode.AUTONOMOUS
    assert out["fix_age_s"] > 1199.0


@pytest.mark.parametrize(("late_s", "share"), [(0, 0.8), (7, 0.8), (600, 0.9), (2000, 1.0)])
def test_old_states_are_carried_to_now(late_s: int, share: float) -> None:
    """GIVEN an outage of 1800 s WHEN states that are up to 2000 s old are uploaded, drawn from their covariance, in
    twenty flights THEN all are taken, their NIS are those of chi-square, the bound shrinks and still holds."""
    nis = []
    for seed in range(20):
        inputs = inputs_until(LOST_S + 60, seed)
        alone = fly(flying_memory(empirical_sigma_mps2=1e-6), inputs.copy())
        t_s = LOST_S - 1.0 - late_s
        put(inputs, LOST_S, t_s, drawn(seed, t_s))
        outputs = fly(flying_memory(empirical_sigma_mps2=1e-6), inputs)
        assert outputs["upload_cause"][LOST_S] == TAKEN
        assert (outputs["upload_cause"][:LOST_S] == ABSENT).all()
        nis.append(outputs["upload_nis"][LOST_S])
        after = outputs[LOST_S + 1 :]
        assert (after["bound_m"] < share * alone["bound_m"][LOST_S + 1 :]).all()
        error_m = np.abs(after["r_gcrf_m"] - TRUTH(after["t_gps_ns"])[0]).max(axis=1)
        assert (error_m < after["bound_m"]).all()
        assert set(after["mode"].tolist()) == {int(Mode.AUTONOMOUS)}
    assert 3.0 < np.mean(nis) < 9.5  # 6 expected; 20 draws have 0.77
    assert max(nis) < 30.0


def test_axes_of_the_earth_serve_as_well() -> None:
    """GIVEN the same state in GCRF and in ITRF, its covariance too WHEN each is uploaded THEN the flights agree."""
    found = []
    for frame in (StateFrame.GCRF, StateFrame.ITRF):
        inputs = inputs_until(LOST_S + 1)
        memory = flying_memory()
        state = put(inputs, LOST_S, LOST_S - 50.0, drawn(4, LOST_S - 50.0))
        if frame == StateFrame.ITRF:
            state, p = to_itrf(inputs["upload_gps_ns"][LOST_S], state, covariance_at(LOST_S - 50.0))
            inputs["upload_frame"][LOST_S] = int(frame)
            inputs["upload_x"][LOST_S], inputs["upload_covariance"][LOST_S] = state, p
        found.append(fly(memory, inputs)[LOST_S])
    one, other = found
    assert one["upload_cause"] == other["upload_cause"] == TAKEN
    # to what flight's table of Earth orientation is worth: millimetres
    assert one["upload_nis"] == pytest.approx(other["upload_nis"], rel=1e-3)
    np.testing.assert_allclose(one["r_gcrf_m"], other["r_gcrf_m"], atol=5e-3)
    np.testing.assert_allclose(one["v_gcrf_mps"], other["v_gcrf_mps"], atol=5e-6)
    assert one["bound_m"] == pytest.approx(other["bound_m"], rel=1e-6)


def to_itrf(t_gps_ns: int, state: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By the bench's own matrix of the Earth's rotation and its rate from differences."""
    t = np.array([t_gps_ns])
    m = itrf_from_gcrf_oracle(t)[0]
    dm = (itrf_from_gcrf_oracle(t + NS) - itrf_from_gcrf_oracle(t - NS))[0] / 2.0
    jacobian = np.block([[m, np.zeros((3, 3))], [dm, m]])
    return jacobian @ state, jacobian @ p @ jacobian.T


def test_what_does_not_fit_changes_nothing() -> None:
    """GIVEN an outage WHEN a state 5 km off is uploaded THEN the gate refuses it, and the state flies on to the bit as
    that of a twin who was sent nothing."""
    inputs = inputs_until(LOST_S + 30)
    alone = flying_memory()
    expected = fly(alone, inputs.copy())
    put(inputs, LOST_S, LOST_S - 1.0, np.array([5e3, 0, 0, 0, 0, 0]))
    memory = flying_memory()
    outputs = fly(memory, inputs)
    assert outputs["upload_cause"][LOST_S] == RejectCause.GATE
    assert outputs["events"][LOST_S] & REFUSED
    assert memory.nav["rejected"][0][RejectCause.GATE] == 1
    for name in ("r_gcrf_m", "v_gcrf_mps", "bound_m", "covariance"):
        np.testing.assert_array_equal(outputs[name], expected[name])
    memory.nav["rejected"][0][RejectCause.GATE] = 0
    assert memory.nav.tobytes() == alone.nav.tobytes()


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"upload_gps_ns": 10 * NS}, RejectCause.TIME_FUTURE),
        ({"upload_gps_ns": -(CATCH_UP + 1) * 10 * NS}, RejectCause.TIME_STALE),
        ({"upload_gps_ns": -(2**62)}, RejectCause.TIME_STALE),
        ({"upload_frame": 7}, RejectCause.UPLOAD_INVALID),
        ({"upload_x": (0, np.nan)}, RejectCause.NOT_FINITE),
        ({"upload_x": (2, np.inf)}, RejectCause.NOT_FINITE),
        ({"upload_x": (0, 1e9)}, RejectCause.OUT_OF_RANGE),
        ({"upload_covariance": ((0, 1), np.nan)}, RejectCause.NOT_FINITE),
        ({"upload_covariance": ((3, 3), 0.0)}, RejectCause.SIGMA),
        ({"upload_covariance": ((0, 0), 1e18)}, RejectCause.SIGMA),
        ({"upload_covariance": ((0, 1), 1e4)}, RejectCause.UPLOAD_INVALID),
    ],
)
def test_states_that_are_none_are_refused_by_name(change: dict[str, Any], cause: RejectCause) -> None:
    """GIVEN a good upload WHEN one thing of it is wrong THEN it is refused for that, and counted."""
    inputs = inputs_until(FIXED_S + 100)
    put(inputs, FIXED_S + 90, FIXED_S + 89.0)
    ((name, value),) = change.items()
    if name == "upload_gps_ns":
        inputs[name][FIXED_S + 90] += value
    elif name == "upload_frame":
        inputs[name][FIXED_S + 90] = value
    else:
        place, number = value
        inputs[name][FIXED_S + 90][place] = number
    memory = flying_memory()
    outputs = fly(memory, inputs)
    assert outputs["upload_cause"][FIXED_S + 90] == cause
    assert memory.nav["rejected"][0][cause] == 1
    assert np.isnan(outputs["upload_nis"][FIXED_S + 90])


def test_flight_starts_from_a_state_of_the_ground() -> None:
    """GIVEN time but no fixes since power-up WHEN a state is uploaded THEN flight coasts from it, AUTONOMOUS, with a
    bound that holds; WHEN fixes come THEN they are used and it is as after any outage."""
    inputs = fixes_every_second(0, 3000, TRUTH, np.random.default_rng(3))
    inputs["fix_present"][:2000] = 0
    put(inputs, 100, 40.0, drawn(7, 40.0))
    outputs = fly(flying_memory(), inputs)
    assert set(outputs["mode"][:100].tolist()) == {int(Mode.INIT)}
    alone = outputs[100:2000]
    assert alone["upload_cause"][0] == TAKEN
    assert set(alone["mode"].tolist()) == {int(Mode.AUTONOMOUS)}
    error_m = np.abs(alone["r_gcrf_m"] - TRUTH(alone["t_gps_ns"])[0]).max(axis=1)
    assert (error_m < alone["bound_m"]).all()
    assert alone["bound_m"][0] < 4.0 * 3.0 * SIGMAS[1]
    assert (np.diff(alone["bound_m"][::600]) > 0.0).all()
    assert (alone["fix_age_s"] > 3.0).all()
    back = outputs[2005:]
    assert set(back["mode"].tolist()) == {int(Mode.INTEGRATED)}
    error_m = np.abs(back["r_gcrf_m"] - TRUTH(back["t_gps_ns"])[0]).max(axis=1)
    assert (error_m < back["bound_m"]).all()


def test_nothing_is_certified_of_it_until_fixes_have_converged() -> None:
    """GIVEN a certified table, in an outage called trusted WHEN a state is uploaded THEN the verdict is NOT CERTIFIED
    for the rest of the outage, and trusted again only so long after fixes as the certificate asks for."""
    inputs = fixes_every_second(0, 2400, TRUTH, np.random.default_rng(5))
    inputs["fix_present"][FIXED_S:1500] = 0
    put(inputs, 1400, 1399.0, drawn(2, 1399.0))
    memory = flying_memory(limit_m=2000.0)
    held = memory.table.copy()
    for name, value in {
        "grade": 2.0,
        "altitude_min_km": 300.0,
        "altitude_max_km": 1000.0,
        "certified_age_s": 5000.0,
        "f107_min": 60.0,
        "f107_max": 300.0,
        "fix_sigma_max_m": 20.0,
        "velocity_sigma_max_mps": 0.5,
        "convergence_s": 60.0,
        "burns": 1.0,
    }.items():
        held[f"envelope_{name}"] = value
    memory.table.flags.writeable = True
    memory.table[:] = held
    memory.table.flags.writeable = False
    outputs = fly(memory, inputs)
    verdict = outputs["verdict"]
    assert set(verdict[1210:1400].tolist()) == {int(Verdict.TRUSTED_COASTING)}
    assert set(verdict[1400:1500].tolist()) == {int(Verdict.NOT_CERTIFIED)}
    first = 1500 + int(np.flatnonzero(verdict[1500:] == Verdict.TRUSTED)[0])
    assert first >= 1400 + 60
    assert (verdict[first:] == Verdict.TRUSTED).all()
