"""Which tick does what for an epoch of pseudoranges: fix in its own, levels and words in the next, nothing mixed."""

from __future__ import annotations

import numpy as np
import pytest
from gnss_bench import Sender, checks, measured, satellites
from harness import Flight, load

from flightsw.icd.can_frames import GNSS_CHECK, GNSS_EXCLUDED, GNSS_USED

FIRST = 101
TOLD = (GNSS_CHECK.frame_id, GNSS_USED.frame_id, GNSS_EXCLUDED.frame_id)
BETWEEN_NS = 1000


def fly(plan: list[int], *settings: str) -> tuple[Flight, int]:
    """A flight that navigates, then one epoch after the other, each of one satellite less: so many in each tick.

    With it the tick of the first.
    """
    with Flight(load("time.duration_s=110", "satellite_fault=[]", *settings, name="gnss_faults")) as flight:
        flight.fly(float(FIRST))
        sender, rows = Sender(flight), measured(flight, FIRST)
        sender.wait(FIRST)
        flight.published.clear()
        first, sent = flight.k, 0
        for epochs in plan:
            for _ in range(epochs):
                sender.whole(FIRST, rows[sent:], later_ns=sent * BETWEEN_NS)
                sent += 1
            flight.tick(with_world=False)
    return flight, first


def told_at(flight: Flight, first: int) -> list[int]:
    """Ticks after the first in which an epoch was told; its three frames are always together and in order."""
    ticks = [(tick - first, found) for tick, found, _ in flight.published if found in TOLD]
    assert [found for _, found in ticks] == [*TOLD] * (len(ticks) // 3)
    assert [tick for tick, _ in ticks[0::3]] == [tick for tick, _ in ticks[2::3]]
    return [tick for tick, _ in ticks[::3]]


def test_the_fix_is_made_in_the_tick_of_the_epoch_and_told_in_the_next() -> None:
    """GIVEN one epoch THEN navigation takes its fix in that tick, and the next publishes it with its levels."""
    flight, first = fly([1, 0, 0])
    assert flight.flown["fix_seen"][first : first + 3].tolist() == [1, 0, 0]
    assert told_at(flight, first) == [1]
    (found,) = checks(flight)
    assert found["offered"] == 1
    assert np.isfinite([found[f"protection_{axis}_m"] for axis in ("east", "north", "up")]).all()


def test_levels_that_decide_on_the_fix_are_made_at_once() -> None:
    """GIVEN a table that holds fixes back by their levels THEN all is done in the tick of the epoch."""
    flight, first = fly([1, 0], "flight.function_table.gnss={hold_beyond_limit=1}")
    assert flight.flown["fix_seen"][first] == 1
    assert told_at(flight, first) == [0]
    assert checks(flight)["offered"].tolist() == [1]


@pytest.mark.parametrize(
    ("plan", "ticks"),
    [([2, 0, 0, 0], [0, 1]), ([1, 1, 1, 0], [1, 2, 3]), ([1, 3, 0, 0], [1, 1, 1, 2]), ([4, 0, 1, 0], [0, 0, 0, 1, 3])],
)
def test_epochs_that_follow_one_another_at_once_lose_nothing(plan: list[int], ticks: list[int]) -> None:
    """GIVEN epochs in one tick, or in ticks one after the other THEN each is told once, in order, and with its own
    satellites, fix and levels: those that it has where every epoch has two ticks for itself.
    """
    slow, _ = fly([1, 0] * sum(plan))
    fast, first = fly(plan)
    assert told_at(fast, first) == ticks
    one, other = checks(fast), checks(slow)
    assert len(one) == len(other) == sum(plan)
    assert len(set(one["protection_up_m"].tolist())) == len(one)
    for name in ("t_gps_ns", "used", "excluded", "dof", "available", "gnss_verdict", "offered"):
        assert one[name].tolist() == other[name].tolist(), name
    for name in ("protection_east_m", "protection_north_m", "protection_up_m", "sigma_up_m", "statistic"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-4, err_msg=name)
    assert satellites(fast, excluded=False) == satellites(slow, excluded=False)
    (function,), (unhurried,) = fast.loop._functions, slow.loop._functions
    for name in ("epochs", "offered"):
        assert getattr(function, name) == getattr(unhurried, name)
