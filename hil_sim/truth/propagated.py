"""Truth by numerical propagation with satkit, a library flight does not use.

Forces: EGM2008 to the chosen degree, at most 70, and EGM96 beyond it where that is wanted (high_degrees.py); drag on
NRLMSISE-00 density, radiation pressure, Sun, Moon, solid tides, general relativity (satkit's propagator; Earth
orientation IERS 2010).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hil_sim.scenario_schema import MU_EGM2008_M3PS2, AreaStep, Orbit, TruthModel, semi_major_axis_m
from hil_sim.truth.burns import FlownBurn
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.hermite import NODES_EACH_SIDE, HermiteTrack
from hil_sim.truth.high_degrees import displace
from hil_sim.truth.interface import TrackTruth
from hil_sim.truth.piecewise import PiecewiseTrack
from hil_sim.truth.satkit_data import satkit_time, session

NODE_STEP_NS = 10_000_000_000
TOLERANCE = 1e-12  # of the adaptive Runge-Kutta 9(8): sub-millimetre over a day's fraction
MARGIN_NODES = NODES_EACH_SIDE + 1
OVERLAP_NODES = NODES_EACH_SIDE - 1  # beyond an edge, so that no window is one-sided
BURN_STEP_MINIMUM_NS = 1_000_000_000  # nodes closer together would cost the velocity its digits


def initial_state(orbit: Orbit) -> np.ndarray:
    """GCRF state (6,) [m, m/s] of osculating elements (Vallado, Fundamentals, 4th ed., algorithm 10)."""
    a = semi_major_axis_m(orbit)
    e = orbit.eccentricity
    perigee = math.radians(orbit.argument_of_perigee_deg)
    anomaly = math.radians(orbit.argument_of_latitude_deg) - perigee
    node, inclination = math.radians(orbit.raan_deg), math.radians(orbit.inclination_deg)
    p = a * (1.0 - e * e)
    radius, speed = p / (1.0 + e * math.cos(anomaly)), math.sqrt(MU_EGM2008_M3PS2 / p)
    r_pqw = radius * np.array([math.cos(anomaly), math.sin(anomaly), 0.0])
    v_pqw = speed * np.array([-math.sin(anomaly), e + math.cos(anomaly), 0.0])
    rotation = _about_z(node) @ _about_x(inclination) @ _about_z(perigee)
    return np.concatenate((rotation @ r_pqw, rotation @ v_pqw))


def propagate(
    orbit: Orbit,
    model: TruthModel,
    t_start_gps_ns: int,
    duration_ns: int,
    finals_path: Path | None = None,
    space_weather_path: Path | None = None,
    burns: tuple[FlownBurn, ...] = (),
) -> TrackTruth:
    """Truth from the start for `duration_ns`, with a little more on both sides.

    burns: in order of time, apart from each other. At their edges, and where the model's area steps, the integration
    stops and begins anew, and so does the track: neither steps nor interpolates across the jump of the force.
    Raises DataError when space weather or Earth orientation does not cover the run, ValueError for a burn that does not
    begin after the start.
    """
    if burns and burns[0].t_start_gps_ns <= t_start_gps_ns:
        raise ValueError("the first burn must begin after the start")
    margin_ns = MARGIN_NODES * NODE_STEP_NS
    after = -(-int(duration_ns) // NODE_STEP_NS) + MARGIN_NODES
    t_last_ns = t_start_gps_ns + after * NODE_STEP_NS
    jumps = bool(burns) or model.area_step is not None
    last_node_ns = t_last_ns + (margin_ns if jumps else 0)
    with session(t_start_gps_ns - margin_ns, last_node_ns, model.fixed_f107, finals_path, space_weather_path) as satkit:
        settings, _ = _settings(satkit, model)
        state = initial_state(orbit)
        edges_ns: list[int] = []
        pieces: list[HermiteTrack] = []
        for arc in _at_area_step(_arcs(t_start_gps_ns, t_last_ns, burns), model.area_step, t_start_gps_ns):
            thrusts = [] if arc.burn is None else [_thrust(satkit, arc)]
            satellite = _satellite(satkit, model, thrusts, arc.area_factor)
            behind = range(-(OVERLAP_NODES if pieces else MARGIN_NODES), 0)
            earlier, _ = _nodes(satkit, settings, satellite, state, arc, behind)
            later, state = _nodes(satkit, settings, satellite, state, arc, range(arc.last_node + 1))
            samples = np.concatenate((earlier, later))
            t0_ns = arc.t_start_ns - len(earlier) * arc.step_ns
            edges_ns.append(arc.t_start_ns)
            pieces.append(HermiteTrack(t0_ns, arc.step_ns, samples[:, :3].copy(), samples[:, 3:].copy()))
    known = PiecewiseTrack(edges_ns[1:], pieces) if jumps else pieces[0]
    source = f"satkit {satkit.__version__}, EGM2008 {model.gravity_degree}, solar {model.solar}"
    if not model.gravity_beyond:
        return TrackTruth(known, source)
    beyond = (model.gravity_degree + 1, model.gravity_beyond)
    return TrackTruth(displace(known, t_start_gps_ns, beyond, finals_path), f"{source}, EGM96 to {beyond[1]}")


class _Arc(NamedTuple):
    """A stretch of flight without a jump of the force, and how far apart its nodes lie; last_node counts from 0."""

    t_start_ns: int
    t_end_ns: int
    step_ns: int
    last_node: int
    burn: FlownBurn | None
    area_factor: float = 1.0  # cross-section over that of the model


def _arcs(t_start_ns: int, t_last_ns: int, burns: tuple[FlownBurn, ...]) -> Iterator[_Arc]:
    at_ns = t_start_ns
    for burn in burns:
        if burn.t_start_gps_ns > at_ns:
            yield _arc(at_ns, burn.t_start_gps_ns, NODE_STEP_NS, None)
        step_ns = min(NODE_STEP_NS, max(BURN_STEP_MINIMUM_NS, burn.duration_ns))
        yield _arc(burn.t_start_gps_ns, burn.t_end_gps_ns, step_ns, burn)
        at_ns = burn.t_end_gps_ns
    yield _last_arc(at_ns, t_last_ns)


def _at_area_step(arcs: Iterator[_Arc], step: AreaStep | None, t_start_ns: int) -> Iterator[_Arc]:
    """The arcs, parted where the area steps; without a step as they are."""
    if step is None:
        yield from arcs
        return
    at_ns = t_start_ns + round(step.at_s * 1e6) * 1000  # satkit's instants are whole microseconds
    parted = list(arcs)
    for arc in parted:
        if arc.t_end_ns <= at_ns:
            yield arc
            continue
        if arc.t_start_ns < at_ns:
            yield _arc(arc.t_start_ns, at_ns, arc.step_ns, arc.burn)
        begin_ns = max(arc.t_start_ns, at_ns)
        if arc is parted[-1]:
            yield _last_arc(begin_ns, arc.t_end_ns)._replace(area_factor=step.factor)
        else:
            yield _arc(begin_ns, arc.t_end_ns, arc.step_ns, arc.burn)._replace(area_factor=step.factor)


def _last_arc(t_start_ns: int, t_last_ns: int) -> _Arc:
    """The last one: t_last has its margin in it."""
    nodes = max(OVERLAP_NODES + 1, -(-(t_last_ns - t_start_ns) // NODE_STEP_NS))
    return _Arc(t_start_ns, t_last_ns, NODE_STEP_NS, nodes, None)


def _arc(t_start_ns: int, t_end_ns: int, step_ns: int, burn: FlownBurn | None) -> _Arc:
    return _Arc(t_start_ns, t_end_ns, step_ns, -(-(t_end_ns - t_start_ns) // step_ns) + OVERLAP_NODES, burn)


def _nodes(
    satkit: Any, settings: Any, satellite: Any, state: np.ndarray, arc: _Arc, numbers: range
) -> tuple[np.ndarray, np.ndarray]:
    """States (n,6) at the numbered nodes of an arc, propagated from `state` (6,) at its start; that at its end (6,).

    Nodes before the start end nothing: `state` comes back.
    """
    t0_ns, step_ns = arc.t_start_ns, arc.step_ns
    backward = numbers[0] < 0
    # satkit's interpolation of many instants walks its steps once: out of the order of integration it extrapolates a
    # step it has passed, by kilometres and without a word
    flown = numbers[::-1] if backward else numbers
    result = satkit.propagate(
        state,
        satkit_time(satkit, t0_ns),
        duration_secs=flown[-1] * step_ns / 1e9,
        propsettings=settings,
        satproperties=satellite,
    )
    samples = np.array(result.interp([satkit_time(satkit, t0_ns + n * step_ns) for n in flown]))
    if backward:
        return samples[::-1], state
    return samples, np.array(result.interp(satkit_time(satkit, arc.t_end_ns)))


def _thrust(satkit: Any, arc: _Arc) -> Any:
    """The thrust of an arc's burn, on over the whole arc and beyond its ends."""
    assert arc.burn is not None
    duration_s = arc.burn.duration_ns / 1e9
    return satkit.thrust.constant(
        [dv / duration_s for dv in arc.burn.dv_mps],
        satkit_time(satkit, arc.t_start_ns - MARGIN_NODES * arc.step_ns),
        satkit_time(satkit, arc.t_start_ns + (arc.last_node + MARGIN_NODES) * arc.step_ns),
        satkit.frame.RTN if arc.burn.frame == "rtn" else satkit.frame.GCRF,
    )


