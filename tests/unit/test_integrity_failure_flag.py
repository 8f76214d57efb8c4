"""The parametric-failure flag: persist, latch, STALE, and every condition of clearing on its own."""

from __future__ import annotations

import math

import pytest
from flight_bench import loaded_memory, record

from flightsw.icd.enums import FlagState
from flightsw.integrity import failure_flag

CLEAR, RAISED, STALE = (int(state) for state in FlagState)


def bench(**overrides):
    settings = {"flag_persist": 3, "limit_m": 100.0, "clear_limit_m": 40.0, "clear_fixes": 5, "clear_nis_low": 0.2}
    memory = loaded_memory("paper", **{**settings, **overrides})
    return record(memory.nav), record(memory.table), memory


def judge(nav, table, *bounds, age=0.0):
    for bound in bounds:
        failure_flag.evaluate(nav, table, bound, age)
    return int(nav.flag)


def test_raised_only_by_consecutive_epochs_above_the_limit():
    nav, table, _ = bench()
    assert judge(nav, table, 101.0, 101.0) == CLEAR
    assert judge(nav, table, 99.0) == CLEAR
    assert judge(nav, table, 101.0, 101.0) == CLEAR
    assert judge(nav, table, 101.0, age=17.0) == RAISED
    assert nav.flag_age_s == 17.0


def test_the_limit_itself_is_permitted():
    """(14): healthy while s <= eps."""
    nav, table, _ = bench(flag_persist=1)
    assert judge(nav, table, 100.0) == CLEAR
    assert judge(nav, table, math.nextafter(100.0, 101.0)) == RAISED


def test_latched_falling_back_clears_nothing_and_the_age_is_that_of_the_first_raise():
    nav, table, _ = bench()
    judge(nav, table, 200.0, 200.0, 200.0, age=30.0)
    assert judge(nav, table, *[1.0] * 500, age=60.0) == RAISED
    assert judge(nav, table, *[500.0] * 10, age=90.0) == RAISED
    assert nav.flag_age_s == 30.0


@pytest.mark.parametrize("bound", [math.nan, math.inf, -math.inf])
def test_stale_while_the_bound_cannot_be_computed(bound):
    nav, table, _ = bench()
    assert judge(nav, table, bound) == STALE
    assert judge(nav, table, bound, bound) == STALE
    assert judge(nav, table, 50.0) == CLEAR


def test_a_raised_flag_does_not_turn_stale():
    nav, table, _ = bench(flag_persist=1)
    judge(nav, table, 101.0)
    assert judge(nav, table, math.nan) == RAISED
    assert judge(nav, table, 1.0) == RAISED


def test_out_of_stale_straight_into_raised():
    nav, table, _ = bench(flag_persist=1)
    judge(nav, table, math.nan)
    assert judge(nav, table, 101.0) == RAISED


def ready_to_clear(nav):
    nav.flag = RAISED
    nav.flag_age_s = 12.0
    nav.over_limit = 4
    nav.streak = 5
    nav.mean_nis = 1.0


def test_clears_at_the_edges_of_all_conditions():
    nav, table, _ = bench()
    ready_to_clear(nav)
    nav.mean_nis = 3.0
    assert failure_flag.clear_if_recovered(nav, table, 40.0)
    assert nav.flag == CLEAR
    assert math.isnan(nav.flag_age_s)
    assert judge(nav, table, 101.0, 101.0) == CLEAR  # the count of persisting epochs began anew


@pytest.mark.parametrize(
    ("field", "value", "bound"),
    [
        ("streak", 4, 40.0),
        ("mean_nis", 3.001, 40.0),
        ("mean_nis", 0.199, 40.0),
        ("mean_nis", math.nan, 40.0),
        ("streak", 5, 40.001),
        ("streak", 5, math.nan),
        ("streak", 5, math.inf),
    ],
)
def test_one_condition_that_fails_keeps_it_raised(field, value, bound):
    nav, table, _ = bench()
    ready_to_clear(nav)
    setattr(nav, field, value)
    assert not failure_flag.clear_if_recovered(nav, table, bound)
    assert nav.flag == RAISED
    assert nav.flag_age_s == 12.0


def test_nothing_to_clear_when_not_raised():
    nav, table, _ = bench()
    ready_to_clear(nav)
    for flag in (CLEAR, STALE):
        nav.flag = flag
        assert not failure_flag.clear_if_recovered(nav, table, 1.0)
        assert nav.flag == flag


def test_table_says_which_bound_drives():
    for driver, expected in ((0, 10.0), (1, 20.0)):
        _, table, _ = bench(flag_driver=driver)
        assert failure_flag.driving(table, 10.0, 20.0) == expected
