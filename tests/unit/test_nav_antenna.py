"""The lever arm: body axes, attitudes from the bus, the antenna's velocity, what is taken and when it is too old."""

from __future__ import annotations

import math
from typing import Any

import erfa
import numpy as np
import pytest
from flight_bench import NS, T0_GPS_NS, calls, put_fixes, put_pulses, record, seconds
from flight_filter_bench import ORBIT, bare_table, errors_rtn, fly, flying_memory, kepler, rtn

from flightsw.icd.enums import RejectCause
from flightsw.nav import antenna
from flightsw.records import INPUT, NAV, WORK

INVALID = int(RejectCause.ATTITUDE_INVALID)
ARM = {"lever_x_m": 1.3, "lever_y_m": -0.7, "lever_z_m": -0.4}
LEVER = np.array([1.3, -0.7, -0.4])
ECCENTRIC = np.concatenate([ORBIT[:3], ORBIT[3:6] * 1.03])


class Bench:
    """A satellite with a lever arm, a clock that is right, and perhaps an attitude."""

    def __init__(self, **table: Any) -> None:
        arrays = bare_table(**{**ARM, "attitude_source": 1, **table}), np.zeros(1, NAV), np.zeros(1, WORK)
        arrays[2].view(np.float64)[:] = np.nan
        self.table, self.nav, self.work = (record(array) for array in arrays)

    def take(self, t_s: float, q: Any, sigma_rad: float = 0.001, now_s: float | None = None) -> int:
        """An attitude of time t_s after T0, received at now_s."""
        inp = record(np.zeros(1, INPUT))
        inp.attitude_gps_ns, inp.attitude_sigma_rad = T0_GPS_NS + round(t_s * NS), sigma_rad
        inp.attitude_q[:] = q
        now_ns = T0_GPS_NS + round((t_s if now_s is None else now_s) * NS)
        return antenna.take_attitude(self.nav, self.table, inp, now_ns)

    def offset(self, x: np.ndarray, t_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        dr, dv = np.full(3, np.nan), np.full(3, np.nan)
        antenna.offset(self.nav, self.table, T0_GPS_NS + round(t_s * NS), x, self.work, dr, dv)
        return dr, dv

    def sigma_m(self, t_s: float = 0.0) -> float:
        return antenna.sigma_m(self.nav, self.table, T0_GPS_NS + round(t_s * NS))


def nadir_axes(x: np.ndarray) -> np.ndarray:
    """Columns: body axes in GCRF, from their definition: z to the Earth, y against the angular momentum."""
    z = -x[:3] / np.linalg.norm(x[:3])
    y = -np.cross(x[:3], x[3:6])
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])


def quaternion(axis: np.ndarray, angle_rad: float) -> np.ndarray:
    return np.concatenate([[math.cos(angle_rad / 2.0)], math.sin(angle_rad / 2.0) * axis / np.linalg.norm(axis)])


# -- geometry


def test_nadir_pointing_axes() -> None:
    """GIVEN no attitude WHEN the lever is one axis at a time THEN they are the documented ones: right-handed, x within
    the orbit's plane and forward, y against the angular momentum, z down."""
    axes = []
    for lever in np.eye(3):
        bench = Bench(**dict(zip(ARM, lever, strict=True)))
        axes.append(bench.offset(ECCENTRIC)[0])
    axes = np.array(axes).T
    np.testing.assert_allclose(axes, nadir_axes(ECCENTRIC), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0, abs=1e-14)
    assert axes[:, 0] @ ECCENTRIC[3:6] > 0.99 * np.linalg.norm(ECCENTRIC[3:6])
    assert axes[:, 2] @ ECCENTRIC[:3] == pytest.approx(-np.linalg.norm(ECCENTRIC[:3]))


def test_an_attitude_turns_the_lever_as_erfa_does() -> None:
    """GIVEN the body turned from GCRF by a rotation vector THEN the lever in GCRF is the transpose of erfa's matrix for
    that vector, which takes GCRF to body; q and -q are one attitude."""
    rng = np.random.default_rng(3)
    for k in range(50):
        axis, angle = rng.standard_normal(3), rng.uniform(-math.pi, math.pi)
        body_from_gcrf = erfa.rv2m(axis / np.linalg.norm(axis) * angle)
        bench = Bench()
        sign = 1.0 if k % 2 else -1.0
        assert bench.take(0.0, sign * quaternion(axis, angle)) == antenna.TAKEN
        np.testing.assert_allclose(bench.offset(ORBIT)[0], body_from_gcrf.T @ LEVER, atol=1e-14)


