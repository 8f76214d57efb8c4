"""Truth with burns: against a propagation that is stopped at every edge, against kicks, and at the edges themselves."""

from __future__ import annotations

import numpy as np
import pytest

from hil_sim import scenario
from hil_sim.scenario_schema import Burn, Orbit, TruthModel
from hil_sim.truth import burns, propagated
from hil_sim.truth.burns import FlownBurn
from hil_sim.truth.hermite import HermiteTrack
from hil_sim.truth.piecewise import PiecewiseTrack
from hil_sim.truth.satkit_data import satkit_time, session

NS = 1_000_000_000
T0_NS = scenario.load("two_orbits").t_start_gps_ns
ORBIT = Orbit(semi_major_axis_m=6_878_136.3, eccentricity=0.0005, inclination_deg=97.5)
MODEL = TruthModel()
RUN_S = 3000.0
MU_M3PS2 = 3.986004415e14


def burn(start_s: float, duration_s: float, dv_mps: tuple[float, float, float], frame: str = "rtn") -> FlownBurn:
    return FlownBurn(T0_NS + round(start_s * NS), round(duration_s * NS), dv_mps, frame)


CASES = {
    "a minute of fixes between": (burn(1000.0, 20.0, (0.1, 1.0, -0.2)),),
    "inertial axes": (burn(1000.0, 20.0, (3.0, -2.0, 1.0), "gcrf"),),
    "a pulse": (burn(1003.3, 0.1, (0.0, 0.05, 0.0)),),
    "the whole of an hour": (burn(100.0, 2800.0, (0.0, 5.0, 1.0)),),
    "large, off the grid": (burn(1234.567891, 333.333333, (0.0, 100.0, 0.0)),),
    "violent": (burn(1000.0, 0.1, (0.0, 100.0, 30.0)),),
    "two, one after the other": (burn(1000.0, 20.0, (0.0, 1.0, 0.0)), burn(1020.0, 7.0, (0.0, -1.0, 0.5))),
    "two with seconds between": (burn(1000.0, 20.0, (0.0, 1.0, 0.0)), burn(1023.0, 40.0, (0.0, -1.0, 0.5), "gcrf")),
    "at the very start and to the very end": (burn(1.0, 5.0, (1.0, 0.0, 0.0)), burn(2990.0, 10.0, (0.0, 0.0, 1.0))),
}


@pytest.fixture(scope="module")
def coasting():
    """The same orbit without burns."""
    return propagate(())


def propagate(flown: tuple[FlownBurn, ...]):
    return propagated.propagate(ORBIT, MODEL, T0_NS, round(RUN_S * NS), burns=flown)


def seconds_of(flown: tuple[FlownBurn, ...]) -> np.ndarray:
    """Instants [s] all over the run, dense about the edges, whole microseconds."""
    edges = [(t - T0_NS) / NS for b in flown for t in (b.t_start_gps_ns, b.t_end_gps_ns)]
    near = [edge + ahead for edge in edges for ahead in (-25.0, -7.3, -0.6, -0.001, 0.0, 0.001, 0.04, 0.9, 4.7, 31.0)]
    s = np.concatenate((np.linspace(5.0, RUN_S, 7), near))
    return np.unique(np.round(s[(s >= 0.0) & (s <= RUN_S)], 6))


def direct(satkit, flown: tuple[FlownBurn, ...], until_s: float) -> np.ndarray:
    """State (6,) by satkit alone: one integration for each stretch between edges, none of its interpolation."""
    settings, _ = propagated._settings(satkit, MODEL)
    until_ns = T0_NS + round(until_s * 1e6) * 1000
    state, at_ns = propagated.initial_state(ORBIT), T0_NS
    stretches: list[tuple[int, FlownBurn | None]] = []
    for b in flown:
        stretches += [(b.t_start_gps_ns, None), (b.t_end_gps_ns, b)]
    for end_ns, pushed in [*stretches, (until_ns, None)]:
        end_ns = min(end_ns, until_ns)
        if end_ns <= at_ns:
            continue
        thrusts = []
        if pushed is not None:
            thrusts = [
                satkit.thrust.constant(
                    [x / (pushed.duration_ns / 1e9) for x in pushed.dv_mps],
                    satkit_time(satkit, at_ns - NS),
                    satkit_time(satkit, end_ns + NS),
                    satkit.frame.RTN if pushed.frame == "rtn" else satkit.frame.GCRF,
                )
            ]
        satellite = propagated._satellite(satkit, MODEL, thrusts)
        state = np.array(
            satkit.propagate(
                state,
                satkit_time(satkit, at_ns),
                end=satkit_time(satkit, end_ns),
                propsettings=settings,
                satproperties=satellite,
            ).state
        )
        at_ns = end_ns
    return state


