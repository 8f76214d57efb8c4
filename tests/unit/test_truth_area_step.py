"""Truth with a step of the cross-section: against satkit alone, stopped at the step, and with burns about it."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from hil_sim import scenario
from hil_sim.errors import ScenarioError
from hil_sim.scenario_schema import AreaStep, Orbit, TruthModel
from hil_sim.truth import propagated
from hil_sim.truth.burns import FlownBurn
from hil_sim.truth.satkit_data import satkit_time, session

NS = 1_000_000_000
T0_NS = scenario.load("two_orbits").t_start_gps_ns
ORBIT = Orbit(semi_major_axis_m=6_748_136.3, eccentricity=0.0005, inclination_deg=97.5)
MODEL = TruthModel(area_to_mass_m2pkg=0.02)
RUN_S = 3000.0
STEP_S = 1234.567891


def stepped(factor: float = 2.0, at_s: float = STEP_S) -> TruthModel:
    return msgspec.structs.replace(MODEL, area_step=AreaStep(at_s=at_s, factor=factor))


def track(model: TruthModel, burns: tuple[FlownBurn, ...] = ()):
    return propagated.propagate(ORBIT, model, T0_NS, round(RUN_S * NS), burns=burns)


def direct(until_s: float, factor: float) -> np.ndarray:
    """Position (3,) by satkit alone: to the step with one cross-section, on from there with the other."""
    at_ns, state = T0_NS, propagated.initial_state(ORBIT)
    step_ns, until_ns = T0_NS + round(STEP_S * 1e6) * 1000, T0_NS + round(until_s * NS)
    with session(T0_NS - 60 * NS, T0_NS + round(RUN_S * NS)) as satkit:
        settings, _ = propagated._settings(satkit, MODEL)
        for end_ns, area in ((min(step_ns, until_ns), 1.0), (until_ns, factor)):
            if end_ns <= at_ns:
                continue
            area_to_mass = MODEL.area_to_mass_m2pkg * area
            satellite = satkit.satproperties(
                cdaoverm=MODEL.drag_coefficient * area_to_mass, craoverm=MODEL.srp_coefficient * area_to_mass
            )
            state = satkit.propagate(
                state,
                satkit_time(satkit, at_ns),
                end=satkit_time(satkit, end_ns),
                propsettings=settings,
                satproperties=satellite,
            ).state
            at_ns = end_ns
    return np.array(state[:3])


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_the_track_is_that_of_a_propagation_stopped_at_the_step(factor: float) -> None:
    """GIVEN a cross-section that halves or doubles WHEN the track is asked before, about and after the step THEN it is
    satkit's own, stopped there, to 10 micrometres."""
    truth = track(stepped(factor))
    for at_s in (5.0, 1200.0, 1234.5, 1234.6, 1240.0, 1300.0, 2999.0):
        r, _ = truth.state_gcrf(np.array([T0_NS + round(at_s * NS)]))
        assert np.abs(r[0] - direct(at_s, factor)).max() < 1e-5, at_s


def test_a_step_of_one_changes_nothing_and_one_of_two_does() -> None:
    """GIVEN an orbit at 370 km WHEN the area steps by 1 and by 2 THEN the first is the track without a step to 10
    micrometres, and the second departs along the track by half a t^2 of the drag, to a third."""
    t = T0_NS + np.array([600, 1235, 2900], np.int64) * NS
    plain, same, twice = (track(m).state_gcrf(t)[0] for m in (MODEL, stepped(1.0), stepped(2.0)))
    assert np.abs(same - plain).max() < 1e-5
    assert np.abs(twice - plain)[:2].max() < 1e-5
    density = propagated.density_kgpm3(track(MODEL), t[2:], MODEL)[0]
    v = np.linalg.norm(track(MODEL).state_gcrf(t[2:])[1])
    drag_mps2 = 0.5 * density * MODEL.drag_coefficient * MODEL.area_to_mass_m2pkg * v * v
    # more drag: lower, faster, ahead; over a third of a revolution the departure is between half and 3/2 a t^2
    expected_m = drag_mps2 * (2900.0 - STEP_S) ** 2
    assert 0.3 * expected_m < np.linalg.norm((twice - plain)[2]) < 2.5 * expected_m


@pytest.mark.parametrize("at_s", [1000.0, 1010.0, 1020.0, 1021.0])
def test_a_burn_about_the_step_does_not_care(at_s: float) -> None:
    """GIVEN a burn and a step of factor one before, within, at the end of, just after it WHEN flown THEN the track is
    that of the burn alone, to 20 micrometres."""
    burn = (FlownBurn(T0_NS + 1000 * NS, 20 * NS, (0.1, 1.0, -0.2), "rtn"),)
    t = T0_NS + np.array([990, 1005, 1015, 1020, 1022, 1050, 2900], np.int64) * NS
    alone, both = track(MODEL, burn).state_gcrf(t)[0], track(stepped(1.0, at_s), burn).state_gcrf(t)[0]
    assert np.abs(both - alone).max() < 2e-5


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("truth.area_step.at_s=10.0",), ("truth.area_step", "factor")),
        (("truth.area_step={at_s=10.0, facter=2.0}",), ("truth.area_step.facter", "did you mean 'factor'")),
        (("truth.area_step={at_s=1e6, factor=2.0}",), ("truth.area_step.at_s", "after the run")),
        (("truth.area_step={at_s=10.0, factor=50.0}",), ("truth.area_step.factor", "cross-section")),
    ],
)
def test_a_wrong_step_is_refused_by_name(settings: tuple[str, ...], words: tuple[str, ...]) -> None:
    """GIVEN a step that is incomplete, misspelt, too late or too large WHEN the scenario is loaded THEN key and remedy
    are named."""
    with pytest.raises(ScenarioError) as refused:
        scenario.load("two_orbits", settings)
    for word in words:
        assert word in str(refused.value)
