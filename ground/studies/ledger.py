"""The reproduction ledger: what the paper says, what this product measured, and the test that holds each line.

A row judges itself: when the measurements no longer bear its verdict, the ledger is not written.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from typing import NamedTuple

from ground.studies.fix_ratio import noise_for_ratio
from ground.studies.measurement import Measured
from ground.studies.outage import OutageRun, Spread
from ground.tuning.paper_result import Result

REPRODUCED, QUALIFIED, CONTRADICTED = "REPRODUCED", "QUALIFIED", "CONTRADICTED"
VERDICTS = (REPRODUCED, QUALIFIED, CONTRADICTED)
LIMIT_M = 2000.0

_PAPER = "tests/scenario/test_paper_reproduction.py"
_LIMITS = "tests/unit/test_study_limits.py"


class Row(NamedTuple):
    """One claim. `ours` puts the measurement in words, `holds` says whether it bears the verdict."""

    claim: str
    where: str
    paper: str
    ours: Callable[[Measured], str]
    verdict: str
    holds: Callable[[Measured], bool]
    test: str  # file::function


def of(runs: list[OutageRun], key: str) -> Spread:
    """Spread of one figure over runs."""
    return Spread.of(getattr(run, key) for run in runs)


def middle(runs: list[OutageRun], key: str) -> float:
    """Median of a figure over the runs in which it was reached; NaN where it never was."""
    value = of(runs, key).median
    return float("nan") if value is None else value


def largest(runs: list[OutageRun], key: str) -> float:
    """Largest value of a figure over the runs in which it was reached; NaN where it never was."""
    value = of(runs, key).largest
    return float("nan") if value is None else value


def least(runs: list[OutageRun], key: str) -> float:
    """Least value of a figure over the runs in which it was reached; NaN where it never was."""
    value = of(runs, key).least
    return float("nan") if value is None else value


def _range(runs: list[OutageRun], key: str, digits: int = 0) -> str:
    return f"{least(runs, key):.{digits}f} to {largest(runs, key):.{digits}f}"


def _best_up_to_100_m(m: Measured) -> float:
    return max(ratio.best for ratio in m.ratios if ratio.sigma_m <= 100.0)


def _ratios(m: Measured) -> str:
    listed = ", ".join(f"{ratio.best:.1f} ({ratio.sigma_m:g} m)" for ratio in m.ratios)
    noise_m = noise_for_ratio(m.ratios, 10.0)
    where = (
        f"10 holds from about {100.0 * round(noise_m / 100.0):.0f} m on" if noise_m is not None else "10 is not reached"
    )
    at_100 = next(ratio for ratio in m.ratios if ratio.sigma_m == 100.0)
    return (
        f"best of a grid of Q and sigma_V: {listed}; {where}. Table 1's row itself: {at_100.table_1:.1f} at 100 m. "
        f"At 33 m the same gravity with RK4 gives {m.ratio_rk4.best:.1f}"
    )


def _no_violation(runs: list[OutageRun]) -> bool:
    return all(run.violations == 0 and run.flag_in_time for run in runs)


ROWS: tuple[Row, ...] = (
    Row(
        "Coordinates repeat with the orbital period",
        "figure 1",
        "period 5580 s",
        lambda m: (
            f"Keplerian period 5580 s; from node to node {m.coordinates.nodal_period_s:.0f} s, because the Earth "
            f"is oblate; largest coordinate {m.coordinates.largest_km:.0f} km"
        ),
        REPRODUCED,
        lambda m: abs(m.coordinates.nodal_period_s - 5580.0) < 15.0,
        f"{_PAPER}::test_coordinates_repeat_with_the_period",
    ),
    Row(
        "Integrated mode with Table 1's row stays within its own three sigmas",
        "figure 2, table 1",
        "good agreement",
        lambda m: (
            f"1 m fixes: rms {middle(m.table_1, 'integrated_rms_m'):.1f} m published, within the bound in "
            f"{100.0 * least(m.table_1, 'covered'):.1f} % of ticks or more"
        ),
        REPRODUCED,
        lambda m: least(m.table_1, "covered") > 0.99 and largest(m.table_1, "integrated_rms_m") < 3.0,
        f"{_PAPER}::test_integrated_mode_stays_within_three_sigmas",
    ),
    Row(
        "Integrated position is ten times better than the fix, for fixes of up to 100 m",
        "figure 2 and text below figure 3",
        "10",
        _ratios,
        CONTRADICTED,
        lambda m: _best_up_to_100_m(m) < 7.0 and max(ratio.table_1 for ratio in m.ratios[:-1]) < 2.0,
        f"{_PAPER}::test_ten_times_better_than_the_fix_does_not_hold",
    ),
    Row(
        "dA is nearly the same on neighbouring revolutions, so it can be stored and flown",
        "figure 3",
        "period 5580 s",
        lambda m: f"correlation of true dA with itself a revolution later {m.correction_euler.neighbours:.4f}",
        REPRODUCED,
        lambda m: m.correction_euler.neighbours > 0.99,
        f"{_PAPER}::test_da_repeats_on_the_next_revolution",
    ),
    Row(
        "The filter's dA is adequate to the true one",
        "figure 3",
        "adequate",
        lambda m: (
            f"correlation {m.correction_euler.estimate:.2f}; off by {1e3 * m.correction_euler.error_rms_mps2:.1f} of "
            f"{1e3 * m.correction_euler.true_rms_mps2:.1f} mm/s2 rms: it also makes up for Euler, and with Table 1's "
            f"Q it trails by some {m.correction_rk4.lag_s} s. With RK4 and the lag taken out: "
            f"{m.correction_rk4.estimate_later:.3f}"
        ),
        QUALIFIED,
        lambda m: m.correction_euler.estimate < 0.9 and m.correction_rk4.estimate_later > 0.99,
        f"{_PAPER}::test_estimated_da_carries_the_error_of_euler",
    ),
    Row(
        "Without fixes the error passes 2000 m after about 900 s",
        "figures 4, 5",
        "about 900 s",
        lambda m: (
            f"of that order: median {middle(m.paper_1m, 'crossed_age_s'):.0f} s "
            f"({_range(m.paper_1m, 'crossed_age_s')} s) with 1 m fixes, {middle(m.paper_33m, 'crossed_age_s'):.0f} s "
            f"({_range(m.paper_33m, 'crossed_age_s')} s) with 33 m, over {len(m.paper_1m)} start phases each"
        ),
        REPRODUCED,
        lambda m: all(450.0 <= middle(runs, "crossed_age_s") <= 1300.0 for runs in (m.paper_1m, m.paper_33m)),
        f"{_PAPER}::test_error_passes_the_limit_after_some_900_s",
    ),
    Row(
        "The error of an outage grows monotonically, so (18) has one root",
        "below (19)",
        "monotonic",
        lambda m: (
            f"falls back by at most {100.0 * largest(m.paper_1m, 'error_dip'):.1f} % (1 m fixes) and "
            f"{100.0 * largest(m.paper_33m, 'error_dip'):.0f} % (33 m) of what it had reached"
        ),
        QUALIFIED,
        lambda m: 0.0 < largest(m.paper_1m, "error_dip") < 0.05 < largest(m.paper_33m, "error_dip") < 0.5,
        f"{_PAPER}::test_the_error_of_an_outage_all_but_grows",
    ),
    Row(
        "When fixes return the correction converges again",
        "figure 4",
        "yes",
        lambda m: (
            f"back in service {largest(m.paper_1m + m.paper_33m, 'back_in_service_s'):.0f} s after GNSS returns, in "
            f"every run: 30 accepted fixes, which is what the flag waits for"
        ),
        REPRODUCED,
        lambda m: all(run.back_in_service_s is not None for run in m.paper_1m + m.paper_33m),
        f"{_PAPER}::test_back_in_service_after_the_outage",
    ),
    Row(
        "Plain propagation (11) grows far faster than the error",
        "above (17)",
        "much faster",
        lambda m: (
            f"three sigmas reach 2000 m after {middle(m.plain, 'flag_age_s'):.0f} s, the error after "
            f"{middle(m.plain, 'crossed_age_s'):.0f} s. Yet early on it is too small: "
            f"broken in {_broken(m.plain)}"
        ),
        REPRODUCED,
        lambda m: middle(m.plain, "flag_age_s") < 0.6 * middle(m.plain, "crossed_age_s"),
        f"{_PAPER}::test_plain_propagation_reaches_the_limit_in_300_s",
    ),
    Row(
        "With Table 1's autonomous row the bound meets the limit together with the error",
        "table 1, figure 5",
        "2000 m at about 900 s",
        lambda m: (
            f"(17) is a Riccati recursion and settles at {largest(m.table_1, 'bound_max_m'):.0f} m, while the error "
            f"reaches {largest(m.table_1, 'error_max_m') / 1e3:.0f} km: the flag came in "
            f"{sum(run.flag_age_s is not None for run in m.table_1)} of {len(m.table_1)} outages; bound below error in "
            f"{_violated_percent(m.table_1):.0f} % of epochs. Reported as a fault of the table"
        ),
        CONTRADICTED,
        lambda m: (
            all(run.flag_age_s is None and run.fault_of_table is not None for run in m.table_1)
            and 480.0 < largest(m.table_1, "bound_max_m") < 510.0
        ),
        f"{_PAPER}::test_table_1_saturates_and_is_a_fault_of_the_table",
    ),
    Row(
        "(17) can be tuned so that the bound holds and the flag comes in time",
        "(15) to (23), figure 5",
        "exact for one start point",
        lambda m: (
            f"one row for each fix noise, over all start phases: bound broken before the flag in "
            f"{_broken(m.paper_1m + m.paper_33m)}, and with other seeds and phases in {_broken(m.fresh)}; flag always "
            f"before the crossing, at {middle(m.paper_1m, 'flag_to_crossing'):.2f} of it in the median "
            f"(1 m fixes; {_range(m.paper_1m, 'flag_to_crossing', 2)}) and "
            f"{middle(m.paper_33m, 'flag_to_crossing'):.2f} (33 m)"
        ),
        QUALIFIED,
        lambda m: (
            _no_violation(m.paper_1m)
            and _no_violation(m.paper_33m)
            and all(run.flag_in_time for run in m.fresh)
            and middle(m.paper_1m, "flag_to_crossing") >= 0.6
        ),
        f"{_PAPER}::test_the_shipped_row_holds_on_every_start_phase",
    ),
    Row(
        "Coordinate descent down the ladder (23) finds parameters with which the bound is eps at T, (22) unbroken",
        "(18) to (23), table 1",
        "found, one start point",
        lambda m: _tuned(m.tuning),
        REPRODUCED,
        lambda m: (
            m.tuning.exact.found.exact
            and m.tuning.exact.broken == 0
            and not any((m.tuning.common.worst > 1.0).tolist())
            and not any((m.tuning.common.worst_unseen > 1.0).tolist())
            and len(m.tuning.table_1) == 1
        ),
        f"{_PAPER}::test_the_descent_of_the_paper_finds_an_exact_solution",
    ),
    Row(
        "Three sigmas on the worst axis cover the error with 0.997",
        "(12), (13)",
        "0.997",
        lambda m: (
            f"{m.coverage:.4f} for three equal axes; 0.997 needs {m.factor_axis:.2f} sigmas (in space "
            f"{m.factor_radius:.2f}). Right where one axis dominates, as in an outage"
        ),
        QUALIFIED,
        lambda m: 0.991 < m.coverage < 0.993,
        f"{_LIMITS}::test_three_sigmas_on_the_worst_axis",
    ),
    Row(
        "The bound is compared with the limit at each instant",
        "(12), (14)",
        "no latch",
        lambda m: (
            f"(12) falls back by up to {100.0 * max(dip.axis for dip in m.dips):.0f} % within an orbit, as the "
            f"along-track direction turns between the axes; the three-dimensional bound by "
            f"{100.0 * max(dip.radius for dip in m.dips):.1f} %. Hence the flag latches until fixes clear it"
        ),
        QUALIFIED,
        lambda m: max(dip.axis for dip in m.dips) > 0.15 and max(dip.radius for dip in m.dips) < 0.02,
        f"{_PAPER}::test_the_bound_falls_back_within_an_orbit",
    ),
    Row(
        "What dA makes up for is mostly gravity that the model leaves out; (3) is discretised by Euler at 1 s",
        "(3), text above figure 1",
        "mostly gravity",
        lambda m: (
            f"on a pure two-body orbit, where no gravity is left out, Euler alone errs by "
            f"{m.euler_900_s_m / 1e3:.1f} km after 900 s; RK4 by less than a micrometre, and in steps of 10 s by "
            f"{1e3 * m.rk4_10_s_900_s_m:.1f} mm"
        ),
        CONTRADICTED,
        lambda m: m.euler_900_s_m > LIMIT_M and m.rk4_900_s_m < 1e-6 and m.rk4_10_s_900_s_m < 1e-2,
        f"{_LIMITS}::test_euler_is_the_error",
    ),
    Row(
        "For the method the order of the onboard gravity model does not matter (in practice: as high as can be)",
        "below (2)",
        "central gravity",
        lambda m: (
            f"for the result it is everything. J2 and RK4, 33 m fixes, after 2000 s: "
            f"{middle(m.j2_paper_orbit, 'error_at_2000_s_m'):.0f} m on the paper's orbit (against "
            f"{middle(m.paper_33m, 'error_at_2000_s_m') / 1e3:.0f} km), "
            f"{middle(m.j2_outage, 'error_at_2000_s_m'):.0f} m at 1336 km: the limit is not reached. "
            f"Best integrated error {m.ratio_j2_421_km.best:.1f} and {m.ratio_j2_1336_km.best:.1f} times smaller "
            f"than the fix's"
        ),
        QUALIFIED,
        lambda m: (
            all(run.crossed_age_s is None for run in m.j2_paper_orbit + m.j2_outage) and m.ratio_j2_1336_km.best > 10.0
        ),
        f"{_PAPER}::test_with_j2_and_rk4_the_limit_is_not_reached",
    ),
)


def _broken(runs: list[OutageRun]) -> str:
    return f"{sum(run.violations > 0 for run in runs)} of {len(runs)} outages"


def _tuned(found: Result) -> str:
    exact, common = found.exact, found.common
    row = ", ".join(f"{value:.2g}" for value in exact.found.row)
    known = common.share_unseen[common.share_unseen > 0.0]
    return (
        f"(q_R, q_V, q_A, s_R, s_V) = ({row}), where Table 1 has (500, 0.05, 1e-06, 1000, 22): T = {exact.t_s:.0f} s, "
        f"s(T) = {exact.found.trial.at_t_m:.0f} m, (22) broken at {exact.broken} epochs. One row for "
        f"{len(common.worst)} start phases, asked for {common.margin:.2f} times the error: broken on "
        f"{int((common.worst > 1.0).sum())}, and on {int((common.worst_unseen > 1.0).sum())} of "
        f"{len(common.worst_unseen)} unseen ones, where T_flag / T is {known.min():.2f} to {known.max():.2f}, "
        f"{median(known.tolist()):.2f} in the median"
    )


def _violated_percent(runs: list[OutageRun]) -> float:
    return 100.0 * sum(run.violations for run in runs) / sum(run.epochs for run in runs)


_HEAD = """# Reproduction ledger

