"""Inputs of the filter's studies: fixes without frames, drawn truth, burns along a known orbit."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from flightsw.kernels.registry import warm_up
from ground.accuracy.bench_cases import Case, Plan
from ground.accuracy.bench_flight import nees
from ground.accuracy.flight_model import FlightModel
from ground.errors import OperatorError
from ground.studies import arcs, consistency, recovery
from ground.studies.drawn_truth import draw
from ground.studies.flights import COARSE_TICK_NS, NS, prepare, true_motion
from ground.studies.kicks import Burn, gravity_mps2, kicked

pytestmark = pytest.mark.compiled  # a drawn truth at degree 70 would take minutes in plain Python

SPAN_S = 3000


@pytest.fixture(scope="module")
def sky() -> arcs.Sky:
    warm_up()
    return arcs.sky("simulated", SPAN_S)


def test_fixes_are_those_of_the_frames(sky: arcs.Sky) -> None:
    """GIVEN a world without noise WHEN its frames are decoded THEN they bring the fixes that the studies make."""
    case = Case(arcs.ALL_ORBITS["simulated"], "white", Plan.of(86_400), "flight")
    silent = ("gnss.sigma_position_m=0.0", "gnss.sigma_velocity_mps=0.0", "time.duration_s=300.0")
    start = f'time.start="{(sky.orbit.start + arcs.timedelta(seconds=1)).isoformat()}"'
    inputs, _ = prepare("two_orbits", [*case.scenario_settings(0), start, *silent], COARSE_TICK_NS).inputs
    framed = inputs[inputs["fix_present"] == 1]
    track = arcs.Track.of(sky, 0, 300)
    counter = arcs.COUNTER_0_NS + np.arange(300, dtype=np.int64) * NS
    made = arcs.measured(sky, track, arcs.Receiver(0.0, 0.0), counter, arcs.stream(0))
    at = np.searchsorted(made["fix_gps_ns"], framed["fix_gps_ns"])
    known = at < len(made)
    assert known.sum() > 290
    for name, tolerance in (("fix_r_itrf_m", 1e-3), ("fix_v_itrf_mps", 1e-5)):
        np.testing.assert_allclose(made[name][at[known]], framed[name][known], rtol=0, atol=tolerance)
    for name in ("fix_gps_ns", "fix_type", "fix_has_velocity"):
        np.testing.assert_array_equal(made[name][at[known]], framed[name][known])


def test_truth_at_the_calls_is_the_motion(sky: arcs.Sky) -> None:
    """GIVEN the truth's own interpolation WHEN a call comes a little after a second THEN both agree to micrometres."""
    settings = ("outage=[]", 'time.scale="gps"', f"time.duration_s={float(SPAN_S)}", *sky.orbit.settings)
    start = f'time.start="{(sky.orbit.start + arcs.timedelta(seconds=1)).isoformat()}"'
    truth, _ = true_motion("two_orbits", (*settings, start))
    r, v = arcs.Track.of(sky, 100, 500).at_calls()
    r_true, v_true = truth.state_gcrf(sky.t_gps_ns[100:600] + arcs.AFTER_NS)
    np.testing.assert_allclose(r, r_true, rtol=0, atol=1e-5)
    # ends of the track have one-sided differences
    np.testing.assert_allclose(v[1:-1], v_true[1:-1], rtol=0, atol=1e-7)


def test_an_oscillator_wanders_as_told() -> None:
    """GIVEN white frequency noise and a walk of the drift WHEN many are drawn THEN their phases spread as they must."""
    phase, drift, n = 1e-18, 4e-19, 400
    errors = []
    for seed in range(600):
        counter = arcs.oscillator_ns(arcs.stream(seed, 1), n, phase, drift)
        error_s = -(counter - arcs.COUNTER_0_NS - np.arange(n) * NS) * 1e-9
        slope = arcs.stream(seed, 1)
        slope.standard_normal((n, 2))
        errors.append(error_s - arcs.DRIFT_SPS * slope.standard_normal() * np.arange(n))
    spread = np.std(errors, axis=0)[-1]
    t = n - 1.0
    assert spread == pytest.approx(math.sqrt(phase * t + drift * t**3 / 3.0), rel=0.08)


