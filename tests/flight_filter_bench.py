"""A bench for the flight filter: it flies a point mass, so that truth is Kepler's closed form, kicks included.

Beside tests/flight_bench.py; the force model itself is tested elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from flight_bench import (
    NS,
    T0_GPS_NS,
    Truth,
    calls,
    circular_orbit,
    loaded_memory,
    put_fixes,
    put_pulses,
    seconds,
    two_body,
)

from flightsw.icd.table_file import decode
from flightsw.icd.table_schema import NAVIGATION
from flightsw.kernels.registry import warm_up
from flightsw.memory import Memory
from flightsw.records import FORCE_TABLE, GRAVITY_TABLE, OUTPUT, TABLE
from ground.campaign import arc
from ground.tables.build import build_navigation

MU = 3.986004415e14
ORBIT = circular_orbit(500e3)
ORBIT[3:6] *= np.sqrt(MU / 3.9860044e14)

# What the bench flies where a test does not say otherwise: a filter a little less certain than the truth allows.
SETTINGS: dict[str, Any] = {
    "gravity_model": "central",
    "mu_m3ps2": MU,
    "empirical_sigma_mps2": 5e-8,
    "empirical_tau_s": 600.0,
    "drag_sigma": 0.0,
    "drag_slow_sigma": 0.0,
}
NO_FORCES = {
    "degree": 2,
    "order": 2,
    "gradient_degree": 2,
    "solid_tides": 0,
    "sun": 0,
    "moon": 0,
    "relativity": 0,
    "area_to_mass_m2pkg": 0.0,
    "drag_coefficient": 2.2,
    "radiation_coefficient": 1.3,
    "f107": 120.0,
    "f107_mean": 120.0,
    "ap": 8.0,
    "valid_from_gps_ns": 0,
    "valid_until_gps_ns": 4_000_000_000 * NS,
    "integrator": 2,
    "step_max_ns": 15 * NS,
}


@cache
def _navigation(settings: tuple[tuple[str, Any], ...]) -> np.ndarray:
    return decode(build_navigation("flight", {**SETTINGS, **dict(settings)})).values


def flying_memory(**settings: Any) -> Memory:
    """A memory that flies the flight filter around a point mass; settings are those of the navigation table."""
    memory = loaded_memory("two_body")
    orientation = memory.orientation
    memory = Memory()
    memory.load(_navigation(tuple(sorted(settings.items()))), orientation)
    forces, field = np.zeros(1, FORCE_TABLE), np.zeros(1, GRAVITY_TABLE)
    for name, value in NO_FORCES.items():
        forces[name] = value
    field["gm_m3ps2"], field["radius_m"], field["degree"] = MU, 6378136.3, 2
    field["coefficients"][0, 0] = 1.0
    memory.load_forces(forces, field)
    return memory


def bare_table(**fields: Any) -> np.ndarray:
    """A navigation table (1,) of defaults and these fields, without the checks of a set."""
    table = np.zeros(1, TABLE)
    for field in NAVIGATION.fields:
        if field.default is not None:
            table[field.name] = field.default
    for name, value in fields.items():
        table[name] = value
    return table


def kepler(state: np.ndarray = ORBIT, kicks: Sequence[tuple[float, Any]] = ()) -> Truth:
    """Truth from the state at T0 on; kicks: (seconds after T0, change of velocity (3,) in RTN), in order of time."""
    pieces = [(T0_GPS_NS, np.array(state[:6]))]
    for at_s, dv_rtn in kicks:
        t_ns = T0_GPS_NS + round(at_s * NS)
        r, v = two_body(pieces[-1][1], np.array([t_ns]), MU, pieces[-1][0])
        pieces.append((t_ns, np.concatenate([r[0], v[0] + rtn(r[0], v[0]) @ np.asarray(dv_rtn)])))

    def truth(t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        t = np.atleast_1d(np.asarray(t_gps_ns, dtype=np.int64))
        r, v = np.zeros((len(t), 3)), np.zeros((len(t), 3))
        for k, (start_ns, start) in enumerate(pieces):
            stop_ns = pieces[k + 1][0] if k + 1 < len(pieces) else np.iinfo(np.int64).max
            here = (t < stop_ns) & ((t >= start_ns) | (k == 0))
            if here.any():
                r[here], v[here] = two_body(start, t[here], MU, start_ns)
        return r, v

    return truth


def rtn(r: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Columns radial, along-track, cross-track."""
    radial = r / np.linalg.norm(r)
    cross = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    return np.column_stack([radial, np.cross(cross, radial), cross])


def fixes_every_second(
    first_s: int,
    stop_s: int,
    truth: Truth,
    noise: np.random.Generator | None = None,
    sigma_r_m: float = 10.0,
    sigma_v_mps: float = 0.1,
) -> np.ndarray:
    """Inputs of one step a second, each with a pulse and a fix."""
    t = seconds(first_s, stop_s)
    inputs = calls(t)
    put_pulses(inputs, slice(None), t)
    put_fixes(inputs, slice(None), t, truth, sigma_r_m, sigma_v_mps, noise)
    return inputs


def fly(memory: Memory, inputs: np.ndarray) -> np.ndarray:
    """Outputs (n,) of records.OUTPUT, by the compiled arc."""
    warm_up()
    outputs = arc.fly(memory, inputs)
    assert outputs.dtype == OUTPUT
    return outputs


def errors_rtn(outputs: np.ndarray, truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Published minus true position and velocity (n, 3) in RTN of the truth."""
    r, v = truth(outputs["t_gps_ns"])
    dr, dv = outputs["r_gcrf_m"] - r, outputs["v_gcrf_mps"] - v
    turn = np.array([rtn(*rv) for rv in zip(r, v, strict=True)])
    return np.einsum("nij,ni->nj", turn, dr), np.einsum("nij,ni->nj", turn, dv)
