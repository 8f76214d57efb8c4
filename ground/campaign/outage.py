"""One run of an ensemble flown and measured: acquisition, outage, perhaps a second one.

Flown at one tick a second through the compiled arc. Errors are published minus true position at the true instant of a
tick, in GCRF; ages count from the last accepted fix.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flightsw.icd.enums import Mode, Verdict
from flightsw.icd.table_file import TableImage, decode
from flightsw.memory import Memory
from ground.campaign import arc, flown
from ground.campaign.ensemble import Draw, Ensemble, draw
from ground.campaign.seeds import Seeds
from ground.tables.build import build_navigation
from ground.tables.earth_orientation import build_earth_orientation
from ground.tables.forces import VALID_DAYS, build_forces
from ground.tables.gps_time import NS_PER_DAY, NS_PER_S, gps_of_day
from ground.tables.gravity_field import build_gravity_field
from hil_sim.truth.interface import MU_PAPER_M3PS2

TICK_NS = NS_PER_S
LIMITS_M = (50.0, 2000.0)
CONVERGED_S = 60.0  # of fixes from the start on, after which the bound is judged: no acquisition is shorter
_ORIENTATION_DAYS = 30
_NEES_STEP = 10

Arrays = dict[str, np.ndarray]


class Flight(NamedTuple):
    """What an ensemble is flown with: picklable, the same for every run. overrides: fields of the set, for tuning."""

    ensemble: Ensemble
    seeds: Seeds
    table_set: str
    overrides: tuple[tuple[str, float], ...] = ()

    def image(self) -> bytes:
        """The navigation table, as flight would load it."""
        return build_navigation(self.table_set, dict(self.overrides) or None)


def ages_s(longest_s: float) -> np.ndarray:
    """Ages at which errors are kept (m,) int: every second of the first minute, then ever wider, to the longest."""
    steps = (
        range(1, 60),
        range(60, 300, 20),
        range(300, 1200, 60),
        range(1200, 7200, 100),
        range(7200, 10**6, 600),
    )
    ages = np.concatenate([np.array(part, np.int64) for part in steps])
    return ages[ages <= longest_s]


def fly(flight: Flight, run: int) -> Arrays:
    """Figures of a run, see `measure`. Raises OperatorError where data do not allow it."""
    drawn = draw(flight.ensemble, flight.seeds, run, flight.table_set)
    world = flown.build_world(drawn.tree, drawn.where, TICK_NS)
    inputs, ticks = flown.step_inputs(world)
    memory = load(flight, drawn, world)
    outputs = flown.last_of_tick(arc.fly(memory, inputs), ticks)
    return measure(flight.ensemble, drawn, world, outputs)


def load(flight: Flight, drawn: Draw, world: flown.World) -> Memory:
    """A memory with the tables of a run."""
    memory = Memory()
    memory.load(_navigation(flight).values, _orientation(world.t_start_gps_ns // (_ORIENTATION_DAYS * NS_PER_DAY)))
    memory.load_forces(forces_of(drawn).values, _field().values)
    return memory


def measure(ensemble: Ensemble, drawn: Draw, world: flown.World, outputs: np.ndarray) -> Arrays:
    """Figures of a run from its outputs, one a tick. m ages, NaN beyond the outage.

    run, cell, drawn (one number each)     what was drawn
    started                                whether there was a state when GNSS was lost
    error_m (m,3), bound_m, bound_3d_m, sigma_m (m,3)   at the ages of the first outage; sigma of the covariance
    worst_ratio, worst_age_s               largest error / bound of the largest axis over every epoch of it, and when
    worst_3d_ratio, worst_3d_age_s         the same in three dimensions
    violated, violated_before_flag         whether any epoch broke the bound; and any before the flag
    broken_epochs, epochs                  of the outage
    crossing_error_s, crossing_bound_s (2,)   first age beyond LIMITS_M, NaN: not reached
    flag_age_s                             at which the flag of the table's own limit was raised
    orbits, integrated_broken, integrated_ratio   revolutions in INTEGRATED mode since convergence, broken epochs, worst
    nees_before, sigma_before_m            mean NEES (6) of the last minute of fixes; position sigma at the loss
    drag_before, drag_after                estimated drag scale at the loss and at the end
    second_ratio, second_violated          of the second outage
    return_ratio                           worst ratio with fixes again, before INTEGRATED
    """
    ages = ages_s(ensemble.outage_s[1])
    since_s = (world.t_true_gps_ns - world.t_start_gps_ns) / 1e9
    error = outputs["r_gcrf_m"] - world.r_true_gcrf_m
    axis_m, radius_m = np.abs(error).max(axis=1), np.linalg.norm(error, axis=1)
    ratio = _ratio(axis_m, outputs["bound_m"], outputs["verdict"])
    ratio_3d = _ratio(radius_m, outputs["bound_3d_m"], outputs["verdict"])
    lost, regained = drawn.acquisition_s, drawn.acquisition_s + drawn.outage_s
    last = int(np.searchsorted(since_s, regained)) - 1
    started = bool(outputs["mode"][max(int(np.searchsorted(since_s, lost)) - 1, 0)] != Mode.INIT)
    found: Arrays = {
        "run": np.array(drawn.run),
        "cell": np.array(drawn.cell),
        "started": np.array(started),
        "acquisition_s": np.array(drawn.acquisition_s),
        "outage_s": np.array(drawn.outage_s),
        **{name: np.array(value) for name, value in drawn.drawn.items()},
    }
    t_fix_ns = outputs["t_gps_ns"][last] - np.nan_to_num(outputs["fix_age_s"][last]) * 1e9
    age = (outputs["t_gps_ns"] - t_fix_ns) / 1e9
    span = np.flatnonzero((age > 0.5) & (np.arange(len(age)) <= last) & started)
    found |= _first_outage(ages, age[span], error[span], axis_m[span], ratio[span], ratio_3d[span], outputs[span])
    outside = np.ones(len(since_s), bool)
    for o in world.scenario.outage:
        outside &= ~((since_s >= o.start_s) & (since_s < o.start_s + o.duration_s))
    integrated = outside & (since_s >= drawn.start_s + CONVERGED_S) & (outputs["mode"] == Mode.INTEGRATED)
    period_s = 2.0 * np.pi * np.sqrt(float(drawn.tree["orbit"]["semi_major_axis_m"]) ** 3 / MU_PAPER_M3PS2)
    before = np.flatnonzero(integrated & (since_s < lost))[-60:]
    returning = (since_s >= regained) & outside & ~integrated
    found |= {
        "orbits": np.array(integrated.sum() / period_s),
        "integrated_broken": np.array(int((ratio[integrated] > 1.0).sum())),
        "integrated_ratio": np.array(_largest(ratio[integrated])),
        "nees_before": np.array(_nees(error, world, outputs, before[::_NEES_STEP])),
        "sigma_before_m": np.array(
            np.sqrt(outputs["covariance"][before[-1], range(3), range(3)].max()) if len(before) else np.nan
        ),
        "drag_before": np.array(outputs["drag_scale"][span[0]] if len(span) else np.nan),
        "drag_after": np.array(outputs["drag_scale"][last]),
        "return_ratio": np.array(_largest(ratio[returning])),
    }
    second = np.zeros(len(since_s), bool)
    for o in world.scenario.outage[1:]:
        second |= (since_s >= o.start_s) & (since_s < o.start_s + o.duration_s)
    return found | {
        "second_ratio": np.array(_largest(ratio[second])),
        "second_violated": np.array(bool((ratio[second] > 1.0).any())),
    }


def _first_outage(
    ages: np.ndarray,
    age: np.ndarray,
    error: np.ndarray,
    axis_m: np.ndarray,
    ratio: np.ndarray,
    ratio_3d: np.ndarray,
    outputs: np.ndarray,
) -> Arrays:
    m = len(ages)
    found: Arrays = {
        "error_m": np.full((m, 3), np.nan),
        "sigma_m": np.full((m, 3), np.nan),
        "bound_m": np.full(m, np.nan),
        "bound_3d_m": np.full(m, np.nan),
    }
    flag_s = outputs["flag_age_s"]
    raised = np.isfinite(flag_s)
    flag_age = float(age[raised][0]) if raised.any() else np.nan
    broken = ratio > 1.0
    found |= {
        "epochs": np.array(len(age)),
        "broken_epochs": np.array(int(broken.sum())),
        "violated": np.array(bool(broken.any())),
        "violated_before_flag": np.array(bool((broken & ~raised).any())),
        "flag_age_s": np.array(flag_age),
        "crossing_error_s": np.array([_first(age, axis_m > limit) for limit in LIMITS_M]),
        "crossing_bound_s": np.array([_first(age, outputs["bound_m"] > limit) for limit in LIMITS_M]),
    }
    for name, values in (("worst", ratio), ("worst_3d", ratio_3d)):
        known = np.isfinite(values).any() or np.isinf(values).any()
        worst = int(np.nanargmax(values)) if known else 0
        found[f"{name}_ratio"] = np.array(values[worst] if known else np.nan)
        found[f"{name}_age_s"] = np.array(age[worst] if known else np.nan)
    if len(age):
        # ticks are a second apart: the one nearest an age is within half a second of it
        at = np.clip(np.searchsorted(age, ages - 0.5), 0, len(age) - 1)
        there = np.abs(age[at] - ages) < 0.75
        at = at[there]
        found["error_m"][there] = error[at]
        found["bound_m"][there] = outputs["bound_m"][at]
        found["bound_3d_m"][there] = outputs["bound_3d_m"][at]
        found["sigma_m"][there] = np.sqrt(np.einsum("nii->ni", outputs["covariance"][at][:, :3, :3]))
    return found


def _ratio(error_m: np.ndarray, bound_m: np.ndarray, verdict: np.ndarray) -> np.ndarray:
    """Error over bound (n,). Without a bound NaN, but infinite where the state is trusted all the same."""
    with np.errstate(invalid="ignore"):
        ratio = error_m / bound_m
    trusted = np.isin(verdict, (int(Verdict.TRUSTED), int(Verdict.TRUSTED_COASTING)))
    return np.where(np.isnan(ratio) & trusted, np.inf, ratio)


def _first(age: np.ndarray, beyond: np.ndarray) -> float:
    return float(age[np.argmax(beyond)]) if beyond.any() else float("nan")


def _largest(values: np.ndarray) -> float:
    return float(np.nanmax(values)) if np.any(~np.isnan(values)) else float("nan")


def _nees(error: np.ndarray, world: flown.World, outputs: np.ndarray, at: np.ndarray) -> float:
    """Mean e' P^-1 e of position and velocity at some ticks; 6 for a consistent filter."""
    if not len(at):
        return float("nan")
    e = np.hstack((error[at], outputs["v_gcrf_mps"][at] - world.v_true_gcrf_mps[at]))
    sigma = np.sqrt(np.einsum("nii->ni", outputs["covariance"][at]))
    # metres and metres per second are decades apart; scaled to correlations the system is well conditioned
    correlation = outputs["covariance"][at] / (sigma[:, :, None] * sigma[:, None, :])
    scaled = e / sigma
    return float(np.einsum("ni,ni->n", scaled, np.linalg.solve(correlation, scaled[..., None])[..., 0]).mean())


