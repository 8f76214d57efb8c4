"""What was made of one epoch of pseudoranges."""

from __future__ import annotations

import math
from typing import NamedTuple

from flightsw.gnss.records import CONSTELLATIONS, Verdict


class Judged(NamedTuple):
    """What was made of an epoch; masks by constellation: bit i is satellite i + 1."""

    t_gps_ns: int = 0
    t_counter_ns: int = 0
    verdict: int = int(Verdict.NO_EPOCH)
    used: tuple[int, ...] = (0,) * CONSTELLATIONS
    excluded: tuple[int, ...] = (0,) * CONSTELLATIONS
    refused: int = 0
    dof: int = 0
    statistic: float = math.nan
    threshold: float = math.nan
    protection_m: tuple[float, ...] = (math.inf,) * 3
    sigma_m: tuple[float, ...] = (math.nan,) * 3
    available: int = 0
    offered: int = 0
