"""The reproduction ledger of the paper on crosslinks: what it says, what the study measured, the test that holds it.

A claim judges itself: where a study does not bear its verdict, the ledger is not written.
"""

from __future__ import annotations

from typing import Any

from ground.campaign.statistics import trials_needed, upper_limit
from ground.studies import paper_ledger
from ground.studies.paper_ledger import CONTRADICTED, QUALIFIED, REPRODUCED, Claim, Study
from hil_sim.truth.constellation.broadcast import DIRECTIONS

NEEDED: tuple[str, ...] = ("paper", "uploads")
_PAPER_RUNS = 10_000_000
_PAPER_MISS = 2e-7
_STUDY = "tests/unit/test_crosslink_study.py"


def _table(study: Study, number: int) -> dict[str, Any]:
    return next(one for one in study["paper"]["tables"] if one["number"] == number)


def _case(study: Study, name: str) -> dict[str, Any]:
    return next(one for one in study["uploads"]["cases"] if one["case"] == name)


def _shares(study: Study, jump: str, key: str) -> list[float]:
    return [_case(study, f"{direction} {jump}")[key] for direction in DIRECTIONS]


def _listed(study: Study, jump: str, key: str) -> str:
    return ", ".join(
        f"{direction} {100.0 * share:.1f} %"
        for direction, share in zip(DIRECTIONS, _shares(study, jump, key), strict=True)
    )


