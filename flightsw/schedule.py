"""The rate-group table and its accounts: who runs in a tick, how often, and how long it took."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from time import perf_counter_ns
from typing import Any

import numpy as np

from flightsw.kernels.histogram import (
    ACCOUNT,
    BINS,
    EIGHTHS,
    LONGEST_NS,
    OCTAVES,
    OVER,
    RUNS,
    TOTAL_NS,
    enter,
    upper_edge_ns,
)

# what is told of it: elements of LEONAV_TIMING.histogram, the first of which ends at 2^10 ns
TIMING_OCTAVES = 20
_FIRST_OCTAVE = 10
_WAITING = 256  # durations that are entered together


class Member:
    """One entry of the rate-group table: a function, run every `divisor` ticks, and its accounts.

    A duration is only put down when it is measured. Some hundred of them are entered in one call, or as many as there
    are when somebody asks.
    """

    __slots__ = (
        *("_account", "_account_view", "_durations", "_durations_view", "_histogram", "_histogram_view", "_waiting"),
        *("budget_us", "divisor", "name", "run"),
    )

    def __init__(self, name: str, divisor: int, budget_us: float, run: Callable[[], None]) -> None:
        self.name = name
        self.divisor = divisor
        self.budget_us = budget_us
        self.run = run
        # not lists: every count beyond 256 would be an object of its own, a slow growth in the tick
        self._durations, self._histogram, self._account = (
            array("q", bytes(8 * size)) for size in (_WAITING, BINS, ACCOUNT)
        )
        self._durations_view, self._histogram_view, self._account_view = (
            np.frombuffer(values, np.int64) for values in (self._durations, self._histogram, self._account)
        )
        self._waiting = 0

    def account(self, duration_ns: int) -> None:
        """Enter one run into the accounts."""
        waiting = self._waiting
        self._durations[waiting] = duration_ns
        self._waiting = waiting + 1
        if waiting == _WAITING - 1:
            self.enter_waiting()

    def enter_waiting(self) -> None:
        """Enter what was put down."""
        enter(self._durations_view, self._waiting, self.budget_us * 1000.0, self._histogram_view, self._account_view)
        self._waiting = 0

    def _of_account(self, place: int) -> int:
        if self._waiting:
            self.enter_waiting()
        return self._account[place]

    @property
    def runs(self) -> int:
        """How often it ran."""
        return self._of_account(RUNS)

    @property
    def total_ns(self) -> int:
        """How long together."""
        return self._of_account(TOTAL_NS)

    @property
    def longest_ns(self) -> int:
        """How long at most."""
        return self._of_account(LONGEST_NS)

    @property
    def over_budget(self) -> int:
        """How often longer than its budget."""
        return self._of_account(OVER)

    @property
    def histogram(self) -> array[int]:
        """Runs by bin of their duration."""
        if self._waiting:
            self.enter_waiting()
        return self._histogram

    def percentile_ns(self, percent: float) -> float:
        """Duration that `percent` of the runs did not exceed, to the width of a bin; NaN before the first run."""
        wanted = self.runs * percent / 100.0
        seen = 0
        for index, count in enumerate(self.histogram):
            seen += count
            if count and seen >= wanted:
                return min(upper_edge_ns(index), float(self.longest_ns))
        return float("nan")

    def octaves(self) -> list[int]:
        """Runs by duration, TIMING_OCTAVES of them: below 2^10 ns, then each octave, the last without an end."""
        counts, histogram = [0] * TIMING_OCTAVES, self.histogram
        for octave in range(OCTAVES):
            place = min(max(octave - _FIRST_OCTAVE, 0), TIMING_OCTAVES - 1)
            counts[place] += sum(histogram[octave << EIGHTHS : (octave + 1) << EIGHTHS])
        return counts

    def summary(self) -> dict[str, Any]:
        """Accounts as plain numbers, microseconds."""
        mean = self.total_ns / self.runs / 1000.0 if self.runs else None
        figures = {
            f"p{percent:g}_us": self.percentile_ns(percent) / 1000.0 if self.runs else None
            for percent in (50.0, 99.0, 99.9)
        }
        return {
            "divisor": self.divisor,
            "runs": self.runs,
            "mean_us": mean,
            **figures,
            "max_us": self.longest_ns / 1000.0 if self.runs else None,
            "budget_us": self.budget_us,
            "over_budget": self.over_budget,
        }


class Schedule:
    """Members in order of execution, the slack group last, and the account of whole ticks."""

    __slots__ = ("_slack", "members", "wake", "whole")

    def __init__(self, members: list[Member], slack: list[Member], tick_budget_us: float) -> None:
        self.members = members
        self._slack = slack
        self.whole = Member("tick", 1, tick_budget_us, lambda: None)
        self.wake = Member("wake", 1, tick_budget_us, lambda: None)  # how late ticks began, in real time
        self.wake.enter_waiting()  # a compiled function's first call takes milliseconds: not in a tick

    def everyone(self) -> tuple[Member, ...]:
        """The whole tick, its members, the slack."""
        return (self.whole, *self.members, *self._slack)

    def insert_before(self, name: str, member: Member) -> None:
        """One more member, right before the one of that name."""
        place = next(index for index, other in enumerate(self.members) if other.name == name)
        self.members.insert(place, member)

    def add_slack(self, member: Member) -> None:
        """One more slack job, after those there are."""
        self._slack.append(member)

    def run_tick(self, tick: int) -> None:
        """Run the members that are due in this tick, in order."""
        start_ns = before_ns = perf_counter_ns()
        for member in self.members:
            if member.divisor and tick % member.divisor == 0:
                member.run()
                after_ns = perf_counter_ns()
                member.account(after_ns - before_ns)
                before_ns = after_ns
        self.whole.account(before_ns - start_ns)

    def run_slack(self, may_go_on: Callable[[], bool]) -> None:
        """Run one bounded slice of each slack job while there is time before the deadline."""
        for member in self._slack:
            if not may_go_on():
                return
            before_ns = perf_counter_ns()
            member.run()
            member.account(perf_counter_ns() - before_ns)

    def summary(self) -> dict[str, Any]:
        """Accounts of the whole tick and of every member, by name."""
        told = self.everyone() if self.wake.runs == 0 else (self.wake, *self.everyone())
        return {member.name: member.summary() for member in told}
