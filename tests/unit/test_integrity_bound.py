"""The two bounds against numpy: per axis (12), and the sphere of the largest eigenvalue."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flight_bench import loaded_memory, record
from flight_filter_bench import fixes_every_second, fly, flying_memory, kepler

from flightsw.integrity.bound import axis_bound_m, radius_bound_m


def covariance(seed):
    root = np.random.default_rng(seed).standard_normal((9, 9)) * np.repeat([300.0, 0.5, 1e-4], 3)[:, None]
    return root @ root.T


def test_bounds_of_a_covariance():
    table = record(loaded_memory("paper", k_axis=2.5, k_radius=3.73).table)
    for seed in range(50):
        p = covariance(seed)
        assert axis_bound_m(table, p) == pytest.approx(2.5 * math.sqrt(np.diag(p)[:3].max()), rel=1e-14)
        assert radius_bound_m(table, p) == pytest.approx(3.73 * math.sqrt(np.linalg.eigvalsh(p[:3, :3])[-1]), rel=1e-12)


def test_a_turn_of_the_axes_moves_one_bound_and_not_the_other():
    """REFERENCE S0, finding 4: the axis bound dips, here to 1/sqrt(3); the sphere stays."""
    table = record(loaded_memory("paper").table)
    along = np.zeros((9, 9))
    along[0, 0] = 1e6
    q, _ = np.linalg.qr(np.column_stack((np.ones(3), [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])))
    turned = np.zeros((9, 9))
    turned[:3, :3] = q @ along[:3, :3] @ q.T
    assert axis_bound_m(table, turned) == pytest.approx(axis_bound_m(table, along) / math.sqrt(3.0), rel=1e-12)
    assert radius_bound_m(table, turned) == pytest.approx(radius_bound_m(table, along), rel=1e-12)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("variance", [math.nan, -1.0, math.inf])
def test_a_broken_variance_on_any_axis_gives_no_finite_bound(axis, variance):
    """A bound over the two good axes would look healthy."""
    table = record(loaded_memory("paper").table)
    p = covariance(1)
    p[axis, axis] = variance
    assert not math.isfinite(axis_bound_m(table, p))
    if variance != -1.0:
        assert not math.isfinite(radius_bound_m(table, p))


@pytest.mark.compiled
def test_an_outage_begins_with_the_bound_of_its_last_fix():
    """GIVEN a margin while fixes come WHEN GNSS is lost THEN the bound waits until the growing one has passed it."""
    inputs = fixes_every_second(0, 3000, kepler(), np.random.default_rng(4))
    inputs["fix_present"][1000:] = 0
    plain = fly(flying_memory(fixes_margin=1.0), inputs.copy())
    wide = fly(flying_memory(fixes_margin=1.25), inputs.copy())
    assert np.array_equal(plain["r_gcrf_m"], wide["r_gcrf_m"], equal_nan=True)
    for name in ("bound_m", "bound_3d_m"):
        assert wide[name][5:1000] == pytest.approx(1.25 * plain[name][5:1000], rel=1e-12)
        held = np.maximum(plain[name][1002:], wide[name][999])
        assert wide[name][1002:] == pytest.approx(held, rel=1e-12)
        assert held[0] > plain[name][1002]
        assert held[-1] == plain[name][-1]