def test_coloured_noise_is_stationary_and_forgets() -> None:
    x = arcs.coloured(arcs.stream(7), 40_000, 5.0, 30.0)
    assert x[:100].shape == (100, 3)
    assert x.std() == pytest.approx(5.0, rel=0.05)
    assert np.mean(x[:-30] * x[30:]) / 25.0 == pytest.approx(math.exp(-1.0), abs=0.05)


def test_a_drawn_truth_without_noise_is_the_force_model(sky: arcs.Sky) -> None:
    """GIVEN no process noise WHEN a truth is drawn THEN it is where the ground's model propagates to."""
    memory = sky.memory(
        "flight",
        {"empirical_sigma_mps2": 0.0, "omitted_gravity_sigma_mps2": 0.0, "drag_sigma": 0.0, "drag_slow_sigma": 0.0},
    )
    track = draw(sky, memory, 10, 601, arcs.stream(1))
    settings = {name: memory.forces[name][0].item() for name in memory.forces.dtype.names or ()}
    settings = {name: settings[name] for name in ("area_to_mass_m2pkg", "degree", "f107", "f107_mean", "ap")}
    model = FlightModel(memory.orientation, None, settings)
    end = model.propagate(int(sky.t_gps_ns[10]), np.hstack((sky.r_m[10], sky.v_mps[10])), 600 * NS)
    np.testing.assert_allclose(track.r_m[-1], end[:3], rtol=0, atol=1e-4)


def test_a_drawn_truth_is_pushed_as_the_table_says(sky: arcs.Sky) -> None:
    """GIVEN accelerations that hardly change WHEN many truths are drawn THEN they part as sigma t^2 / 2."""
    calm = {"empirical_sigma_mps2": 0.0, "omitted_gravity_sigma_mps2": 0.0, "drag_sigma": 0.0, "drag_slow_sigma": 0.0}
    pushed = {**calm, "empirical_sigma_mps2": 1e-6, "empirical_tau_s": 1e6}
    still = draw(sky, sky.memory("flight", calm), 10, 101, arcs.stream(1))
    memory = sky.memory("flight", pushed)
    ends = [draw(sky, memory, 10, 101, arcs.stream(seed)).r_m[-1] - still.r_m[-1] for seed in range(150)]
    assert np.std(ends) == pytest.approx(1e-6 * 100.0**2 / 2.0, rel=0.1)


def test_white_accelerations_are_refused(sky: arcs.Sky) -> None:
    memory = sky.memory("flight", {"white_along_m2ps3": 1e-12})
    with pytest.raises(OperatorError, match="draws none; set them 0"):
        draw(sky, memory, 0, 10, arcs.stream(1))


def test_a_burn_moves_the_orbit_as_satkit_moves_it(sky: arcs.Sky) -> None:
    """GIVEN satkit's truth with a burn of 4.6 m/s WHEN the orbit without it is kicked THEN they agree."""
    start = f'time.start="{(sky.orbit.start + arcs.timedelta(seconds=1)).isoformat()}"'
    settings = ("outage=[]", 'time.scale="gps"', start, f"time.duration_s={float(SPAN_S)}", *sky.orbit.settings)
    dv = (1.0, 4.0, -2.0)
    burn = f"burn=[{{start_s=200.0, duration_s=20.0, dv_mps={list(dv)}, announced=false}}]"
    truth, _ = true_motion("two_orbits", (*settings, burn))
    (moved,) = kicked(arcs.Track.of(sky, 0, 2000), [Burn(200, 20, np.array(dv))])
    r, v = truth.state_gcrf(sky.t_gps_ns[:2000])
    away = np.linalg.norm(r - sky.r_m[:2000], axis=1)
    assert away[-1] > 5000.0
    left = np.linalg.norm(moved.r_m - r, axis=1)
    assert np.all(left[:301] <= 1e-6 + 1e-6 * away[:301])
    assert np.all(left[:1001] <= 1e-3 + 3e-5 * away[:1001])
    assert np.all(left <= 1e-3 + 1e-4 * away)
    assert np.linalg.norm(moved.v_mps[230] - v[230]) < 1e-6


