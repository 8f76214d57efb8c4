"""How long a slowly growing error stays hidden: whole monitors, epoch by epoch, as they fly.

A run is one case and one seed: a random geometry, a random faulty satellite, whose own monitor is flown. The ramp
begins after `QUIET_S` of healthy epochs, in which the statistics of slow faults are also counted against chi-square.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flightsw.crosslink.majority import UNRELIABLE
from flightsw.crosslink.monitor import monitor_epoch
from flightsw.crosslink.own import FAULT, SUSPECT
from flightsw.crosslink.setup import MonitorMemory
from flightsw.crosslink.thresholds import chi2_quantile
from ground.campaign import store
from ground.campaign.seeds import Seeds, tuning
from ground.crosslink.scene import PERIOD_S, Setting, fill_epoch
from hil_sim.truth.constellation.broadcast import DIRECTIONS, Fault, broadcast
from hil_sim.truth.constellation.crosslinks import Ranging, both, once

QUIET_S = 300
LIMIT_S = {0.01: 1400, 0.05: 500}
MAJORITY_LIMIT_S = 20_000
CHECKED_TAILS = (0.1, 0.01, 0.001)

Arrays = dict[str, np.ndarray]


class Case(NamedTuple):
    """A ramp of one satellite."""

    direction: int
    rate_mps: float

    @property
    def name(self) -> str:
        """For tables."""
        return f"{DIRECTIONS[self.direction]} {self.rate_mps:g} m/s"


CASES = tuple(Case(direction, rate) for rate in LIMIT_S for direction in range(4))


@dataclass(frozen=True)
class Ramps:
    """What is flown, with which seeds; run r is case r modulo their number."""

    setting: Setting = field(default_factory=lambda: Setting(both=True))
    seeds: Seeds = field(default_factory=lambda: tuning(2))


def work(ramps: Ramps, first: int, last: int) -> Arrays:
    """Figures of runs first to last, stacked; for the campaign's executor."""
    return store.stacked(one(ramps, run) for run in range(first, last + 1))


class _World:
    """A constellation whose healthy errors last, with one fault."""

    def __init__(self, setting: Setting, rng: np.random.Generator, fault: Fault, start_s: float) -> None:
        self.setting, self.fault, self.start_s, self._rng = setting, fault, start_s, rng
        self._bias, self._rate = setting.errors.draw(setting.walker.total, rng)
        self._ranging = Ranging(setting.range_sigma_m, two_way=setting.two_way)

    def errors_m(self, t_s: float) -> np.ndarray:
        """Errors (n,4) at a time from the start."""
        errors = self.setting.errors.at_age(self._bias, self._rate, t_s)
        errors[list(self.fault.satellites)] += self.fault.error_m(t_s)
        return errors

    def put(self, memory: MonitorMemory, t_s: float) -> None:
        """The epoch at t into a monitor."""
        walker = self.setting.walker
        r, v = walker.states(self.start_s + t_s)
        seen = self.setting.view.pairs(r)
        pairs = both(seen) if self.setting.both else once(seen)
        pairs, ranges = self._ranging.measure(walker, self.start_s + t_s, pairs, np.zeros(walker.total), self._rng)
        position, clock = broadcast(r, v, self.errors_m(t_s))
        fill_epoch(memory, t_s, position, v, clock, pairs, ranges)