def forces_of(drawn: Draw) -> TableImage:
    """The force table of a run: weather of its day, the satellite as flight knows it."""
    noon = gps_of_day(drawn.weather.day) + NS_PER_DAY // 2
    reach = round(VALID_DAYS * NS_PER_DAY)
    return decode(
        build_forces(
            {
                "area_to_mass_m2pkg": drawn.area_to_mass_m2pkg,
                "f107": drawn.weather.f107,
                "f107_mean": drawn.weather.f107_mean,
                "ap": drawn.weather.ap,
                "valid_from_gps_ns": noon - reach,
                "valid_until_gps_ns": noon + reach,
            }
        )
    )


@lru_cache(maxsize=4)
def _navigation(flight: Flight) -> TableImage:
    return decode(flight.image())


@lru_cache(maxsize=512)
def _orientation(window: int) -> np.ndarray:
    """Earth orientation of a window of days and two more. Nodes lie on one grid: it matters not which window serves."""
    start = window * _ORIENTATION_DAYS * NS_PER_DAY
    return decode(build_earth_orientation(start - NS_PER_DAY, start + (_ORIENTATION_DAYS + 3) * NS_PER_DAY)).values


@lru_cache(maxsize=1)
def _field() -> TableImage:
    degree = int(decode(build_forces()).values["degree"][0])
    return decode(build_gravity_field(None, degree))
