"""The paper's problem (15) to (23) on outages that were flown: one outage exactly or by frequency, or all start
phases."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_saturation import saturation
from ground.tuning.descent import Found, Trial, admissible_start, descend, latest_flag
from ground.tuning.recursion import PARAMETERS, Carried, Outages, carry
from ground.tuning.settling import settled_m

# "any" start, of which (23) asks nothing but (22): Table 1's noise with pseudo-measurements that hardly weigh
START = np.array([500.0, 0.05, 1e-6, 5e4, 5e2])
_SETTLED = 2.02  # times eps, at least, where the bound settles: the saturation linter asks for 2


class Problem(NamedTuple):
    """Outages, eps, T of each (18) [epochs], whether eps is reached there, and the table that the row is for.

    Where it is not reached, (22) is asked for as long as was flown.
    """

    outages: Outages
    limit_m: float
    last: np.ndarray
    reached: np.ndarray
    values: np.ndarray
    row: int

    @classmethod
    def of(cls, outages: Outages, limit_m: float, values: np.ndarray, row: int) -> Problem:
        """values: (1,) of the table, row: of its tuning rows the one that these fixes meet."""
        crossing = outages.crossing(limit_m)
        reached = crossing >= 0
        return cls(outages, limit_m, np.where(reached, crossing, len(outages.error_m) - 1), reached, values, row)

    def part(self, lanes: np.ndarray) -> Problem:
        """Some of the outages."""
        return self._replace(outages=self.outages.of(lanes), last=self.last[lanes], reached=self.reached[lanes])

    def carry(self, row: np.ndarray, margin: float = 1.0, allowed: int = 0) -> Carried:
        """What a row does; see `recursion.carry`."""
        return carry(self.outages, self.last, row, self.limit_m, margin, allowed)

    def sound(self, row: np.ndarray) -> bool:
        """Whether the saturation linter passes the row."""
        return not refusals(self.values, self.row, row)


def with_row(values: np.ndarray, index: int, row: np.ndarray) -> np.ndarray:
    """A table (1,) with another row for (17)."""
    changed = values.copy()
    for name, value in zip(PARAMETERS, row, strict=True):
        changed[f"tuning_bound_{name}"][0, index] = value
    return changed


def refusals(values: np.ndarray, index: int, row: np.ndarray) -> list[str]:
    """What the saturation linter says of a row, alone in its table."""
    changed = with_row(values, index, row)
    for name in changed.dtype.names or ():
        if name.startswith("tuning_") and name != "tuning_rows":
            changed[name][0, 0] = changed[name][0, index]
    changed["tuning_rows"] = 1
    return saturation(changed)


def solve(problem: Problem, margin: float = 1.0, frequency: float = 0.0, common: bool = False) -> Found:
    """Down the ladder. frequency: share of an outage's epochs at which (22) may be broken (the paper's statistical
    variant; 0: exact). common: on from there for the latest flag over all outages. ValueError where nothing covers."""
    allowed = int(frequency * float(problem.last.min()))

    def attempt(row: np.ndarray) -> Trial | None:
        done = problem.carry(row, margin, allowed)
        if not done.holds:
            return None
        outages = problem.outages
        settled = settled_m(row, outages.dt_s, outages.runge_kutta, outages.k_axis) / (_SETTLED * problem.limit_m)
        if not settled > 1.0:
            return None
        room = np.maximum(1.0 - margin * done.worst, 1e-9)
        flag_s = np.where(np.isnan(done.flag_s), problem.last, done.flag_s)
        share = flag_s[problem.reached] / problem.last[problem.reached]
        at_t_m = float(np.exp(np.log(done.at_last_m[problem.reached]).mean()))
        slack = float(-np.log(room).mean()) - math.log(1.0 - 1.0 / settled)
        return Trial(at_t_m, slack, float(-np.log(share).mean()))

    if not problem.reached.any():
        raise ValueError(f"no error reaches {problem.limit_m:g} m: (18) has no solution")
    start = admissible_start(START, problem.limit_m, attempt, problem.sound)
    found = descend(start, problem.limit_m, attempt, problem.sound)
    return latest_flag(found, problem.limit_m, attempt, problem.sound) if common else found


def margin_of(problem: Problem) -> float:
    """What to ask for beyond (22) so that phases which were not tuned on hold: each half is tuned on the other one.

    Rows that only just cover the outages they were made from are broken by others. The margin is the worst error /
    bound that either row meets on the half which it has not seen; at least 1.
    """
    lanes = np.arange(len(problem.last))
    halves = problem.part(lanes[::2]), problem.part(lanes[1::2])
    worst = 1.0
    for seen, unseen in (halves, halves[::-1]):
        found = solve(seen, common=True)
        worst = max(worst, float(unseen.carry(found.row, allowed=len(unseen.outages.error_m)).worst.max()))
    return worst
