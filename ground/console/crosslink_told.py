"""What flight says of its crosslinks, and how the console keeps it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple


class Crosslink(NamedTuple):
    """LEONAV_CROSSLINK: the inter-satellite monitor. Satellites count from 0 here, from 1 on the screen."""

    t_gps_ns: int
    faulty: int
    named: int
    own_statistic: float
    own_threshold: float
    network_statistic: float
    network_threshold: float
    weakest_m: float
    epoch_age_s: float
    links: int
    own_links: int
    rank: int
    parameters: int
    incomplete: int
    own_state: int
    majority: int
    own: int
    satellites: int
    network_worst: int
    own_peer: int
    weakest: int
    unmonitored: int = 0  # an older flight does not tell


def fold_crosslink(state: Any, message: Any, now_s: float) -> Any:
    """The console's state after a LEONAV_CROSSLINK was heard."""
    told = Crosslink(*(getattr(message, name) for name in Crosslink._fields))
    return replace(state, crosslink=told, crosslink_s=now_s)
