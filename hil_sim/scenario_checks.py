"""What one key of a burn, a command or the attitude alone cannot show to be impossible."""

from __future__ import annotations

from collections.abc import Iterator

from hil_sim.crosslink_checks import check_crosslinks
from hil_sim.fault_kinds import ON_THE_BUS, PSEUDORANGES, RECEIVER_TARGETS
from hil_sim.pseudorange_schema import check as check_pseudoranges
from hil_sim.scenario_schema import Burn, Command, Fault, Problem, Scenario

MAXIMUM_BURNS = 255  # the frame's number of the burn has eight bits


def check_events(scenario: Scenario) -> Iterator[Problem]:
    """Contradictions between burns, commands, attitude and the rest of the scenario."""
    yield from _check_burns(scenario)
    yield from _check_gravity(scenario)
    yield from _check_area_step(scenario)
    for i, command in enumerate(scenario.command):
        yield from _check_command(f"command.{i}", command, scenario.time.duration_s)
    if scenario.attitude is not None and not whole_epochs(scenario.attitude.rate_hz):
        yield Problem(
            "attitude.rate_hz",
            f"{scenario.attitude.rate_hz} attitudes per second do not fall on whole GPS epochs",
            "use for example 0.1, 0.5, 1, 2, 4, 5 or 10",
        )
    for i, fault in enumerate(scenario.fault):
        yield from _check_fault(f"fault.{i}", fault, scenario)
    yield from _check_recording(scenario)
    yield from check_crosslinks(scenario)
    for kind in scenario.flight.function_table:
        if kind not in scenario.flight.functions:
            yield Problem(
                f"flight.function_table.{kind}", "no such function flies", f'set flight.functions.{kind} = "{kind}"'
            )
    flies = "gnss" in scenario.flight.functions
    for wrong in check_pseudoranges(scenario.pseudoranges, scenario.satellite_fault, flies, scenario.time.duration_s):
        yield Problem(*wrong)


def _check_recording(scenario: Scenario) -> Iterator[Problem]:
    gnss = scenario.gnss
    if (gnss.recorded is None) != (not gnss.recorded_orbits):
        key = "gnss.recorded" if gnss.recorded is None else "gnss.recorded_orbits"
        yield Problem(key, "observations are solved with precise orbits of their days", "give both, or neither")
    if gnss.recorded is not None and scenario.orbit.source == "propagated":
        yield Problem(
            "gnss.recorded", "a recorded receiver flew one orbit only", 'set orbit.source = "file" and give it'
        )
    noise = (gnss.sigma_position_m, gnss.sigma_velocity_mps, gnss.coloured_sigma_m, gnss.periodic_sigma_m)
    if gnss.recorded is not None and any(noise):
        yield Problem("gnss.sigma_position_m", "a recorded receiver has its own noise", "set all noise of gnss to 0")


def _check_fault(key: str, fault: Fault, scenario: Scenario) -> Iterator[Problem]:
    if not scenario.gnss.velocity and (fault.kind == "velocity_step" or fault.target == "velocity"):
        yield Problem(f"{key}.kind", "the receiver gives no velocity", "set gnss.velocity = true")
    if fault.target not in RECEIVER_TARGETS:
        if fault.kind not in ON_THE_BUS:
            yield Problem(
                f"{key}.target", f"{fault.kind} strikes the receiver", "one of " + ", ".join(RECEIVER_TARGETS)
            )
        elif not getattr(scenario, "pseudoranges" if fault.target in PSEUDORANGES else fault.target, None):
            yield Problem(f"{key}.target", f"the scenario has no {fault.target}", "add it, or choose another target")


def whole_epochs(rate_hz: float) -> bool:
    """Whether the period is a whole number of nanoseconds."""
    period_ns = 1e9 / rate_hz
    return abs(period_ns - round(period_ns)) <= 1e-3


def _check_burns(scenario: Scenario) -> Iterator[Problem]:
    if scenario.burn and scenario.orbit.source != "propagated":
        yield Problem(
            "burn.0.start_s", "a replayed orbit cannot be changed by a burn", 'set orbit.source = "propagated"'
        )
        return
    if len(scenario.burn) > MAXIMUM_BURNS:
        yield Problem("burn", f"{len(scenario.burn)} burns", f"no more than {MAXIMUM_BURNS}")
    end_before = 0.0
    for i, burn in enumerate(scenario.burn):
        yield from _check_burn(f"burn.{i}", burn, scenario.time.duration_s)
        if burn.start_s < end_before:
            yield Problem(f"burn.{i}.start_s", "overlaps the one before it", "list them in order of time")
        end_before = burn.start_s + burn.duration_s


def _check_burn(key: str, burn: Burn, run_s: float) -> Iterator[Problem]:
    if burn.start_s + burn.duration_s > run_s:
        yield Problem(
            f"{key}.start_s",
            f"ends at {burn.start_s + burn.duration_s:g} s, after the run's {run_s:g} s",
            "start it earlier or lengthen time.duration_s",
        )
    if burn.announced and not 0.0 <= burn.start_s - burn.announce_lead_s < run_s:
        yield Problem(
            f"{key}.announce_lead_s",
            f"would be announced {burn.start_s - burn.announce_lead_s:g} s after the start, outside the run",
            "announce it later or earlier, or set announced = false",
        )


def _check_command(key: str, command: Command, run_s: float) -> Iterator[Problem]:
    if command.at_s >= run_s:
        yield Problem(f"{key}.at_s", f"is after the run's {run_s:g} s", "give it earlier")
    for name in ("target", "value"):
        given = getattr(command, name) is not None
        if command.command == "edit" and not given:
            yield Problem(
                f"{key}.{name}", "edit needs it", "give position or velocity; auto, accept, reject or inhibit"
            )
        if command.command != "edit" and given:
            yield Problem(f"{key}.{name}", f"{command.command} takes none", "remove it")


def _check_gravity(scenario: Scenario) -> Iterator[Problem]:
    truth = scenario.truth
    if not truth.gravity_beyond:
        return
    if scenario.orbit.source != "propagated":
        yield Problem("truth.gravity_beyond", "a replayed orbit has the forces it had", "remove it")
    if truth.gravity_beyond <= truth.gravity_degree:
        yield Problem(
            "truth.gravity_beyond",
            f"{truth.gravity_beyond} is not above truth.gravity_degree = {truth.gravity_degree}",
            "give a higher degree, or 0 for none",
        )


def _check_area_step(scenario: Scenario) -> Iterator[Problem]:
    step = scenario.truth.area_step
    if step is None:
        return
    if scenario.orbit.source != "propagated":
        yield Problem("truth.area_step", "a replayed orbit has the forces it had", "remove it")
    if step.at_s >= scenario.time.duration_s:
        yield Problem(
            "truth.area_step.at_s",
            f"{step.at_s:g} s lies after the run's {scenario.time.duration_s:g} s",
            "put it earlier or lengthen time.duration_s",
        )
