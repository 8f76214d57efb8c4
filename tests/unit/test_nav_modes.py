"""The mode machine: every mode under every combination of conditions, against the rules in words."""

from __future__ import annotations

from itertools import product

import pytest

from flightsw.icd.enums import FlagState, Mode
from flightsw.modes import TRANSITIONS, next_mode


def in_words(mode, initialised, flag, coasting, corrected):
    """No state: INIT. A raised flag: FAILED. No fix for too long: AUTONOMOUS. Enough fixes: INTEGRATED."""
    if not initialised:
        return Mode.INIT
    if flag == FlagState.RAISED:
        return Mode.FAILED
    if coasting:
        return Mode.AUTONOMOUS
    if corrected or mode in (Mode.INIT, Mode.INTEGRATED):
        return Mode.INTEGRATED
    return Mode.AUTONOMOUS


@pytest.mark.parametrize("mode", list(Mode))
def test_every_transition(mode):
    for initialised, flag, coasting, corrected in product((0, 1), FlagState, (False, True), (False, True)):
        got = next_mode(int(mode), initialised, int(flag), coasting, corrected)
        assert got == in_words(mode, initialised, flag, coasting, corrected), (initialised, flag, coasting, corrected)


def test_never_integrated_while_flagged_or_without_a_state():
    for mode, coasting, corrected in product(Mode, (False, True), (False, True)):
        assert next_mode(int(mode), 1, int(FlagState.RAISED), coasting, corrected) == Mode.FAILED
        for flag in FlagState:
            assert next_mode(int(mode), 0, int(flag), coasting, corrected) == Mode.INIT


def test_table_names_modes_only():
    assert TRANSITIONS.shape == (len(Mode), 5)
    assert set(TRANSITIONS.ravel()) <= set(Mode)
