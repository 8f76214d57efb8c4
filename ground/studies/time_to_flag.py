"""How long a satellite may fly without GNSS: the age of the flag by flight's own prediction, quiet Sun and active.

500 km, 0.01 m2/kg, two revolutions of fixes of 10 m and 0.1 m/s, a calibrated clock; six phases along the orbit on each
of two days. That flight predicts its flag well is measured by `ground certify --long`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.memory import Memory
from ground.campaign import arc, flown
from ground.campaign.endurance import ask
from ground.campaign.outage import LIMITS_M
from ground.studies.flights import COARSE_TICK_NS, HOUR_NS, NS, prepare
from ground.tables.build import build_navigation
from ground.tables.earth_orientation import build_earth_orientation

SCENARIO = "nominal"
TABLE_SET = "flight"
FIXES_S = 11_400
HORIZON_S = 150_000.0  # how far flight is asked to look
PHASES_DEG = tuple(range(0, 360, 60))
# the least of two cycles, the largest of two
DAYS = {"solar minimum": ("2008-08-15", "2019-06-15"), "solar maximum": ("2001-12-15", "2014-02-25")}

# asked of the age of the flag [s], and the goal, by Sun and limit [m]
WANTED_S = {
    ("solar minimum", 50.0): (7000.0, 9000.0),
    ("solar maximum", 50.0): (3600.0, 5400.0),
    ("solar minimum", 2000.0): (80_000.0, 110_000.0),
    ("solar maximum", 2000.0): (25_000.0, 35_000.0),
}


@dataclass(frozen=True)
class Task:
    """One flight; picklable."""

    sun: str
    day: str
    phase_deg: int
    settings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Found:
    """What one flight foretold at the loss of GNSS: by limit the age of the flag, infinite beyond the horizon."""

    sun: str
    day: str
    phase_deg: int
    f107: float
    ap: float
    t_flag_s: tuple[float, ...]


def tasks(settings: Iterable[str] = ()) -> list[Task]:
    """All flights of the study."""
    return [
        Task(sun, day, phase, tuple(settings)) for sun, days in DAYS.items() for day in days for phase in PHASES_DEG
    ]


def fly(task: Task) -> Found:
    """Fly with fixes, then ask. Raises OperatorError where settings do not allow it."""
    prepared = prepare(
        SCENARIO,
        (
            f"time.start={task.day}T00:00:00.6",  # ticks find the fix of their own second
            f"time.duration_s={FIXES_S + 60}",
            f"outage.0.start_s={FIXES_S}",
            "outage.0.duration_s=60",
            f"orbit.argument_of_latitude_deg={task.phase_deg}",
            "truth.area_to_mass_m2pkg=0.01",
            'truth.solar="data"',
            f"flight.table_set={TABLE_SET}",
            *task.settings,
        ),
        COARSE_TICK_NS,
    )
    memory = Memory()
    world = prepared.world
    start_gps_ns, stop_gps_ns = world.t_start_gps_ns, int(world.t_true_gps_ns[-1]) + round(1.1 * HORIZON_S * NS)
    orientation = build_earth_orientation(start_gps_ns - HOUR_NS, stop_gps_ns, None)
    memory.load(prepared.table().values, decode(orientation).values)
    forces = flown.force_images(world)
    memory.load_forces(*(image.values for image in forces))
    inputs, ticks = prepared.inputs
    stop = int(np.searchsorted(ticks, FIXES_S, "right"))
    arc.fly(memory, inputs[:stop])
    flight = world.scenario.flight
    asked = {**flight.table, "ahead_horizon_s": HORIZON_S}
    limits = (decode(build_navigation(flight.table_set, asked | {"limit_m": limit})) for limit in LIMITS_M)
    counter_ns = int(inputs["counter_now_ns"][stop - 1])
    values = forces.forces.values
    return Found(
        task.sun,
        task.day,
        task.phase_deg,
        float(values["f107"][0]),
        float(values["ap"][0]),
        tuple(ask(memory, limit, counter_ns) for limit in limits),
    )


def summarise(found: Iterable[Found]) -> list[dict[str, Any]]:
    """By Sun and limit: least, median and largest age of the flag, what was asked, whether the least reaches it."""
    every = list(found)
    lines = []
    for (sun, limit), (wanted_s, goal_s) in WANTED_S.items():
        k = LIMITS_M.index(limit)
        ages = np.array([one.t_flag_s[k] for one in every if one.sun == sun])
        lines.append(
            {
                "sun": sun,
                "limit_m": limit,
                "flights": len(ages),
                "least_s": _number(ages.min()),
                "median_s": _number(np.median(ages)),
                "largest_s": _number(ages.max()),
                "wanted_s": wanted_s,
                "goal_s": goal_s,
                "reached": bool(ages.min() >= wanted_s),
                "goal_reached": bool(ages.min() >= goal_s),
            }
        )
    return lines


def table(found: Iterable[Found]) -> str:
    """Lines for the terminal."""
    every = list(found)
    lines = [f"{'':>15}{'day':>12}{'F10.7':>7}{'ap':>5}   age of the flag at 50 m, 2000 m [s], by phase"]
    for sun, days in DAYS.items():
        for day in days:
            here = [one for one in every if (one.sun, one.day) == (sun, day)]
            if not here:
                continue
            ages = "  ".join(", ".join(_text(age) for age in one.t_flag_s) for one in here)
            lines.append(f"{sun:>15}{day:>12}{here[0].f107:7.0f}{here[0].ap:5.0f}   {ages}")
    for line in summarise(every):
        said = "the goal, too" if line["goal_reached"] else "reached" if line["reached"] else "NOT REACHED"
        spread = " / ".join(_text(line[f"{name}_s"]) for name in ("least", "median", "largest"))
        lines.append(
            f"{line['sun']}, {line['limit_m']:g} m: {spread} s (least / median / largest of {line['flights']}), wanted "
            f"{line['wanted_s']:.0f}, goal {line['goal_s']:.0f}: {said}"
        )
    return "\n".join(lines)


def as_document(found: Iterable[Found]) -> dict[str, Any]:
    """For --json."""
    every = list(found)
    flights = [asdict(one) | {"t_flag_s": [_number(age) for age in one.t_flag_s]} for one in every]
    return {"study": "time_to_flag", "limits_m": list(LIMITS_M), "summary": summarise(every), "flights": flights}


def _number(value: float) -> float | None:
    """For JSON; None: beyond the horizon of the prediction."""
    return float(value) if math.isfinite(value) else None


def _text(age_s: float | None) -> str:
    return "> horizon" if age_s is None or math.isinf(age_s) else f"{age_s:.0f}"
