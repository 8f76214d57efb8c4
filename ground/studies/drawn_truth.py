"""Truth drawn from the flight filter's own stochastic model: the same forces, and accelerations as the table says.

What the filter takes for random is drawn as random: empirical RTN accelerations and the two parts of the drag scale as
first-order Gauss-Markov processes. If the filter is right about itself, its errors along such a truth have its
covariance. The forces are flight's own kernels on purpose: what is tested here is the filter, not the model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flightsw.kernels.orbit_integrators import advance
from flightsw.kernels.registry import F8, I8, MATRIX, VECTOR, entry, frozen_records, records
from flightsw.memory import Memory
from flightsw.records import FIELD, FORCE_TABLE, FORCE_WORK, ORIENTATION
from ground.errors import OperatorError
from ground.studies.arcs import Sky, Track, coloured

_NS = 1_000_000_000


@entry(
    frozen_records(FORCE_TABLE),
    frozen_records(FIELD),
    frozen_records(ORIENTATION),
    I8,
    F8,
    MATRIX,
    VECTOR,
    MATRIX,
    records(FORCE_WORK),
)
def _carry(forces, field, eop, t_gps_ns, step_s, empirical_rtn, drag_scale, states, work):
    """states[0] (6,) on through all rows, a step each, the accelerations of a step being its own. Returns the rows."""
    step_ns = round(step_s * 1e9)
    for k in range(states.shape[0] - 1):
        for i in range(6):
            states[k + 1, i] = states[k, i]
        x = states[k + 1]
        if not advance(
            forces[0], field[0], eop[0], t_gps_ns + k * step_ns, x, step_ns, drag_scale[k], empirical_rtn[k], work[0]
        ):
            return k
    return states.shape[0] - 1


def _empirical_sigma_mps2(table: Any, radius_m: np.ndarray) -> np.ndarray:
    """Steady sigma of each empirical acceleration at these radii: the table's, and omitted gravity's."""
    ratio = (float(table["equatorial_radius_m"]) + 500e3) / radius_m
    omitted = float(table["omitted_gravity_sigma_mps2"]) * ratio ** (float(table["omitted_gravity_degree"]) + 2.0)
    return np.hypot(float(table["empirical_sigma_mps2"]), omitted)


def draw(sky: Sky, memory: Memory, first: int, count: int, noise: np.random.Generator) -> Track:
    """A motion of `count` rows that begins at the sky's true state of second `first`. The table in `memory` says how
    its accelerations vary; within a step they have the mean of its ends."""
    table: Any = memory.table[0]
    white = {name: float(table[f"white_{name}_m2ps3"]) for name in ("radial", "along", "cross")}
    if any(white.values()):
        raise OperatorError(f"white accelerations {white}: the truth of a study of consistency draws none; set them 0")
    sigma_mps2 = _empirical_sigma_mps2(table, np.linalg.norm(sky.r_m[first : first + count], axis=1))
    empirical = sigma_mps2[:, None] * coloured(noise, count, 1.0, float(table["empirical_tau_s"]))
    fast = coloured(noise, count, float(table["drag_sigma"]), float(table["drag_tau_s"]), 1)
    slow = coloured(noise, count, float(table["drag_slow_sigma"]), float(table["drag_slow_tau_s"]), 1)
    scale = 1.0 + (fast + slow)[:, 0]
    states = np.zeros((count, 6))
    states[0] = np.concatenate((sky.r_m[first], sky.v_mps[first]))
    done = _carry(
        memory.forces,
        memory.field,
        memory.orientation,
        int(sky.t_gps_ns[first]),
        1.0,
        np.ascontiguousarray(0.5 * (empirical[1:] + empirical[:-1])),
        np.ascontiguousarray(0.5 * (scale[1:] + scale[:-1])),
        states,
        memory.scratch,
    )
    if done != count - 1:
        raise OperatorError(f"the Earth-orientation table ends {done} s after the start of a drawn motion")
    return Track(first, states[:, :3], states[:, 3:])
