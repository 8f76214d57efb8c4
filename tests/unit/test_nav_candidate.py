"""Starting from positions alone: an arc of three gives the velocity, as good as its noise, or is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from flight_bench import NS, T0_GPS_NS, calls, put_fixes, put_pulses, record, seconds
from flight_filter_bench import MU, bare_table, errors_rtn, fly, flying_memory, kepler

from flightsw.icd.enums import FixType
from flightsw.kernels import registry
from flightsw.kernels.registry import MATRIX, TIMES, entry, records
from flightsw.nav import candidate
from flightsw.records import NAV, TABLE, WORK

ARC_S = 60.0


@entry(records(NAV), records(TABLE), TIMES, MATRIX, registry.F8, records(WORK), MATRIX)
def _offer(nav, table, t_gps_ns, positions, sigma_r_m, work, velocities):
    """Offer positions (n, 3); velocities (n, 3) of those that complete an arc, NaN of the others."""
    for i in range(len(t_gps_ns)):
        for k in range(3):
            work[0].z[k] = positions[i, k]
            work[0].z[3 + k] = np.nan
        if candidate.offer_position(nav[0], table[0], t_gps_ns[i], sigma_r_m, work[0]):
            for k in range(3):
                velocities[i, k] = work[0].z[3 + k]


class Offers:
    """One receiver's positions offered in turn, to a filter without a state."""

    def __init__(self, **table: Any) -> None:
        registry.warm_up()
        settings = {"mu_m3ps2": MU, "gravity_model": 0, "position_arc_s": ARC_S, **table}
        self.nav, self.work, self.table = np.zeros(1, NAV), np.zeros(1, WORK), bare_table(**settings)
        self.nav["pole"][0, 2] = 1.0

    def __call__(self, t_s: np.ndarray, positions: np.ndarray, sigma_r_m: float = 10.0) -> np.ndarray:
        velocities = np.full((len(t_s), 3), np.nan)
        t_gps_ns = T0_GPS_NS + np.rint(np.asarray(t_s) * NS).astype(np.int64)
        _offer(self.nav, self.table, t_gps_ns, positions, sigma_r_m, self.work, velocities)
        return velocities


def found(velocities: np.ndarray) -> np.ndarray:
    return np.flatnonzero(np.isfinite(velocities[:, 0]))


def truth_at(t_s: Any) -> tuple[np.ndarray, np.ndarray]:
    return kepler()(T0_GPS_NS + np.rint(np.asarray(t_s) * NS).astype(np.int64))


@pytest.mark.compiled
@pytest.mark.parametrize("period_s", [1.0, 10.0, 29.0])
@pytest.mark.parametrize("arc_s", [10.0, 60.0, 600.0])
def test_without_noise_the_velocity_is_the_orbits(arc_s: float, period_s: float) -> None:
    """GIVEN positions of an orbit every 1 to 29 s, arcs from 10 s to a tenth of the orbit WHEN an arc is complete THEN
    the velocity at its end is right to 0.01 mm/s, and the next arc begins with the next position."""
    t = np.arange(0.0, 3.0 * arc_s + 5.0 * period_s, period_s)
    r, v = truth_at(t)
    velocities = Offers(position_arc_s=arc_s)(t, r, 1.0)
    ends = found(velocities)
    if period_s > 2.0 * arc_s:  # no three of them within what an arc may last
        assert not ends.size
        return
    assert len(ends) >= 2
    assert t[ends[0]] >= arc_s
    for end in ends:
        assert np.linalg.norm(velocities[end] - v[end]) <= 1e-5