@pytest.mark.parametrize("name", CASES)
def test_track_is_the_direct_propagation(name: str) -> None:
    """GIVEN burns of all sorts WHEN the track is asked all over the run and about the edges THEN it is the propagation
    stopped at each edge and at that instant, to 10 micrometres and 0.3 micrometres per second."""
    flown = CASES[name]
    truth = propagate(flown)
    with session(T0_NS, T0_NS + round(RUN_S * NS)) as satkit:
        for at_s in seconds_of(flown):
            r, v = truth.state_gcrf(np.array([T0_NS + round(at_s * 1e6) * 1000]))
            expected = direct(satkit, flown, at_s)
            assert np.abs(r[0] - expected[:3]).max() < 1e-5, at_s
            assert np.abs(v[0] - expected[3:]).max() < 3e-7, at_s


@pytest.mark.parametrize("name", CASES)
def test_position_and_velocity_are_continuous_at_the_edges_and_nothing_rings(name: str, coasting) -> None:
    """GIVEN an edge THEN across one nanosecond position and velocity change by what the motion gives, and close to it
    the acceleration is that of gravity and thrust: it jumps by the thrust, to a millionth before and after."""
    flown = CASES[name]
    truth = propagate(flown)
    for b in flown:
        push = np.linalg.norm(b.dv_mps) / (b.duration_ns / 1e9)
        for edge in (b.t_start_gps_ns, b.t_end_gps_ns):
            r, v = truth.state_gcrf(edge + np.array([-1, 0]))
            assert np.abs(r[1] - r[0] - v[0] * 1e-9).max() < 1e-6
            assert np.abs(v[1] - v[0]).max() < 1e-6 if push > 100.0 else 2e-7
            t = edge + np.arange(-2_000_000_000, 2_000_000_000, 100_000_000)
            inside = np.zeros(len(t), bool)
            for other in flown:
                inside |= (t >= other.t_start_gps_ns) & (t < other.t_end_gps_ns)
            residual = np.linalg.norm(truth.acceleration_residual(t), axis=1)
            assert residual[~inside].max(initial=0.0) < 0.03  # 3 J2 mu R^2 / r^4, over the poles, is 0.025 m/s2
            largest = max(np.linalg.norm(o.dv_mps) / (o.duration_ns / 1e9) for o in flown)
            assert residual[inside].max(initial=0.0) < largest + 0.03
    first = flown[0]
    push = np.linalg.norm(first.dv_mps) / (first.duration_ns / 1e9)
    t = first.t_start_gps_ns + np.arange(-20_000_000, 20_000_000, 1_000_000)
    thrust = np.linalg.norm(truth.acceleration_residual(t) - coasting.acceleration_residual(t), axis=1)
    assert thrust[:20].max() < 1e-6
    np.testing.assert_allclose(thrust[20:], push, rtol=1e-4)


def test_one_polynomial_across_an_edge_would_ring() -> None:
    """GIVEN the very states of a burn's truth WHEN one track runs across the edges THEN it errs by decimetres: what the
    pieces are for."""
    flown = CASES["a minute of fixes between"]
    truth = propagate(flown)
    nodes = T0_NS + np.arange(0, 201) * 10 * NS
    whole = HermiteTrack(T0_NS, 10 * NS, *truth.state_gcrf(nodes))
    t = T0_NS + np.arange(985, 1040, dtype=np.int64) * NS
    r, v = truth.state_gcrf(t)
    bent_r, bent_v = whole.evaluate(t)
    assert np.abs(bent_r - r).max() > 1e-3
    assert np.abs(bent_v - v).max() > 1e-3


