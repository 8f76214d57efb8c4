"""What the flight filter's step costs by the degree of its gravity field, beside satkit's propagation in the same run.

A satellite at 421 km with a fix a second is flown through the compiled arc, then on without fixes. Every figure is the
least of some rounds, taken in turn: what the machine does when left alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.memory import Memory
from ground.accuracy.flight_model import FlightModel
from ground.accuracy.forces import peer_settings
from ground.campaign import arc
from ground.studies.flights import COARSE_TICK_NS, NS, Prepared, prepare
from ground.tables.forces import build_forces
from ground.tables.gravity_field import build_gravity_field
from hil_sim.truth.satkit_data import satkit_time, session

DEGREES = (36, 50, 70)
FIXES_S, OUTAGE_S = 2000, 2000
ROUNDS = 5
_SETTLED_S = 10  # of an outage, before it is timed: the grid has its long steps by then
_SCENARIO = "two_orbits"
_DAY = date(2003, 6, 1)  # its ticks find the fix of their own second
_SETTINGS = (
    "flight.table_set=flight",
    f"time.duration_s={FIXES_S + 60}",
    f"outage.0.start_s={FIXES_S}",
    "outage.0.duration_s=60",
)


class Cost(NamedTuple):
    """Microseconds for a second of flight at one degree.

    fix_us: with a fix, all calls of the navigation step in it; calls: how many. call_us: one of them.
    outage_us: without fixes. mean_us: of these, carrying the mean alone. satkit_us: satkit, the mean alone.
    """

    degree: int
    calls: float
    fix_us: float
    call_us: float
    outage_us: float
    mean_us: float
    satkit_us: float


def measure(degrees: tuple[int, ...] = DEGREES, gravity: Path | None = None, rounds: int = ROUNDS) -> list[Cost]:
    """Fly and time. gravity: an ICGEM file; None takes the packaged field. Raises OperatorError."""
    prepared = prepare(_SCENARIO, (*_SETTINGS, f"time.start={_DAY}T00:00:00.6"), COARSE_TICK_NS)
    return [_measure_degree(prepared, degree, gravity, rounds) for degree in degrees]


def _measure_degree(prepared: Prepared, degree: int, gravity: Path | None, rounds: int) -> Cost:
    inputs, ticks = prepared.inputs
    calls = int(np.searchsorted(ticks, FIXES_S, "right"))
    blank = np.zeros(_SETTLED_S + OUTAGE_S, inputs.dtype)
    blank["counter_now_ns"] = inputs["counter_now_ns"][calls - 1] + np.arange(1, len(blank) + 1) * NS
    navigation, orientation = prepared.table().values, prepared.orientation.values
    forces = decode(build_forces({"degree": degree}, day=_DAY)).values
    field = decode(build_gravity_field(gravity, degree)).values
    model = FlightModel(orientation, gravity, {"degree": degree}, _DAY)
    t_gps_ns = int(prepared.world.t_start_gps_ns)
    x = np.concatenate((prepared.world.r_true_gcrf_m[0], prepared.world.v_true_gcrf_mps[0]))

    with session(t_gps_ns, t_gps_ns + OUTAGE_S * NS) as satkit:
        settings = peer_settings(satkit, degree)
        instant = satkit_time(satkit, t_gps_ns)

        def once() -> tuple[float, ...]:
            memory = Memory()
            memory.load(navigation, orientation)
            memory.load_forces(forces, field)
            fixes_s = _seconds(lambda: arc.fly(memory, inputs[:calls]))
            arc.fly(memory, blank[:_SETTLED_S])
            return (
                fixes_s,
                _seconds(lambda: arc.fly(memory, blank[_SETTLED_S:])),
                _seconds(lambda: model.propagate(t_gps_ns, x, OUTAGE_S * NS)),
                _seconds(lambda: satkit.propagate(x, instant, duration_secs=float(OUTAGE_S), propsettings=settings)),
            )

        once()  # compiles what is not compiled yet
        fix_s, outage_s, mean_s, satkit_s = np.min([once() for _ in range(rounds)], axis=0)
    return Cost(
        degree,
        calls / FIXES_S,
        1e6 * fix_s / FIXES_S,
        1e6 * fix_s / calls,
        1e6 * outage_s / OUTAGE_S,
        1e6 * mean_s / OUTAGE_S,
        1e6 * satkit_s / OUTAGE_S,
    )


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def table(found: list[Cost]) -> str:
    """Lines for the terminal."""
    lines = [
        "microseconds for a second of flight (least of some rounds)",
        f"{'degree':>8}{'with a fix':>13}{'calls':>7}{'a call':>9}{'no fix':>9}{'its mean':>10}{'satkit, mean':>14}",
    ]
    for one in found:
        lines.append(
            f"{one.degree:>8}{one.fix_us:>13.1f}{one.calls:>7.1f}{one.call_us:>9.1f}{one.outage_us:>9.1f}"
            f"{one.mean_us:>10.1f}{one.satkit_us:>14.1f}"
        )
    return "\n".join(lines)
