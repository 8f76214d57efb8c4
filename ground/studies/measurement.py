"""Everything the ledger judges by, measured in one go: flights and figures, in parallel where they take time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from flightsw.icd.table_file import decode
from ground.studies import fix_ratio, model_limits, orbit_limits
from ground.studies.fix_ratio import Case, Ratio
from ground.studies.flights import Advance, each, pool, progress_bar
from ground.studies.orbit_limits import AccelerationCorrection, Coordinates, Dip, Orbit
from ground.studies.outage import OutageRun, Variant, fly_variant, variants
from ground.tables.build import build_navigation
from ground.tuning import paper
from ground.tuning.paper_result import Result

_WEAK = 1e12  # a pseudo-measurement that weighs nothing: (17) becomes (11)
_J2_SIGMA_M = 33.0


@dataclass(frozen=True)
class Effort:
    """How much is flown: runs of the paper's outage and of its variations, fix noises, grids thinned or whole."""

    runs: int = 20
    fresh_runs: int = 60
    side_runs: int = 10
    sigmas_m: tuple[float, ...] = fix_ratio.FIX_SIGMAS_M
    thin: bool = False
    tuning_phases: int = 64


@dataclass(frozen=True)
class Measured:
    """Results, by study. Lists of runs are over seeds and start phases."""

    paper_1m: list[OutageRun]
    paper_33m: list[OutageRun]
    fresh: list[OutageRun]  # 1 m fixes, seeds and phases that nothing else here has
    table_1: list[OutageRun]
    plain: list[OutageRun]
    j2_paper_orbit: list[OutageRun]
    j2_outage: list[OutageRun]
    tuning: Result  # 1 m fixes
    ratios: list[Ratio]
    ratio_rk4: Ratio
    ratio_j2_421_km: Ratio
    ratio_j2_1336_km: Ratio
    dips: list[Dip]
    correction_euler: AccelerationCorrection
    correction_rk4: AccelerationCorrection
    coordinates: Coordinates
    euler_900_s_m: float
    rk4_900_s_m: float
    rk4_10_s_900_s_m: float
    coverage: float
    factor_axis: float
    factor_radius: float


def plain_propagation_settings() -> tuple[str, ...]:
    """Settings under which the bound of an outage is (11) with the Q of Table 1's integrated row."""
    row = decode(build_navigation("paper_table1")).values[0]
    cells = {f"bound_{q}": float(row[f"tuning_{q}"][0]) for q in ("q_r_m2", "q_v_m2ps2", "q_a_m2ps4")}
    cells |= {"bound_s_r_m": _WEAK, "bound_s_v_mps": _WEAK}
    table = ", ".join(f'"tuning.0.{key}" = {value!r}' for key, value in cells.items())
    return "flight.table_set=paper_table1", f"flight.table={{{table}}}"


def outage_variants(effort: Effort) -> dict[str, list[Variant]]:
    """What is flown through an outage, by the name it has in `Measured`."""
    n, m = effort.runs, effort.side_runs
    return {
        "paper_1m": variants("paper_outage", n, ["gnss.sigma_position_m=1.0"]),
        "paper_33m": variants("paper_outage", n, ["gnss.sigma_position_m=33.0"]),
        "fresh": variants("paper_outage", effort.fresh_runs, ["gnss.sigma_position_m=1.0"], 1001, 1.7),
        "table_1": variants("paper_outage", m, ["flight.table_set=paper_table1"]),
        "plain": variants("paper_outage", m, plain_propagation_settings()),
        "j2_paper_orbit": variants(
            "paper_outage", m, ["flight.table_set=j2", f"gnss.sigma_position_m={_J2_SIGMA_M!r}"]
        ),
        "j2_outage": variants("j2_outage", m),
    }


def ratio_cases(effort: Effort) -> list[Case]:
    """The grids: the paper's model at every noise, then with RK4, then J2 on two orbits."""
    cases = [
        *fix_ratio.paper_cases(effort.sigmas_m),
        Case(_J2_SIGMA_M, "paper", "RK4", fix_ratio.paper_grid()),
    ]
    if effort.thin:
        cases = [fix_ratio.thinned(case) for case in cases]
    return [
        *cases,
        Case(_J2_SIGMA_M, "j2", "RK4", fix_ratio.j2_grid()),
        Case(_J2_SIGMA_M, "j2", "RK4", fix_ratio.j2_grid(), period_s=6743.0),
    ]


def dip_places(effort: Effort) -> list[tuple[Orbit, float]]:
    """Orbits and phases at which the dip of the bound is looked for."""
    orbits = (Orbit("paper_outage", 65.0, 5580), Orbit("j2_outage", 66.04, 6743))
    step = 60.0 if effort.thin else 30.0
    return [(orbit, phase * step) for orbit in orbits for phase in range(int(180.0 / step))]


def _dip(place: tuple[Orbit, float]) -> Dip:
    return orbit_limits.bound_dip(*place)


@contextmanager
def _unseen(label: str, total: int) -> Iterator[Callable[[int], None]]:
    """No bar within a bar."""
    del label, total
    yield lambda done: None


def measure(effort: Effort = Effort(), jobs: int = 1, advance: Advance | None = None) -> Measured:
    """Fly and measure everything. Without `advance` a bar is shown on stderr."""
    flights, cases, places = outage_variants(effort), ratio_cases(effort), dip_places(effort)
    chosen = [variant for group in flights.values() for variant in group]
    total = len(chosen) + len(cases) + len(places) + 1
    if advance is None:
        with progress_bar("flying the paper", total) as step:
            return measure(effort, jobs, step)
    with pool(jobs) as workers:
        runs = each(workers, fly_variant, chosen, advance)
        ratios = each(workers, fix_ratio.measure_case, cases, advance)
        dips = each(workers, _dip, places, advance)
        euler = orbit_limits.acceleration_correction("Euler")
        rk4 = orbit_limits.acceleration_correction("RK4")
    tuning = paper.measure("paper", 1.0, effort.tuning_phases, 1, _unseen)
    advance()
    by_name: dict[str, Any] = {}
    for name, group in flights.items():
        by_name[name], runs = runs[: len(group)], runs[len(group) :]
    return Measured(
        **by_name,
        tuning=tuning,
        ratios=ratios[:-3],
        ratio_rk4=ratios[-3],
        ratio_j2_421_km=ratios[-2],
        ratio_j2_1336_km=ratios[-1],
        dips=dips,
        correction_euler=euler,
        correction_rk4=rk4,
        coordinates=orbit_limits.coordinates(),
        euler_900_s_m=model_limits.two_body_error_m("Euler", 1.0, 900.0),
        rk4_900_s_m=model_limits.two_body_error_m("RK4", 1.0, 900.0),
        rk4_10_s_900_s_m=model_limits.two_body_error_m("RK4", 10.0, 900.0),
        coverage=model_limits.coverage_of_worst_axis(3.0),
        factor_axis=model_limits.factor_for_worst_axis(),
        factor_radius=model_limits.factor_for_radius(),
    )
