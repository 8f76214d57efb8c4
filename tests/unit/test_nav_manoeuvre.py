"""Announced burns: their displacement and noise against closed forms, what is taken, what comes late."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flight_bench import NS, T0_GPS_NS, calls, put_fixes, put_pulses, record, seconds
from flight_filter_bench import errors_rtn, fixes_every_second, fly, flying_memory, kepler
from process_bench import Bench, difference, rtn, whole

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import BurnFrame, FlagState, RejectCause
from flightsw.nav import manoeuvre
from flightsw.records import BURNS, INPUT, STATES

TRUTH = kepler()
LATE, INVALID = int(RejectCause.BURN_LATE), int(RejectCause.BURN_INVALID)


# -- displacement


def displaced(bench: Bench, dt_s: float, rate: float, at_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """What burn 0 adds to r and v over a step of dt from at_s, the basis at T0 being the unit matrix."""
    angle = rate * at_s
    basis = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    dr, dv = np.zeros(3), np.zeros(3)
    t_gps_ns = T0_GPS_NS + round(at_s * NS)
    manoeuvre.displacement(bench.nav, 0, t_gps_ns, dt_s, basis, rate, np.zeros(3), dr, dv)
    return dr, dv


def closed_form(start_s: float, stop_s: float, dt_s: float, a: Any, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Integrals over [0, dt] of an acceleration that turns with the axes and acts from start to stop.

    In the plane of the orbit as complex numbers: v = a (e^(i w stop) - e^(i w start)) / (i w), r by parts.
    """
    plane, w = complex(a[0], a[1]), rate

    def v_at(t: float) -> complex:
        return plane * (np.exp(1j * w * t) - np.exp(1j * w * start_s)) / (1j * w)

    during = plane * (
        (np.exp(1j * w * stop_s) - np.exp(1j * w * start_s)) / (1j * w) ** 2
        - np.exp(1j * w * start_s) * (stop_s - start_s) / (1j * w)
    )
    r = during + v_at(stop_s) * (dt_s - stop_s)
    v = v_at(stop_s)
    acting = stop_s - start_s
    normal = a[2] * acting * (0.5 * acting + dt_s - stop_s)
    return np.array([r.real, r.imag, normal]), np.array([v.real, v.imag, a[2] * acting])


OVERLAPS = [
    (-30.0, 10.0, None),  # over
    (25.0, 10.0, None),  # to come
    (2.0, 3.0, (2.0, 5.0)),  # inside the step
    (-4.0, 6.0, (0.0, 2.0)),  # across its beginning
    (7.0, 20.0, (7.0, 10.0)),  # across its end
    (-100.0, 300.0, (0.0, 10.0)),  # longer
]


@pytest.mark.parametrize(("start_s", "duration_s", "acts"), OVERLAPS)
def test_displacement_is_that_of_a_constant_acceleration(
    start_s: float, duration_s: float, acts: tuple[float, float] | None
) -> None:
    """GIVEN a burn in GCRF and a step of 10 s THEN r and v gain the closed form of the overlap, and else nothing."""
    bench, total = Bench(), np.array([0.3, -2.0, 0.7])
    bench.burn(0, start_s, duration_s, 0.0)
    bench.nav.burn_dv_mps[0] = total
    dr, dv = displaced(bench, 10.0, 1.1e-3)
    if acts is None:
        assert not dr.any()
        assert not dv.any()
        return
    acting = acts[1] - acts[0]
    np.testing.assert_allclose(dv, total * acting / duration_s, rtol=1e-14)
    np.testing.assert_allclose(dr, dv * (0.5 * acting + 10.0 - acts[1]), rtol=1e-14)


