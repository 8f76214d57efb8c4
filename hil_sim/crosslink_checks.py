"""What one key of the crosslinks alone cannot show to be impossible."""

from __future__ import annotations

import math
from collections.abc import Iterator

from hil_sim.scenario_schema import Problem, Scenario

_GRID_NS = 100_000_000


def check_crosslinks(scenario: Scenario) -> Iterator[Problem]:
    """Contradictions between the constellation, its faults and the rest of the scenario."""
    link, run_s = scenario.crosslink, scenario.time.duration_s
    if link is None:
        if scenario.crosslink_fault:
            yield Problem("crosslink_fault", "there is no constellation", "add [crosslink], or remove the faults")
        return
    if "crosslink" not in scenario.flight.functions:
        yield Problem("crosslink", "no flight function would hear it", 'set flight.functions.crosslink = "crosslink"')
    if link.satellites % link.planes or link.phasing >= link.planes:
        yield Problem(
            "crosslink.planes",
            f"no Walker pattern {link.satellites}/{link.planes}/{link.phasing}",
            "planes must hold equal numbers, and phasing be below planes",
        )
    if link.own > link.satellites:
        yield Problem("crosslink.own", f"{link.own} is not one of {link.satellites}", "give a number up to that")
    real = link.precise is not None
    if real != (link.broadcast is not None):
        yield Problem("crosslink.precise", "a real day has both orbits and messages", "give both, or neither")
    if not real and scenario.orbit.source != "propagated":
        yield Problem("crosslink.own", "a replayed orbit is in no pattern", 'set orbit.source = "propagated"')
    if real and scenario.orbit.source == "propagated":
        yield Problem("crosslink.precise", "a propagated orbit is not that of the day", 'set orbit.source = "file"')
    if math.fmod(link.period_s * 1e9, _GRID_NS):
        yield Problem(
            "crosslink.period_s", f"{link.period_s:g} s is no whole number of 0.1 s", "use for example 1 or 2"
        )
    if link.spread_s >= link.period_s:
        yield Problem("crosslink.spread_s", "an epoch would end after the next began", "spread over less")
    for i, fault in enumerate(scenario.crosslink_fault):
        unknown = [number for number in fault.satellites if not 1 <= number <= link.satellites]
        if unknown:
            yield Problem(f"crosslink_fault.{i}.satellites", f"{unknown[0]} is none of them", f"1 to {link.satellites}")
        if fault.start_s >= run_s:
            yield Problem(f"crosslink_fault.{i}.start_s", f"starts after the run's {run_s:g} s", "start it earlier")
        if not any(fault.jump_m) and not any(fault.ramp_mps):
            yield Problem(f"crosslink_fault.{i}.jump_m", "this fault does nothing", "give jump_m or ramp_mps")
