"""Oscillator, receiver and random streams."""

import msgspec
import numpy as np
import pytest

from hil_sim import gps_time, scenario
from hil_sim.scenario_schema import Gnss, Outage
from hil_sim.scenario_schema import Oscillator as OscillatorSettings
from hil_sim.sensors import gnss_receiver
from hil_sim.sensors.oscillator import Oscillator
from hil_sim.sensors.streams import open_streams
from hil_sim.world import World

T0_NS = scenario.load("two_orbits").t_start_gps_ns
HOUR_NS = 3600 * gps_time.NS


def oscillator(**settings: float) -> Oscillator:
    return Oscillator(OscillatorSettings(**settings), T0_NS, HOUR_NS, np.random.default_rng(1))


def test_counter_of_a_steady_oscillator() -> None:
    """offset + (1 + drift) t: 1 ppm gains 3.6 ms in an hour, to the nanosecond."""
    clock = oscillator(offset_s=123.456, drift_ppm=1.0, random_walk=0.0)
    t = T0_NS + np.array([0, 1_000_000, HOUR_NS])
    assert clock.counter_ns(t).tolist() == [
        123_456_000_000,
        123_456_000_000 + 1_000_001,
        123_456_000_000 + HOUR_NS + 3_600_000,
    ]


@pytest.mark.parametrize("drift_ppm", [-100.0, 0.0, 1.0, 100.0])
@pytest.mark.parametrize("random_walk", [0.0, 1e-7])
def test_inverse_to_the_nanosecond(drift_ppm: float, random_walk: float) -> None:
    clock = oscillator(offset_s=-5e6, drift_ppm=drift_ppm, random_walk=random_walk)
    t = T0_NS + np.random.default_rng(2).integers(0, HOUR_NS, 2000)
    assert np.abs(clock.true_time_ns(clock.counter_ns(t)) - t).max() <= 1


def test_random_walk_grows_with_the_root_of_time() -> None:
    """1e-8 s/sqrt(s) over 900 s: 300 ns, here from 400 independent clocks."""
    ends = []
    for seed in range(400):
        clock = Oscillator(
            OscillatorSettings(offset_s=0.0, drift_ppm=0.0, random_walk=1e-8),
            T0_NS,
            900 * gps_time.NS,
            np.random.default_rng(seed),
        )
        ends.append(clock.counter_ns(np.array([T0_NS + 900 * gps_time.NS]))[0] - 900 * gps_time.NS)
    assert np.std(ends) == pytest.approx(300.0, rel=0.12)


def test_phase_under_a_walking_drift_grows_with_the_power_three_halves() -> None:
    """A drift that walks by 1e-9/sqrt(s) displaces the phase by 1e-9 sqrt(t^3 / 3): 15.6 us after 900 s."""
    settings = OscillatorSettings(offset_s=0.0, drift_ppm=0.0, random_walk=0.0, drift_walk=1e-9)
    ends = []
    for seed in range(400):
        clock = Oscillator(settings, T0_NS, 900 * gps_time.NS, np.random.default_rng(seed))
        t = T0_NS + np.array([225, 900]) * gps_time.NS
        ends.append(clock.counter_ns(t) - (t - T0_NS))
    assert np.std(ends, axis=0) == pytest.approx([1950.0, 15_600.0], rel=0.12)
    assert clock.counter_ns(np.array([T0_NS]))[0] == 0


def test_epochs_are_whole_gps_seconds() -> None:
    """GIVEN a start between seconds WHEN fixes are taken at 2 Hz THEN they fall on whole and half GPS seconds."""
    t = gnss_receiver.epochs_ns(T0_NS + 123_456_789, T0_NS + 3 * gps_time.NS, 500_000_000)
    assert ((t - T0_NS) / 1e9).tolist() == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]