@pytest.mark.parametrize("step_s", [1.0, 10.0, 60.0])
def test_a_burn_in_rtn_turns_with_the_orbit(step_s: float) -> None:
    """GIVEN a burn of 300 s along axes that turn by 19 degrees meanwhile WHEN taken in steps of 1 to 60 s THEN velocity
    is that of the turning acceleration to (omega dt)^2 / 24 of the burn, position to omega dt^2 / 12 of it: half a
    millimetre for 5 m/s in steps of 1 s."""
    rate, total = 1.108e-3, np.array([0.3, 5.0, 0.7])
    bench = Bench()
    bench.burn(0, 7.0, 300.0, 0.0, BurnFrame.RTN)
    bench.nav.burn_dv_mps[0] = total
    r, v = np.zeros(3), np.zeros(3)
    for at_s in np.arange(0.0, 360.0, step_s):
        dr, dv = displaced(bench, step_s, rate, at_s)
        r, v = r + v * step_s + dr, v + dv
    expected_r, expected_v = closed_form(7.0, 307.0, 360.0, total / 300.0, rate)
    assert np.abs(v - expected_v).max() <= (rate * step_s) ** 2 / 24.0 * np.linalg.norm(total)
    assert np.abs(r - expected_r).max() <= rate * step_s**2 / 12.0 * np.linalg.norm(total)


def test_a_burn_is_active_while_it_overlaps() -> None:
    for start_s, duration_s, acts in OVERLAPS:
        bench = Bench()
        assert not manoeuvre.is_active(bench.nav, T0_GPS_NS, 10.0)
        bench.burn(1, start_s, duration_s, 0.0)
        assert manoeuvre.is_active(bench.nav, T0_GPS_NS, 10.0) == (acts is not None)


# -- noise

BURN_SIGMA = np.array([0.03, 0.02, 0.01])


def burn_noise(start_s: float, stop_s: float, dt_s: float, duration_s: float) -> np.ndarray:
    """(6, 6) of white acceleration between start and stop within a step of dt, of BURN_SIGMA over the whole burn.

    Closed form: r = (dt - s) v for a kick v at s, integrated over s.
    """
    p = np.zeros((6, 6))
    a, b = dt_s - stop_s, dt_s - start_s
    density = np.diag(BURN_SIGMA**2) / duration_s
    p[:3, :3] = density * (b**3 - a**3) / 3.0
    p[:3, 3:] = p[3:, :3] = density * (b**2 - a**2) / 2.0
    p[3:, 3:] = density * (b - a)
    return p


@pytest.mark.parametrize(
    ("start_s", "duration_s", "acts"),
    [
        (-30.0, 10.0, None),  # over
        (-30.0, 30.0, None),  # ends as the step begins
        (25.0, 10.0, None),  # to come
        (10.0, 10.0, None),  # begins as the step ends
        (2.0, 3.0, (2.0, 5.0)),  # inside
        (0.0, 10.0, (0.0, 10.0)),  # the whole step
        (-4.0, 6.0, (0.0, 2.0)),  # across the beginning
        (7.0, 20.0, (7.0, 10.0)),  # across the end
        (-100.0, 300.0, (0.0, 10.0)),  # longer than the step
    ],
)
def test_burn_noise_is_that_of_the_overlap(start_s: float, duration_s: float, acts: tuple[float, float] | None) -> None:
    """GIVEN a step of 10 s WHEN a burn overlaps it THEN Q gains the closed form of the overlap, and else nothing."""
    quiet = Bench().noise(10.0)
    bench = Bench()
    bench.burn(2, start_s, duration_s, BURN_SIGMA)
    noise = bench.noise(10.0)
    if acts is None:
        np.testing.assert_array_equal(noise, quiet)
        return
    quiet[:6, :6] += burn_noise(*acts, 10.0, duration_s)
    assert difference(noise, quiet) <= 1e-13


def test_a_burn_over_many_steps_has_its_whole_sigma_at_the_end() -> None:
    """GIVEN a burn of 95 s over ten steps of 10 s THEN the sum of its noise is the closed form: sigma in velocity,
    sigma T / sqrt 3 in position; along the axes it is given in."""
    for frame, axes in ((BurnFrame.GCRF, np.eye(3)), (BurnFrame.RTN, rtn())):
        bench, quiet = Bench(), Bench()
        bench.burn(0, 3.0, 95.0, BURN_SIGMA, frame)
        ud, still = np.zeros((STATES, STATES)), np.zeros((STATES, STATES))
        for k in range(10):
            ud, still = bench.predict(ud, 10.0, at_s=10.0 * k), quiet.predict(still, 10.0)
        turn = np.kron(np.eye(2), axes)
        expected = whole(still)[:6, :6] + turn @ burn_noise(3.0, 98.0, 100.0, 95.0) @ turn.T
        assert difference(whole(ud)[:6, :6], expected) <= 1e-12


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_burns_at_once_add_up(count: int) -> None:
    """GIVEN as many burns as can be announced, all within one step THEN none is forgotten.

    Of more than two, the position variance lacks what a burn of T spreads about its middle, T^2 / 12.
    """
    bench, expected = Bench(), Bench().noise(10.0)
    for k in range(count):
        bench.burn(k, 1.0 + k, 3.0, BURN_SIGMA)
        expected[:6, :6] += burn_noise(1.0 + k, 4.0 + k, 10.0, 3.0)
        if count > 2:
            expected[:3, :3] -= np.diag(BURN_SIGMA**2) * 3.0**2 / 12.0
    assert difference(bench.noise(10.0), expected) <= 1e-12


