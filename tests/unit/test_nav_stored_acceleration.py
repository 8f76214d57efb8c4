"""Stored dA: the place on the orbit, bins, age, coverage, interpolation; a missing stretch is never zero."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flight_bench import NS, T0_GPS_NS, circular_orbit, loaded_memory, record

from flightsw.nav import stored_acceleration as stored

BINS = 36
WIDTH = 2.0 * math.pi / BINS


def bench(**overrides):
    memory = loaded_memory(
        "paper", **{"stored_da_bins": BINS, "stored_da_min_samples": 1, "stored_da_max_age_s": 6000.0, **overrides}
    )
    return record(memory.nav), record(memory.table), record(memory.work)


def state_at(u, inclination_deg=51.6, node_deg=40.0, da=(0.0, 0.0, 0.0)):
    return np.concatenate((circular_orbit(500e3, inclination_deg, node_deg, math.degrees(u)), da))


def independent_argument(x):
    """By spherical trigonometry of the ascending node found from the orbit normal, not by the kernel's products."""
    r, v = x[:3] / np.linalg.norm(x[:3]), x[3:6]
    normal = np.cross(r, v)
    normal /= np.linalg.norm(normal)
    node_angle = math.atan2(normal[0], -normal[1])
    node = np.array([math.cos(node_angle), math.sin(node_angle), 0.0])
    return math.atan2(normal @ np.cross(node, r), node @ r) % (2.0 * math.pi)


@pytest.mark.parametrize("inclination", [0.01, 1.0, 28.5, 51.6, 90.0, 97.8, 120.0, 179.99])
def test_argument_of_latitude_at_every_inclination(inclination):
    _, _, work = bench()
    for node in (0.0, 40.0, 135.0, 290.0):
        for u in np.linspace(0.0, 2.0 * math.pi, 37)[:-1]:
            x = state_at(u, inclination, node)
            got = stored.argument_of_latitude(x, work)
            assert 0.0 <= got <= 2.0 * math.pi
            for expected in (u, independent_argument(x)):
                assert abs((got - expected + math.pi) % (2.0 * math.pi) - math.pi) < 1e-10 / math.sin(
                    math.radians(inclination)
                )


@pytest.mark.parametrize(("inclination", "sense"), [(0.0, 1.0), (180.0, -1.0)])
def test_equatorial_orbits_count_from_the_x_axis_in_the_sense_of_motion(inclination, sense):
    _, _, work = bench()
    for u in np.linspace(0.1, 6.2, 20):
        x = state_at(u, inclination, 0.0)
        x[2] = x[5] = 0.0
        expected = (sense * math.atan2(x[1], x[0])) % (2.0 * math.pi)
        assert stored.argument_of_latitude(x, work) == pytest.approx(expected, abs=1e-12)


def test_argument_grows_steadily_over_an_eccentric_orbit():
    _, _, work = bench()
    x = state_at(0.3)
    x[3:6] *= 1.02
    places = []
    for _ in range(200):
        places.append(stored.argument_of_latitude(x, work))
        for _ in range(30):  # the test's own motion: symplectic Euler is enough for an order
            x[3:6] -= 3.9860044e14 / np.linalg.norm(x[:3]) ** 3 * x[:3]
            x[:3] += x[3:6]
    steps = np.diff(np.unwrap(places))
    assert (steps > 0.02).all()
    assert (steps < 0.05).all()


def fill(nav, table, work, u_values, da_of, t_gps_ns=T0_GPS_NS):
    for u in u_values:
        stored.store(nav, table, state_at(u, da=da_of(u)), t_gps_ns, work)


def recalled(nav, table, work, u, t_gps_ns=T0_GPS_NS):
    x = state_at(u, da=(7.0, 7.0, 7.0))
    ok = stored.recall(nav, table, x, t_gps_ns, work)
    return x[6:9] if ok else None


def wave(u):
    return np.array([1e-3 * math.sin(u), -2e-3 * math.cos(u), 5e-4])


def test_a_bin_holds_the_mean_of_its_last_passage():
    nav, table, work = bench()
    fill(nav, table, work, WIDTH * (5 + np.array([0.2, 0.5, 0.8])), lambda u: (1.0, 2.0, 3.0))
    fill(nav, table, work, [WIDTH * 6.5], lambda u: (9.0, 9.0, 9.0))
    values = iter([(4.0, 0.0, 0.0), (8.0, 0.0, 3.0)])
    fill(nav, table, work, WIDTH * (5 + np.array([0.3, 0.6])), lambda u: next(values))
    assert nav.da_samples[5] == 2
    np.testing.assert_allclose(nav.da_mean[5], (6.0, 0.0, 1.5))
    np.testing.assert_allclose(nav.da_mean[6], 9.0)


