"""Interpolation between nodes, against motions known in closed form."""

import numpy as np
import pytest

from hil_sim.truth.hermite import HermiteTrack, interpolate_uneven

RATE_RADPS = 2.0 * np.pi / 5580.0
RADIUS_M = 6.8e6
T0_NS = 1_230_336_000_000_000_000


def circle(t_s: np.ndarray) -> list[np.ndarray]:
    """Position, velocity, acceleration on an inclined circle, each (n, 3)."""
    c, s = np.cos(RATE_RADPS * t_s), np.sin(RATE_RADPS * t_s)
    r = RADIUS_M * np.stack((c, 0.6 * s, 0.8 * s), axis=1)
    v = RADIUS_M * RATE_RADPS * np.stack((-s, 0.6 * c, 0.8 * c), axis=1)
    return [r, v, -(RATE_RADPS**2) * r]


def track(step_s: float, count: int) -> HermiteTrack:
    r, v, _ = circle(np.arange(count) * step_s)
    return HermiteTrack(T0_NS, round(step_s * 1e9), r, v)


@pytest.mark.parametrize("step_s", [10.0, 60.0, 120.0])
def test_circle_between_nodes(step_s: float) -> None:
    """Inside, rounding alone is left; in the two outer intervals the one-sided window amplifies it a little."""
    path = track(step_s, 60)
    step_ns = round(step_s * 1e9)
    offsets_ns = np.random.default_rng(1).integers(2 * step_ns, 57 * step_ns, 500)
    r, v, a = path.evaluate(T0_NS + offsets_ns, derivatives=2)
    expected = circle(offsets_ns / 1e9)
    assert np.abs(r - expected[0]).max() < 2e-8
    assert np.abs(v - expected[1]).max() < 1e-8
    assert np.abs(a - expected[2]).max() < 1e-8
    outer_ns = np.random.default_rng(2).integers(0, 2 * step_ns, 200)
    r, v = path.evaluate(T0_NS + outer_ns)
    assert np.abs(r - circle(outer_ns / 1e9)[0]).max() < 1e-5
    assert np.abs(v - circle(outer_ns / 1e9)[1]).max() < 1e-5


def test_nodes_themselves_are_returned() -> None:
    path = track(60.0, 12)
    r, v, _ = circle(np.arange(12) * 60.0)
    got_r, got_v = path.evaluate(T0_NS + np.arange(2, 9) * 60_000_000_000)
    assert np.abs(got_r - r[2:9]).max() < 2e-8
    assert np.abs(got_v - v[2:9]).max() < 1e-8


def test_one_nanosecond_is_resolved_at_todays_gps_time() -> None:
    """GIVEN 1.2e18 ns since the GPS epoch WHEN the time moves by 1 ns THEN the position moves by 7.66 micrometres."""
    path = track(10.0, 60)
    (r, _) = path.evaluate(T0_NS + np.array([123_456_789_000, 123_456_789_001]))
    assert np.linalg.norm(r[1] - r[0]) == pytest.approx(RADIUS_M * RATE_RADPS * 1e-9, abs=2e-9)


@pytest.mark.parametrize("offset_ns", [-1, 11 * 10_000_000_000 + 1])
def test_outside_is_refused(offset_ns: int) -> None:
    with pytest.raises(ValueError, match="outside"):
        track(10.0, 12).evaluate(np.array([T0_NS + offset_ns]))


def test_too_few_nodes_are_refused() -> None:
    with pytest.raises(ValueError, match="nodes"):
        track(10.0, 5)


def test_uneven_nodes_as_good_as_even_ones() -> None:
    """GIVEN nodes 5 to 120 s apart on a circle WHEN interpolated THEN micrometres; at a node its own values."""
    steps_s = np.random.default_rng(4).integers(5, 121, 60).astype(float)
    nodes_s = np.concatenate(([0.0], np.cumsum(steps_s)))
    t_ns = T0_NS + np.rint(nodes_s * 1e9).astype(np.int64)
    r, v, _ = circle(nodes_s)
    offsets_ns = np.random.default_rng(5).integers(t_ns[3] - T0_NS, t_ns[-4] - T0_NS, 500)
    got_r, got_v = interpolate_uneven(t_ns, r, v, T0_NS + offsets_ns)
    expected = circle(offsets_ns / 1e9)
    assert np.abs(got_r - expected[0]).max() < 1e-6
    assert np.abs(got_v - expected[1]).max() < 1e-6
    got_r, got_v = interpolate_uneven(t_ns, r, v, t_ns)
    assert np.abs(got_r - r).max() < 1e-6
    assert np.abs(got_v - v).max() < 1e-6


def test_uneven_interpolation_agrees_with_the_track() -> None:
    path = track(60.0, 30)
    r, v, _ = circle(np.arange(30) * 60.0)
    at = T0_NS + np.random.default_rng(6).integers(0, 29 * 60_000_000_000, 300)
    got_r, got_v = interpolate_uneven(T0_NS + np.arange(30) * 60_000_000_000, r, v, at)
    expected = path.evaluate(at)
    assert np.abs(got_r - expected[0]).max() < 1e-5
    assert np.abs(got_v - expected[1]).max() < 1e-5


def test_uneven_outside_and_too_few_are_refused() -> None:
    t_ns = T0_NS + np.arange(8) * 60_000_000_000
    r, v, _ = circle(np.arange(8) * 60.0)
    with pytest.raises(ValueError, match="outside"):
        interpolate_uneven(t_ns, r, v, t_ns[-1:] + 1)
    with pytest.raises(ValueError, match="least"):
        interpolate_uneven(t_ns[:5], r[:5], v[:5], t_ns[:1])