<!-- Written by `ground ledger`. Do not edit: change ground/studies/ledger.py and write it again. -->

leonav began as a paper: V. Uspenskyi, Y. Reshetniak, *Method for ensuring the data integrity provision in the
coordinate determination system of orbital objects* (2026, in Ukrainian). Its idea is good and is what flies here: a
satellite that has lost GNSS bounds its own error and says in time that it may no longer be trusted. To build on a
paper one has to know which of its statements carry weight. So we flew them.

Every line below was measured with the product itself: the compiled navigation step that flies, on a truth that knows
nothing of it (70 x 70 gravity, drag, Sun, Moon, radiation pressure), with fixes that went through codec and checks.
Errors are the largest axis in GCRF. **REPRODUCED**: it is so. **QUALIFIED**: it is so under a condition that the paper
does not give. **CONTRADICTED**: we find otherwise. A line names the test that fails should it cease to be true.
"""

_TAIL = """
## What follows from it

- **The bound must be able to reach the limit.** Equation (17) has a fixed point. A tuning whose fixed point lies below
  the limit is silent for ever, and silence looks like health. Weak pseudo-updates avoid it; the shipped sets do.
- **The integrator first.** At 1 s steps explicit Euler costs kilometres that Runge-Kutta saves for the price of three
  more evaluations of gravity. dA, meant for gravity, is spent on it. Set `paper` keeps Euler on purpose; set `j2`
  shows the other way.