def test_interpolated_between_the_middles_of_bins_also_across_the_node():
    nav, table, work = bench()
    fill(nav, table, work, WIDTH * (np.arange(BINS) + 0.5), wave)
    for u in np.linspace(0.0, 2.0 * math.pi, 500, endpoint=False):
        place = u / WIDTH - 0.5
        below = math.floor(place)
        share = place - below
        expected = (1 - share) * wave((below + 0.5) * WIDTH) + share * wave((below + 1.5) * WIDTH)
        np.testing.assert_allclose(recalled(nav, table, work, u), expected, atol=1e-15)


def test_continuous_at_the_edges_and_middles_of_bins():
    nav, table, work = bench()
    fill(nav, table, work, WIDTH * (np.arange(BINS) + 0.5), wave)
    for place in np.arange(0, 2 * BINS) / 2.0:
        before, after = (recalled(nav, table, work, (place * WIDTH + e) % (2 * math.pi)) for e in (-1e-9, 1e-9))
        assert np.abs(before - after).max() < 1e-11


def test_empty_is_missing_and_leaves_the_state_alone():
    nav, table, work = bench()
    assert recalled(nav, table, work, 1.0) is None
    x = state_at(1.0, da=(1e-3, 2e-3, 3e-3))
    assert not stored.recall(nav, table, x, T0_GPS_NS, work)
    np.testing.assert_array_equal(x[6:9], (1e-3, 2e-3, 3e-3))
    assert stored.coverage_pct(nav, table, T0_GPS_NS) == 0


def test_beside_a_missing_bin_the_other_one_is_held_and_no_zero_mixed_in():
    nav, table, work = bench()
    fill(nav, table, work, WIDTH * (np.array([10, 11, 12]) + 0.5), lambda u: (2.0, 2.0, 2.0))
    for place in np.arange(9.5, 13.5, 0.05):
        value = recalled(nav, table, work, place * WIDTH)
        assert value is not None, place
        np.testing.assert_allclose(value, 2.0, rtol=1e-14)
    for place in (8.0, 9.4, 13.6, 15.0, 0.2, 35.9):
        assert recalled(nav, table, work, place * WIDTH) is None


def test_coverage_counts_bins_rounded_down():
    nav, table, work = bench()
    for filled in range(1, BINS + 1):
        fill(nav, table, work, [WIDTH * (filled - 0.5)], wave)
        assert stored.coverage_pct(nav, table, T0_GPS_NS) == math.floor(100 * filled / BINS)


def test_a_bin_ages():
    nav, table, work = bench()
    fill(nav, table, work, [WIDTH * 3.5], wave)
    fill(nav, table, work, [WIDTH * 4.5], wave, T0_GPS_NS + 100 * NS)
    assert recalled(nav, table, work, WIDTH * 3.5, T0_GPS_NS + 6000 * NS) is not None
    later = T0_GPS_NS + 6000 * NS + 1
    np.testing.assert_allclose(recalled(nav, table, work, WIDTH * 3.7, later), wave(WIDTH * 4.5))
    assert stored.coverage_pct(nav, table, later) == 100 * 1 // BINS
    assert recalled(nav, table, work, WIDTH * 3.7, later + 100 * NS) is None


def test_too_few_samples_are_missing():
    nav, table, work = bench(stored_da_min_samples=3)
    fill(nav, table, work, WIDTH * (3 + np.array([0.2, 0.4])), wave)
    assert recalled(nav, table, work, WIDTH * 3.5) is None
    fill(nav, table, work, [WIDTH * 3.6], wave)
    assert recalled(nav, table, work, WIDTH * 3.5) is not None


def test_the_last_bin_takes_what_rounding_puts_on_two_pi():
    nav, table, work = bench()
    x = state_at(0.0, 51.6, 0.0, wave(0.0))
    x[:3] = (6.9e6, 0.0, -1e-12)  # atan2 gives -1e-19: plus two pi is two pi
    x[3:6] = (0.0, 4.7e3, 6.0e3)
    stored.store(nav, table, x, T0_GPS_NS, work)
    assert nav.da_samples.sum() == 1
    assert nav.da_samples[BINS - 1] == 1
    assert stored.recall(nav, table, x, T0_GPS_NS, work)
