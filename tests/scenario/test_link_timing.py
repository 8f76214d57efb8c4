"""Timing of flight's members, told to the ground in turns."""

from __future__ import annotations

from harness import Flight, Telemetry, load
from link_bench import Linked


def test_every_member_tells_its_timing_in_turn_where_the_ground_listens_and_only_there() -> None:
    """GIVEN flight with a ground link WHEN as many status periods pass as there are members THEN each has told its
    account once, as the schedule keeps it; WHEN none listens THEN nothing: a run of a seed stays the same bytes.
    """
    with Linked() as flight:
        schedule = flight.loop.schedule
        members = schedule.everyone()
        flight.fly(until_s=float(len(members)))
        told = [message for message in flight.wire.heard() if message.get_type() == "LEONAV_TIMING"]
        assert [message.name for message in told[: len(members)]] == [member.name[:16] for member in members]
        assert {(message.index, message.count) for message in told} == {(k, len(members)) for k in range(len(members))}
        last = told[-1]
        member = members[last.index]
        assert 0 < last.runs <= member.runs
        assert sum(last.histogram) == last.runs
        assert last.p50_us <= last.p99_us <= last.p999_us <= last.longest_us * (1.0 + 1e-6)
        assert last.longest_us * 1e3 <= member.longest_ns * (1.0 + 1e-6)
        assert last.budget_us == member.budget_us
        assert last.slips == flight.loop.slips
    silent = Telemetry()
    with Flight(load("time.duration_s=20"), sink=silent) as alone:
        alone.fly()
    assert not silent.of("LEONAV_TIMING")
    assert silent.of("LEONAV_COUNTERS")