def one(ramps: Ramps, run: int) -> Arrays:
    """Seconds from the ramp's begin to each verdict; NaN: not until the limit.

    network_s: somebody named; named_right: exactly the faulty one. own_s: SUSPECT or FAULT; own_fault_s: FAULT.
    majority_s: the paper's rule. quiet_named, quiet_own, quiet_majority: epochs with a finding before the ramp.
    slow_tested, slow_beyond (3,): statistics of slow faults before it, and those beyond CHECKED_TAILS.
    """
    case = CASES[run % len(CASES)]
    rng = np.random.default_rng(ramps.seeds.of_run(run))
    own = int(rng.integers(ramps.setting.walker.total))
    ramp = [0.0] * 4
    ramp[case.direction] = case.rate_mps * (1.0 if rng.random() < 0.5 else -1.0)
    fault = Fault((own,), ramp_mps=(ramp[0], ramp[1], ramp[2], ramp[3]), onset_s=float(QUIET_S))
    world = _World(ramps.setting, rng, fault, float(rng.uniform(0.0, PERIOD_S)))
    memory = MonitorMemory(ramps.setting.monitor(own))
    arguments = memory.arguments()
    verdict, state = memory.verdict, memory.state
    quiet = dict.fromkeys(("quiet_named", "quiet_own", "quiet_majority"), 0)
    found = dict.fromkeys(("network_s", "own_s", "own_fault_s", "majority_s"), math.nan)
    right, tested, beyond = False, 0, np.zeros(len(CHECKED_TAILS), np.int64)
    limits = np.array([chi2_quantile(p, 4) for p in CHECKED_TAILS])
    for second in range(QUIET_S + LIMIT_S[case.rate_mps]):
        world.put(memory, float(second))
        monitor_epoch(*arguments)
        age = float(second - QUIET_S)
        if age < 0.0:
            quiet["quiet_named"] += int(verdict["named"][0] != 0)
            quiet["quiet_own"] += int(state["own_state"][0] != 0)
            quiet["quiet_majority"] += int(verdict["majority"][0] == UNRELIABLE)
            if math.isfinite(verdict["slow_age_s"][0]) and memory.network["ready"][0]:
                full = memory.network["dof"][0] == 4
                tested += int(full.sum())
                beyond += (memory.network["statistic"][0][full][:, None] > limits).sum(axis=0)
            continue
        if math.isnan(found["network_s"]) and verdict["named"][0] != 0:
            found["network_s"] = age
            right = int(verdict["named"][0]) == 1 << own
        if math.isnan(found["own_s"]) and state["own_state"][0] in (SUSPECT, FAULT):
            found["own_s"] = age
        if math.isnan(found["own_fault_s"]) and state["own_state"][0] == FAULT:
            found["own_fault_s"] = age
        if math.isnan(found["majority_s"]) and verdict["majority"][0] == UNRELIABLE:
            found["majority_s"] = age
        if not math.isnan(found["network_s"]) and not math.isnan(found["own_fault_s"]):
            break
    if math.isnan(found["majority_s"]):
        found["majority_s"] = _majority_s(world, memory, own)
    return {
        "case": np.array(run % len(CASES)),
        "own": np.array(own),
        "named_right": np.array(right),
        **{name: np.array(value) for name, value in {**found, **quiet}.items()},
        "slow_tested": np.array(tested),
        "slow_beyond": beyond,
    }


def _majority_s(world: _World, memory: MonitorMemory, own: int) -> float:
    """When the paper's rule finds the ramp at last: own links only, lines of sight anew each minute."""
    threshold_m = float(memory.table["majority_threshold_m"][0])
    rng, setting = np.random.default_rng(own), world.setting
    for minute in range(0, MAJORITY_LIMIT_S, 60):
        t_s = QUIET_S + minute
        r, v = setting.walker.states(world.start_s + t_s)
        others = np.flatnonzero(setting.view.pairs(r)[own])
        wrong, clock = broadcast(r, v, world.errors_m(t_s))
        later, clock_later = broadcast(r, v, world.errors_m(t_s + 60.0))
        first = _differences(r, wrong, clock, own, others)
        last = _differences(r, later, clock_later, own, others)
        share = np.arange(60)[:, None] / 60.0
        dr = first + share * (last - first) + setting.range_sigma_m * rng.standard_normal((60, len(others)))
        votes = 2 * (np.abs(dr) > threshold_m).sum(axis=1) > len(others)
        if votes.any():
            return float(minute + int(np.argmax(votes)))
    return math.nan


def _differences(r: np.ndarray, wrong: np.ndarray, clock: np.ndarray, own: int, others: np.ndarray) -> np.ndarray:
    true = np.linalg.norm(r[own] - r[others], axis=1)
    return np.linalg.norm(wrong[own] - wrong[others], axis=1) - true + clock[own] - clock[others]
