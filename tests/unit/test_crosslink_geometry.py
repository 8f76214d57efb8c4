"""Residuals and sensitivities of links: against iterated flight times and differences of the truth."""

from __future__ import annotations

import numpy as np
import pytest
from crosslink_bench import WALKER, Bench, jump

from hil_sim.truth.constellation.broadcast import broadcast
from hil_sim.truth.constellation.crosslinks import LIGHT_MPS, View, flight_m
from hil_sim.truth.local_frames import rtn_axes

N = WALKER.total


def test_flight_time_is_iterated_on_the_orbit() -> None:
    """GIVEN the orbits WHEN the flight time is solved on them by bisection THEN the world has these distances."""
    found = flight_m(WALKER, 123.0)
    r, _ = WALKER.states(123.0)
    for receiver, sender in ((0, 8), (3, 19), (23, 1)):
        low, high = 0.0, 1.0
        for _ in range(80):
            tau = 0.5 * (low + high)
            far = np.linalg.norm(r[receiver] - WALKER.states(123.0 - tau)[0][sender])
            low, high = (tau, high) if far > LIGHT_MPS * tau else (low, tau)
        assert found[receiver, sender] == pytest.approx(LIGHT_MPS * low, abs=1e-5)


@pytest.mark.parametrize(("directions", "two_way"), [(True, False), (False, False), (False, True)])
def test_without_errors_residuals_vanish(directions: bool, two_way: bool) -> None:
    """GIVEN true ephemerides and exact ranges, by independent code WHEN residuals are computed THEN they vanish."""
    bench = Bench(noise=0.0, directions=directions, two_way=two_way)
    bench.step()
    m = int(bench.verdict["links"])
    assert m > 100
    assert np.abs(bench.memory.work["residual_m"][0, :m]).max() < 1e-5


@pytest.mark.parametrize("direction", range(4))
def test_sensitivities_are_derivatives(direction: int) -> None:
    """GIVEN an error of one satellite in one direction THEN residuals change by the sensitivity times the error."""
    bench = Bench(noise=0.0)
    bench.faults = [jump(9, direction, 10.0)]
    bench.step()
    test = bench.memory.network[0]
    m = int(bench.verdict["links"])
    expected = np.zeros(m)
    for link in range(m):
        for end, name in enumerate(("receiver", "sender")):
            if test[name][link] == 9:
                expected[link] = 10.0 * test["h"][link, end, direction]
    np.testing.assert_allclose(bench.memory.work["residual_m"][0, :m], expected, atol=2e-4)
    assert np.abs(expected).max() > 1.0


def test_neighbours_of_the_paper() -> None:
    """GIVEN Walker 24/3/1 and 86 deg THEN satellite 1 sees the paper's nine, and 9.3 see each other on average."""
    seen = View().pairs(WALKER.states(0.0)[0])
    assert (np.flatnonzero(seen[0]) + 1).tolist() == [2, 8, 9, 10, 11, 16, 17, 18, 19]
    mean = np.mean([View().pairs(WALKER.states(t)[0]).sum(axis=1).mean() for t in np.linspace(0.0, 40_544.0, 200)])
    assert mean == pytest.approx(9.3, abs=0.1)


def test_limits_of_view() -> None:
    """GIVEN limits THEN the Earth hides what lies behind it, and an antenna's field cuts what is outside it."""
    r, _ = WALKER.states(0.0)
    behind = View(central_angle_max_deg=180.0)
    angle = np.degrees(np.arccos(np.clip((r @ r.T) / 25_508_000.0**2, -1.0, 1.0)))
    seen = behind.pairs(r)
    limb = 2.0 * np.degrees(np.arccos((6_378_137.0 + 100_000.0) / 25_508_000.0))
    others = ~np.eye(N, dtype=bool)
    assert np.array_equal(seen, others & (angle < limb))
    assert np.array_equal(View(180.0, off_nadir_min_deg=47.0).pairs(r), others & (angle <= 86.0) & (angle < limb))
    assert not View().pairs(np.full((3, 3), np.nan)).any()


def test_broadcast_errors_are_in_the_satellites_own_axes() -> None:
    r, v = WALKER.states(50.0)
    errors = np.arange(4.0 * N).reshape(N, 4)
    said, clock = broadcast(r, v, errors)
    axes = rtn_axes(r, v)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", axes, said - r), errors[:, :3], atol=1e-7)
    np.testing.assert_array_equal(clock, errors[:, 3])