def density_kgpm3(
    truth: TrackTruth,
    t_gps_ns: np.ndarray,
    model: TruthModel,
    finals_path: Path | None = None,
    space_weather_path: Path | None = None,
) -> np.ndarray:
    """Atmospheric density (n,) [kg/m3] that drag sees along the truth (NRLMSISE-00)."""
    t_gps_ns = np.asarray(t_gps_ns, dtype=np.int64)
    r_gcrf_m, v_gcrf_mps = truth.state_gcrf(t_gps_ns)
    first, last = int(t_gps_ns.min()), int(t_gps_ns.max())
    r_itrf_m, _ = EarthOrientation(first, last, finals_path).to_itrf(t_gps_ns, r_gcrf_m, v_gcrf_mps)
    with session(first, last, model.fixed_f107, finals_path, space_weather_path) as satkit:
        return np.array(
            [
                satkit.density.nrlmsise(satkit.itrfcoord(r), satkit_time(satkit, t))[0]
                for r, t in zip(r_itrf_m, t_gps_ns, strict=True)
            ]
        )


def _settings(satkit: Any, model: TruthModel) -> tuple[Any, Any]:
    settings = satkit.propsettings(
        abs_error=TOLERANCE,
        rel_error=TOLERANCE,
        gravity_degree=model.gravity_degree,
        gravity_model=satkit.gravmodel.egm2008,
        use_sun_gravity=model.sun,
        use_moon_gravity=model.moon,
        tide_model=satkit.tidemodel.solid_step1 if model.tides else satkit.tidemodel.none,
        require_eop_coverage=True,
    )
    return settings, _satellite(satkit, model, [])


def _satellite(satkit: Any, model: TruthModel, thrusts: list[Any], area_factor: float = 1.0) -> Any:
    """The satellite with so many times the model's cross-section."""
    area_to_mass = model.area_to_mass_m2pkg * area_factor
    return satkit.satproperties(
        cdaoverm=model.drag_coefficient * area_to_mass,
        craoverm=model.srp_coefficient * area_to_mass,
        thrusts=thrusts,
    )


def _about_z(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
