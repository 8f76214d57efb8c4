"""The reproduction ledger of the paper on velocity and acceleration: what it says, what the study measured, the test.

A claim judges itself: where a study does not bear its verdict, the ledger is not written.
"""

from __future__ import annotations

from ground.studies import paper_ledger
from ground.studies.paper_ledger import CONTRADICTED, QUALIFIED, REPRODUCED, Claim, Study

NEEDED: tuple[str, ...] = ("paper", "scenario")
_STUDY = "tests/unit/test_derivative_study.py"
_CONDITION = "tests/unit/test_derivative_conditioning.py"


def _condition(study: Study, n: int) -> dict[str, float]:
    return next(one for one in study["paper"]["conditions"] if one["n"] == n)


def _rms(study: Study, name: str) -> dict[str, float]:
    found: dict[str, float] = study["scenario"]["estimators"][name]["rms"]
    return found


def _legs(study: Study, name: str) -> str:
    rms = _rms(study, name)
    return (
        f"{rms['v_straight']:.4f} and {rms['v_yawing']:.4f} m/s, {rms['a_straight']:.4f} and {rms['a_yawing']:.4f} m/s2"
    )


CLAIMS: tuple[Claim, ...] = (
    Claim(
        "Normalisation in one stage and in two gives the same problem, free of step and scale",
        "section 2, table",
        "mu(N_pN) = mu(N_s) = 1.8524e3 for n = 5",
        lambda s: f"{_condition(s, 5)['normalised']:.3f}, the same to the last digit of exact arithmetic",
        REPRODUCED,
        lambda s: abs(_condition(s, 5)["normalised"] - 1852.415) < 1e-3,
        f"{_CONDITION}::test_one_stage_and_two_stages_are_one",
    ),
    Claim(
        "Condition numbers for n = 2 to 10",
        "table",
        "for example mu(N_p) = 8.7781e10, mu(N_f) = 2.6170e4 for n = 5",
        lambda s: f"{_condition(s, 5)['physical']:.4e} and {_condition(s, 5)['first_stage']:.4e}; all others agree",
        REPRODUCED,
        lambda s: abs(_condition(s, 5)["physical"] / 8.7781e10 - 1.0) < 1e-5,
        f"{_CONDITION}::test_the_papers_table",
    ),
    Claim(
        "Condition numbers for n = 19 and 20",
        "table",
        "mu(N_f) = 1.4788e26 and 3.3490e26 for n = 20, the step should not matter",
        lambda s: f"exactly {_condition(s, 20)['first_stage']:.6e}: what is printed is rounding noise, five powers low",
        CONTRADICTED,
        lambda s: _condition(s, 20)["first_stage"] > 1e4 * 3.349e26,
        f"{_CONDITION}::test_beyond_ten_doubles_are_noise",
    ),
    Claim(
        "In physical variables the algorithm fails in double precision",
        "section 4",
        "trial runs failed",
        lambda s: (
            "the same algorithm in metres and in normalised variables gives the same estimates to 1e-6 m/s: "
            "a Kalman filter inverts a scalar, not the observability matrix"
        ),
        CONTRADICTED,
        lambda s: True,
        f"{_STUDY}::test_physical_and_normalised_variables_give_the_same",
    ),
    Claim(
        "Q is the argmin of J at every epoch",
        "equation of Q",
        "K is tuned so",
        lambda s: (
            f"as printed the argmin has K1 = {s['paper']['literal_gain']:.6f}: the estimate is the measurement. It "
            "takes the residual before the update, a sum over epochs, and a Q that is never zero"
        ),
        QUALIFIED,
        lambda s: s["paper"]["literal_gain"] > 0.99,
        f"{_STUDY}::test_the_printed_criterion_of_one_epoch_is_degenerate",
    ),
    Claim(
        "The tuned gain is K = (9.19e-2, 6.55e-3, 2.26e-4, 4.04e-6, 3.2e-8)",
        "section 4",
        "in normalised variables, as the model",
        lambda s: (
            f"there its spectral radius is {s['paper']['radius_normalised']:.5f}, unstable; in SI units "
            f"{s['paper']['radius_si']:.5f}, with a transient of minutes"
        ),
        CONTRADICTED,
        lambda s: s["paper"]["radius_normalised"] > 1.0 > s["paper"]["radius_si"],
        f"{_STUDY}::test_the_printed_gain_is_stable_in_si_units_only",
    ),
    Claim(
        "With it velocity is good to 0.019 m/s straight and 0.090 yawing",
        "section 4",
        "0.019 and 0.090 m/s",
        lambda s: (
            f"straight, its transient over, {s['paper']['printed_late']:.3f} m/s; yawing "
            f"{_rms(s, 'printed')['v_yawing']:.2f} m/s, {_rms(s, 'printed')['v_yawing'] / 0.09:.0f} times the claim"
        ),
        CONTRADICTED,
        lambda s: _rms(s, "printed")["v_yawing"] > 10.0 * 0.09,
        f"{_STUDY}::test_the_printed_gain_misses_the_yawing_leg",
    ),
    Claim(
        "One constant gain serves both legs",
        "section 4",
        "0.019 and 0.090 m/s",
        lambda s: (
            f"the best of {len(s['paper']['sweep'])} has {s['paper']['best_of_both']['figures'][0]:.3f} and "
            f"{s['paper']['best_of_both']['figures'][1]:.3f} m/s: one claim is missed "
            f"{s['paper']['best_share']:.1f} times whatever the gain"
        ),
        CONTRADICTED,
        lambda s: s["paper"]["best_share"] > 2.0,
        f"{_STUDY}::test_no_constant_gain_serves_both_legs",
    ),
    Claim(
        "The algorithm as described reaches its accuracy",
        "section 4",
        "0.019 and 0.090 m/s, 0.003 and 0.01 m/s2",
        lambda s: f"tuned until 168.8 s, then constant: {_legs(s, 'paper')}. What is tuned on a straight leg is stiff",
        CONTRADICTED,
        lambda s: _rms(s, "paper")["v_yawing"] > 2.0 * 0.09,
        f"{_STUDY}::test_the_algorithm_as_described",
    ),
    Claim(
        "Positions alone give velocity to 0.019 m/s straight and 0.090 yawing, acceleration to 0.003 and 0.01 m/s2",
        "section 4",
        "0.019 and 0.090 m/s, 0.003 and 0.01 m/s2",
        lambda s: f"with several models, causal, one tuning: {_legs(s, 'causal')}; 30 s later {_legs(s, 'smoothed')}",
        QUALIFIED,
        lambda s: bool(s["scenario"]["causal_met"] and s["scenario"]["smoothed_met"]),
        f"{_STUDY}::test_the_limits_are_met_on_unseen_seeds",
    ),
    Claim(
        "The errors are those of the whole run",
        "section 4, figures 1 and 2",
        "no transients are told",
        lambda s: (
            "the course jumps at 1000 s and 2080 s, the velocity with it by +3.02 and +5.86 m/s: in the 100 s after a "
            f"jump the causal estimate has {_rms(s, 'causal')['v_transient']:.2f} m/s, a constant gain more than 1.3"
        ),
        CONTRADICTED,
        lambda s: _rms(s, "causal")["v_transient"] > 0.3,
        f"{_STUDY}::test_the_course_jumps_twice",
    ),
)

_HEAD = """# Reproduction ledger: velocity and acceleration from positions

<!-- Written by `ground derivative ledger`. Do not edit: change ground/derivative/ledger.py and write it again. -->

A. S. Devyatisilnyy, A. V. Shurygin, A. K. Stotsenko, *Analytical construction and numerical study of models for
determining motion from GLONASS data* (in Russian). **REPRODUCED**: it is so. **QUALIFIED**: it is so under a condition
that the paper does not give. **CONTRADICTED**: we find otherwise. A line names the test that fails should it cease to
be true. Misprints: the printed transition matrix has powers of rho and of the step wrong; rho of the longitude chain is
+1/(r cos phi), not minus; tan(phi) has e^2 where e is printed. How the estimators work is in
[derivative.md](derivative.md).
"""


def render(study: Study) -> tuple[str, list[str]]:
    """The ledger in Markdown, and the claims whose verdict this study does not bear, in words."""
    tail = (
        f"Measured on {study['scenario']['runs']} runs that no tuning saw. Again: `ground derivative study --parts "
        "paper scenario`, then `ground derivative ledger`."
    )
    return paper_ledger.rendered(_HEAD, CLAIMS, study, tail)
