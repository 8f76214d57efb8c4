"""Where GPS satellites transmit from: precise orbits give the centre of mass, and the antenna is up to 2.7 m below it.

Offsets along the axis toward the Earth, from igs05.atx (IGS, absolute calibration; Schmid et al. 2007, J Geod 81), the
model that the CODE orbits and clocks of 2010 were made with. They matter: between blocks they differ by two metres. The
offset across, 0.28 m on block IIA toward the Sun's side, shows by 7 cm at most and is left out, as are the patterns.
"""

from __future__ import annotations

import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError

# satellites 1 to 32 as they flew from G25's first day (SVN 62) to the day before G01 became SVN 63
_FIRST_NS = 11_100 * gps_time.DAY_NS  # 2010-05-28
_LAST_NS = 11_514 * gps_time.DAY_NS  # 2011-07-16
_TOWARD_EARTH_M = (
    0.7, 0.614, 2.619, 2.279, 0.7, 2.676, 0.7, 2.405, 2.34, 2.389, 0.971, 0.7, 1.203, 1.178, 0.7, 1.307,
    0.645, 1.133, 0.668, 1.154, 1.3, 0.792, 0.602, 2.455, 1.407, 2.307, 2.472, 0.911, 0.7, 2.466, 0.75, 2.575,
)  # fmt: skip


def offsets_toward_earth_m(t_first_gps_ns: int, t_last_gps_ns: int) -> np.ndarray:
    """Offsets of satellites 1 to 32 toward the Earth (32,) [m]. Raises DataError outside the days they hold for."""
    if t_first_gps_ns < _FIRST_NS or t_last_gps_ns > _LAST_NS:
        raise DataError(
            f"antenna offsets of GPS satellites are known from {gps_time.to_calendar(_FIRST_NS):%Y-%m-%d} to "
            f"{gps_time.to_calendar(_LAST_NS):%Y-%m-%d}, not for {gps_time.to_calendar(t_first_gps_ns):%Y-%m-%d}; "
            "set gnss.recorded_antennas = false to solve for centres of mass"
        )
    return np.array(_TOWARD_EARTH_M)
