"""The search of the paper: coordinate descent on the parameters of (17), down the ladder (23) while (22) holds.

Knows nothing of orbits: what a point is worth is told by a function. Steps are taken in the logarithm of each
parameter. A descent that follows s(T) alone soon stands in a corner of (22), from which no single parameter leads on:
what it minimises therefore has a share of slack in it, a logarithmic barrier, that fades as the ladder ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

SOLVED = 1e-3  # relative distance to a rung that counts as its solution
EXACT = 0.01  # the same to eps, at the end
_FIRST_STEP, _LARGEST_STEP, _SMALLEST_STEP = 0.3, 0.6, 5e-3  # decades
_BARRIER, _LAST_BARRIER = 0.1, 5e-4  # weight of the slack: by what is left to descend (logarithm), and at the end
_FAILURES = 3  # rungs in a row that are not reached
_SWEEPS = 40  # over the parameters, for one rung


class Trial(NamedTuple):
    """What a row is worth where (22) holds. at_t_m: s(T), the geometric mean over outages; slack: mean over outages of
    -log(1 - worst error / bound), and the same of what else must hold, 0 for all room, infinite for none;
    early: mean of -log(T_flag / T)."""

    at_t_m: float
    slack: float
    early: float


Try = Callable[[np.ndarray], Trial | None]  # None: (22) is broken
Sound = Callable[[np.ndarray], bool]  # asked once a sweep: it may be dear
Ranges = tuple[tuple[float, float], ...]


def ranges(limit_m: float) -> Ranges:
    """Where the five parameters may lie. Beyond its upper end a pseudo-measurement weighs nothing, and a descent that
    has gone there would not find back."""
    return ((1e-6, 1e6), (1e-9, 1e2), (1e-14, 1e-2), (1.0, 50.0 * limit_m), (1e-2, 0.5 * limit_m))


class Rung(NamedTuple):
    """A step of the ladder: what was sought, what was found [m], and the parameters."""

    sought_m: float
    found_m: float
    row: tuple[float, ...]


class Found(NamedTuple):
    """Where a search ended: the row (5,), what it is worth, whether s(T) is eps, the ladder, how many rows were
    tried."""

    row: np.ndarray
    trial: Trial
    exact: bool
    ladder: tuple[Rung, ...]
    tried: int


def admissible_start(row: np.ndarray, limit_m: float, attempt: Try, sound: Sound) -> np.ndarray:
    """The row, its noise raised threefold until (22) holds. ValueError where no noise within the ranges does that."""
    point = np.array(row, float)
    highest = np.array([high for _, high in ranges(limit_m)])
    while attempt(point) is None or not sound(point):
        point[:3] *= 3.0
        if np.any(point > highest):
            raise ValueError("(22) is broken by whatever noise: (17) cannot cover these errors")
    return point


def descend(start: np.ndarray, limit_m: float, attempt: Try, sound: Sound, share: float = 0.14) -> Found:
    """Down the ladder from an admissible start to eps, or to where (22) stops it.

    share: of a rung by which the next one is lower, delta eps of (23). sound: asked of a point beside (22).
    """
    search = _Search(attempt, sound, ranges(limit_m))
    point, trial = np.array(start, float), attempt(np.asarray(start, float))
    if trial is None or not sound(point):
        raise ValueError("the start breaks (22)")
    ladder = [Rung(trial.at_t_m, trial.at_t_m, tuple(point.tolist()))]
    sought, failures = trial.at_t_m, 0
    while sought > limit_m and failures < _FAILURES:
        sought = max(limit_m, (1.0 - share) * sought)
        weight = _BARRIER * math.log(sought / limit_m) + _LAST_BARRIER

        def merit(t: Trial, sought: float = sought, weight: float = weight) -> float:
            return abs(math.log(t.at_t_m / sought)) + weight * t.slack

        def solved(t: Trial, sought: float = sought) -> bool:
            return abs(math.log(t.at_t_m / sought)) <= SOLVED

        point, trial = search.settle(point, trial, merit, solved)
        ladder.append(Rung(sought, trial.at_t_m, tuple(point.tolist())))
        failures = 0 if trial.at_t_m <= sought * (1.0 + 10.0 * SOLVED) else failures + 1
    exact = abs(trial.at_t_m / limit_m - 1.0) <= EXACT
    return Found(point, trial, exact, tuple(ladder), search.tried)


def latest_flag(found: Found, limit_m: float, attempt: Try, sound: Sound) -> Found:
    """On from there for the latest flag over all outages: s(T) = eps cannot be had for all of them with one row, and a
    bound that is flat near eps has a small s(T) and an early flag."""
    search = _Search(attempt, sound, ranges(limit_m))
    weight = _LAST_BARRIER
    point, trial = search.settle(found.row, found.trial, lambda t: t.early + weight * t.slack, lambda t: False)
    exact = abs(trial.at_t_m / limit_m - 1.0) <= EXACT
    return Found(point, trial, exact, found.ladder, found.tried + search.tried)


class _Search:
    """Coordinate descent; remembers which way and how far each parameter last went."""

    def __init__(self, attempt: Try, sound: Sound, within: Ranges) -> None:
        self._attempt, self._sound, self._within = attempt, sound, within
        self._steps = np.full(len(within), _FIRST_STEP)
        self.tried = 0

    def settle(
        self, point: np.ndarray, trial: Trial, merit: Callable[[Trial], float], solved: Callable[[Trial], bool]
    ) -> tuple[np.ndarray, Trial]:
        """The least merit found from here by one parameter at a time, or the first point that is solved."""
        self._steps = np.copysign(np.maximum(np.abs(self._steps), _FIRST_STEP / 3.0), self._steps)
        for _ in range(_SWEEPS):
            ahead, ahead_trial = point, trial
            for axis in range(len(self._within)):
                ahead, ahead_trial = self._along(axis, ahead, ahead_trial, merit)
            if ahead is not point:
                if self._sound(ahead):
                    point, trial = ahead, ahead_trial
                else:
                    self._steps *= 0.5
            if solved(trial) or np.all(np.abs(self._steps) < _SMALLEST_STEP):
                break
        return point, trial

    def _along(
        self, axis: int, point: np.ndarray, trial: Trial, merit: Callable[[Trial], float]
    ) -> tuple[np.ndarray, Trial]:
        low, high = self._within[axis]
        for sign in (1.0, -1.0):
            other = point.copy()
            other[axis] = min(max(other[axis] * 10.0 ** (sign * self._steps[axis]), low), high)
            if other[axis] == point[axis]:
                continue
            reached = self._attempt(other)
            self.tried += 1
            if reached is not None and merit(reached) < merit(trial) - 1e-7:
                growth = 1.5 if abs(self._steps[axis]) * 1.5 <= _LARGEST_STEP else 1.0
                self._steps[axis] *= sign * growth
                return other, reached
        self._steps[axis] *= 0.5
        return point, trial
