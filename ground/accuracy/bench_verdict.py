"""What is wanted of the flight filter on real orbits, the goal beyond it, and what the bench measured; misses too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from ground.accuracy.bench_cases import PERFECT_CLOCK
from ground.accuracy.bench_summary import (
    NEAR_M,
    NEAR_S,
    STEADY_FACTOR,
    STEADY_S,
    Summary,
    clock_ratios,
    velocity_ratios,
)

RETURNS_WANTED = 200  # runs of the return of fixes

# orbit -> wanted and goal of the steady rms [m, mm/s]; Sentinel-3A also stands for the goal of a prototype
_STEADY: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "gracefo": ((1.0, 1.5), (0.51, 0.6)),
    "sentinel3a": ((0.7, 1.0), (0.47, 0.5)),
}
# orbit -> age -> wanted and goal of the outage error, median and maximum [m]
_OUTAGE: dict[str, dict[str, tuple[tuple[float, float], tuple[float, float]]]] = {
    "gracefo": {
        "900": ((1.5, 5.0), (0.6, 2.5)),
        "2000": ((3.0, 9.0), (1.0, 4.5)),
        "7200": ((7.0, 25.0), (3.0, 10.0)),
    },
    "sentinel3a": {
        "900": ((1.0, 3.0), (0.6, 2.0)),
        "2000": ((1.5, 4.5), (1.1, 3.5)),
        "7200": ((2.5, 7.0), (1.5, 5.0)),
    },
}
_COLOURED_RMS_M = 5.0
_COLOURED_OUTAGE = ("2000", (5.0, 16.0))
_VELOCITY_RATIO = 1.3
_CLOCK_RATIO = 1.5
_CLOCK_AGES = ("900", "2000", "7200")
_NEES_AGES = ("60", "900", "2000", "7200")
_NEES = (0.3, 1.1)
_BEYOND_SHARE = 0.003
_MISSING = float("inf")  # a figure that is not finite misses every limit


class Line(NamedTuple):
    """One figure against what is wanted of it. least: of what must not be less, None where there is no such limit."""

    item: str
    orbit: str
    profile: str
    what: str
    unit: str
    measured: float | None
    wanted: float
    goal: float | None = None
    least: float | None = None

    @property
    def met(self) -> bool:
        """Whether what is wanted is reached."""
        value = _MISSING if self.measured is None else self.measured
        return value <= self.wanted and (self.least is None or value >= self.least)

    @property
    def goal_met(self) -> bool | None:
        """Whether the goal is reached; None where there is none."""
        if self.goal is None:
            return None
        return self.measured is not None and self.measured <= self.goal

    def as_document(self) -> dict[str, Any]:
        """For accuracy.json."""
        return self._asdict() | {"met": self.met, "goal_met": self.goal_met}


def judge(summaries: Sequence[Summary]) -> list[Line]:
    """All lines that these cases bear; an orbit without a requirement has none of its own."""
    lines = [line for one in summaries for line in (*_steady(one), *_outages(one), *_consistency(one))]
    lines += [
        Line("1", orbit, "position_only", "velocity rms by that of white fixes", "", ratio, _VELOCITY_RATIO)
        for orbit, ratio in velocity_ratios(summaries).items()
    ]
    lines += [
        Line("2", orbit, "white", f"outage rms at {age} s by that of a perfect clock", "", ratios[age], _CLOCK_RATIO)
        for orbit, ratios in clock_ratios(summaries, PERFECT_CLOCK).items()
        for age in _CLOCK_AGES
        if age in ratios
    ]
    lines += _returns(summaries)
    return sorted(lines, key=lambda line: line.item)


def _steady(one: Summary) -> Iterator[Line]:
    orbit, profile, steady = one["orbit"], one["profile"], one["steady"]
    if profile == "white" and orbit in _STEADY:
        wanted, goal = _STEADY[orbit]
        yield Line("1", orbit, profile, "steady 3-D position rms", "m", steady["rms_3d_m"], wanted[0], goal[0])
        velocity = steady["rms_3d_mps"]
        in_mm = None if velocity is None else 1e3 * velocity
        yield Line("1", orbit, profile, "steady 3-D velocity rms", "mm/s", in_mm, wanted[1], goal[1])
    if profile == "coloured":
        yield Line("1", orbit, profile, "steady 3-D position rms", "m", steady["rms_3d_m"], _COLOURED_RMS_M)


def _outages(one: Summary) -> Iterator[Line]:
    orbit, profile, ages = one["orbit"], one["profile"], one["outages"]
    if profile == "white":
        limits = {age: both for age, both in _OUTAGE.get(orbit, {}).items() if age in ages}
        for age, (wanted, goal) in limits.items():
            for k, name in enumerate(("median", "max")):
                what = f"outage error at {age} s, {name}"
                yield Line("2", orbit, profile, what, "m", ages[age].get(f"{name}_m"), wanted[k], goal[k])
    age, limit = _COLOURED_OUTAGE
    if profile == "coloured" and orbit in _OUTAGE and age in ages:
        for k, name in enumerate(("median", "max")):
            what = f"outage error at {age} s, {name}"
            yield Line("2", orbit, profile, what, "m", ages[age].get(f"{name}_m"), limit[k])


def _consistency(one: Summary) -> Iterator[Line]:
    orbit, profile, steady = one["orbit"], one["profile"], one["steady"]
    if profile == PERFECT_CLOCK:
        return
    if steady.get("nees_per_state") is not None:
        value = steady["nees_per_state"]
        yield Line("5", orbit, profile, "steady NEES per state", "", value, _NEES[1], None, _NEES[0])
        for age in one["outages"]:
            value = one["outages"][age].get("nees_per_state")
            if value is not None and age in _NEES_AGES:
                what = f"NEES per state {age} s into the outage"
                yield Line("5", orbit, profile, what, "", value, _NEES[1], None, _NEES[0])
    for what, share in (
        ("time beyond the bound with fixes", steady["beyond_bound_share"]),
        ("time beyond the bound in outages", one["outage_beyond_bound_share"]),
    ):
        in_percent = None if share is None else 1e2 * share
        yield Line("5", orbit, profile, what, "%", in_percent, 1e2 * _BEYOND_SHARE)


def _returns(summaries: Sequence[Summary]) -> Iterator[Line]:
    """Misses over all orbits of a profile, none allowed; and whether there were runs enough."""
    for profile in dict.fromkeys(one["profile"] for one in summaries):
        if profile == PERFECT_CLOCK:
            continue
        runs = [
            one_return
            for one in summaries
            if one["profile"] == profile
            for one_return in one["back_to_steady"].values()
            if one_return["runs"]
        ]
        count = sum(one["runs"] for one in runs)
        if not count:
            continue
        runs_word = f"of {count} returns" + ("" if count >= RETURNS_WANTED else f" ({RETURNS_WANTED} wanted)")
        near, steady = (count - sum(one[f"{name}_in_time"] for one in runs) for name in ("near", "steady"))
        what = f"{runs_word} not within {NEAR_M:g} m in {NEAR_S:g} s"
        yield Line("6", "all", profile, what, "", near, 0)
        what = f"{runs_word} not within {STEADY_FACTOR:g} steady rms in {STEADY_S:g} s"
        yield Line("6", "all", profile, what, "", steady, 0)
