"""The paper's tuning: (17) in lanes against matrices and against flight, the ladder, where a bound settles, what is
said of Table 1."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from flightsw.icd.table_file import decode
from flightsw.icd.table_saturation import saturation
from ground.errors import OperatorError
from ground.tables.build import build_navigation
from ground.tuning import lanes_source, paper, paper_search, written
from ground.tuning.descent import Trial, admissible_start, descend
from ground.tuning.method import Effort, Tuned
from ground.tuning.outages import Plan, fly
from ground.tuning.paper_result import TABLE_1
from ground.tuning.recursion import PARAMETERS, Outages, carry, trace
from ground.tuning.settling import settled_m

ROW = np.array([104.0, 1.57e-3, 5.67e-8, 4.97e4, 45.2])
TABLE_1_KEYS = {f"tuning.0.bound_{name}": value for name, value in zip(PARAMETERS, TABLE_1.tolist(), strict=True)}


@contextmanager
def no_bar(label: str, total: int):
    yield lambda n: None


def by_matrices(outages: Outages, lane: int, row: np.ndarray) -> list[float]:
    """(17) and (12) as the paper prints them, one outage."""
    h, tau = np.hstack((np.eye(6), np.zeros((6, 3)))), outages.dt_s
    second = 0.5 * tau**2 if outages.runge_kutta else 0.0
    q, r = np.diag(np.repeat(row[:3], 3)), np.diag(np.repeat(row[3:] ** 2, 3))
    p, bounds = outages.p0[lane], []
    for xx, xy, xz, yy, yz, zz in outages.gradient_ps2[:, :, lane]:
        pull = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        one, none = np.eye(3), np.zeros((3, 3))
        phi = np.block(
            [
                [one + second * pull, tau * one, second * one],
                [tau * pull, one + second * pull, tau * one],
                [none, none, one],
            ]
        )
        p = phi @ p @ phi.T + q
        k = np.linalg.solve(h @ p @ h.T + r, h @ p).T  # S is symmetric
        p = (np.eye(9) - k @ h) @ p
        bounds.append(outages.k_axis * np.sqrt(np.diag(p)[:3].max()))
    return bounds


def drawn(lanes: int, seconds: int, runge_kutta: bool) -> Outages:
    rng = np.random.default_rng(4)
    root = rng.standard_normal((lanes, 9, 9)) * np.repeat((3.0, 0.3, 1e-3), 3)[:, None]
    pull = 1.2e-6 * rng.standard_normal((seconds, 6, lanes))
    return Outages(root @ root.transpose(0, 2, 1), pull, np.zeros((seconds + 1, lanes)), 1.0, runge_kutta, 3.0)


@pytest.mark.compiled
@pytest.mark.parametrize("runge_kutta", [False, True])
def test_lanes_are_the_matrices_of_the_paper(runge_kutta: bool) -> None:
    """GIVEN 19 outages, more than go side by side and not a multiple WHEN carried THEN each has the bounds of (17)."""
    outages = drawn(19, 80, runge_kutta)
    bounds = trace(outages, ROW)
    for lane in (0, 7, 15, 16, 18):
        assert bounds[1:, lane] == pytest.approx(by_matrices(outages, lane, ROW), rel=1e-9)


def test_the_step_in_lanes_is_fresh() -> None:
    assert lanes_source.FILE.read_text(encoding="utf-8") == lanes_source.render()


@pytest.mark.compiled
def test_22_is_judged_where_it_must_be() -> None:
    """GIVEN errors that exceed the bound at one epoch of one outage WHEN judged to before, to it, with it allowed, and
    with a margin THEN it counts exactly there; flag and s(T) are those of the trace."""
    outages = drawn(3, 60, False)
    bounds = trace(outages, ROW)
    errors = 0.5 * bounds
    errors[40, 1] = 1.01 * bounds[40, 1]
    outages = outages._replace(error_m=errors)
    before, beyond = np.array([60, 39, 60]), np.array([60, 60, 60])
    assert carry(outages, before, ROW, 1e9).holds
    assert not carry(outages, beyond, ROW, 1e9).holds
    done = carry(outages, beyond, ROW, float(bounds[30, 0]), allowed=1)
    assert done.holds
    assert done.broken.tolist() == [0, 1, 0]
    assert done.worst == pytest.approx([0.5, 1.01, 0.5])
    assert done.at_last_m == pytest.approx(bounds[60])
    assert done.flag_s[0] == pytest.approx(30.0, abs=1e-6)
    assert not carry(outages, before, ROW, 1e9, margin=2.001).holds
    assert carry(outages, before, ROW, 1e9, margin=1.999).holds


@pytest.mark.compiled
def test_the_recursion_is_what_flight_publishes(tmp_path: Path) -> None:
    """GIVEN two outages of set paper, flown WHEN (17) is carried on from the last fix with the set's own row THEN it is
    the bound that flight published, which is the larger of the two ends of its interval; kept outages are read, not
    flown again."""
    plan = Plan("paper", 1.0, 2, 1, outage_s=120)
    flown = fly(plan, tmp_path)
    bounds = trace(flown.outages, ROW)
    assert flown.published_m[2:-1] == pytest.approx(np.maximum(bounds[2:-1], bounds[3:]), rel=1e-9)
    done: list[int] = []
    again = fly(plan, tmp_path, done.append)
    assert done == [2]
    assert np.array_equal(again.outages.error_m, flown.outages.error_m)


def test_a_bound_settles_where_the_linter_says() -> None:
    """GIVEN Table 1 WHEN its fixed point is found by doubling THEN it is the linter's 495 m, which steps to it."""
    (reason,) = saturation(decode(build_navigation("paper_table1")).values)
    assert settled_m(TABLE_1, 1.0, False, 3.0) == pytest.approx(495.0, abs=0.5)
    assert "the bound settles at 495 m" in reason
    assert settled_m(ROW, 1.0, False, 3.0) > 4000.0