- **One row for all start phases is late nowhere and early somewhere.** The error's growth depends on where the outage
  begins; the flag, blind to it, has to follow the fastest.
- **Three sigmas are broken now and then.** No run of twenty shows it. A rate that one may rely on takes a thousand
  outages (998 without a failure for 0.997 at 95 %), which is the business of certification and not of this page.
- **Latch.** A bound per axis breathes with the orbit. A flag that follows it down would offer a state that is worse
  than the one it had refused.

## How it was measured

{runs} runs of scenario `paper_outage` for each fix noise, {fresh} with other seeds, {side} of each of the others, each
with its own seed and the starts spread evenly over the orbit; {cases} grids of tunings. The ratio to the fix is rms
against rms at the fixes themselves. Again: `ground ledger`; one study by itself: `ground study paper --sigma 33`.
"""


class VerdictsFail(Exception):
    """Rows whose verdict the measurements do not bear."""

    def __init__(self, rows: list[Row], measured: Measured) -> None:
        super().__init__("\n".join(f"{row.verdict} does not hold: {row.claim}: {row.ours(measured)}" for row in rows))


def render(measured: Measured) -> str:
    """The ledger in Markdown. Raises VerdictsFail rather than write what is not so."""
    failing = [row for row in ROWS if not row.holds(measured)]
    if failing:
        raise VerdictsFail(failing, measured)
    counts = ", ".join(f"{sum(row.verdict == verdict for row in ROWS)} {verdict}" for verdict in VERDICTS)
    lines = ["| claim of the paper | where | the paper's figure | ours | verdict | test |", "|" + "---|" * 6]
    lines += [
        f"| {row.claim} | {row.where} | {row.paper} | {row.ours(measured)} | **{row.verdict}** | {_short(row.test)} |"
        for row in ROWS
    ]
    tail = _TAIL.format(
        runs=len(measured.paper_1m),
        fresh=len(measured.fresh),
        side=len(measured.table_1),
        cases=len(measured.ratios) + 3,
    )
    return f"{_HEAD}\n{counts}.\n\n" + "\n".join(lines) + "\n" + tail


def _short(test: str) -> str:
    path, _, name = test.partition("::")
    return f"[`{name}`](../{path})"
