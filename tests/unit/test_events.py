"""The event ring: edges of conditions, happenings, sequence numbers without gaps, the oldest overwritten."""

from __future__ import annotations

import math

import numpy as np

from flightsw.events import EventRing
from flightsw.icd.alerts import ALERTS, BOUND, QUANTITIES, AlertId

FLAG, OUTAGE, JUMP = (1 << int(a) for a in (AlertId.FLAG_RAISED, AlertId.OUTAGE_START, AlertId.TIME_JUMP_REJECTED))


def ring():
    told = []
    return EventRing(lambda *event: told.append(event)), told


def test_a_condition_is_announced_at_its_edges_only():
    events, told = ring()
    for t, conditions in ((10, 0), (20, FLAG), (30, FLAG), (40, FLAG | OUTAGE), (50, OUTAGE), (60, 0), (70, 0)):
        events.note(t, 0, conditions, float(t))
    assert told == [
        (1, 20, AlertId.FLAG_RAISED, 1, 20.0),
        (2, 40, AlertId.OUTAGE_START, 1, 40.0),
        (3, 50, AlertId.FLAG_RAISED, 0, 50.0),
        (4, 60, AlertId.OUTAGE_START, 0, 60.0),
    ]


def test_what_happens_is_announced_each_time():
    events, told = ring()
    for t in (1, 2, 3):
        events.note(t, JUMP, 0, 0.0)
    assert [event[:4] for event in told] == [(k, k, AlertId.TIME_JUMP_REJECTED, 1) for k in (1, 2, 3)]


def test_an_alert_that_happens_and_holds_is_told_once_and_its_end_too():
    events, told = ring()
    events.note(1, FLAG, FLAG, 0.0)
    events.note(2, 0, 0, 0.0)
    assert [(event[2], event[3]) for event in told] == [(AlertId.FLAG_RAISED, 1), (AlertId.FLAG_RAISED, 0)]


def test_all_alerts_at_once_in_order_of_their_ids():
    events, told = ring()
    events.note(5, sum(1 << int(alert) for alert in ALERTS), 0, 1.5)
    assert [event[2] for event in told] == sorted(int(alert) for alert in ALERTS)
    assert [event[0] for event in told] == list(range(1, len(ALERTS) + 1))


def test_the_oldest_are_overwritten_and_the_newest_come_first():
    events, told = ring()
    for t in range(1000):
        events.note(t, JUMP, 0, float(t))
    kept = events.newest_first()
    assert len(told) == events.sequence == 1000
    assert len(kept) == len(events.records) < 1000
    np.testing.assert_array_equal(kept["sequence"], np.arange(1000, 1000 - len(kept), -1))
    np.testing.assert_array_equal(kept["t_gps_ns"], kept["sequence"] - 1)


def test_a_new_ring_is_empty():
    events, _ = ring()
    assert len(events.newest_first()) == 0


def test_an_alert_carries_the_value_that_is_its_own_or_none():
    """GIVEN one function that tells a value WHEN all alerts come at once THEN navigation's have its bound, that
    function's its own value as it is now, and the others none."""
    events, told = ring()
    counted = [3.0]
    events.values[int(AlertId.GNSS_EXCLUDED)] = lambda: counted[0]
    for round_ in (1, 2):
        counted[0] = float(round_)
        events.note(round_, sum(1 << int(alert) for alert in ALERTS), 0, 12.5)
    for _, t_gps_ns, alert_id, _, value in told:
        if alert_id == AlertId.GNSS_EXCLUDED:
            assert value == t_gps_ns
        elif QUANTITIES[alert_id] is BOUND:
            assert value == 12.5
        else:
            assert math.isnan(value)
    kept = events.newest_first()
    assert kept["value"][kept["alert_id"] == AlertId.GNSS_EXCLUDED].tolist() == [2.0, 1.0]
