"""How much better than the fix the filter can be: the best of a grid of tunings, by the position noise of the fixes.

Measured as the paper's (13) is: at the fixes themselves, right after their correction. The published state, carried
on from there for up to a fix period, is worse with this model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from ground.studies.flights import COARSE_TICK_NS, Prepared, prepare

FIX_SIGMAS_M = (1.0, 3.0, 10.0, 33.0, 100.0, 300.0, 1000.0, 3000.0)  # with 1 m/s of velocity noise
SETTLED_S = 1200.0
# Of the q in m2, m2/s2, m2/s4 per 1 s step and of the sigma that the filter gives velocities [m/s]. A finer
# grid gains less than a tenth.
Q_R_M2 = (0.0, 1.0)
Q_V_M2PS2 = (1e-6, 1e-3)
Q_A_M2PS4 = (1e-8, 3e-8, 1e-7, 3e-7, 1e-6)
SIGMA_V_MPS = (1.0, 5.0, 20.0, 100.0)
# J2 and RK4 leave a hundredth of the acceleration to dA.
J2_Q_V_M2PS2 = (1e-7, 1e-6, 1e-5)
J2_Q_A_M2PS4 = (1e-13, 1e-12, 1e-11, 1e-10)

_SCENARIO = "paper_outage"
_SETTINGS = (
    "outage=[]",
    "orbit.argument_of_latitude_deg=40.0",
    # A tick falls a few microseconds after each fix, and the fix is there: what is published is its correction.
    "gnss.latency_s=0.0",
    "oscillator.drift_ppm=-1.0",
)
_WEAK = 1e12  # of what the study does not use


class Tuning(NamedTuple):
    """What a tuning row says about integrated flight."""

    q_r_m2: float
    q_v_m2ps2: float
    q_a_m2ps4: float
    sigma_v_mps: float


TABLE_1 = Tuning(1.0, 0.01, 1e-6, 1.0)  # the paper's integrated row; its sigma_R is that of the fix


class Case(NamedTuple):
    """Fixes of one noise, flown with one onboard model over one grid of tunings."""

    sigma_m: float
    table_set: str
    integrator: str
    grid: tuple[Tuning, ...]
    period_s: float = 5580.0


class Ratio(NamedTuple):
    """Fix error over integrated error, rms of the largest axis: for the paper's row, and for the best of the grid."""

    sigma_m: float
    fix_rms_m: float
    table_1: float
    best: float
    tuning: Tuning


def paper_grid() -> tuple[Tuning, ...]:
    """Tunings tried for the paper's model."""
    return tuple(Tuning(*row) for row in product(Q_R_M2, Q_V_M2PS2, Q_A_M2PS4, SIGMA_V_MPS))


def thinned(case: Case) -> Case:
    """The case with the corners of its grid left out where the best never was: a fast look at the same ratio."""
    return case._replace(grid=tuple(t for t in case.grid if not t.q_r_m2 and 1e-8 < t.q_a_m2ps4 < 1e-6))


def j2_grid() -> tuple[Tuning, ...]:
    """Tunings tried for J2 and RK4."""
    return tuple(Tuning(0.0, q_v, q_a, 1.0) for q_v, q_a in product(J2_Q_V_M2PS2, J2_Q_A_M2PS4))


def paper_cases(sigmas_m: Sequence[float] = FIX_SIGMAS_M) -> list[Case]:
    """The paper's model, one case for each noise."""
    return [Case(sigma_m, "paper", "Euler", paper_grid()) for sigma_m in sigmas_m]


def measure_case(case: Case) -> Ratio:
    """One orbit of fixes, flown once with each tuning of the grid."""
    prepared = prepare(
        _SCENARIO,
        (
            *_SETTINGS,
            f"gnss.sigma_position_m={case.sigma_m!r}",
            f"orbit.period_s={case.period_s!r}",
            f"time.duration_s={case.period_s!r}",
            f"flight.table_set={case.table_set}",
        ),
        COARSE_TICK_NS,
    )
    fix_error_m = np.abs(prepared.world.truth_arrays()["fix_error_m"]).max(axis=1)
    fix_rms_m = float(np.sqrt(np.mean(fix_error_m**2)))
    errors = [(_integrated_rms_m(prepared, case, tuning), tuning) for tuning in case.grid]
    best_m, tuning = min(errors)
    return Ratio(
        case.sigma_m, fix_rms_m, fix_rms_m / _integrated_rms_m(prepared, case, TABLE_1), fix_rms_m / best_m, tuning
    )


def _integrated_rms_m(prepared: Prepared, case: Case, tuning: Tuning) -> float:
    outputs, _ = prepared.fly(prepared.table(_overrides(case, tuning)))
    error_m = prepared.error_m(outputs)[prepared.age_s >= SETTLED_S]
    return float(np.sqrt(np.mean(error_m**2)))


def _overrides(case: Case, tuning: Tuning) -> dict[str, Any]:
    row = {
        "sigma_fix_m": 1e6,
        "q_r_m2": tuning.q_r_m2,
        "q_v_m2ps2": tuning.q_v_m2ps2,
        "q_a_m2ps4": tuning.q_a_m2ps4,
        "sigma_r_floor_m": case.sigma_m,
        "sigma_v_floor_mps": tuning.sigma_v_mps,
        "bound_q_r_m2": 0.0,
        "bound_q_v_m2ps2": 0.0,
        "bound_q_a_m2ps4": 0.0,
        "bound_s_r_m": _WEAK,
        "bound_s_v_mps": _WEAK,
    }
    # a wide gate: it is the model that is judged, not what rejects its fixes
    return {"tuning": [row], "integrator": case.integrator, "gate_nis": 1e9, "sigma_r_max_m": 1e6}


def noise_for_ratio(ratios: Sequence[Ratio], wanted: float) -> float | None:
    """Fix noise [m] from which on the best ratio reaches `wanted`, by log interpolation; None if none measured does."""
    for low, high in pairwise(sorted(ratios)):
        if low.best < wanted <= high.best:
            share = math.log(wanted / low.best) / math.log(high.best / low.best)
            return low.sigma_m * (high.sigma_m / low.sigma_m) ** share
    return None
