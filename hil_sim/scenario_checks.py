"""What one key of a burn, a command or the attitude alone cannot show to be impossible."""

from __future__ import annotations

from collections.abc import Iterator

from hil_sim.scenario_schema import Burn, Command, Problem, Scenario

MAXIMUM_BURNS = 255  # the frame's number of the burn has eight bits


def check_events(scenario: Scenario) -> Iterator[Problem]:
    """Contradictions between burns, commands, attitude and the rest of the scenario."""
    yield from _check_burns(scenario)
    for i, command in enumerate(scenario.command):
        yield from _check_command(f"command.{i}", command, scenario.time.duration_s)
    if scenario.attitude is not None and not whole_epochs(scenario.attitude.rate_hz):
        yield Problem(
            "attitude.rate_hz",
            f"{scenario.attitude.rate_hz} attitudes per second do not fall on whole GPS epochs",
            "use for example 0.1, 0.5, 1, 2, 4, 5 or 10",
        )
    if not scenario.gnss.velocity:
        for i, fault in enumerate(scenario.fault):
            if fault.kind == "velocity_step" or fault.target == "velocity":
                yield Problem(f"fault.{i}.kind", "the receiver gives no velocity", "set gnss.velocity = true")


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
