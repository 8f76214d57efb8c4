"""The rate-group table and its accounts: who runs when, histogram, percentiles against sorting, the slack group."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from flightsw import schedule
from flightsw.kernels.histogram import BINS, bin_of, upper_edge_ns
from flightsw.schedule import Member, Schedule


def member(name="m", divisor=1, budget_us=1.0, run=lambda: None):
    return Member(name, divisor, budget_us, run)


def test_every_duration_is_in_a_bin_no_wider_than_an_eighth():
    durations = {*range(5000), *(2**k + d for k in range(12, 40) for d in (-1, 0, 1, 2**k // 3))}
    for duration in sorted(durations):
        index = bin_of(duration)
        below = upper_edge_ns(index - 1) if index and upper_edge_ns(index - 1) < upper_edge_ns(index) else -1
        assert below < duration <= upper_edge_ns(index)
        assert upper_edge_ns(index) <= duration * 1.125


def test_bins_rise_with_the_duration_and_end():
    assert all(bin_of(d) <= bin_of(d + 1) for d in range(100_000))
    for huge in (2**40, 2**62, 10**18):
        assert bin_of(huge) == BINS - 1


@pytest.mark.parametrize("percent", [1.0, 50.0, 99.0, 99.9, 100.0])
def test_percentiles_are_those_of_the_sorted_durations_to_the_width_of_a_bin(percent):
    durations = np.random.default_rng(1).lognormal(11.0, 1.0, 5000).astype(int)
    account = member()
    for duration in durations:
        account.account(int(duration))
    exact = np.sort(durations)[math.ceil(Fraction(str(percent)) * 5000 / 100) - 1]
    assert exact <= account.percentile_ns(percent) <= exact * 1.125


def test_accounts():
    account = member(budget_us=1.0)
    assert math.isnan(account.percentile_ns(50.0))
    assert account.summary()["mean_us"] is None
    for duration in (500, 1000, 1001, 5000):
        account.account(duration)
    summary = account.summary()
    assert summary["runs"] == 4
    assert summary["over_budget"] == 2  # the budget itself is within it
    assert summary["max_us"] == 5.0
    assert summary["mean_us"] == pytest.approx(7.501 / 4)
    assert summary["p99.9_us"] == 5.0  # never beyond the longest
    assert sum(account.histogram) == 4


def test_members_run_in_order_every_so_many_ticks_and_never_with_divisor_zero():
    calls = []
    members = [
        member(name, divisor, run=lambda name=name: calls.append(name))
        for name, divisor in (("every", 1), ("third", 3), ("never", 0), ("second", 2))
    ]
    table = Schedule(members, [], 100.0)
    for tick in range(6):
        calls.append(tick)
        table.run_tick(tick)
    assert calls == [
        *(0, "every", "third", "second"),
        *(1, "every"),
        *(2, "every", "second"),
        *(3, "every", "third"),
        *(4, "every", "second"),
        *(5, "every"),
    ]
    assert {name: entry["runs"] for name, entry in table.summary().items()} == {
        "tick": 6,
        "every": 6,
        "third": 2,
        "never": 0,
        "second": 3,
    }


def test_durations_are_charged_to_the_member_that_took_them(monkeypatch):
    """Injected readings: 10 us for the first, 30 us for the second, 40 us for the tick."""
    readings = iter([0, 10_000, 40_000])
    monkeypatch.setattr(schedule, "perf_counter_ns", lambda: next(readings))
    first, second, skipped = member("first"), member("second"), member("skipped", 2)
    table = Schedule([first, skipped, second], [], 39.0)
    table.run_tick(1)
    assert (first.longest_ns, second.longest_ns, skipped.runs) == (10_000, 30_000, 0)
    assert table.whole.longest_ns == 40_000
    assert table.whole.over_budget == 1


def test_slack_stops_at_the_deadline():
    calls = []
    slack = [member(str(k), run=lambda k=k: calls.append(k)) for k in range(4)]
    left = iter([True, True, False])
    Schedule([], slack, 1.0).run_slack(lambda: next(left))
    assert calls == [0, 1]