def test_coloured_noise_has_its_sigma_and_correlation() -> None:
    noise = gnss_receiver.coloured_noise(np.random.default_rng(4), 200_000, 1.0, 5.0, 60.0)
    assert np.std(noise, axis=0) == pytest.approx([5.0] * 3, rel=0.1)
    lag = 60
    correlation = [np.corrcoef(noise[:-lag, k], noise[lag:, k])[0, 1] for k in range(3)]
    assert correlation == pytest.approx([np.exp(-1.0)] * 3, abs=0.06)


def test_streams_are_independent_and_repeatable() -> None:
    first, again, other = open_streams(1), open_streams(1), open_streams(2)
    draws = [first[i].standard_normal(2000) for i in range(6)]
    assert np.array_equal(draws[0], again.position_noise.standard_normal(2000))
    draws.append(other.position_noise.standard_normal(2000))
    correlations = np.abs(np.corrcoef(draws) - np.eye(7))
    assert correlations.max() < 0.1


def build(*overrides: str) -> World:
    return World.build(scenario.load("two_orbits", ["time.duration_s=1200", "outage=[]", *overrides]))


def test_fixes_measure_the_truth_with_the_noise_asked_for() -> None:
    world = build("gnss.sigma_position_m=33", "gnss.sigma_velocity_mps=1")
    arrays = world.truth_arrays()
    assert len(arrays["fix_t_gps_ns"]) == 1201
    assert np.all(arrays["fix_t_gps_ns"] % gps_time.NS == 0)
    assert np.std(arrays["fix_error_m"], axis=0) == pytest.approx([33.0] * 3, rel=0.08)
    r, _ = world.truth.state_gcrf(arrays["fix_t_gps_ns"])
    assert np.array_equal(r, arrays["fix_r_gcrf_m"])


def test_an_outage_leaves_all_other_noise_as_it_was() -> None:
    """GIVEN one seed WHEN an outage is added THEN every fix outside it is bit for bit the same."""
    plain, broken = build(), build("outage.0.start_s=300", "outage.0.duration_s=400")
    kept = np.isin(plain.truth_arrays()["fix_t_gps_ns"], broken.truth_arrays()["fix_t_gps_ns"])
    assert kept.sum() == 801
    assert np.array_equal(plain.truth_arrays()["fix_error_m"][kept], broken.truth_arrays()["fix_error_m"])


def test_dropouts_happen_as_often_as_asked() -> None:
    world = build("gnss.dropout_probability=0.25")
    assert len(world.truth_arrays()["fix_t_gps_ns"]) == pytest.approx(900, abs=60)


def claimed(**gnss: float) -> World:
    loaded = scenario.load("two_orbits", ["time.duration_s=60", "outage=[]"])
    settings = Gnss(sigma_position_m=3.0, sigma_velocity_mps=0.1, **gnss)
    return World.build(loaded._replace(scenario=msgspec.structs.replace(loaded.scenario, gnss=settings)))


def test_a_receiver_claims_its_white_noise_and_knows_nothing_of_errors_that_last() -> None:
    for lasting in ({}, {"coloured_sigma_m": 4.0}, {"periodic_sigma_m": 4.0}):
        world = claimed(**lasting)
        assert np.all(world._fixes.sigma_r_m == 3.0)
        assert np.all(world._fixes.sigma_v_mps == 0.1)


def test_a_claimed_sigma_of_the_scenario_is_what_the_receiver_says() -> None:
    """GIVEN a claim of its own THEN the frames hold it, and the measured positions are as without it."""
    world, plain = claimed(coloured_sigma_m=4.0, claimed_sigma_m=5.0), claimed(coloured_sigma_m=4.0)
    assert np.all(world._fixes.sigma_r_m == 5.0)
    assert np.array_equal(world._fixes.r_itrf_m, plain._fixes.r_itrf_m)


def test_window_of_an_outage_is_half_open() -> None:
    t = T0_NS + np.array([9, 10, 19, 20]) * gps_time.NS
    hidden = gnss_receiver.in_outage(t, (Outage(start_s=10.0, duration_s=10.0),), T0_NS)
    assert hidden.tolist() == [False, True, True, False]
