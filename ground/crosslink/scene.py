"""A constellation at one instant with its monitor made ready by the code that flies."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from flightsw.crosslink.monitor import monitor_epoch
from flightsw.crosslink.setup import MonitorMemory, Settings
from hil_sim.truth.constellation.broadcast import HealthyErrors, broadcast
from hil_sim.truth.constellation.crosslinks import View, both, flight_m, once
from hil_sim.truth.constellation.orbits import Constellation, Walker

FIRST_LATITUDE_DEG = 52.0  # from 50.0 to 60.25 satellite 1 sees the paper's nine neighbours

PERIOD_S = 40_544.0  # of the orbit: the geometry of the pattern repeats after a third of it


@dataclass(frozen=True)
class Setting:
    """What a study is about; picklable, the same for every run."""

    walker: Walker = field(default_factory=lambda: Walker(first_latitude_deg=FIRST_LATITUDE_DEG))
    view: View = field(default_factory=View)
    errors: HealthyErrors = field(default_factory=HealthyErrors)
    range_sigma_m: float = 11.8
    p_false_alarm: float = 2e-7
    two_way: bool = False
    both: bool = False

    def monitor(self, own: int = 0) -> Settings:
        """The monitor of one satellite, which knows the noise table."""
        return Settings(
            satellites=self.walker.total,
            own=own,
            two_way=self.two_way,
            both=self.both,
            sigma_range_m=self.range_sigma_m,
            sigma_m=self.errors.sigma_m,
            sigma_rate_mps=self.errors.sigma_rate_mps,
            p_false_alarm=self.p_false_alarm,
        )


def fill_epoch(
    memory: MonitorMemory,
    t_s: float,
    r_m: np.ndarray,
    v_mps: np.ndarray,
    clock_m: np.ndarray,
    pairs: np.ndarray,
    range_m: np.ndarray,
) -> None:
    """Put an epoch into a monitor: positions, velocities (n,3), clocks (n,) as broadcast; pairs (m,2), ranges (m,)."""
    epoch, n, m = memory.epoch, len(r_m), len(pairs)
    known = np.isfinite(r_m).all(axis=1)
    epoch["t_gps_ns"] = round(t_s * 1e9)
    epoch["known"][0, :n] = known
    epoch["healthy"][0, :n] = 1
    epoch["r_m"][0, :n] = np.where(known[:, None], r_m, 0.0)
    epoch["v_mps"][0, :n] = np.where(known[:, None], v_mps, 0.0)
    epoch["clock_m"][0, :n] = clock_m
    epoch["links"] = m
    epoch["receiver"][0, :m] = pairs[:, 0]
    epoch["sender"][0, :m] = pairs[:, 1]
    epoch["range_m"][0, :m] = range_m


def ready(
    setting: Setting, t_s: float, own: int = 0, constellation: Constellation | None = None
) -> tuple[MonitorMemory, np.ndarray]:
    """A monitor after one epoch without any error, its tests ready; and the pairs (m,2) in view."""
    where: Constellation = setting.walker if constellation is None else constellation
    memory = MonitorMemory(setting.monitor(own))
    r, v = where.states(t_s)
    seen = setting.view.pairs(r)
    pairs = both(seen) if setting.both else once(seen)
    distance = flight_m(where, t_s)
    i, j = pairs[:, 0], pairs[:, 1]
    ranges = 0.5 * (distance[i, j] + distance[j, i]) if setting.two_way else distance[i, j]
    position, clock = broadcast(r, v, np.zeros((len(r), 4)))
    fill_epoch(memory, t_s, position, v, clock, pairs, ranges)
    monitor_epoch(*memory.arguments())
    return memory, pairs


@lru_cache(maxsize=4)
def mean_neighbours(setting: Setting, samples: int = 720) -> float:
    """Neighbours in view, mean over satellites and a revolution."""
    return float(np.mean([setting.view.pairs(setting.walker.states(t)[0]).sum(axis=1).mean() for t in _times(samples)]))


def neighbours_of(setting: Setting, satellite: int, t_s: float) -> tuple[int, ...]:
    """Numbers from 1 of the satellites in view of one, which is counted from 0."""
    return tuple(int(k) + 1 for k in np.flatnonzero(setting.view.pairs(setting.walker.states(t_s)[0])[satellite]))


def _times(samples: int) -> np.ndarray:
    return np.arange(samples) * (PERIOD_S / samples)
