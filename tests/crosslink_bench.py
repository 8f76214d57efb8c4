"""A constellation and monitors for the tests of the inter-satellite monitor."""

from __future__ import annotations

import numpy as np

from flightsw.crosslink.monitor import monitor_epoch
from flightsw.crosslink.setup import MonitorMemory, Settings
from hil_sim.truth.constellation.broadcast import Fault, HealthyErrors, broadcast
from hil_sim.truth.constellation.crosslinks import Ranging, View, both, once
from hil_sim.truth.constellation.orbits import Walker

WALKER = Walker(first_latitude_deg=52.0)


class Bench:
    """A world of one constellation and the monitor of one satellite in it."""

    def __init__(self, seed: int = 1, noise: float = 1.0, directions: bool = True, **settings) -> None:
        self.rng = np.random.default_rng(seed)
        self.errors = HealthyErrors()
        self.bias, self.rate = self.errors.draw(WALKER.total, self.rng)
        self.bias *= noise
        self.rate *= noise
        self.memory = MonitorMemory(Settings(both=directions, **settings))
        self.ranging = Ranging(11.8 * noise, two_way=bool(settings.get("two_way", False)))
        self.directions = directions
        self.issue = np.zeros(WALKER.total, np.int64)
        self.faults: list[Fault] = []
        self.t_s = 0.0

    @property
    def verdict(self) -> np.ndarray:
        """The last verdict."""
        return self.memory.verdict[0]

    @property
    def state(self) -> np.ndarray:
        """What is latched."""
        return self.memory.state[0]

    def step(self, epochs: int = 1) -> np.ndarray:
        """Fly so many epochs; the last verdict."""
        for _ in range(epochs):
            self.put(self.t_s)
            monitor_epoch(*self.memory.arguments())
            self.t_s += 1.0
        return self.verdict

    def put(self, t_s: float) -> None:
        """Fill the epoch of t."""
        r, v = WALKER.states(t_s)
        errors = self.bias + t_s * self.rate
        for fault in self.faults:
            errors[list(fault.satellites)] += fault.error_m(t_s)
        seen = View().pairs(r)
        pairs = both(seen) if self.directions else once(seen)
        pairs, ranges = self.ranging.measure(WALKER, t_s, pairs, np.zeros(WALKER.total), self.rng)
        position, clock = broadcast(r, v, errors)
        epoch, n, m = self.memory.epoch, WALKER.total, len(pairs)
        epoch["known"][0, :n], epoch["issue"][0, :n] = 1, self.issue
        epoch["r_m"][0, :n], epoch["v_mps"][0, :n], epoch["clock_m"][0, :n] = position, v, clock
        epoch["links"] = m
        epoch["receiver"][0, :m], epoch["sender"][0, :m] = pairs[:, 0], pairs[:, 1]
        epoch["range_m"][0, :m] = ranges


def jump(satellite: int, direction: int, size_m: float, **when: float) -> Fault:
    """A jump of one satellite in one direction."""
    vector = [0.0] * 4
    vector[direction] = size_m
    return Fault((satellite,), jump_m=(vector[0], vector[1], vector[2], vector[3]), **when)


def ramp(satellite: int, direction: int, rate_mps: float, **when: float) -> Fault:
    """A ramp of one satellite in one direction."""
    vector = [0.0] * 4
    vector[direction] = rate_mps
    return Fault((satellite,), ramp_mps=(vector[0], vector[1], vector[2], vector[3]), **when)
