"""Steps with one evaluation of the forces against steps with Nyström's four: the same motion to a millimetre."""

from __future__ import annotations

import numpy as np
import pytest

from flightsw.nav import dynamics  # noqa: F401  (names the room under test for the lanes)
from flightsw.records import OUTPUT
from ground.studies import arcs

FIXES_S, OUTAGE_S = 600, 3000


def coasting(overrides: dict[str, float]) -> np.ndarray:
    """Outputs of an outage that begins with the same state whatever the overrides."""
    sky = arcs.sky("simulated", FIXES_S + OUTAGE_S + 10)
    flight = arcs.Flight(sky, "flight", arcs.WHITE, arcs.stream(7, 1), {"split_step_max_s": 0.0})
    flight.until(FIXES_S)
    memory = sky.memory("flight", overrides)
    memory.nav[:] = flight.memory.nav
    return arcs.fly(memory, flight.blank(FIXES_S, FIXES_S + OUTAGE_S))


@pytest.mark.compiled
def test_one_evaluation_a_step_is_the_same_motion() -> None:
    """GIVEN gravity to degree 70, drag, Sun, Moon, radiation WHEN an outage of 3000 s is flown with one evaluation of
    the forces a step THEN the orbit differs from that of four by less than a millimetre, and velocity, published up to
    a second on with the forces of half a second before, by some micrometres per second; where steps are longer both
    take four, and a tenth of a millimetre of the short ones before is left."""
    four, one = (coasting({"split_step_max_s": s, "coast_step_ns": 0}) for s in (0.0, 2.0))
    assert four.dtype == OUTPUT
    apart = np.linalg.norm(one["r_gcrf_m"] - four["r_gcrf_m"], axis=1)
    assert 0.0 < apart.max() < 1e-3
    assert np.linalg.norm(one["v_gcrf_mps"] - four["v_gcrf_mps"], axis=1).max() < 5e-6
    np.testing.assert_allclose(one["bound_m"], four["bound_m"], rtol=1e-6)
    longer = [coasting({"split_step_max_s": s, "coast_step_ns": 10_000_000_000}) for s in (0.0, 2.0)]
    late = slice(20, None)  # behind the seconds in which steps are still short
    assert np.linalg.norm(longer[0]["r_gcrf_m"] - longer[1]["r_gcrf_m"], axis=1)[late].max() < 1e-4
