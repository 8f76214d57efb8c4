"""Protection levels for any fault modes: never below the root of the risk, above it by no more than is stated.

Oracle: the risk added up by the standard library over every mode.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flightsw.gnss import protection
from flightsw.gnss.records import WORK

Mode = tuple[float, float, float]  # prior, reach [m], sigma [m]


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


def risk(modes: list[Mode], level_m: float) -> float:
    """Probability that the error exceeds a level."""
    return math.fsum(p * 0.5 * math.erfc((level_m - reach) / sigma / math.sqrt(2.0)) for p, reach, sigma in modes)


def level(modes: list[Mode], allowed: float) -> float:
    """What flight makes of modes."""
    work = np.zeros(1, WORK)
    for k, (p, reach, sigma) in enumerate(modes):
        work["mode_p"][0, k], work["mode_odds"][0, k] = p, 2.0 * math.log(p / 2.0)
        work["mode_reach_m"][0, k], work["mode_sigma_m"][0, k] = reach, sigma
    return float(protection._level(work[0], len(modes), 0, allowed))


MODES = st.lists(st.tuples(powers(-14, -0.4), st.just(0.0) | powers(-2, 4), powers(-2, 3)), max_size=40)


@settings(max_examples=300, deadline=None)
@given(powers(-2, 2), MODES, powers(-12, -0.4))
@example(1.0, [], 1e-7)
@example(0.5, [(1e-4, 2.0, 0.6)] * 30 + [(1e-8, 3.0, 0.8)] * 400, 1e-7)
@example(0.5, [(1e-12, 1e4, 1e3), (1e-5, 2.0, 0.6)], 1e-7)
@example(1.0, [(1e-3, 5000.0, 0.01)], 9e-4)
@example(0.01, [(1e-12, 1e4, 1e3)], 1e-3)
def test_the_level_is_the_root_of_the_risk(sigma_m: float, faults: list[Mode], allowed: float) -> None:
    """GIVEN any fault modes THEN the risk beyond the level is no more than allowed, and a hundred thousandth below it
    would be more than all but a ten thousandth of that.
    """
    modes = [(2.0, 0.0, sigma_m), *faults]
    found = level(modes, allowed)
    assert risk(modes, found) <= allowed * (1.0 + 1e-12)
    assert risk(modes, found * (1.0 - 1.01e-5)) >= allowed * (1.0 - 1e-4) * (1.0 - 1e-9)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e12])
@pytest.mark.parametrize("place", [1, 2])
def test_without_a_level_it_is_infinite(bad: float, place: int) -> None:
    """GIVEN a mode whose reach or sigma is no number, or beyond a million kilometres THEN so is the level."""
    mode = [1e-5, 2.0, 0.6]
    mode[place] = bad
    assert level([(2.0, 0.0, 0.5), tuple(mode)], 1e-7) == math.inf  # type: ignore[list-item]