CLAIMS: tuple[Claim, ...] = (
    Claim(
        "The threshold follows from the accuracy of the ephemerides",
        "table 2, figure 3",
        "59.7 m",
        lambda s: f"{s['paper']['threshold_m']:.2f} m: 12 sigma of the position error of Table 2",
        REPRODUCED,
        lambda s: abs(s["paper"]["threshold_m"] - 59.7) < 0.05,
        "tests/unit/test_crosslink_thresholds.py::test_the_papers_threshold_follows_from_table_2",
    ),
    Claim(
        "Satellite 1 ranges to nine others",
        "tables 5 to 7",
        "2 8 9 10 11 16 17 18 19",
        lambda s: (
            f"{' '.join(map(str, s['paper']['neighbours_of_1']))} with links of up to 86 deg of central angle; "
            f"{s['paper']['mean_neighbours']:.1f} neighbours on average"
        ),
        REPRODUCED,
        lambda s: s["paper"]["neighbours_of_1"] == [2, 8, 9, 10, 11, 16, 17, 18, 19],
        "tests/unit/test_crosslink_geometry.py::test_neighbours_of_the_paper",
    ),
    Claim(
        "A jump shows on every link in the second in which it occurs",
        "tables 5 to 7, figures 4 to 6",
        "second 50",
        lambda s: (
            "in the paper's model, which adds the whole error to the size of the noise on every link, yes. Then dR "
            "minus the jump is "
            f"never negative (least printed {min(_table(s, n)['excess_least_m'] for n in (5, 6, 7)):.2f} m), which no "
            "error of position does: a link sees its projection, of either sign"
        ),
        QUALIFIED,
        lambda s: all(
            _table(s, n)["first_printed_s"] == _table(s, n)["first_model_s"][0] == 50.0
            and _table(s, n)["excess_least_m"] >= 0.0
            for n in (5, 6, 7)
        ),
        f"{_STUDY}::test_the_scalar_model_gives_the_printed_seconds",
    ),
    Claim(
        "Each link has its own measurement",
        "tables 5 to 7",
        "nine columns",
        lambda s: (
            "after the jump the columns of satellites 9 and 10, and of 17 and 18, are the same to the centimetre in "
            "all rows of all three tables: seven independent links, not nine"
        ),
        CONTRADICTED,
        lambda s: all([tuple(p) for p in _table(s, n)["equal_columns"]] == [(9, 10), (17, 18)] for n in (5, 6, 7)),
        f"{_STUDY}::test_columns_that_are_copies",
    ),
    Claim(
        "A ramp is found when it reaches the threshold, in the first or second second",
        "tables 8 and 9, figures 7 and 8",
        "5935 s and 1155 s",
        lambda s: (
            f"its own rows have a strict majority at {_table(s, 8)['first_printed_s']:.0f} s and "
            f"{_table(s, 9)['first_printed_s']:.0f} s; its model with fresh noise every second at "
            f"{_table(s, 8)['first_model_s'][0]:.0f} s and {_table(s, 9)['first_model_s'][0]:.0f} s (medians): noise "
            "helps a growing error over the threshold"
        ),
        CONTRADICTED,
        lambda s: (
            (_table(s, 8)["first_printed_s"], _table(s, 9)["first_printed_s"]) == (5040.0, 1148.0)
            and _table(s, 8)["first_model_s"][2] < 5040.0
            and _table(s, 9)["first_model_s"][2] < 1148.0
        ),
        f"{_STUDY}::test_first_majorities_of_the_printed_ramps",
    ),
    Claim(
        "A jump of 70 m is found at once, whatever it is",
        "table 5, conclusion 1",
        "next second",
        lambda s: (
            f"with true geometry the paper's rule finds {_listed(s, '70 m', 'majority')}; the network monitor finds "
            f"and names {_listed(s, '70 m', 'exact')}"
        ),
        CONTRADICTED,
        lambda s: max(_shares(s, "70 m", "majority")[:3]) < 0.05 and min(_shares(s, "70 m", "exact")) > 0.99,
        "tests/unit/test_crosslink_monitor.py::test_a_jump_of_70_m_is_named_in_its_epoch_where_the_paper_misses_it",
    ),
    Claim(
        "Jumps of 300 and 700 m are found at once",
        "tables 6 and 7",
        "next second",
        lambda s: f"300 m: {_listed(s, '300 m', 'majority')}; 700 m: {_listed(s, '700 m', 'majority')}",
        REPRODUCED,
        lambda s: min(_shares(s, "300 m", "majority")) >= 0.97 and min(_shares(s, "700 m", "majority")) >= 0.97,
        f"{_STUDY}::test_large_jumps_are_seen_by_the_papers_rule",
    ),
    Claim(
        "10 million runs show a probability of at least 1 - 2e-7",
        "conclusion 2",
        "1 - 2e-7",
        lambda s: (
            f"10 million runs without a miss leave {upper_limit(0, _PAPER_RUNS):.1e} at 95 % confidence; 2e-7 takes "
            f"{trials_needed(0, _PAPER_MISS) / 1e6:.1f} million"
        ),
        CONTRADICTED,
        lambda s: upper_limit(0, _PAPER_RUNS) > _PAPER_MISS,
        f"{_STUDY}::test_ten_million_runs_do_not_show_2e_7",
    ),
)

_HEAD = """# Reproduction ledger: integrity by inter-satellite ranging

<!-- Written by `ground crosslink ledger`. Do not edit: change ground/crosslink/ledger.py and write it again. -->

V. Kurshin, R. Syatkovskiy, D. Panov, *Analysis of the application of onboard inter-satellite measurement equipment for
monitoring of the GLONASS integrity* (2023, in Russian). **REPRODUCED**: it is so. **QUALIFIED**: it is so under a
condition that the paper does not give. **CONTRADICTED**: we find otherwise. A line names the test that fails should it
cease to be true. How the monitors work is in [crosslink.md](crosslink.md).
"""


def render(study: Study) -> tuple[str, list[str]]:
    """The ledger in Markdown, and the claims whose verdict this study does not bear, in words."""
    trials = _case(study, "radial 70 m")["trials"]
    tail = (
        f"Measured with {trials} faulty uploads of each case in {study['uploads']['runs']} geometries, every pair "
        "ranging both ways. Again: `ground crosslink study --parts paper uploads`, then `ground crosslink ledger`."
    )
    return paper_ledger.rendered(_HEAD, CLAIMS, study, tail)
