"""How the body is turned, where that puts the antenna, what is reported of it; errors with the period of the orbit."""

from __future__ import annotations

import numpy as np
import pytest

from flightsw.icd.can_frames import ATTITUDE
from hil_sim import scenario
from hil_sim.scenario_schema import Attitude
from hil_sim.sensors import attitude, gnss_receiver
from hil_sim.sensors.attitude import Pointing, multiply, quaternions
from hil_sim.sensors.streams import open_streams
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.local_frames import argument_of_latitude, rtn_axes
from hil_sim.world import World, build_truth

NS = 1_000_000_000
ORBIT = ("time.duration_s=6000", "outage=[]")
QUIET = ("gnss.sigma_position_m=0", "gnss.sigma_velocity_mps=0")


@pytest.fixture(scope="module")
def truth():
    return build_truth(scenario.load("two_orbits", ORBIT))


def times(truth, step_s: float = 7.0, margin_s: float = 60.0) -> np.ndarray:
    start, stop = truth.t_first_gps_ns + round(margin_s * NS), truth.t_last_gps_ns - round(margin_s * NS)
    return np.arange(start, stop, round(step_s * NS))


def build(*settings: str) -> World:
    return World.build(scenario.load("two_orbits", [*ORBIT, *settings]))


def test_nadir_pointing_axes(truth) -> None:
    """z points to the Earth, y against the angular momentum, x = y cross z lies on the side of the velocity."""
    r, v = truth.state_gcrf(times(truth))
    axes = Pointing().body_axes(r, v)
    np.testing.assert_allclose(axes[:, 2], -r / np.linalg.norm(r, axis=1, keepdims=True), atol=1e-15)
    h = np.cross(r, v)
    np.testing.assert_allclose(axes[:, 1], -h / np.linalg.norm(h, axis=1, keepdims=True), atol=1e-15)
    np.testing.assert_allclose(axes[:, 0], np.cross(axes[:, 1], axes[:, 2]), atol=1e-15)
    assert (np.einsum("ni,ni->n", axes[:, 0], v) > 7000.0).all()


@pytest.mark.parametrize(
    ("pointing", "axis_of_body", "where"),
    [
        (Pointing(yaw_rad=np.pi / 2), 0, "-cross"),  # right turn: the nose to the right of the track, starboard
        (Pointing(pitch_rad=np.pi / 6), 0, "nose up"),
        (Pointing(roll_rad=np.pi / 2), 1, "nadir"),  # right wing down
    ],
)
def test_sense_of_the_turns(truth, pointing: Pointing, axis_of_body: int, where: str) -> None:
    """Yaw, pitch and roll as in flight mechanics (3-2-1): nose right, nose up, right side down."""
    r, v = truth.state_gcrf(times(truth)[:1])
    radial, along, cross = rtn_axes(r, v)[0]
    expected = {
        "-cross": -cross,
        "nose up": np.cos(np.pi / 6) * along + np.sin(np.pi / 6) * radial,
        "nadir": -radial,
    }[where]
    np.testing.assert_allclose(pointing.body_axes(r, v)[0, axis_of_body], expected, atol=1e-12)


TURNS = [
    Pointing(),
    Pointing(0.3, -0.2, 0.1),
    Pointing(3.0, 1.5, -3.1),
    Pointing(np.pi, 0.0, 0.0),
    Pointing(0, 0, np.pi),
]


@pytest.mark.parametrize("pointing", TURNS)
def test_quaternion_says_the_same_as_the_matrix_and_as_satkit(truth, pointing: Pointing) -> None:
    """v_body = q* v_gcrf q by Hamilton's rules written out here, and by satkit's own quaternion; whatever component is
    the largest."""
    satkit = pytest.importorskip("satkit")
    axes = pointing.body_axes(*truth.state_gcrf(times(truth, 97.0)))
    q = quaternions(axes)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-15)
    assert (q[:, 0] >= 0.0).all()
    vector = np.array([0.3, -1.2, 2.5])
    conjugate = q * [1.0, -1.0, -1.0, -1.0]
    v = np.tile(np.concatenate(([0.0], vector)), (len(q), 1))
    turned = multiply(multiply(conjugate, v), q)
    np.testing.assert_allclose(turned[:, 1:], axes @ vector, atol=1e-14)
    np.testing.assert_allclose(turned[:, 0], 0.0, atol=1e-14)
    for row, matrix in zip(q[:20], axes[:20], strict=True):
        theirs = satkit.quaternion(*row).conj() * vector  # w, x, y, z; rotates a vector by q v q*
        np.testing.assert_allclose(theirs, matrix @ vector, atol=1e-13)


