"""The force model alone against real orbits: from published states, what it errs by after some time, and its cost."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from flightsw.kernels import force_model, spherical_harmonics
from flightsw.kernels.registry import F8, I8, VECTOR, entry, frozen_records, records
from flightsw.records import FIELD, FORCE_TABLE, FORCE_WORK, ORIENTATION
from ground.accuracy.flight_model import FlightModel
from ground.accuracy.orbits import ReferenceOrbit
from ground.errors import OperatorError
from ground.tables.gps_time import NS_PER_S
from hil_sim.truth.satkit_data import satkit_time, session

AGES_S = (900, 2000, 7200)
SPACING_S = 1000  # between starts, at least


class Errors(NamedTuple):
    """Errors after one time, the largest axis in GCRF [m] of every start, and who made them."""

    who: str
    age_s: int
    error_m: np.ndarray


def starts(orbit: ReferenceOrbit, age_s: int, at_most: int | None = None) -> list[int]:
    """Samples from which the orbit is known for `age_s` more, SPACING_S apart or a little more, none left out.

    at_most: evenly thinned to so many.
    """
    step = math.ceil(SPACING_S * NS_PER_S / orbit.track.step_ns)
    found = [
        k for k in range(0, len(orbit.t_gps_ns), step) if orbit.t_gps_ns[k] + age_s * NS_PER_S <= orbit.t_gps_ns[-1]
    ]
    if at_most is not None and len(found) > at_most:
        found = [found[i * len(found) // at_most] for i in range(at_most)]
    if not found:
        raise OperatorError(f"{orbit.name}: shorter than {age_s} s; name a longer orbit file")
    return found


def flight_errors(
    model: FlightModel, orbit: ReferenceOrbit, age_s: int, at_most: int | None = None
) -> tuple[Errors, float]:
    """What the flight model errs by after `age_s` from the published states, and its mean time for one [ms]."""
    chosen = starts(orbit, age_s, at_most)
    model.propagate(int(orbit.t_gps_ns[chosen[0]]), orbit.x[chosen[0]], NS_PER_S)  # compiles what is not compiled yet
    began = time.perf_counter()
    ends = [model.propagate(int(orbit.t_gps_ns[k]), orbit.x[k], age_s * NS_PER_S) for k in chosen]
    spent_ms = (time.perf_counter() - began) * 1e3 / len(chosen)
    return Errors("flight", age_s, _against(orbit, chosen, ends, age_s)), spent_ms


def peer_settings(satkit: Any, degree: int) -> Any:
    """How satkit propagates where it is a peer: EGM2008, as far as it goes."""
    return satkit.propsettings(
        abs_error=1e-8,
        rel_error=1e-10,
        gravity_degree=min(degree, 70),
        gravity_model=satkit.gravmodel.egm2008,
        enable_interp=False,
        require_eop_coverage=True,
    )


def satkit_errors(
    orbit: ReferenceOrbit, settings: Mapping[str, Any], degree: int, age_s: int, at_most: int
) -> tuple[Errors, float]:
    """The same with satkit's propagator and EGM2008, and its mean time for one propagation [ms]."""
    chosen = starts(orbit, age_s, at_most)
    first, last = int(orbit.t_gps_ns[chosen[0]]), int(orbit.t_gps_ns[chosen[-1]]) + age_s * NS_PER_S
    area = float(settings["area_to_mass_m2pkg"])
    with session(first, last) as satkit:
        model = peer_settings(satkit, degree)
        surface = satkit.satproperties(
            cdaoverm=area * float(settings["drag_coefficient"]),
            craoverm=area * float(settings["radiation_coefficient"]),
        )
        ends, began = [], time.perf_counter()
        for k in chosen:
            instant = satkit_time(satkit, int(orbit.t_gps_ns[k]))
            result = satkit.propagate(
                orbit.x[k], instant, duration_secs=float(age_s), propsettings=model, satproperties=surface
            )
            ends.append(np.array(result.state))
        spent_ms = (time.perf_counter() - began) * 1e3 / len(chosen)
    return Errors("satkit", age_s, _against(orbit, chosen, ends, age_s)), spent_ms


def _against(orbit: ReferenceOrbit, chosen: list[int], ends: list[np.ndarray], age_s: int) -> np.ndarray:
    r, _ = orbit.track.evaluate(orbit.t_gps_ns[chosen] + age_s * NS_PER_S)
    return np.abs(np.array(ends)[:, :3] - r).max(axis=1)


@entry(
    frozen_records(FORCE_TABLE), frozen_records(FIELD), frozen_records(ORIENTATION), I8, VECTOR, VECTOR, VECTOR,
    records(FORCE_WORK), I8, I8, F8,
)  # fmt: skip
def _repeat(forces, field, eop, t_gps_ns, r, v, out, work, what, count, drag_scale):
    """Do one thing many times, each a little elsewhere, and return a number that depends on all of them."""
    total = 0.0
    nothing = work[0].gradient_itrf[0]
    nothing[:] = 0.0
    for k in range(count):
        r[0] += 1e-3
        if what == 0:
            force_model.prepare(forces[0], field[0], eop[0], t_gps_ns + k, work[0])
        elif what == 1:
            force_model.turn(eop[0], t_gps_ns + k, work[0])
        elif what == 2:
            force_model.evaluate(forces[0], field[0], r, v, drag_scale, nothing, work[0], out)
        else:
            spherical_harmonics.acceleration(field[0], r, work[0], out)
        total += out[0] + work[0].itrf_from_gcrf[0, 0] + work[0].sun_m[0]
    return total


def costs_us(model: FlightModel, t_gps_ns: int, x: np.ndarray, count: int = 2000, rounds: int = 7) -> dict[str, float]:
    """Time of the parts [us], the least of some rounds: what the machine does when left alone."""
    parts = {"Sun, Moon, tide (once a step)": 0, "Earth rotation": 1, "forces, all": 2, "of these harmonics": 3}
    found = {}
    for name, what in parts.items():
        best = math.inf
        for _ in range(rounds + 1):
            r, v, out = x[:3].copy(), x[3:6].copy(), np.zeros(3)
            began = time.perf_counter()
            _repeat(model.forces, model.field, model.orientation, t_gps_ns, r, v, out, model.work, what, count, 1.0)
            best = min(best, time.perf_counter() - began)
        found[name] = best / count * 1e6
    return found
