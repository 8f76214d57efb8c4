"""Verdicts on the bus against the faults of a scenario, and what the verdict of a run makes of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from flightsw.icd.can_frames import CROSSLINK_STATUS
from flightsw.icd.enums import CrosslinkState
from ground.reports.verdict import render_verdict
from hil_sim.crosslink_evaluation import evaluate

S = 1_000_000_000
T0 = 1_230_000_000 * S


def truth(*faults: tuple[int, float, float, float, float], **more: Any) -> dict[str, np.ndarray]:
    """faults: mask, start, end [s], jump [m] and ramp [m/s] along the track."""
    ticks = np.arange(1000)
    return {
        "tick": ticks,
        "t_true_gps_ns": T0 + ticks * S // 10,
        "crosslink_own": np.array(0),
        "crosslink_fault_mask": np.array([f[0] for f in faults], np.int64),
        "crosslink_fault_start_s": np.array([f[1] for f in faults]),
        "crosslink_fault_end_s": np.array([f[2] for f in faults]),
        "crosslink_fault_jump_m": np.array([[0.0, f[3], 0.0, 0.0] for f in faults]).reshape(-1, 4),
        "crosslink_fault_ramp_mps": np.array([[0.0, f[4], 0.0, 0.0] for f in faults]).reshape(-1, 4),
        **more,
    }


def monitor(faulty: dict[int, int], named: dict[int, int] | None = None, own_fault: int = -1) -> dict[str, np.ndarray]:
    """A status an epoch, six ticks after it. faulty, named: second -> mask, from then on, in it; own_fault: second."""
    records = np.zeros(99, CROSSLINK_STATUS.dtype)
    mask = 0
    for second, record in enumerate(records):
        mask = faulty.get(second, mask)
        record["t_gps_ns"], record["faulty"] = T0 + second * S, mask
        record["named"] = (named or {}).get(second, 0)
        record["own_state"] = CrosslinkState.FAULT if second == own_fault else CrosslinkState.CLEAR
    return {"tick": np.arange(1000), "crosslink": records, "crosslink_row": 10 * np.arange(99) + 6}


def test_a_fault_is_named_when_the_frame_said_so_and_no_earlier() -> None:
    """GIVEN a ramp of 2 m/s of number 4 from 20 s WHEN it is excluded from the epoch of 25 s to that of 60 s THEN it is
    named 5.6 s after its onset, at 10 m, and taken in again 10.6 s after its end at 50 s."""
    found = evaluate(truth((8, 20.0, 50.0, 0.0, 2.0)), monitor({25: 8, 60: 0}, {25: 8}))
    (fault,) = found["faults"]
    assert fault["satellites"] == [4]
    assert (fault["named_s"], fault["size_when_named_m"], fault["taken_in_again_s"]) == (5.6, 10.0, 10.6)
    assert (found["epochs"], found["named_in_vain"], found["own"]) == (99, [], 1)


def test_the_own_satellite_counts_as_named_by_its_own_monitor_and_others_not_in_part() -> None:
    own = evaluate(truth((1, 20.0, 50.0, 70.0, 0.0)), monitor({}, own_fault=21))
    assert own["faults"][0]["named_s"] == 1.6
    both = evaluate(truth((0b110, 20.0, 50.0, 70.0, 0.0)), monitor({21: 0b10}, {21: 0b10}))
    assert both["faults"][0]["named_s"] is None
    assert both["named_in_vain"] == []


def test_who_is_named_without_a_fault_is_told() -> None:
    """GIVEN names before the fault's onset, of another satellite, and right ones THEN the first two were in vain."""
    found = evaluate(truth((8, 20.0, 50.0, 70.0, 0.0)), monitor({}, {19: 8, 30: 4, 31: 8}))
    assert found["named_in_vain"] == [3, 4]
    assert evaluate(truth(), {"tick": np.arange(1000)})["epochs"] == 0


def test_on_a_real_day_the_true_error_is_told_instead() -> None:
    sizes = np.full((10, 24), 2.0)
    sizes[3:, 2] = 21.0
    real = truth(crosslink_error_t_s=10.0 * np.arange(10), crosslink_error_m=sizes)
    found = evaluate(real, monitor({}, {25: 4}))
    assert found["real_day"] == [{"satellite": 3, "named_s": 25.6, "error_m": 21.0}]
    assert found["named_in_vain"] == []


def test_the_verdict_of_a_run_tells_it_in_words() -> None:
    found = evaluate(
        truth((8, 20.0, 50.0, 0.0, 2.0), (1, 60.0, 90.0, 70.0, 0.0)), monitor({25: 8, 60: 0}, {25: 8, 70: 16})
    )
    said = " ".join(render_verdict({"crosslinks": found}).split())
    for words in (
        "What satellite 4 broadcast was ever more wrong by 2 m/s from 20 s; flight named it 5.6 s later, at 10.0 m, "
        "and took it in again 11 s after it was right.",
        "What satellite 1, the flown one, broadcast was wrong by 70 m from 60 s; flight NEVER found it.",
        "flight judged 99 epochs as satellite 1 and named satellite 5 without reason.",
    ):
        assert words in said, said
    real = {"own": 4, "epochs": 7, "real_day": [{"satellite": 3, "named_s": 881.0, "error_m": 20.4}]}
    assert "excluded satellite 3 at 881 s; what it really broadcast was wrong by 20.4 m." in " ".join(
        render_verdict({"crosslinks": real}).split()
    )
    assert "rosslink" not in render_verdict({})