def test_the_attitude_of_nadir_pointing_is_nadir_pointing() -> None:
    """The two sources agree where the bus says what is assumed without it."""
    rotation = nadir_axes(ORBIT)  # body to GCRF
    vector = erfa.rm2v(np.ascontiguousarray(rotation.T))
    bench = Bench()
    assert bench.take(0.0, quaternion(vector, float(np.linalg.norm(vector)))) == antenna.TAKEN
    told = bench.offset(ORBIT)
    assumed = Bench(attitude_source=0).offset(ORBIT)
    np.testing.assert_allclose(told, assumed, atol=1e-14)


@pytest.mark.parametrize("orbit", [ORBIT, ECCENTRIC], ids=["circular", "eccentric"])
def test_velocity_of_the_antenna_is_the_derivative_of_its_arm(orbit: np.ndarray) -> None:
    """omega x l against a central difference of the nadir-pointing arm along Kepler's orbit, all around it."""
    bench, truth = Bench(attitude_source=0), kepler(orbit)
    for t_s in np.arange(0.0, 6000.0, 300.0):
        at = T0_GPS_NS + round(t_s * NS) + np.array([-NS // 2, 0, NS // 2])
        r, v = truth(at)
        arms = [bench.offset(np.concatenate([r[k], v[k]])) for k in range(3)]
        np.testing.assert_allclose(arms[1][1], arms[2][0] - arms[0][0], atol=2e-9)
        assert np.linalg.norm(arms[1][1]) > 5e-4


def test_no_lever_no_offset() -> None:
    bench = Bench(**dict.fromkeys(ARM, 0.0))
    assert bench.take(0.0, [1.0, 0.0, 0.0, 0.0]) == antenna.TAKEN
    for part in bench.offset(ORBIT):
        np.testing.assert_array_equal(part, np.zeros(3))


# -- what is taken


@pytest.mark.parametrize(
    "q",
    [
        [0.0, 0.0, 0.0, 0.0],
        [1.0, 0.1, 0.0, 0.0],
        [0.99, 0.0, 0.0, 0.0],
        [np.nan, 0.0, 0.0, 0.0],
        [1.0, np.inf, 0.0, 0.0],
    ],
)
def test_what_is_no_rotation_is_refused(q: list[float]) -> None:
    bench = Bench()
    assert bench.take(0.0, q) == INVALID
    assert bench.nav.attitude_gps_ns == 0


@pytest.mark.parametrize("sigma_rad", [-1e-9, 3.15, np.nan, np.inf])
def test_a_sigma_that_cannot_be_is_refused(sigma_rad: float) -> None:
    assert Bench().take(0.0, [1.0, 0.0, 0.0, 0.0], sigma_rad) == INVALID


def test_single_precision_is_taken_and_made_whole() -> None:
    """GIVEN a quaternion rounded to float32 and 2e-4 too long THEN the lever keeps its length."""
    q = quaternion(np.array([1.0, 2.0, -3.0]), 1.1).astype(np.float32) * np.float32(1.0002)
    bench = Bench()
    assert bench.take(0.0, q) == antenna.TAKEN
    assert np.linalg.norm(bench.offset(ORBIT)[0]) == pytest.approx(np.linalg.norm(LEVER), rel=1e-14)


def test_attitudes_come_in_order_and_not_from_the_future() -> None:
    """The same and older ones are refused; one from further ahead than an attitude may be old is, too: it would hold
    off all that follow."""
    bench, q = Bench(attitude_max_age_s=5.0), [1.0, 0.0, 0.0, 0.0]
    assert bench.take(10.0, q) == antenna.TAKEN
    assert bench.take(10.0, q) == INVALID
    assert bench.take(9.9, q, now_s=10.0) == INVALID
    assert bench.take(15.1, q, now_s=10.0) == INVALID
    assert bench.take(4e9, q, now_s=10.0) == INVALID
    assert bench.take(10.1, q) == antenna.TAKEN


def test_an_old_attitude_gives_way_to_nadir_pointing() -> None:
    """Fresh to either side of its time by attitude_max_age; its sigma goes with it. Without a bus as source, never."""
    q = quaternion(np.array([0.3, 1.0, 0.2]), 2.0)
    bench = Bench(attitude_max_age_s=5.0, attitude_sigma_rad=0.02, lever_sigma_m=0.01)
    down = Bench(attitude_source=0).offset(ORBIT)[0]
    arm = np.linalg.norm(LEVER)
    assert bench.take(100.0, q, sigma_rad=0.001) == antenna.TAKEN
    told = bench.offset(ORBIT, 100.0)[0]
    assert np.linalg.norm(told - down) > 0.5
    for t_s in (95.0, 105.0):
        np.testing.assert_array_equal(bench.offset(ORBIT, t_s)[0], told)
        assert bench.sigma_m(t_s) == pytest.approx(math.hypot(0.01, 0.001 * arm))
    for t_s in (94.99, 105.01):
        np.testing.assert_array_equal(bench.offset(ORBIT, t_s)[0], down)
        assert bench.sigma_m(t_s) == pytest.approx(math.hypot(0.01, 0.02 * arm))
    bench.table.attitude_source = 0
    np.testing.assert_array_equal(bench.offset(ORBIT, 100.0)[0], down)


# -- through the step


def antenna_truth(body: Any) -> Any:
    """Truth of the antenna: Kepler's orbit and LEVER in body axes that `body(r, v)` gives as columns."""
    truth = kepler()

    def at(t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, v = truth(t_gps_ns)
        rate = np.linalg.norm(np.cross(ORBIT[:3], ORBIT[3:6])) / (ORBIT[:3] @ ORBIT[:3])
        arms = np.array([body(*rv) @ LEVER for rv in zip(r, v, strict=True)])
        normals = np.array([rtn(*rv)[:, 2] for rv in zip(r, v, strict=True)])
        return r + arms, v + rate * np.cross(normals, arms)

    return at


@pytest.mark.compiled
@pytest.mark.parametrize("source", ["nadir-pointing", "bus"])
def test_the_state_is_the_centre_of_mass(source: str) -> None:
    """GIVEN fixes of an antenna 1.5 m off the centre of mass, pointing down or turned by 40 degrees about it as the bus
    says WHEN flown THEN the state has none of the arm, from the start on; nor has it where attitudes stop for less
    than their age. Without the table's lever arm it is 1.5 m off."""
    yaw = math.radians(40.0) if source == "bus" else 0.0

    def body(r: np.ndarray, v: np.ndarray) -> np.ndarray:
        turn = np.array([[math.cos(yaw), -math.sin(yaw), 0.0], [math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        return nadir_axes(np.concatenate([r, v])) @ turn

    truth, n = kepler(), 600
    t = seconds(0, n)
    inputs = calls(t)
    put_pulses(inputs, slice(None), t)
    put_fixes(inputs, slice(None), t, antenna_truth(body), 0.1, 0.01)
    if source == "bus":
        for k in range(0, n, 3):  # a second before the fix that it serves
            r, v = truth(t[k : k + 1])
            vector = erfa.rm2v(np.ascontiguousarray(body(r[0], v[0]).T))
            inputs["attitude_present"][k] = 1
            inputs["attitude_gps_ns"][k] = t[k]
            inputs["attitude_q"][k] = quaternion(vector, float(np.linalg.norm(vector)))
    settings = {**ARM, "attitude_source": source, "lever_sigma_m": 0.0, "attitude_sigma_rad": 0.0}
    outputs = fly(flying_memory(**settings), inputs)
    assert (outputs["fix_cause"][5:] == -1).all()
    dr, dv = errors_rtn(outputs[4:], truth)
    off = 0.0 if source == "nadir-pointing" else 2 * 1.48 * 1.1e-3  # attitude of up to two seconds ago
    assert np.abs(dr).max() <= 2e-3 + off
    assert np.abs(dv[60:]).max() <= 2e-4
    without = fly(flying_memory(), inputs)
    assert np.linalg.norm(errors_rtn(without[-1:], truth)[0]) == pytest.approx(np.linalg.norm(LEVER), abs=0.05)


def test_invalid_attitudes_are_counted() -> None:
    """Each refused one once; before there is a time, as one that came too early."""
    memory = flying_memory(attitude_source="bus")
    inputs = calls(seconds(0, 12))
    put_pulses(inputs, slice(None), seconds(0, 12))
    inputs["attitude_present"] = 1
    inputs["attitude_gps_ns"] = seconds(0, 12)
    inputs["attitude_q"][:, 0] = 1.0
    inputs["attitude_q"][5] = np.nan
    inputs["attitude_q"][7] = 0.6
    inputs["attitude_gps_ns"][9] = T0_GPS_NS + 10**9 * NS
    fly(memory, inputs)
    nav = record(memory.nav)
    early = int(nav.rejected[int(RejectCause.CLOCK_UNSET)])
    assert 1 <= early <= 3
    assert nav.rejected[INVALID] == 3
    assert nav.attitude_gps_ns == T0_GPS_NS + 11 * NS
