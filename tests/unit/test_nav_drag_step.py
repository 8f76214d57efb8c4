"""Drag that changes when GNSS is lost: the process noise that stands for it."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import record
from flight_filter_bench import fixes_every_second, fly, flying_memory, kepler

from flightsw.nav import flight_model  # noqa: F401  (names the room under test for the lanes)

TRUTH = kepler()


@pytest.mark.compiled
def test_drag_may_change_once_in_an_outage() -> None:
    """GIVEN a step of drag of 0.5 at a fix age of 60 s WHEN GNSS is lost THEN the slow part of drag has that variance
    more from then on, once, however the steps are cut; with fixes, and in a gap of half a minute, nothing is added."""
    inputs = fixes_every_second(0, 900, TRUTH)
    inputs["fix_present"][300:330] = 0
    inputs["fix_present"][600:] = 0
    settings = {"drag_sigma": 0.4, "drag_slow_sigma": 0.3}
    slow = {}
    for name, sigma, coast_step_ns in (("none", 0.0, 0), ("step", 0.5, 0), ("long steps", 0.5, 7 * 10**9)):
        memory = flying_memory(drag_step_sigma=sigma, coast_step_ns=coast_step_ns, **settings)
        slow[name] = []
        for part in np.split(inputs, [335, 650, 670]):
            fly(memory, part.copy())
            ud = record(memory.nav).UD
            slow[name].append(float(ud[10, 10]))
    assert slow["step"][:2] == slow["none"][:2]
    for name in ("step", "long steps"):
        added = np.array(slow[name][2:]) - slow["none"][2:]
        assert added == pytest.approx(0.25, rel=0.01)