@pytest.mark.parametrize("frame", ["rtn", "gcrf"])
def test_thrust_is_what_many_small_kicks_are(frame: str) -> None:
    """GIVEN a burn as n coasts between half kicks, along axes made here WHEN n is doubled THEN the difference to the
    truth falls by four, to below a millimetre: frame, sense and size of the thrust are not satkit's word alone."""
    dv = np.array([3.0, 10.0, -5.0])
    b = burn(1000.0, 160.0, tuple(dv.tolist()), frame)
    expected = np.concatenate(propagate((b,)).state_gcrf(np.array([b.t_end_gps_ns])), axis=1)[0]
    errors = []
    with session(T0_NS, T0_NS + round(RUN_S * NS)) as satkit:
        settings, satellite = propagated._settings(satkit, MODEL)
        before = direct(satkit, (b,), 1000.0)
        for n in (80, 160, 320):
            state, step_ns = before.copy(), b.duration_ns // n
            for i in range(n):
                for half in range(2):
                    kick = np.zeros(3)
                    for _ in range(2):  # along the axes in the middle of the kick
                        radial = state[:3] / np.linalg.norm(state[:3])
                        normal = np.cross(state[:3], state[3:] + 0.5 * kick)
                        normal /= np.linalg.norm(normal)
                        axes = np.array([radial, np.cross(normal, radial), normal]) if frame == "rtn" else np.eye(3)
                        kick = 0.5 / n * dv @ axes
                    state[3:] += kick
                    if half == 0:
                        state = np.array(
                            satkit.propagate(
                                state,
                                satkit_time(satkit, b.t_start_gps_ns + i * step_ns),
                                duration_secs=step_ns / 1e9,
                                propsettings=settings,
                                satproperties=satellite,
                            ).state
                        )
            errors.append(np.linalg.norm((state - expected)[:3]))
    assert errors[-1] < 1e-3
    assert np.divide(errors[:-1], errors[1:]) == pytest.approx(4.0, rel=0.1)


def test_an_along_track_burn_raises_the_orbit() -> None:
    """Against vis-viva: da = 2 a^2 v dv / mu (Vallado, Fundamentals, 4th ed., eq. 6-4), over the osculating change that
    the same orbit has without the burn."""
    b = burn(1000.0, 20.0, (0.0, 1.0, 0.0))

    def semi_major_axis_m(flown: tuple[FlownBurn, ...], at_ns: int) -> float:
        r, v = propagate(flown).state_gcrf(np.array([at_ns]))
        return float(1.0 / (2.0 / np.linalg.norm(r) - v[0] @ v[0] / MU_M3PS2))

    raised = semi_major_axis_m((b,), b.t_end_gps_ns) - semi_major_axis_m((), b.t_end_gps_ns)
    a, v = 6_878_136.3, np.sqrt(MU_M3PS2 / 6_878_136.3)
    assert raised == pytest.approx(2.0 * a**2 * v * 1.0 / MU_M3PS2, rel=0.01)


def test_without_burns_there_is_one_piece() -> None:
    assert isinstance(propagate(()).track, HermiteTrack)


def test_a_burn_at_or_before_the_start_is_refused() -> None:
    with pytest.raises(ValueError, match="after the start"):
        propagate((burn(0.0, 20.0, (0.0, 1.0, 0.0)),))


def test_pieces_that_do_not_meet_are_refused() -> None:
    circle = np.zeros((6, 3))
    one, other = HermiteTrack(0, 10, circle, circle), HermiteTrack(60, 10, circle, circle)
    with pytest.raises(ValueError, match="reach its edge"):
        PiecewiseTrack([55], [one, other])
    with pytest.raises(ValueError, match="rising edges"):
        PiecewiseTrack([], [one, other])
    with pytest.raises(ValueError, match="rising edges"):
        PiecewiseTrack([50, 50], [one, one, one])


def test_execution_errors_have_the_announced_sigma() -> None:
    """GIVEN 4000 burns THEN mean and spread of what is flown are those of N(dv, sigma), axis by axis; and a sigma
    changed, or a burn appended, leaves the draws of the others."""
    one = Burn(start_s=1.0, duration_s=1.0, dv_mps=(0.0, 1.0, -2.0), sigma_mps=(0.0, 0.02, 0.5))
    flown = burns.fly((one,) * 4000, T0_NS, np.random.default_rng(5))
    dv = np.array([b.dv_mps for b in flown])
    assert (dv[:, 0] == 0.0).all()
    np.testing.assert_allclose(dv.mean(axis=0), one.dv_mps, atol=4.0 * 0.5 / np.sqrt(4000))
    np.testing.assert_allclose(dv.std(axis=0)[1:], one.sigma_mps[1:], rtol=0.05)
    fewer = burns.fly((one,) * 10, T0_NS, np.random.default_rng(5))
    assert fewer == flown[:10]


def test_times_of_a_burn_are_whole_microseconds() -> None:
    (flown,) = burns.fly((Burn(start_s=1.23456789, duration_s=0.3333333333, dv_mps=(0.0, 0.0, 0.0)),), T0_NS, rng())
    assert flown.t_start_gps_ns - T0_NS == 1_234_568_000
    assert flown.duration_ns == 333_333_000


def rng() -> np.random.Generator:
    return np.random.default_rng(1)
