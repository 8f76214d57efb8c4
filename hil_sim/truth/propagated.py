"""Truth by numerical propagation with satkit, a library flight does not use.

Forces: EGM2008 to the chosen degree, drag on NRLMSISE-00 density, radiation pressure, Sun, Moon, solid tides, general
relativity (satkit's propagator; Earth orientation IERS 2010).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from hil_sim.scenario_schema import MU_EGM2008_M3PS2, Orbit, TruthModel, semi_major_axis_m
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.hermite import NODES_EACH_SIDE, HermiteTrack
from hil_sim.truth.interface import TrackTruth
from hil_sim.truth.satkit_data import satkit_time, session

NODE_STEP_NS = 10_000_000_000
TOLERANCE = 1e-12  # of the adaptive Runge-Kutta 9(8): sub-millimetre over a day's fraction
MARGIN_NODES = NODES_EACH_SIDE + 1


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
) -> TrackTruth:
    """Truth from the start for `duration_ns`, with a little more on both sides.

    Raises DataError when space weather or Earth orientation does not cover the run.
    """
    margin_ns = MARGIN_NODES * NODE_STEP_NS
    after = -(-int(duration_ns) // NODE_STEP_NS) + MARGIN_NODES
    t_last_ns = t_start_gps_ns + after * NODE_STEP_NS
    with session(t_start_gps_ns - margin_ns, t_last_ns, model.fixed_f107, finals_path, space_weather_path) as satkit:
        settings, satellite = _settings(satkit, model)
        start = satkit_time(satkit, t_start_gps_ns)
        state = initial_state(orbit)
        parts = []
        for nodes in (range(-MARGIN_NODES, 0), range(after + 1)):
            reach_s = (nodes[0] if nodes[0] < 0 else nodes[-1]) * NODE_STEP_NS / 1e9
            result = satkit.propagate(
                state, start, duration_secs=reach_s, propsettings=settings, satproperties=satellite
            )
            instants = [satkit_time(satkit, t_start_gps_ns + n * NODE_STEP_NS) for n in nodes]
            parts.append(np.array(result.interp(instants)))
    samples = np.concatenate(parts)
    track = HermiteTrack(t_start_gps_ns - margin_ns, NODE_STEP_NS, samples[:, :3].copy(), samples[:, 3:].copy())
    return TrackTruth(track, f"satkit {satkit.__version__}, EGM2008 {model.gravity_degree}, solar {model.solar}")


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
    satellite = satkit.satproperties(
        cdaoverm=model.drag_coefficient * model.area_to_mass_m2pkg,
        craoverm=model.srp_coefficient * model.area_to_mass_m2pkg,
    )
    return settings, satellite


def _about_z(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