def test_gravity_of_a_burn_is_a_gradient_of_its_potential() -> None:
    """GIVEN the potential of central field and J2 WHEN differentiated in 40 digits THEN it is the acceleration."""
    from ground.studies import kicks

    point = (5.1e6, -3.2e6, 3.4e6)

    def potential(x: mpmath.mpf, y: mpmath.mpf, z: mpmath.mpf) -> mpmath.mpf:
        r = mpmath.sqrt(x * x + y * y + z * z)
        p2 = (3 * (z / r) ** 2 - 1) / 2
        return kicks.MU_M3PS2 / r * (1 - kicks.J2 * (kicks.RADIUS_M / r) ** 2 * p2)

    with mpmath.workdps(40):
        expected = [float(mpmath.diff(potential, point, n)) for n in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    np.testing.assert_allclose(gravity_mps2(np.array([point]))[0], expected, rtol=1e-12)


@pytest.mark.parametrize("dof", [100.0, 600.0, 1200.0])
@pytest.mark.parametrize("z", [-1.959963984540054, 0.0, 1.959963984540054])
def test_quantiles_of_chi_square(dof: float, z: float) -> None:
    """GIVEN a quantile WHEN put into the regularised incomplete gamma function THEN it gives the probability back."""
    p = mpmath.gammainc(dof / 2, 0, consistency.chi_square(dof, z) / 2, regularized=True)
    assert float(p) == pytest.approx(0.5 * math.erfc(-z / math.sqrt(2.0)), abs=2e-4)


def test_a_series_counts_what_is_in_its_band() -> None:
    """GIVEN chi-square draws, but at one of four epochs twice as large WHEN summed up THEN three of four are inside."""
    draws = np.sum(arcs.stream(5).standard_normal((200, 4, 6)) ** 2, axis=2)
    draws *= 6.0 * np.array([1.0, 0.95, 2.0, 1.07]) / draws.mean(axis=0)
    series = consistency.Series.of("NEES", np.arange(4), draws, 6)
    assert series.inside == 0.75
    assert series.mean == pytest.approx([1.0, 0.95, 2.0, 1.07])
    assert series.low < 1.0 < series.high


def test_a_redrawn_state_errs_as_its_covariance_says(sky: arcs.Sky) -> None:
    """GIVEN a converging filter WHEN its error is drawn anew many times THEN the mean NEES is that of chi-square."""
    flight = arcs.Flight(sky, "flight", arcs.WHITE, arcs.stream(3))
    flight.until(900)
    published = flight.outputs[-1:]
    error = arcs.Errors.of(flight.track.part(898, 900), flight.outputs[-2:])
    noise = arcs.stream(4)
    values = []
    for _ in range(400):
        other = arcs.fork(flight.memory)
        recovery.redraw(other, np.concatenate((error.r_m[-1], error.v_mps[-1])), noise)
        moved = other.nav["x"][0, :6] - flight.memory.nav["x"][0, :6]
        now = np.concatenate((error.r_m[-1], error.v_mps[-1])) + moved
        values.append(nees(now[None], published["covariance"])[0] / 6.0)
        kept = other.nav["history_x"][0, 0, 3:6] - flight.memory.nav["history_x"][0, 0, 3:6]
        np.testing.assert_allclose(kept, moved[3:])
    low, high = consistency.band(6, len(values))
    assert low - 0.03 < np.mean(values) < high + 0.03