def test_noise_of_the_papers_filter_is_at_least_that_of_the_burn() -> None:
    """Its diagonal noise takes the largest sigma for all axes: no variance is below that of the closed form."""
    for start_s, duration_s, acts in OVERLAPS:
        bench, p = Bench(), np.zeros((9, 9))
        bench.burn(0, start_s, duration_s, BURN_SIGMA)
        manoeuvre.add_noise(bench.nav, T0_GPS_NS, 10.0, p)
        if acts is None:
            assert not p.any()
        else:
            assert (np.diag(p)[:6] >= np.diag(burn_noise(*acts, 10.0, duration_s)) - 1e-15).all()
            np.testing.assert_allclose(np.diag(p)[3:6], BURN_SIGMA.max() ** 2 * (acts[1] - acts[0]) / duration_s)
            assert not (p - np.diag(np.diag(p))).any()


# -- what is announced


def announcement(start_s: float = 100.0, duration_s: float = 20.0, **fields: Any) -> Any:
    """An INPUT record with a burn, seconds from T0."""
    inputs = np.zeros(1, INPUT)
    put_burn(inputs, 0, start_s, duration_s, **fields)
    return record(inputs)


def put_burn(inputs: np.ndarray, at: int, start_s: float, duration_s: float, **fields: Any) -> None:
    values = {"id": 7, "frame": int(BurnFrame.RTN), "dv_mps": [0.3, 1.0, -0.2], "sigma_mps": 0.01, **fields}
    inputs["burn_present"][at] = 1
    inputs["burn_start_gps_ns"][at] = T0_GPS_NS + round(start_s * NS)
    inputs["burn_duration_ns"][at] = round(duration_s * NS)
    for name, value in values.items():
        inputs["burn_" + name][at] = value


def announce(bench: Bench, now_s: float = 0.0, **fields: Any) -> int:
    return manoeuvre.announce(bench.nav, bench.table, announcement(**fields), T0_GPS_NS + round(now_s * NS))


