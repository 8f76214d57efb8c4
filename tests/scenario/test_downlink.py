"""The downlink's ticks: every stream at its rate, none that bears what a second holds."""

from __future__ import annotations

from collections import Counter

import pytest
from link_bench import Linked

TOGETHER = ("LEONAV_NAV_STATE", "LEONAV_INTEGRITY", "LEONAV_PROTECTION")
ONCE_A_SECOND = (
    "HEARTBEAT",
    "SYS_STATUS",
    "SYSTEM_TIME",
    "GPS_RAW_INT",
    "ESTIMATOR_STATUS",
    "LEONAV_INNOVATION",
    "LEONAV_COVARIANCE",
    "LEONAV_TIME_TO_FLAG",
)


def test_a_second_of_status_is_spread_over_its_ticks() -> None:
    """GIVEN ten ticks a second WHEN ten seconds fly THEN each status message has come once in each of them, always in
    the same tenth, none in a tick of state and integrity where others are free, and never more than two in a tick."""
    with Linked("outage=[]") as flight:
        flight.fly(until_s=5.0)
        ticks: dict[int, Counter[str]] = {}
        tenths: dict[str, set[int]] = {}
        flight.wire.heard()
        first = flight.k
        while flight.k < first + 100:
            k = flight.k
            flight.tick()
            kinds = [message.get_type() for message in flight.wire.heard()]
            ticks[k] = Counter(kinds)
            for kind in kinds:
                tenths.setdefault(kind, set()).add(k % 10)
    total = sum(ticks.values(), Counter())
    for kind in ONCE_A_SECOND:
        assert total[kind] == 10
        assert len(tenths[kind]) == 1
    states = {k for k, kinds in ticks.items() if kinds["LEONAV_NAV_STATE"]}
    assert all(set(TOGETHER) <= set(ticks[k]) for k in states)
    for k, kinds in ticks.items():
        status = sum(count for kind, count in kinds.items() if kind in ONCE_A_SECOND)
        assert status <= 2
        assert status == 0 or k not in states


@pytest.mark.parametrize("rate_ticks", [0, 1, 100_000])
def test_any_rate_that_a_table_may_have_flies(rate_ticks: int) -> None:
    """GIVEN status messages never, in every tick, or every 100,000 ticks WHEN a second flies THEN so many come."""
    with Linked("outage=[]", f"flight.table.rate_status_ticks={rate_ticks}") as flight:
        flight.fly(until_s=1.0)
        flight.wire.heard()
        flight.fly(until_s=2.0)
        messages = Counter(message.get_type() for message in flight.wire.heard())
    assert messages["SYSTEM_TIME"] == (10 if rate_ticks == 1 else 0)
    assert messages["LEONAV_NAV_STATE"] > 0
