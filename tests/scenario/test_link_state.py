"""A state from the ground over the link: one message, one answer in the same tick, taken once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from link_bench import OTHER_KEY, Linked, Station

from flightsw.icd import mavlink as m
from flightsw.icd.enums import Mode, RejectCause

SETTINGS = ("flight.table_set=flight", "time.duration_s=900", "outage.0.start_s=300", "outage.0.duration_s=600")
SIGMAS = np.array([5.0, 5.0, 5.0, 0.01, 0.01, 0.01])
TAKEN = 255


def upload(
    flight: Linked, sequence: int, offset: Any = 0.0, station: Station | None = None, age_s: float = 1.0
) -> None:
    """A state of a second ago, in the next tick."""
    t_ns = int(flight.loop.memory.output["t_gps_ns"][0]) - round(age_s * 1e9)
    r, v = flight.world.truth.state_gcrf(np.array([t_ns]))
    state = np.concatenate((r[0], v[0])) + offset
    covariance = np.diag(SIGMAS**2)[np.triu_indices(6)]
    station = flight.now() if station is None else station
    message = m.MAVLink_leonav_state_upload_message(t_ns, state.tolist(), covariance.tolist(), sequence, 1, 1, 0)
    station.mav.send(message)


def test_a_state_is_taken_in_the_tick_it_comes_with_and_only_once() -> None:
    """GIVEN five minutes of outage WHEN a state is sent THEN the same tick answers that it was taken, the bound
    shrinks, the mode stays AUTONOMOUS and the fix age runs on; WHEN it is sent again because the answer was lost THEN
    it is answered again, and nothing changes; one that does not fit is refused by name."""
    with Linked(*SETTINGS) as flight:
        flight.fly(until_s=600.0)
        before_m, age_s = (float(flight.loop.memory.output[name][0]) for name in ("bound_m", "fix_age_s"))
        flight.wire.heard()
        upload(flight, 7)
        flight.tick()
        (result,) = flight.wire.heard("LEONAV_STATE_RESULT")
        assert (result.sequence, result.cause) == (7, TAKEN)
        assert 0.0 < result.nis < 40.0
        out = flight.loop.memory.output[0]
        assert out["bound_m"] < before_m
        assert out["mode"] == Mode.AUTONOMOUS
        assert out["fix_age_s"] > age_s
        covariance = flight.loop.memory.nav["UD"].copy()
        upload(flight, 7)
        flight.tick()
        (again,) = flight.wire.heard("LEONAV_STATE_RESULT")
        assert (again.sequence, again.cause, again.nis) == (7, TAKEN, result.nis)
        np.testing.assert_array_equal(flight.loop.memory.nav["UD"], covariance)
        upload(flight, 8, offset=np.array([2e4, 0, 0, 0, 0, 0]))
        flight.tick()
        (refused,) = flight.wire.heard("LEONAV_STATE_RESULT")
        assert (refused.sequence, refused.cause) == (8, RejectCause.GATE)


@pytest.mark.parametrize("key", [None, OTHER_KEY])
def test_nobody_else_moves_the_state(key: bytes | None) -> None:
    """GIVEN an outage WHEN a state is sent unsigned, or signed with another key THEN it is not even answered."""
    with Linked(*SETTINGS) as flight:
        flight.fly(until_s=400.0)
        flight.wire.heard()
        stranger = Station(flight.wire, key)
        stranger.at(flight.loop.unix_start_ns + flight.k * flight.period_ns)
        upload(flight, 9, station=stranger)
        flight.tick()
        assert flight.wire.heard("LEONAV_STATE_RESULT") == []
        assert flight.loop.memory.output["upload_cause"][0] == -2
        assert sum(flight.refused.values()) == 1
