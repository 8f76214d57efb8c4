"""Outages flown past the flag: how long the bound stays below a limit, whether it holds so long, and was it foretold.

A run is one of an ensemble whose outages last up to a day. How long one is flown is asked of flight itself: 1.3 times
the age at which, by its own prediction at the loss of GNSS, the bound crosses the highest limit. The table's own limit
is set that high, for the flag must not end what is looked at. At three ages flight is asked when the flag will rise.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from flightsw.icd.enums import Governing
from flightsw.icd.table_file import TableImage, decode
from flightsw.memory import Memory
from flightsw.records import OUTPUT
from ground.campaign import arc, flown, store
from ground.campaign.ensemble import Draw, Ensemble, draw
from ground.campaign.outage import LIMITS_M, TICK_NS, Arrays, Flight, load, measure
from ground.tables.build import build_navigation

LONGEST_S = 86_400.0
BEYOND = 1.3
ASKED_AT_S = 60.0  # of an outage; also at its loss, and at half of what is foretold then
QUICK_LONGEST_S = 7200.0


def ensemble_of(ensemble: Ensemble, quick: bool = False) -> Ensemble:
    """The long outages of an ensemble: one to a run, up to a day.

    Their truth ends at degree 70, as flight does: what the field leaves out is metres by the hour, drag is kilometres,
    and the outages of 2000 s have it.
    """
    longest_s = QUICK_LONGEST_S if quick else LONGEST_S
    return replace(ensemble, outage_s=(longest_s, longest_s), second_share=0.0, gravity_beyond=())


def flight_of(flight: Flight) -> Flight:
    """The same with the limit out of the way of its outages."""
    return flight._replace(overrides=(*flight.overrides, ("limit_m", max(LIMITS_M))))


def fly_chunk(flight: Flight, first: int, last: int) -> Arrays:
    """Figures of runs first to last, stacked."""
    return store.stacked(fly(flight, run) for run in range(first, last + 1))


def fly(flight: Flight, run: int) -> Arrays:
    """Figures of a run: those of `measure`, and by limit (of LIMITS_M) what flight foretold.

    asked_s, foretold_s (3,2)   ages at which flight was asked, and the age at which it said that the bound would cross
                                the limit; infinite: not within its horizon; NaN: not asked, the bound was beyond
    planned_s                   length of the outage; reached: whether it was ended by the flag, not by the day
    """
    limits = [decode(build_navigation(flight.table_set, dict(flight.overrides) | {"limit_m": m})) for m in LIMITS_M]
    at_loss = _foretold_at_loss(flight, run, limits[-1])
    planned_s = min(flight.ensemble.outage_s[1], math.ceil(BEYOND * at_loss) if math.isfinite(at_loss) else math.inf)
    drawn = draw(flight.ensemble, flight.seeds, run, flight.table_set, outage_s=max(planned_s, 2.0 * ASKED_AT_S))
    world, inputs, ticks, memory = _prepared(flight, drawn)
    # A tick a second. The first of the outage still uses the last fix.
    lost_tick = round(drawn.acquisition_s)
    asked_s, foretold_s = np.full((3, len(LIMITS_M)), np.nan), np.full((3, len(LIMITS_M)), np.nan)
    outputs = np.zeros(len(inputs), OUTPUT)
    done = 0

    def go_to(age_s: float) -> int:
        nonlocal done
        stop = int(np.searchsorted(ticks, lost_tick + round(age_s), "right"))
        if stop > done:
            arc.fly(memory, inputs[done:stop], outputs[done:stop])
            done = stop
        return int(inputs["counter_now_ns"][done - 1])

    for row, age_s in enumerate((0.0, ASKED_AT_S)):
        counter_ns = go_to(age_s)
        for k in range(len(LIMITS_M)):
            foretold_s[row, k] = ask(memory, limits[k], counter_ns)
            asked_s[row, k] = age_s
    for k in np.argsort(foretold_s[1]).tolist():
        half_s = 0.5 * foretold_s[1, k]
        if math.isfinite(half_s) and ASKED_AT_S < half_s < drawn.outage_s:
            counter_ns = go_to(half_s)
            foretold_s[2, k] = ask(memory, limits[k], counter_ns)
            asked_s[2, k] = half_s
    arc.fly(memory, inputs[done:], outputs[done:])
    return measure(flight.ensemble, drawn, world, flown.last_of_tick(outputs, ticks)) | {
        "asked_s": asked_s,
        "foretold_s": foretold_s,
        "planned_s": np.array(drawn.outage_s),
        "reached": np.array(drawn.outage_s < flight.ensemble.outage_s[1]),
    }


def _prepared(flight: Flight, drawn: Draw) -> tuple[flown.World, np.ndarray, np.ndarray, Memory]:
    world = flown.build_world(drawn.tree, drawn.where, TICK_NS)
    inputs, ticks = flown.step_inputs(world)
    return world, inputs, ticks, load(flight, drawn, world)


def _foretold_at_loss(flight: Flight, run: int, limit: TableImage) -> float:
    """Age at which the bound would cross the limit, asked at the loss of GNSS in a flight that ends there."""
    drawn = draw(flight.ensemble, flight.seeds, run, flight.table_set, outage_s=2.0)
    drawn.tree["burn"] = []  # all of them come later
    _, inputs, ticks, memory = _prepared(flight, drawn)
    stop = int(np.searchsorted(ticks, round(drawn.acquisition_s), "right"))
    arc.fly(memory, inputs[:stop])
    return ask(memory, limit, int(inputs["counter_now_ns"][stop - 1]))


def ask(memory: Memory, limit: TableImage, counter_ns: int) -> float:
    """Age of the outage at which flight says that its flag will rise; infinite beyond its horizon, NaN: no answer."""
    held = memory.table.copy()
    memory.load_navigation(limit.values)
    memory.ahead.view(np.uint8)[:] = 0
    memory.predict(counter_ns)
    memory.load_navigation(held)
    if not memory.ahead["valid"][0]:
        return math.nan
    governing = int(memory.ahead["governing"][0])
    if governing == Governing.BOUND:
        return float(memory.ahead["t_flag_gps_ns"][0] - memory.nav["t_fix_gps_ns"][0]) * 1e-9
    return math.inf if governing == Governing.HORIZON else math.nan