def test_an_announcement_is_kept_as_given() -> None:
    bench = Bench()
    assert announce(bench, sigma_mps=[0.1, 0.2, 0.3]) == 0
    assert bench.nav.burn_id[0] == 7
    assert bench.nav.burn_frame[0] == BurnFrame.RTN
    assert bench.nav.burn_start_gps_ns[0] == T0_GPS_NS + 100 * NS
    assert bench.nav.burn_duration_ns[0] == 20 * NS
    np.testing.assert_array_equal(bench.nav.burn_dv_mps[0], [0.3, 1.0, -0.2])
    np.testing.assert_array_equal(bench.nav.burn_sigma_mps[0], [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    "fields",
    [
        {"duration_s": 0.0},
        {"duration_s": -1.0},
        {"duration_s": 7200.1},
        {"start_s": -2e9},  # before the GPS epoch
        {"start_s": 4e9},
        {"frame": 2},
        {"frame": -1},
        {"dv_mps": [0.0, 500.1, 0.0]},
        {"dv_mps": [np.nan, 0.0, 0.0]},
        {"dv_mps": [0.0, 0.0, np.inf]},
        {"sigma_mps": -1e-9},
        {"sigma_mps": np.nan},
        {"sigma_mps": 500.1},
    ],
)
def test_what_cannot_be_a_burn_is_refused(fields: dict[str, Any]) -> None:
    bench = Bench()
    assert announce(bench, **fields) == manoeuvre.REFUSED - INVALID
    assert not bench.nav.burn_duration_ns.any()


def test_late_is_measured_from_the_start() -> None:
    """Up to burn_late_max after its start a burn is taken, whether it still goes on or not; later it is refused."""
    for late_s, duration_s, expected in ((4.99, 20.0, 0), (4.99, 1.0, 0), (5.01, 20.0, manoeuvre.REFUSED - LATE)):
        assert announce(Bench(burn_late_max_s=5.0), now_s=100.0 + late_s, duration_s=duration_s) == expected


def test_word_for_word_again_changes_nothing() -> None:
    """Repeated before, during and after the burn, also when it would be late as a new one."""
    bench = Bench()
    assert announce(bench) == 0
    for now_s in (0.0, 50.0, 110.0, 150.0):
        assert announce(bench, now_s=now_s) == manoeuvre.KNOWN
    assert np.count_nonzero(bench.nav.burn_duration_ns) == 1


def test_the_same_number_before_the_start_replaces() -> None:
    """GIVEN a burn and a free place before it WHEN announced otherwise before its start THEN it is replaced in place;
    after its start it is refused and goes on."""
    bench = Bench()
    assert announce(bench, id=1) == 0
    assert announce(bench, id=2) == 1
    bench.nav.burn_duration_ns[0] = 0
    assert announce(bench, now_s=99.9, id=2, dv_mps=[0.0, 2.0, 0.0]) == 1
    assert bench.nav.burn_dv_mps[1, 1] == 2.0
    assert np.count_nonzero(bench.nav.burn_duration_ns) == 1
    assert announce(bench, now_s=100.0, id=2, dv_mps=[0.0, 3.0, 0.0]) == manoeuvre.REFUSED - INVALID
    assert bench.nav.burn_dv_mps[1, 1] == 2.0


def test_a_full_list_refuses_and_keeps_what_it_has() -> None:
    bench = Bench()
    for k in range(BURNS):
        assert announce(bench, id=k, start_s=100.0 + k) == k
    assert announce(bench, id=99) == manoeuvre.REFUSED - INVALID
    np.testing.assert_array_equal(bench.nav.burn_id, range(BURNS))


def test_what_is_long_over_makes_room() -> None:
    """Also without fixes: a burn that ended more than a minute before the newest epoch is forgotten for a new one."""
    for initialised in (0, 1):
        bench = Bench()
        for k in range(BURNS):
            announce(bench, id=k, start_s=100.0 + k)
        bench.nav.initialised = initialised
        for now_s, expected in ((180.0, manoeuvre.REFUSED - INVALID), (180.1, 0)):
            bench.nav.t_gps_ns = T0_GPS_NS + round(now_s * NS)
            assert announce(bench, now_s=now_s, id=99, start_s=1000.0) == expected
        if initialised:  # the chain is behind after a stall: what it has not flown yet stays
            bench.nav.t_gps_ns = T0_GPS_NS + 100 * NS
            assert announce(bench, now_s=500.0, id=98, start_s=1000.0) == manoeuvre.REFUSED - INVALID


# -- through the step


def flown(announced_s: float, stop_s: int, fix_stop_s: int = 100, **burn: Any) -> tuple[Any, np.ndarray, Any]:
    """An arc of one step a second with fixes up to fix_stop, the burn announced at that time; outputs of whole seconds.

    Its last call brings a fix that is nearly a second late, with whatever the filter says of it.
    """
    memory = flying_memory(latency_max_s=1.0)
    inputs = fixes_every_second(0, fix_stop_s, TRUTH, np.random.default_rng(3))
    t = np.unique(np.concatenate([seconds(fix_stop_s, stop_s), [T0_GPS_NS + round(announced_s * NS)]]))
    t = np.concatenate([t, t[-1:] + NS // 50])
    coasting = calls(t)
    put_pulses(coasting, slice(None), t)
    values = {"start_s": 120.0, "duration_s": 60.0, **burn}
    put_burn(coasting, int(np.searchsorted(t, T0_GPS_NS + round(announced_s * NS))), **values)
    put_fixes(coasting, len(coasting) - 1, t[-1:] - 9 * NS // 10, TRUTH, 10.0, 0.1)
    outputs = fly(memory, np.concatenate([inputs, coasting]))
    whole_seconds = outputs[outputs["t_gps_ns"] % NS == 0]
    return record(memory.nav), whole_seconds, outputs[-1]


@pytest.mark.compiled
@pytest.mark.parametrize("frame", [BurnFrame.RTN, BurnFrame.GCRF])
@pytest.mark.parametrize("announced_s", [120.0, 121.0, 122.5, 124.99])
def test_a_late_announcement_is_caught_up(frame: int, announced_s: float) -> None:
    """GIVEN a burn of 1 m/s in an outage WHEN it is announced up to 5 s after its start THEN position and velocity are
    within 1 mm and 0.01 mm/s of those of an announcement in time, minutes after its end too, and so is what the
    filter says of them; a fix that goes back behind the announcement meets the same covariance."""
    _, expected, fix_expected = flown(110.0, 300, frame=int(frame))
    _, got, fix = flown(announced_s, 300, frame=int(frame))
    after = int(np.ceil(announced_s)) + 1
    assert np.abs(got["r_gcrf_m"] - expected["r_gcrf_m"])[after:].max() < 1e-3
    assert np.abs(got["v_gcrf_mps"] - expected["v_gcrf_mps"])[after:].max() < 1e-5
    moved = np.abs(expected["r_gcrf_m"] - flown(110.0, 300, dv_mps=0.0)[1]["r_gcrf_m"])[299].max()
    assert moved > 50.0
    for time_s in (130, 299):
        p, q = got["covariance"][time_s], expected["covariance"][time_s]
        assert difference(p, q) < 0.02
    np.testing.assert_allclose(fix["innovation_sigma"], fix_expected["innovation_sigma"], rtol=0.01)


@pytest.mark.compiled
def test_a_late_fix_after_a_late_announcement_meets_the_same_covariance() -> None:
    """GIVEN a burn of large sigma, announced 3 s late WHEN a fix 0.9 s late follows at once THEN its innovation is
    expected to be as large as after an announcement in time: epochs of the past are caught up too."""
    sigmas = []
    for announced_s in (110.0, 123.01):
        burn = {"dv_mps": [0.0, 20.0, 0.0], "sigma_mps": 5.0, "duration_s": 4.0}
        _, _, fix = flown(announced_s, 124, **burn)
        assert fix["fix_seen"]
        sigmas.append(fix["innovation_sigma"].copy())
    np.testing.assert_allclose(sigmas[0], sigmas[1], rtol=0.02)
    assert sigmas[0][3:].max() > 3.0


@pytest.mark.compiled
def test_a_burn_that_comes_too_late_raises_the_flag() -> None:
    nav, outputs, _ = flown(126.0, 140)
    assert outputs["flag"][125] == FlagState.CLEAR
    assert outputs["flag"][126] == FlagState.RAISED
    assert outputs["events"][126] & (1 << int(AlertId.BURN_REFUSED))
    assert nav.rejected[LATE] == 1


@pytest.mark.compiled
def test_a_burn_flown_is_the_truth_of_a_burn() -> None:
    """GIVEN a kick of 1 m/s in a second, announced, with fixes all the time WHEN flown THEN no innovation notices it:
    the state stays within its sigma of the true one, kicked in the middle of that second."""
    truth = kepler(kicks=[(300.5, [0.2, 0.9, -0.4])])
    inputs = fixes_every_second(0, 700, truth, np.random.default_rng(5))
    put_burn(inputs, 200, 300.0, 1.0, dv_mps=[0.2, 0.9, -0.4], sigma_mps=1e-4)
    outputs = fly(flying_memory(monitor_use="no"), inputs)
    assert (outputs["fix_cause"][5:] == -1).all()
    dr, _ = errors_rtn(outputs[250:], truth)
    sigma = np.sqrt(np.trace(outputs["covariance"][250:, :3, :3], axis1=1, axis2=2))
    assert (np.linalg.norm(dr, axis=1) <= 3.0 * sigma).all()
    assert np.mean(outputs["type_nis"][300:, 0]) == pytest.approx(3.0, abs=0.5)
