"""The paper's problem (15) to (23) on outages that were flown: one outage exactly or by frequency, or all start
phases."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_saturation import saturation
from ground.tuning.descent import Found, Trial, admissible_start, descend, latest_flag
from ground.tuning.recursion import PARAMETERS, Carried, Outages, carry
from ground.tuning.settling import settled_m

# "any" start, of which (23) asks nothing but (22): Table 1's noise with pseudo-measurements that hardly weigh. The
# descent has no single end; where the first does not come to eps, the second may.
STARTS = tuple(np.array([500.0, 0.05, 1e-6, 5e4, s_v_mps]) for s_v_mps in (500.0, 50.0))
ROUNDS = 6  # of asking for more until others hold, too
_TAIL_LEAST = 4  # outages that tell how the worst of them are spread
_HEADROOM = 0.002  # else each round is stopped by what the search for the last one left undone
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


def solve(
    problem: Problem,
    margin: float = 1.0,
    frequency: float = 0.0,
    common: bool = False,
    starts: Sequence[np.ndarray] = STARTS,
) -> Found:
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
    found: Found | None = None
    for any_row in starts:
        try:
            start = admissible_start(any_row, problem.limit_m, attempt, problem.sound)
        except ValueError:
            continue
        other = descend(start, problem.limit_m, attempt, problem.sound)
        if common:  # s(T) = eps is not to be had of many: every start is tried
            other = latest_flag(other, problem.limit_m, attempt, problem.sound)
            better = found is None or other.trial.early < found.trial.early
        else:
            better = found is None or other.trial.at_t_m < found.trial.at_t_m
        if better:
            found = other
        if other.exact and not common:
            break
    if found is None:
        raise ValueError("(22) is broken by whatever noise: (17) cannot cover these errors")
    return found


def common_row(problem: Problem, others: Sequence[Problem], advance: Callable[[int], None]) -> tuple[float, Found]:
    """One row for all outages of a problem that holds on those of others, too: (margin, what was found).

    A row that only just covers the outages it was made from is broken by their like: by other start phases, and by
    other noise of the same fixes. It is asked for more than (22) by the worst error / bound that is to be expected of
    as many outages again, until that is below 1; as it will be written, to four digits. ValueError where it stays
    above.
    """
    margin, starts = 1.0, STARTS
    for done in range(ROUNDS):
        found = solve(problem, margin, common=True, starts=starts)
        row = np.array([float(f"{value:.4g}") for value in found.row])
        # those tuned on tell nothing of a tail: the search ends where they touch (22)
        seen, *unseen = (one.carry(row, allowed=len(one.outages.error_m)).worst for one in (problem, *others))
        worst = max(float(seen.max()), foreseen(np.concatenate(unseen), len(problem.last)))
        if worst <= 1.0:
            advance(ROUNDS - done)
            return margin, found._replace(row=row)
        margin *= worst * (1.0 + _HEADROOM)
        near = found.row.copy()
        near[:3] *= margin * margin  # a bound goes with the root of its noise
        starts = (near, *STARTS)
        advance(1)
    raise ValueError(f"(22) is broken on outages that were not tuned on, even with a margin of {margin:.3f}")


def foreseen(worst: np.ndarray, count: int, chance: float = 0.05) -> float:
    """The error / bound that `count` outages more exceed with this chance, from the worst of each (n,) so far.

    The largest of them lie above the next one as exponential variables do: the tail of whatever distribution has one
    that falls as fast (Pickands 1975). Never below the largest that was met.
    """
    ordered = np.sort(worst)
    largest = max(1, min(len(ordered) - 1, max(_TAIL_LEAST, len(ordered) // 32)))
    base = float(ordered[-largest - 1])
    mean = float(ordered[-largest:].mean()) - base
    return max(float(ordered[-1]), base + mean * math.log(largest / len(ordered) * count / chance))
