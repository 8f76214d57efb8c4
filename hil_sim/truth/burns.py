"""Manoeuvres as they are flown: what was commanded, and the error of its execution."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hil_sim.scenario_schema import Burn

_US = 1000  # satkit's instants are whole microseconds


class FlownBurn(NamedTuple):
    """A burn of the truth: constant acceleration dv / duration along the axes of its frame, 'gcrf' or 'rtn'.

    Times in ns, whole microseconds; dv_mps (3,) as flown, execution error included.
    """

    t_start_gps_ns: int
    duration_ns: int
    dv_mps: tuple[float, float, float]
    frame: str

    @property
    def t_end_gps_ns(self) -> int:
        """When the thrust ends [ns]."""
        return self.t_start_gps_ns + self.duration_ns


def fly(burns: tuple[Burn, ...], t_start_gps_ns: int, stream: np.random.Generator) -> tuple[FlownBurn, ...]:
    """The scenario's burns with their errors of execution: N(0, sigma_mps) on each axis, three draws a burn."""
    flown = []
    for burn in burns:
        error = np.array(burn.sigma_mps) * stream.standard_normal(3)
        x, y, z = (np.array(burn.dv_mps) + error).tolist()
        flown.append(
            FlownBurn(
                t_start_gps_ns + round(burn.start_s * 1e6) * _US,
                round(burn.duration_s * 1e6) * _US,
                (x, y, z),
                burn.frame,
            )
        )
    return tuple(flown)