def test_the_ladder_ends_at_eps_or_where_22_stops_it() -> None:
    """GIVEN s(T) = q_R s_R, with (22) as q_R >= 2, s_R >= 50 WHEN descended from 5000 to 1000 THEN exactly there; to
    60, below the least that is possible, THEN at 100, and it is said to be not exact."""

    def attempt(row: np.ndarray) -> Trial | None:
        if row[0] < 2.0 or row[3] < 50.0:
            return None
        return Trial(row[0] * row[3], 2.0 / row[0] + 50.0 / row[3], 0.0)

    start = admissible_start(np.array([0.5, 1e-3, 1e-6, 1000.0, 10.0]), 1000.0, attempt, lambda row: True)
    assert attempt(start) is not None
    found = descend(start, 1000.0, attempt, lambda row: True)
    assert found.exact
    assert found.trial.at_t_m == pytest.approx(1000.0, rel=0.01)
    assert [rung.sought_m for rung in found.ladder] == sorted((r.sought_m for r in found.ladder), reverse=True)
    stopped = descend(start, 60.0, attempt, lambda row: True)
    assert not stopped.exact
    assert stopped.trial.at_t_m == pytest.approx(100.0, rel=0.05)
    with pytest.raises(ValueError, match="22"):
        admissible_start(start, 1000.0, lambda row: None, lambda row: True)


@pytest.mark.compiled
def test_one_outage_is_solved_exactly_and_the_row_flies(tmp_path: Path) -> None:
    """GIVEN the paper's model, six start phases WHEN tuned THEN one outage has s(T) = eps to 1 % without a break of
    (22); the common row breaks it nowhere it was tuned on; the set that is written builds, passes the linter and says
    what was before; Table 1 is refused with the reason."""
    effort = Effort(quick=True, runs=6)
    tuned = paper.Paper().tune("paper", tmp_path, effort, no_bar)
    (fixes,) = tuned.evidence["fixes"]
    assert fixes["exact"]["exact"]
    assert fixes["exact"]["bound_at_t_m"] == pytest.approx(2000.0, rel=0.01)
    assert fixes["exact"]["broken_epochs"] == 0
    assert 400.0 < fixes["exact"]["t_s"] < 1300.0
    assert fixes["common"]["phases"]["broken"] == 0
    assert fixes["common"]["margin"] >= 1.0
    assert 0.3 < fixes["common"]["phases"]["t_flag_over_t"]["median"] <= 1.0
    assert "settles at 495 m" in fixes["table_1"]["refused"][0]
    path = written.write(tmp_path, "paper", "paper", effort, tuned)
    built, asked = decode(build_navigation(path)), decode(build_navigation("paper", dict(tuned.changes)))
    assert built.set_name == "paper_tuned"
    assert built.values.tobytes() == asked.values.tobytes()
    assert saturation(built.values) == []
    assert "# was 104.0" in path.read_text()
    report = (tmp_path / written.REPORT).read_text()
    assert "Table 1 is refused: tuning row 0: the bound settles at 495 m" in report
    assert sorted(p.name for p in (tmp_path / written.PICTURES).iterdir()) == [
        "1_figure_5_1m.png",
        "2_start_phases_1m.png",
    ]


@pytest.mark.parametrize(("scale", "n", "count"), [(0.05, 256, 64), (0.3, 64, 16)])
def test_what_is_foreseen_of_the_unseen_is_exceeded_seldom(scale: float, n: int, count: int) -> None:
    """GIVEN worst errors / bounds with a tail that falls exponentially WHEN what as many again reach is foreseen from n
    THEN they exceed it in some 5 % of the cases (few tell the tail: rather more), and it is never below the worst."""
    rng = np.random.default_rng(3)
    exceeded = 0
    for _ in range(2000):
        seen, unseen = 0.6 + rng.exponential(scale, n), 0.6 + rng.exponential(scale, count)
        limit = paper_search.foreseen(seen, count)
        assert limit >= seen.max()
        exceeded += int(unseen.max() > limit)
    assert 0.02 < exceeded / 2000 < 0.12


def test_no_set_is_written_that_flight_would_refuse(tmp_path: Path) -> None:
    """GIVEN a tuning that comes to Table 1's autonomous row WHEN written THEN refused with the linter's reason, and the
    folder stays empty."""
    tuned = Tuned(TABLE_1_KEYS, "", {}, [])
    with pytest.raises(OperatorError, match=r"settles at 495 m.*no set is written"):
        written.write(tmp_path, "paper", "paper", Effort(), tuned)
    assert list(tmp_path.iterdir()) == []
    values = decode(build_navigation("paper")).values
    assert paper_search.refusals(values, 0, ROW) == []
    assert "settles at 495 m" in paper_search.refusals(values, 1, TABLE_1)[0]


def test_sets_of_another_filter_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OperatorError, match="flight: has no"):
        fly(Plan("flight", 1.0, 2, 1), tmp_path)
