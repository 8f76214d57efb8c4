"""The paper's own tuning: coordinate descent on (17) with (22) and (23), for one outage and for all start phases.

One outage is solved exactly and by frequency, for the comparison with Table 1 and figure 5. What goes into the set is
one row for all start phases, tried on phases and noise that it was not made from.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.table_file import decode
from ground.errors import OperatorError
from ground.tables.build import build_navigation
from ground.tuning import paper_report
from ground.tuning.method import Bar, Effort, Tuned
from ground.tuning.outages import Plan, fly
from ground.tuning.paper_result import TABLE_1, Common, Result, Single
from ground.tuning.paper_search import ROUNDS, Problem, common_row, refusals, solve
from ground.tuning.recursion import PARAMETERS

PHASES, QUICK_PHASES = 64, 16
FREQUENCY = 0.003  # of epochs at which the statistical variant may break (22): the paper's 0.997
SIGMAS_M = (1.0, 33.0)  # of the fixes, with 1 m/s: those that the ledger flies
# Added to the seed, with the first start phase as share of the step between them. Others to hold on, with noise of
# their own, and those that nothing was made from.
_OTHERS = ((2_000_003, 0.0), (3_000_017, 0.25), (4_000_037, 0.75))
_HELD_OUT = (1_000_003, 0.5)


class Paper:
    """See the module."""

    help = "the paper's: (17) by coordinate descent, (22), (23), over all start phases"
    usual_set = "paper"

    def tune(self, table_set: str, folder: Path, effort: Effort, bar: Bar) -> Tuned:
        """Fly, search, try on unseen phases. Raises OperatorError where (17) cannot cover the errors."""
        phases = effort.runs or (QUICK_PHASES if effort.quick else PHASES)
        results = [
            measure(table_set, sigma_m, phases, effort.seed, bar, folder)
            for sigma_m in (SIGMAS_M[:1] if effort.quick else SIGMAS_M)
        ]
        changes = {
            f"tuning.{one.flown.row}.bound_{name}": float(f"{value:.4g}")
            for one in results
            for name, value in zip(PARAMETERS, one.common.found.row, strict=True)
        }
        if len({one.flown.row for one in results}) != len(results):
            raise OperatorError(
                f"--set {table_set}: fixes of different quality meet the same row; give it one for each"
            )
        broken = sum(int(np.sum(one.common.worst_unseen > 1.0)) for one in results)
        summary = (
            f"{phases} start phases, as many unseen: (22) broken in {broken} of {phases * len(results)} unseen; "
            + "; ".join(
                f"{one.sigma_m:g} m: T_flag / T {np.nanmedian(one.common.share_unseen):.2f} in the median"
                for one in results
            )
        )
        return Tuned(
            changes,
            summary,
            {"method": "paper", "phases": phases, "seed": effort.seed, "fixes": [document(one) for one in results]},
            paper_report.lines(results),
            paper_report.drawings(results),
        )


def measure(table_set: str, sigma_m: float, phases: int, seed: int, bar: Bar, folder: Path | None = None) -> Result:
    """Tune with fixes of one quality. Raises OperatorError."""
    values = decode(build_navigation(table_set)).values
    limit_m = float(values["limit_m"][0])
    with bar(f"flying outages, fixes of {sigma_m:g} m", (2 + len(_OTHERS)) * phases) as advance:
        seen, unseen, *others = (
            fly(Plan(table_set, sigma_m, phases, seed + added, share * 360.0 / phases), folder, advance)
            for added, share in ((0, 0.0), _HELD_OUT, *_OTHERS)
        )
    problem = Problem.of(seen.outages, limit_m, values, seen.row)
    held_out = Problem.of(unseen.outages, limit_m, values, unseen.row)
    try:
        with bar(f"searching, fixes of {sigma_m:g} m", 2 + ROUNDS) as advance:
            one = problem.part(np.flatnonzero(problem.reached)[:1])
            phase = float(seen.plan.phase_deg[np.flatnonzero(problem.reached)[:1]][0])
            exact = _single(one, phase, 0.0)
            advance(1)
            statistical = _single(one, phase, FREQUENCY)
            advance(1)
            beside = [Problem.of(one.outages, limit_m, values, one.row) for one in others]
            margin, found = common_row(problem, beside, advance)
    except (ValueError, IndexError) as error:
        raise OperatorError(
            f"--set {table_set}, fixes of {sigma_m:g} m: {error or 'no error reaches the limit'}"
        ) from error
    common = Common(found, margin, *_judged(problem, found.row), *_judged(held_out, found.row))
    return Result(sigma_m, seen, problem, exact, statistical, common, refusals(values, seen.row, TABLE_1))


def _single(problem: Problem, phase_deg: float, frequency: float) -> Single:
    found = solve(problem, frequency=frequency)
    done = problem.carry(found.row, allowed=len(problem.outages.error_m))
    flag_s = float(done.flag_s[0]) if done.flag_s[0] == done.flag_s[0] else float(problem.last[0])
    return Single(phase_deg, float(problem.last[0]) * problem.outages.dt_s, found, flag_s, int(done.broken[0]))


def _judged(problem: Problem, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """T_flag / T and worst error / bound before T (L,)."""
    done = problem.carry(row, allowed=len(problem.outages.error_m))
    t_s = problem.last * problem.outages.dt_s
    return np.where(problem.reached, np.where(np.isnan(done.flag_s), t_s, done.flag_s) / t_s, np.nan), done.worst


def document(one: Result) -> dict[str, Any]:
    """Plain values for tuning.json."""

    def named(row: Iterable[float]) -> dict[str, float]:
        return dict(zip(PARAMETERS, map(float, row), strict=True))

    def single(what: Single) -> dict[str, Any]:
        return {
            "phase_deg": what.phase_deg,
            "t_s": what.t_s,
            "row": named(what.found.row),
            "bound_at_t_m": what.found.trial.at_t_m,
            "exact": what.found.exact,
            "flag_s": what.flag_s,
            "broken_epochs": what.broken,
            "rows_tried": what.found.tried,
            "ladder": [{"sought_m": r.sought_m, "found_m": r.found_m, **named(r.row)} for r in what.found.ladder],
        }

    return {
        "sigma_m": one.sigma_m,
        "table_row": one.flown.row,
        "exact": single(one.exact),
        "statistical": single(one.statistical),
        "common": {
            "row": named(one.common.found.row),
            "margin": one.common.margin,
            "rows_tried": one.common.found.tried,
            "phases": spread(one.common.share, one.common.worst),
            "unseen_phases": spread(one.common.share_unseen, one.common.worst_unseen),
        },
        "table_1": {"row": named(TABLE_1), "refused": one.table_1},
    }


def spread(share: np.ndarray, worst: np.ndarray) -> dict[str, Any]:
    """Figures of a row on many outages."""
    known = share[np.isfinite(share)]
    return {
        "outages": len(worst),
        "broken": int(np.sum(~(worst <= 1.0))),
        "worst_error_to_bound": float(worst.max()),
        "reached": len(known),
        "t_flag_over_t": {"min": float(known.min()), "median": float(np.median(known)), "max": float(known.max())},
    }
