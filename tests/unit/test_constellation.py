"""The world's constellation: orbits, ranging, faults, GLONASS navigation files."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from hil_sim.errors import DataError
from hil_sim.truth.constellation.broadcast import FAILURES, CommonRotation, Fault, HealthyErrors, draw_failures
from hil_sim.truth.constellation.crosslinks import Ranging, View, both, flight_m, once
from hil_sim.truth.constellation.orbits import MU_M3PS2, Walker
from hil_sim.truth.orbit_files.glonass_nav import clock_m, propagate, read_glonass_nav

WALKER = Walker(first_latitude_deg=10.0)
_NAV = """\
     2.01           GLONASS NAV DATA                        RINEX VERSION / TYPE
                                                            END OF HEADER
 3 09  4  1  0 15  0.0-0.342596322298E-04-0.272848410532E-11 0.000000000000E+00
    0.256211230469E+04-0.189046859741E+00-0.186264514923E-08 0.000000000000E+00
   -0.253048676758E+05 0.253620147705E+00-0.931322574616E-09 0.500000000000E+01
   -0.194164404297E+04-0.356233310700E+01 0.279396772385E-08 0.000000000000E+00
"""


def test_orbits_are_kepler_circles() -> None:
    """GIVEN the pattern THEN radius, speed and acceleration are those of a circle, planes and slots evenly spread."""
    r, v = WALKER.states(500.0)
    np.testing.assert_allclose(np.linalg.norm(r, axis=1), WALKER.semi_major_axis_m)
    np.testing.assert_allclose(np.linalg.norm(v, axis=1), math.sqrt(MU_M3PS2 / WALKER.semi_major_axis_m))
    np.testing.assert_allclose(np.einsum("ni,ni->n", r, v), 0.0, atol=1e-1)
    later, _ = WALKER.states(500.5)
    earlier, _ = WALKER.states(499.5)
    np.testing.assert_allclose(later - earlier, v, atol=1e-4)
    assert np.degrees(np.arccos(r[0] @ r[1] / (r[0] @ r[0]))) == pytest.approx(45.0)
    normal = np.cross(r, v)
    tilt = np.degrees(np.arccos(normal[:, 2] / np.linalg.norm(normal, axis=1)))
    np.testing.assert_allclose(tilt, 64.8)
    assert sorted(np.bincount(WALKER.plane)) == [8, 8, 8]


@pytest.mark.parametrize("bad", [(24, 5, 1), (24, 3, 3), (1, 1, 0), (24, 0, 0)])
def test_a_pattern_that_is_none_is_refused(bad: tuple[int, int, int]) -> None:
    with pytest.raises(ValueError, match="Walker"):
        Walker(*bad)


def test_ranges_hold_noise_bias_clocks_and_dropouts() -> None:
    """GIVEN ranging THEN one way holds receiver minus sender clock, two ways none; the noise is as asked for."""
    r, _ = WALKER.states(0.0)
    seen = View().pairs(r)
    clock = np.arange(24.0) * 1000.0
    rng = np.random.default_rng(1)
    pairs, ranges = Ranging(0.0, bias_m=5.0).measure(WALKER, 0.0, both(seen), clock, rng)
    distance = flight_m(WALKER, 0.0)
    i, j = pairs[:, 0], pairs[:, 1]
    np.testing.assert_allclose(ranges, distance[i, j] + clock[i] - clock[j] + 5.0)
    pairs, ranges = Ranging(0.0, two_way=True).measure(WALKER, 0.0, once(seen), clock, rng)
    i, j = pairs[:, 0], pairs[:, 1]
    np.testing.assert_allclose(ranges, 0.5 * (distance[i, j] + distance[j, i]))
    many = [Ranging(11.8, dropout=0.25).measure(WALKER, 0.0, once(seen), 0.0 * clock, rng) for _ in range(200)]
    share = np.mean([len(pairs) for pairs, _ in many]) / len(once(seen))
    assert share == pytest.approx(0.75, abs=0.02)
    noise = np.concatenate([ranges - distance[pairs[:, 0], pairs[:, 1]] for pairs, ranges in many])
    assert noise.std() == pytest.approx(11.8, rel=0.03)


def test_faults_begin_grow_and_end() -> None:
    fault = Fault((3,), (1.0, 0.0, 0.0, 0.0), (0.0, 0.5, 0.0, 0.0), onset_s=10.0, duration_s=20.0)
    np.testing.assert_array_equal(fault.error_m(9.9), np.zeros(4))
    np.testing.assert_allclose(fault.error_m(14.0), [1.0, 2.0, 0.0, 0.0])
    np.testing.assert_array_equal(fault.error_m(30.0), np.zeros(4))


def test_healthy_errors_are_those_of_table_2() -> None:
    drawn = HealthyErrors().draw(200_000, np.random.default_rng(2))
    np.testing.assert_allclose(drawn[0].std(axis=0), [0.5, 3.5, 3.5, 0.0], rtol=0.01)
    np.testing.assert_allclose(drawn[1].std(axis=0), [0.0017, 0.0002, 0.0002, 0.0], rtol=0.01)


@pytest.mark.parametrize("age_s", [1.0, 294.0, 900.0, 1800.0])
def test_healthy_errors_stay_those_of_table_2(age_s: float) -> None:
    """GIVEN errors and rates of the table at an upload WHEN they have aged THEN both still have its sigma, and at the
    upload they change by the rate."""
    healthy = HealthyErrors()
    error_m, rate_mps = healthy.draw(200_000, np.random.default_rng(4))
    aged, later = healthy.at_age(error_m, rate_mps, age_s), healthy.at_age(error_m, rate_mps, age_s + 0.01)
    np.testing.assert_allclose(aged.std(axis=0), [0.5, 3.5, 3.5, 0.0], rtol=0.01)
    np.testing.assert_allclose((later - aged).std(axis=0) / 0.01, [0.0017, 0.0002, 0.0002, 0.0], rtol=0.01)
    np.testing.assert_allclose(healthy.at_age(error_m, rate_mps, 1e-3), error_m + 1e-3 * rate_mps, atol=1e-6)


def test_a_common_rotation_keeps_distances() -> None:
    r, _ = WALKER.states(0.0)
    turned = r + CommonRotation(1e-6, (1.0, 2.0, 3.0), onset_s=5.0).displacement_m(5.0, r)
    before = np.linalg.norm(r[:, None] - r[None], axis=2)
    np.testing.assert_allclose(np.linalg.norm(turned[:, None] - turned[None], axis=2), before, atol=1e-4)
    assert not CommonRotation(1e-6, onset_s=5.0).displacement_m(4.0, r).any()


def test_failures_have_the_rates_of_tables_3_and_4() -> None:
    """GIVEN a century at the standard's rates THEN counts are Poisson about them, sizes in the class's range."""
    span_s = 100.0 * 365.25 * 86400.0
    faults = draw_failures(24, span_s, np.random.default_rng(3))
    expected = sum(kind.per_satellite_hour for kind in FAILURES) * 24 * span_s / 3600.0
    assert len(faults) == pytest.approx(expected, abs=5.0 * math.sqrt(expected))
    jumps = [max(map(abs, one.jump_m)) for one in faults if any(one.jump_m)]
    ramps = [max(map(abs, one.ramp_mps)) for one in faults if any(one.ramp_mps)]
    assert min(jumps) >= 70.0
    assert max(ramps) <= 0.05
    assert all(a.onset_s <= b.onset_s for a, b in itertools.pairwise(faults))


def test_a_navigation_file_is_read_and_propagated(tmp_path: Path) -> None:
    """GIVEN a record WHEN read THEN its numbers are those printed; propagated forth and back it comes to itself."""
    path = tmp_path / "x.09g"
    path.write_text(_NAV)
    (record,) = read_glonass_nav(path)
    assert record.slot == 3
    assert record.healthy
    np.testing.assert_allclose(record.state[:3], [2562112.30469, -25304867.6758, -1941644.04297])
    np.testing.assert_allclose(record.state[3:], [-189.046859741, 253.620147705, -3562.33310700])
    # 2009-04-01 00:15 UTC is 15 s earlier than that reading of GPS time: 1525 weeks and three days after 1980-01-06
    assert record.t_gps_ns == ((1525 * 7 + 3) * 86400 + 900 + 15) * 1_000_000_000
    later = propagate(record, record.t_gps_ns + 900_000_000_000)
    back = propagate(record._replace(t_gps_ns=record.t_gps_ns + 900_000_000_000, state=later), record.t_gps_ns)
    np.testing.assert_allclose(back, record.state, atol=1e-4)
    assert clock_m(record, record.t_gps_ns) == pytest.approx(-0.342596322298e-4 * 299_792_458.0)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("nothing", "must say GLONASS"),
        (_NAV.replace("END OF HEADER", "END OF NOTHING"), "no END OF HEADER"),
        (_NAV.replace("0.256211230469E+04", "0.2562x1230469E+04"), "not a GLONASS navigation record"),
        ("\n".join(_NAV.splitlines()[:4]), "not a GLONASS navigation record"),
    ],
)
def test_a_broken_navigation_file_is_named(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "x.09g"
    path.write_text(text)
    with pytest.raises(DataError, match=told):
        read_glonass_nav(path)
