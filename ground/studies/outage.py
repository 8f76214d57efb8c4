"""An outage flown from many start phases: when the true error passes the limit, when the flag comes, what was violated.

Run k of n has seed k + 1 and starts 360 k / n degrees of argument of latitude further along the orbit: where the
outage begins decides how fast the error grows (paper, remark after figure 5).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from ground.errors import OperatorError
from ground.studies.flights import NS, Prepared, prepare

SETTLED_S = 900.0  # of fixes before integrated figures that are taken here begin


class Variant(NamedTuple):
    """One run to fly: a scenario with settings, its seed and the phase of its start."""

    scenario: str
    settings: tuple[str, ...]
    seed: int
    phase_deg: float


@dataclass(frozen=True)
class OutageRun:
    """Figures of one run with one outage. Ages count from the last accepted fix [s]; None: it never happened.

    Errors are the largest axis in GCRF [m]. covered: share of integrated ticks before the outage whose bound held.
    """

    seed: int
    phase_deg: float
    crossed_age_s: float | None
    flag_age_s: float | None
    flag_to_crossing: float | None
    violations: int
    epochs: int
    worst_error_to_bound: float | None
    back_in_service_s: float | None
    fix_rms_m: float
    integrated_rms_m: float
    fix_to_integrated: float
    covered: float
    error_at_900_s_m: float | None
    error_at_2000_s_m: float | None
    error_max_m: float
    error_dip: float
    bound_max_m: float
    fault_of_table: str | None

    @property
    def flag_in_time(self) -> bool:
        """The flag came, and not after the true error had passed the limit."""
        if self.flag_age_s is None:
            return False
        return self.crossed_age_s is None or self.flag_age_s <= self.crossed_age_s


def variants(
    scenario: str, runs: int, settings: Iterable[str] = (), first_seed: int = 1, first_phase_deg: float = 0.0
) -> list[Variant]:
    """`runs` variants of a scenario, phases spread evenly over the orbit."""
    return [Variant(scenario, tuple(settings), first_seed + k, first_phase_deg + 360.0 * k / runs) for k in range(runs)]


def fly_variant(variant: Variant) -> OutageRun:
    """Fly one variant. Raises OperatorError unless it has exactly one outage."""
    return measure(prepare_variant(variant), variant)


def prepare_variant(variant: Variant) -> Prepared:
    """The world of a variant; settings the operator gave win over seed and phase."""
    phase = [f"seed={variant.seed}", f"orbit.argument_of_latitude_deg={variant.phase_deg!r}"]
    return prepare(variant.scenario, [*phase, *variant.settings])


def measure(prepared: Prepared, variant: Variant, overrides: Mapping[str, Any] | None = None) -> OutageRun:
    """Fly a prepared variant, with overrides of its table if any."""
    if len(prepared.world.scenario.outage) != 1:
        raise OperatorError(f"{variant.scenario}: a study of an outage needs exactly one [[outage]]")
    outputs, monitor = prepared.fly(prepared.table(overrides))
    evaluation = prepared.evaluate(monitor)
    outage, integrated = evaluation["outages"][0], evaluation["integrated"]
    t_ns, (start_ns, end_ns) = prepared.world.t_true_gps_ns, prepared.world.outages_gps_ns[0]
    inside = (t_ns >= start_ns) & (t_ns < end_ns)
    before = (prepared.age_s >= SETTLED_S) & (t_ns < start_ns)
    error_m, bound_m = prepared.error_m(outputs), outputs["bound_m"]
    crossed, flag = outage["error_crossed_eps_age_s"], outage["flag_raised_age_s"]
    scenario = prepared.world.scenario
    return OutageRun(
        seed=scenario.seed,
        phase_deg=scenario.orbit.argument_of_latitude_deg,
        crossed_age_s=crossed,
        flag_age_s=flag,
        flag_to_crossing=None if crossed is None or flag is None else flag / crossed,
        violations=outage["violations"],
        epochs=outage["epochs"],
        worst_error_to_bound=outage["worst_error_to_bound"],
        back_in_service_s=outage["back_in_service_s"],
        fix_rms_m=integrated["fix_rms_m"],
        integrated_rms_m=integrated["position_rms_m"],
        fix_to_integrated=integrated["fix_rms_m"] / integrated["position_rms_m"],
        covered=float(np.mean(bound_m[before] >= error_m[before])),
        error_at_900_s_m=outage["error_at_900_s_m"],
        error_at_2000_s_m=outage["error_at_2000_s_m"],
        error_max_m=float(error_m[inside].max()),
        error_dip=largest_dip(error_m[inside & (t_ns >= start_ns + 100 * NS)]),
        bound_max_m=float(np.nanmax(bound_m[inside])),
        fault_of_table=outage["fault_of_table"],
    )


def largest_dip(values: np.ndarray) -> float:
    """How far a series falls back below what it had reached, as a share of that; 0 for one that only grows."""
    return float(np.max(1.0 - values / np.maximum.accumulate(values), initial=0.0))


class Spread(NamedTuple):
    """Least, middle and largest of the runs in which a figure was reached, and in how many it was not."""

    least: float | None
    median: float | None
    largest: float | None
    never: int

    @classmethod
    def of(cls, values: Iterable[float | None]) -> Spread:
        """The spread of these; None counts as never reached."""
        everything = list(values)
        known = [value for value in everything if value is not None]
        if not known:
            return cls(None, None, None, len(everything))
        return cls(min(known), median(known), max(known), len(everything) - len(known))


SPREAD_KEYS = tuple(f.name for f in fields(OutageRun) if f.name not in ("seed", "phase_deg", "fault_of_table"))


def summarise(runs: list[OutageRun]) -> dict[str, Any]:
    """Figures over all runs: `SPREAD_KEYS`, each with least, median, largest and never; counts of outages."""
    summary: dict[str, Any] = {
        "runs": len(runs),
        "outages_violated": sum(run.violations > 0 for run in runs),
        "violated_epochs": sum(run.violations for run in runs),
        "flag_in_time": sum(run.flag_in_time for run in runs),
        "back_in_service": sum(run.back_in_service_s is not None for run in runs),
    }
    for key in SPREAD_KEYS:
        summary[key] = Spread.of(getattr(run, key) for run in runs)._asdict()
    return summary


def as_document(study: str, chosen: list[Variant], runs: list[OutageRun]) -> dict[str, Any]:
    """What --json writes."""
    return {
        "study": study,
        "scenario": chosen[0].scenario,
        "settings": list(chosen[0].settings),
        "runs": [asdict(run) | {"flag_in_time": run.flag_in_time} for run in runs],
        "summary": summarise(runs),
    }