@pytest.mark.compiled
@pytest.mark.parametrize(("arc_s", "sigma_m"), [(60.0, 10.0), (60.0, 1.0), (200.0, 10.0)])
def test_velocity_is_as_good_as_the_noise_allows(arc_s: float, sigma_m: float) -> None:
    """GIVEN 2000 arcs with white noise THEN the velocity has sigma sqrt(2) sigma / arc in each axis, which is what the
    start claims for it, without a mean; and 99 % of the arcs are taken."""
    rng, n = np.random.default_rng(4), 2000
    t = np.array([0.0, 0.4 * arc_s, arc_s])
    r, v = truth_at(t)
    times = (np.arange(n)[:, None] * 10.0 * arc_s + t).ravel()  # of the same arc again and again: each its own start
    positions = np.tile(r, (n, 1)) + sigma_m * rng.standard_normal((3 * n, 3))
    velocities = Offers(position_arc_s=arc_s)(times, positions, sigma_m).reshape(n, 3, 3)
    assert np.isnan(velocities[:, :2]).all()
    taken = np.isfinite(velocities[:, 2, 0])
    assert taken.mean() >= 0.99
    error = velocities[taken, 2] - v[2]
    claimed = math.sqrt(2.0) * sigma_m / arc_s
    assert (np.abs(error.mean(axis=0)) <= 4.0 * claimed / math.sqrt(n)).all()
    # the arc bends: over 200 s, 13 degrees, its ends do not quite span a chord
    np.testing.assert_allclose(error.std(axis=0), claimed, rtol=0.08)


@pytest.mark.compiled
@pytest.mark.parametrize("place", [0, 1, 2])
def test_an_outlier_is_refused_wherever_it_is(place: int) -> None:
    """GIVEN one of the three positions off by 30 sigma of what the check can see WHEN the arc is complete THEN no state
    starts from it, and the next arc is taken."""
    t = np.array([0.0, 0.4, 1.0, 1.1, 1.6, 2.2]) * ARC_S
    r, v = truth_at(t)
    r[place] += np.array([0.0, 600.0, 0.0])
    velocities = Offers()(t, r)
    assert found(velocities).tolist() == [5]
    assert np.linalg.norm(velocities[5] - v[5]) <= 1e-5


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("times", "ends"),
    [
        ([0, 24, 60], [2]),
        ([0, 23, 60, 119, 120], [3]),  # the middle one is the first at 0.4 of the arc or later
        ([0, 24, 59, 60], [3]),
        ([0, 24, 160, 184, 220], [4]),  # 136 s after the middle one: too old, the arc starts anew
        ([0, 181, 205, 241], [3]),  # 181 s after the first: anew
        ([0, 24, 10, 60], [3]),  # a time that goes back within the arc is not a reason to end it
        ([100, 90, 114, 150], [3]),  # one before the first is
        ([0, 24, 60, 61, 85, 121], [2, 5]),  # and again
    ],
)
def test_an_arc_starts_anew_after_a_gap(times: list[int], ends: list[int]) -> None:
    t = np.array(times, dtype=float)
    r, _ = truth_at(t)
    assert found(Offers()(t, r)).tolist() == ends


# -- through the step


@pytest.mark.compiled
def test_a_receiver_without_velocities_starts_the_filter() -> None:
    """GIVEN positions of 10 m alone, once a second WHEN an arc of a minute is complete THEN the filter starts within
    four sigma of what it claims and after 40 min has the orbit to a metre and 2 mm/s."""
    truth, t = kepler(), seconds(0, 2400)
    inputs = calls(t)
    put_pulses(inputs, slice(None), t)
    put_fixes(inputs, slice(None), t, truth, 10.0, 0.1, np.random.default_rng(2))
    inputs["fix_type"] = int(FixType.POSITION_3D)
    inputs["fix_has_velocity"] = 0
    inputs["fix_v_itrf_mps"] = np.nan
    memory = flying_memory(position_arc_s=ARC_S)
    outputs = fly(memory, inputs)
    first = int(np.flatnonzero(np.isfinite(outputs["r_gcrf_m"][:, 0]))[0])
    assert 60 <= first <= 64
    dr, dv = errors_rtn(outputs[first:], truth)
    claimed = math.sqrt(2.0) * 10.0 / ARC_S
    assert np.abs(dr[0]).max() <= 40.0
    assert np.abs(dv[0]).max() <= 4.0 * claimed
    assert np.sqrt(np.diag(outputs["covariance"][first])[3:]) == pytest.approx(claimed, rel=0.3)
    assert np.sqrt((dr[-300:] ** 2).sum(axis=1).mean()) <= 1.5
    assert np.sqrt((dv[-300:] ** 2).sum(axis=1).mean()) <= 3e-3
    assert record(memory.nav).rejected.sum() == 2  # before there was a time