@pytest.mark.parametrize("pointing", TURNS[:3])
def test_antenna_moves_with_the_velocity_that_is_said(truth, pointing: Pointing) -> None:
    """GIVEN an antenna 100 m off WHEN its position is differentiated THEN that is its velocity, to 1 micrometre per
    second: the turn of the orbit's plane by J2 (up to 2e-6 rad/s, 0.2 mm/s here) is in it."""
    offset = np.array([60.0, -50.0, 62.0])
    t = times(truth, 13.0)
    _, velocity = pointing.lever(truth, t, offset)
    h = round(0.5 * NS)
    f = {k: pointing.lever(truth, t + k * h, offset)[0] for k in (-2, -1, 1, 2)}
    derivative = (8.0 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12.0 * h / 1e9)
    assert np.abs(velocity - derivative).max() < 1e-6
    assert np.linalg.norm(velocity, axis=1).max() > 0.05


def test_lever_arm_has_its_length_and_direction(truth) -> None:
    r, v = truth.state_gcrf(times(truth))
    radial, along, cross = rtn_axes(r, v).transpose(1, 0, 2)
    arm, _ = Pointing().lever(truth, times(truth), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(arm, along - 2.0 * cross - 3.0 * radial, atol=1e-12)


def test_receiver_measures_at_its_antenna() -> None:
    """GIVEN no noise and an antenna off the centre THEN fixes in GCRF are truth and lever arm, position and velocity;
    the truth that is recorded stays that of the centre of mass, and the error of a fix is that of measuring."""
    world = build(*QUIET, "gnss.antenna_offset_m=[1.5, -0.5, 2.0]", "attitude.sigma_rad=0", "attitude.pitch_deg=20")
    plain = build(*QUIET)
    t = world._fixes.t_true_gps_ns
    orientation = EarthOrientation(int(t[0]), int(t[-1]))
    r, v = orientation.to_gcrf(t, world._fixes.r_itrf_m, world._fixes.v_itrf_mps)
    true_r, true_v = world.truth.state_gcrf(t)
    arm, speed = Pointing(pitch_rad=np.radians(20.0)).lever(world.truth, t, np.array([1.5, -0.5, 2.0]))
    np.testing.assert_allclose(r - true_r, arm, atol=1e-7)
    np.testing.assert_allclose(v - true_v, speed, atol=1e-9)
    np.testing.assert_array_equal(world._fixes.r_true_gcrf_m, plain._fixes.r_true_gcrf_m)
    assert not world._fixes.error_gcrf_m.any()


def test_reported_attitude_has_its_sigma_and_its_times() -> None:
    """GIVEN 2 Hz and 2 mrad THEN frames at every half second, late by the latency, each turned from the truth by errors
    of that sigma about the body's axes; and not one random draw of the receiver is another."""
    world = build("attitude.rate_hz=2", "attitude.sigma_rad=0.002", "attitude.latency_s=0.3")
    frames = [(k, p) for k in range(world.n_ticks) for i, p in world.frames_due(k) if i == ATTITUDE.frame_id]
    records = np.frombuffer(b"".join(p for _, p in frames), ATTITUDE.dtype)
    t = records["t_gps_ns"]
    assert (np.diff(t) == NS // 2).all()
    assert (t % (NS // 2) == 0).all()
    ticks = np.array([k for k, _ in frames])
    assert np.abs((world.t_true_gps_ns[ticks] - t) / 1e9 - 0.3).max() < 0.11
    np.testing.assert_array_equal(records["sigma_rad"], np.float32(0.002))
    reported = np.stack([records[f"q_{c}"] for c in "wxyz"], axis=1).astype(float)
    true = quaternions(Pointing().body_axes(*world.truth.state_gcrf(t)))
    error = multiply(true * [1.0, -1.0, -1.0, -1.0], reported)
    angles = 2.0 * error[:, 1:] * np.sign(error[:, :1])
    assert angles.std(axis=0) == pytest.approx([0.002] * 3, rel=0.05)
    assert np.abs(angles.mean(axis=0)).max() < 4.0 * 0.002 / np.sqrt(len(t))
    assert records["counter"].tolist() == [n % 256 for n in range(len(t))]
    assert np.array_equal(world._fixes.r_itrf_m, build()._fixes.r_itrf_m)


def test_a_zero_sigma_of_attitude_is_never_claimed(truth) -> None:
    series = attitude.measure(truth, Pointing(), Attitude(sigma_rad=0.0), times(truth), np.random.default_rng(1))
    assert series.sigma_rad == attitude.MINIMUM_SIGMA_RAD
    np.testing.assert_allclose(series.q, quaternions(Pointing().body_axes(*truth.state_gcrf(times(truth)))), atol=1e-15)


def test_argument_of_latitude(truth) -> None:
    """Zero where the satellite passes the equator northwards, a quarter turn at its northernmost point, rising; on the
    equator itself counted from x."""
    t = times(truth, 1.0)
    r, v = truth.state_gcrf(t)
    u = np.unwrap(argument_of_latitude(r, v))
    assert (np.diff(u) > 0.0).all()
    up = np.flatnonzero((r[:-1, 2] < 0.0) & (r[1:, 2] >= 0.0))
    assert len(up) >= 1
    assert np.abs((u[up] + np.pi) % (2 * np.pi) - np.pi).max() < 2e-3
    top = np.argmax(r[:, 2])
    assert np.sin(u[top]) == pytest.approx(1.0, abs=1e-5)
    flat = argument_of_latitude(np.array([[0.0, 7e6, 0.0]]), np.array([[-7500.0, 0.0, 0.0]]))
    assert flat == pytest.approx([np.pi / 2])


def test_periodic_error_is_one_harmonic_of_the_orbit_along_rtn() -> None:
    """GIVEN nothing but this error WHEN it is fitted with cos u and sin u along R, T and N THEN nothing is left; the
    velocity has none of it."""
    world = build(*QUIET, "gnss.periodic_sigma_m=5", "seed=3")
    t = world._fixes.t_true_gps_ns
    r, v = world.truth.state_gcrf(t)
    error = np.einsum("nij,nj->ni", rtn_axes(r, v), world._fixes.error_gcrf_m)
    u = argument_of_latitude(r, v)
    basis = np.stack((np.cos(u), np.sin(u)), axis=1)
    amplitudes, *_ = np.linalg.lstsq(basis, error, rcond=None)
    assert np.abs(error - basis @ amplitudes).max() < 1e-9
    assert (np.abs(amplitudes) > 1e-3).all()
    assert np.array_equal(world._fixes.v_itrf_mps, build(*QUIET, "seed=3")._fixes.v_itrf_mps)
    # the claim is of the white noise, here none
    assert np.all(world._fixes.sigma_r_m == gnss_receiver.MINIMUM_SIGMA_M)


def test_periodic_amplitudes_have_the_sigma_of_the_scenario() -> None:
    """GIVEN 300 seeds THEN A and B of each axis scatter by the sigma: the stream is of its own, the draws normal."""
    drawn = np.array([open_streams(seed).periodic_error.standard_normal((2, 3)) for seed in range(300)])
    assert drawn.std(axis=0) == pytest.approx(1.0, rel=0.15)
    assert np.abs(drawn.mean(axis=0)).max() < 4.0 / np.sqrt(300)


def test_new_errors_leave_the_old_draws() -> None:
    """GIVEN periodic error, antenna, attitude, burns THEN white noise, latched counters and dropouts are as before."""
    plain = build("gnss.dropout_probability=0.1")
    world = build(
        "gnss.dropout_probability=0.1",
        "gnss.periodic_sigma_m=5",
        "gnss.antenna_offset_m=[1.0, 0.0, 0.0]",
        "attitude.sigma_rad=0.01",
        "burn=[{start_s=5500.0, duration_s=10.0, dv_mps=[0.0, 0.01, 0.0], sigma_mps=[0.001, 0.001, 0.001]}]",
    )
    assert np.array_equal(world._fixes.sent, plain._fixes.sent)
    assert np.array_equal(world._fixes.t_counter_ns, plain._fixes.t_counter_ns)
    t = world._fixes.t_true_gps_ns
    r, v = world.truth.state_gcrf(t)
    u = argument_of_latitude(r, v)
    difference = np.einsum("nij,nj->ni", rtn_axes(r, v), world._fixes.error_gcrf_m - plain._fixes.error_gcrf_m)
    basis = np.stack((np.cos(u), np.sin(u)), axis=1)
    left = difference - basis @ np.linalg.lstsq(basis, difference, rcond=None)[0]
    assert np.abs(difference).max() > 0.1
    assert np.abs(left).max() < 1e-6  # nothing but the one harmonic is new
