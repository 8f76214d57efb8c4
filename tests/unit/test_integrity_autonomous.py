"""The autonomous covariance (17) written out plainly with numpy, and what Table 1 of the paper makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import (
    COMMON_AUTONOMOUS,
    MU_M3PS2,
    TABLE_1_AUTONOMOUS,
    circular_orbit,
    finish,
    loaded_memory,
    record,
    run,
    seconds,
    steady_calls,
    transition_at,
    two_body,
)

from flightsw.icd.enums import FlagState
from flightsw.integrity.autonomous import predict_bound_covariance
from flightsw.integrity.bound import axis_bound_m

POLE = np.array([0.0, 0.0, 1.0])
ORBIT = circular_orbit(500e3)


def truth(t_gps_ns):
    return two_body(ORBIT, t_gps_ns)


def plain_17(p, r, row, tau=1.0):
    """P- = Phi P Phi' + Q~; K = P- H' (H P- H' + R~)^-1; P = (E - K H) P-."""
    q_r, q_v, q_a, s_r, s_v = row
    size = np.linalg.norm(r)
    phi = np.eye(9) + tau * (np.eye(9, k=3))
    phi[3:6, 0:3] = tau * MU_M3PS2 / size**5 * (3.0 * np.outer(r, r) - size**2 * np.eye(3))
    p = phi @ p @ phi.T + np.diag(np.repeat([q_r, q_v, q_a], 3))
    h = np.eye(6, 9)
    gain = np.linalg.solve(h @ p @ h.T + np.diag(np.repeat([s_r**2, s_v**2], 3)), h @ p).T
    return (np.eye(9) - gain @ h) @ p


def start_covariance():
    return np.diag(np.repeat([1.0, 1.0, 1e-6], 3))


def flight_17(memory, p, r):
    table, work = record(memory.table), record(memory.work)
    x = np.zeros(9)
    x[:3] = r
    transition_at(table, x, 1.0, POLE, work)
    ok = predict_bound_covariance(table, 0, p, work, p)
    return ok, axis_bound_m(table, p)


@pytest.mark.parametrize(("name", "row"), [("paper_table1", TABLE_1_AUTONOMOUS), ("paper", COMMON_AUTONOMOUS)])
def test_five_hundred_steps(name, row):
    memory = loaded_memory(name)
    p = start_covariance()
    plain = p.copy()
    for r in truth(seconds(0, 500))[0]:
        ok, bound = flight_17(memory, p, r)
        plain = plain_17(plain, r, row)
        assert ok
        assert (np.abs(p - plain) <= 1e-9 * np.sqrt(np.outer(np.diag(plain), np.diag(plain)))).all()
        assert bound == pytest.approx(3.0 * np.sqrt(np.diag(plain)[:3].max()), rel=1e-10)
        assert (p == p.T).all()


@pytest.mark.compiled
def test_table_1_saturates_at_494_m():
    """REFERENCE S0, finding 2, tau = 1 s: it settles below 500 m by numpy and by flight alike, and stays there."""
    memory = loaded_memory("paper_table1")
    p = start_covariance()
    plain = p.copy()
    bounds = []
    for r in truth(seconds(0, 2000))[0]:
        bounds.append(flight_17(memory, p, r)[1])
        plain = plain_17(plain, r, TABLE_1_AUTONOMOUS)
    assert bounds[-1] == pytest.approx(3.0 * np.sqrt(np.diag(plain)[:3].max()), rel=1e-9)
    assert bounds[-1] == pytest.approx(494.0, abs=1.0)
    assert max(bounds) < 496.0


@pytest.mark.compiled
def test_table_1_never_flags_in_a_flight_of_two_days():
    """GIVEN 60 fixes WHEN the outage lasts two days THEN the bound of Table 1 never comes near 2000 m: no flag."""
    memory = loaded_memory("paper_table1", da_max_mps2=1e-3)
    inputs = steady_calls(63, truth)
    finish(run(memory, inputs))
    day = np.repeat(inputs[-1:], 1)
    day["pulse_present"] = day["fix_present"] = 0
    highest = 0.0
    for k in range(1, 2 * 86_400 // 200):
        day["counter_now_ns"] = inputs["counter_now_ns"][-1] + k * 200_000_000_000
        out = finish(run(memory, day))
        highest = max(highest, out.bound_m)
    assert out.fix_age_s > 1.9 * 86_400
    assert out.flag == FlagState.CLEAR
    assert 490.0 < highest < 500.0


def test_weak_pseudo_updates_cross_the_limit():
    """REFERENCE S0, findings 2 and 11: s_R = 2e4 crosses 2000 m, at 513 s after 1 m, 1 m/s fixes."""
    memory = loaded_memory("paper")
    p = start_covariance()
    age = next(k for k, r in enumerate(truth(seconds(0, 2000))[0], 1) if flight_17(memory, p, r)[1] > 2000.0)
    assert 400 < age < 620


@pytest.mark.parametrize("variance", [-1e12, np.nan, np.inf])
def test_without_a_definite_innovation_there_is_no_bound(variance):
    memory = loaded_memory("paper")
    p = start_covariance()
    p[1, 1] = variance
    table, work = record(memory.table), record(memory.work)
    work.phi_pull[:, :] = 0.0
    work.phi_step_s = work.phi_square_s2 = 0.0
    assert not predict_bound_covariance(table, 0, p, work, p)
