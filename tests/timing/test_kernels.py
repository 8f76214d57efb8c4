"""The nine-state filter beside a C translation and NumPy: the same covariance, and a time of its class."""

import pytest
from budgets import BUDGETS

from ground.timing import lanes, nine_states

BUDGET = BUDGETS["nine_states"]


@pytest.fixture(scope="module")
def ways() -> dict[str, nine_states.Way]:
    return {way.name: way for way in nine_states.compare(rounds=5, epochs=500)}


def test_every_way_comes_to_the_same_covariance(ways: dict[str, nine_states.Way]) -> None:
    assert len(ways) >= 3
    assert max(way.difference for way in ways.values()) <= BUDGET["difference_max"]


def test_the_step_is_of_the_class_of_c(ways: dict[str, nine_states.Way]) -> None:
    if "C translation" not in ways:
        pytest.skip("no C compiler here")
    assert ways["flight"].step_ns <= BUDGET["over_c_max"] * ways["C translation"].step_ns


def test_the_step_is_far_below_numpy(ways: dict[str, nine_states.Way]) -> None:
    assert BUDGET["below_numpy_min"] * ways["flight"].step_ns <= ways["NumPy, out="].step_ns


def test_lanes_are_worth_their_while() -> None:
    """GIVEN the ensemble of (17) in lanes and by flight's own kernels WHEN timed in turn THEN lanes do a multiple."""
    rates = {rate.name: rate.arcs_per_s for rate in lanes.compare(rounds=9)}
    assert rates["lanes, one thread"] >= BUDGETS["lanes"]["over_flight_min"] * rates["flight's kernels, one arc"]
