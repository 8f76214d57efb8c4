"""Outages of the paper's filter, flown once: what candidates for (17) are tried on.

All share one true motion, that of scenario `paper_outage`; they differ in where on the orbit GNSS is lost and in the
noise of their fixes. One revolution of fixes a second comes before, as in the paper. What flies is the navigation step.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_file import TableImage, decode
from flightsw.kernels.integrators import RK4
from flightsw.kernels.registry import warm_up
from flightsw.memory import Memory
from ground.campaign import arc
from ground.errors import OperatorError
from ground.studies.arcs import Errors, Motion, Receiver, Track, blank, counter_of, measured, stream
from ground.studies.flights import HOUR_NS, NS, true_motion
from ground.tables.build import build_navigation
from ground.tables.earth_orientation import build_earth_orientation
from ground.tuning.recursion import Outages
from hil_sim.truth.earth_rotation import EarthOrientation

SCENARIO = "paper_outage"
PERIOD_S = 5580
_STREAM = 4_021  # of the noises of this module
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

Advance = Callable[[int], None]


@dataclass(frozen=True)
class Plan:
    """Which outages: fixes of this 1-sigma [m] and [m/s], so many start phases evenly over the orbit from `first_deg`
    on, for so long; seed of their noise."""

    table_set: str
    sigma_m: float
    phases: int
    seed: int
    first_deg: float = 0.0
    sigma_mps: float = 1.0
    outage_s: int = 2000

    @property
    def phase_deg(self) -> np.ndarray:
        """Argument of latitude of the truth's start plus the way along the orbit to the start of fixes (n,) [deg]."""
        return self.first_deg + 360.0 * np.arange(self.phases) / self.phases


class Flown(NamedTuple):
    """Outages for tuning, beside them the errors by axis (N + 1, L, 3) [m], GCRF, the bound that flight published with
    the set as it was (N + 1, L) [m], which serves the interval that follows, and the tuning row in force."""

    plan: Plan
    outages: Outages
    error_xyz_m: np.ndarray
    published_m: np.ndarray
    row: int


@lru_cache(maxsize=2)
def _sky(seconds: int) -> tuple[Motion, TableImage]:
    settings = ("outage=[]", f"time.duration_s={float(seconds)!r}")
    truth, t0 = true_motion(SCENARIO, settings)
    assert t0 % NS == 0
    t = t0 + np.arange(seconds + 1, dtype=np.int64) * NS
    r, v = truth.state_gcrf(t)
    matrices, spin = EarthOrientation(int(t[0]), int(t[-1])).rotations(t)
    return Motion(t, r, v, matrices, spin), decode(build_earth_orientation(t0 - HOUR_NS, int(t[-1]) + HOUR_NS))


def fly(plan: Plan, folder: Path | None = None, advance: Advance = lambda n: None) -> Flown:
    """Fly a plan; with a folder, what it holds of this plan is not flown again. advance: told how many phases are done.

    Raises OperatorError where the table flies another filter.
    """
    image = decode(build_navigation(plan.table_set))
    kept = folder / _name(plan, image.crc32) if folder is not None else None
    if kept is not None and kept.exists():
        advance(plan.phases)
        with np.load(kept) as file:
            held = {name: file[name] for name in file.files}
    else:
        held = _fly_all(plan, image, advance)
        if kept is not None:
            partial = kept.with_suffix(f".{os.getpid()}.partial")
            with partial.open("wb") as stream_out:
                np.savez(stream_out, **held)  # type: ignore[arg-type]
            partial.replace(kept)
    values = image.values
    outages = Outages(
        held["p0"],
        held["gradient_ps2"],
        np.abs(held["error_xyz_m"]).max(axis=2),
        float(values["nav_step_ns"][0]) * 1e-9,
        int(values["integrator"][0]) == RK4,
        float(values["k_axis"][0]),
    )
    return Flown(plan, outages, held["error_xyz_m"], held["published_m"], int(held["row"]))


def _name(plan: Plan, crc32: int) -> str:
    return (
        f"outages-{crc32:08x}-{plan.sigma_m:g}m-{plan.sigma_mps:g}mps-{plan.phases}x{plan.outage_s}s-"
        f"{plan.first_deg:g}deg-{plan.seed}.npz"
    )


def _fly_all(plan: Plan, image: TableImage, advance: Advance) -> dict[str, np.ndarray]:
    if int(image.values["filter_model"][0]) != 0:
        raise OperatorError(f"--set {plan.table_set}: has no (17); only sets of the paper's filter are tuned this way")
    if int(image.values["nav_step_ns"][0]) != NS:
        raise OperatorError(f"--set {plan.table_set}: loop.nav_step_ns must be a second, the step of the paper")
    warm_up()
    n = plan.outage_s
    sky, orientation = _sky(2 * PERIOD_S + n + 10)
    p0, gradient = np.empty((plan.phases, 9, 9)), np.empty((n, 6, plan.phases))
    error, published = np.empty((n + 1, plan.phases, 3)), np.empty((n + 1, plan.phases))
    rows = set()
    for lane, phase in enumerate(plan.phase_deg):
        first = round(PERIOD_S * float(phase) / 360.0) % PERIOD_S
        noise = stream(_STREAM, plan.seed, round(1e3 * plan.sigma_m), lane)
        memory = Memory()
        memory.load(image.values, orientation.values)
        track = Track.of(sky, first, PERIOD_S + n)
        counter_ns = counter_of(memory, PERIOD_S + n, noise)
        receiver = Receiver(plan.sigma_m, plan.sigma_mps)
        fixes = measured(sky, track.part(0, PERIOD_S), receiver, counter_ns[:PERIOD_S], noise)
        outputs = [arc.fly(memory, fixes)[-1:]]
        nav = memory.nav[0]
        if not nav["initialised"] or nav["t_fix_gps_ns"] != nav["t_gps_ns"]:
            raise OperatorError(f"--set {plan.table_set}: the last fix at phase {phase:.1f} deg was not accepted")
        p0[lane] = nav["P_bound"]
        rows.add(int(nav["row"]))
        coast = blank(counter_ns[PERIOD_S:])
        for epoch in range(n):
            gradient[epoch, :, lane] = [nav["gradient_ps2"][i, j] for i, j in _UPPER]
            outputs.append(arc.fly(memory, coast[epoch : epoch + 1]))
        flown = np.concatenate(outputs)
        error[:, lane] = Errors.of(track.part(PERIOD_S - 1), flown).r_m
        published[:, lane] = flown["bound_m"]
        advance(1)
    if len(rows) != 1:
        raise OperatorError(f"--set {plan.table_set}: fixes of {plan.sigma_m:g} m meet different rows {sorted(rows)}")
    return {
        "p0": p0,
        "gradient_ps2": gradient,
        "error_xyz_m": error,
        "published_m": published,
        "row": np.array(rows.pop()),
    }
