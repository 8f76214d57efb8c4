"""Corrections that are no fix of position: what they leave as it was."""

from __future__ import annotations

import numpy as np
import pytest
from flight_filter_bench import fly, flying_memory
from test_nav_flight_filter import POSITION, USED, VELOCITY, command, noisy

from flightsw.icd.enums import EditMode


@pytest.mark.compiled
def test_a_correction_without_a_position_leaves_the_long_steps_of_an_outage_whole() -> None:
    """GIVEN positions inhibited, so that the last position ages while velocities correct the state WHEN velocities end
    too THEN the first step of ten seconds carries the covariance as ten of one second do, not as one of them."""
    found = []
    for coast_step_ns in (0, 10_000_000_000):
        inputs = noisy(1020, 21)
        command(inputs, 600, POSITION, EditMode.INHIBIT)
        inputs["fix_present"][1000:] = 0
        outputs = fly(flying_memory(coast_step_ns=coast_step_ns), inputs)
        assert (outputs["type_cause"][700:1000, VELOCITY] == USED).all()
        found.append(np.sqrt(np.diagonal(outputs["covariance"][1000:], axis1=1, axis2=2)))
    np.testing.assert_allclose(found[1], found[0], rtol=4e-3)
    assert (found[0][-1, :3] > 1.01 * found[0][0, :3]).any()
