"""Which tick does what for an epoch of pseudoranges: fix in its own, levels and words in the next, nothing mixed.

Between them comes one for the search, where the satellites disagree.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from gnss_bench import Sender, checks, measured, satellites
from harness import Flight, load

from flightsw.icd.can_frames import GNSS_CHECK, GNSS_EXCLUDED, GNSS_USED
from flightsw.icd.enums import GnssVerdict

FIRST = 101
TOLD = (GNSS_CHECK.frame_id, GNSS_USED.frame_id, GNSS_EXCLUDED.frame_id)
BETWEEN_NS = 1000


def fly(plan: list[int], *settings: str, wrong: Sequence[int] = ()) -> tuple[Flight, int]:
    """A flight that navigates, then one epoch after the other, each of one satellite less: so many in each tick.

    wrong: those of them whose last satellite is 500 m off. Returns the flight, and the tick of the first epoch.
    """
    with Flight(load("time.duration_s=110", "satellite_fault=[]", *settings, name="gnss_faults")) as flight:
        flight.fly(float(FIRST))
        sender, rows = Sender(flight), measured(flight, FIRST)
        sender.wait(FIRST)
        flight.published.clear()
        first, sent = flight.k, 0
        for epochs in plan:
            for _ in range(epochs):
                *others, last = rows[sent:]
                if sent in wrong:
                    last = last._replace(range_m=last.range_m + 500.0)
                sender.whole(FIRST, [*others, last], later_ns=sent * BETWEEN_NS)
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


def test_who_is_left_out_is_found_in_a_tick_of_its_own() -> None:
    """GIVEN an epoch with a wrong satellite THEN navigation takes its fix a tick later, and the third one tells it."""
    flight, first = fly([1, 0, 0, 0], wrong=[0])
    assert flight.flown["fix_seen"][first : first + 4].tolist() == [0, 1, 0, 0]
    assert told_at(flight, first) == [2]
    (found,) = checks(flight)
    assert (found["gnss_verdict"], found["excluded"], found["offered"]) == (GnssVerdict.EXCLUDED, 1, 1)
    assert np.isfinite([found[f"protection_{axis}_m"] for axis in ("east", "north", "up")]).all()


@pytest.mark.parametrize("wrong", [[0], [1], [0, 1, 2]])
def test_a_search_that_another_epoch_interrupts_is_finished_before_it(wrong: list[int]) -> None:
    """GIVEN an epoch in every tick, wrong satellites in some THEN all are told in order, as with time for each."""
    slow, _ = fly([1, 0, 0] * 3, wrong=wrong)
    fast, first = fly([1, 1, 1, 0, 0], wrong=wrong)
    assert told_at(fast, first) == [1, 2, 3 + (2 in wrong)]
    one, other = checks(fast), checks(slow)
    assert [verdict == GnssVerdict.EXCLUDED for verdict in one["gnss_verdict"]] == [k in wrong for k in range(3)]
    for name in ("t_gps_ns", "used", "excluded", "dof", "available", "gnss_verdict", "offered"):
        assert one[name].tolist() == other[name].tolist(), name
    assert satellites(fast) == satellites(slow)


@pytest.mark.parametrize("wrong", [[], [0]])
def test_levels_that_decide_on_the_fix_are_made_at_once(wrong: list[int]) -> None:
    """GIVEN a table that holds fixes back by their levels THEN all is done in the tick of the epoch, search or not."""
    flight, first = fly([1, 0], "flight.function_table.gnss={hold_beyond_limit=1}", wrong=wrong)
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
