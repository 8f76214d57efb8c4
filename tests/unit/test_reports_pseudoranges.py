"""Sentences of a run with pseudoranges, and what they are counted from."""

from __future__ import annotations

import numpy as np
import pytest

from flightsw.icd.can_frames import GNSS_CHECK, GNSS_EXCLUDED
from flightsw.icd.enums import GnssVerdict
from ground.reports.pseudoranges import fix_words, pseudorange_story
from ground.reports.verdict import render_verdict
from hil_sim.pseudoranges import evaluation

ZERO_NS = 10**18


def judged(named: list[int], masks: list[tuple[int, float, float]], kind: str = "step") -> dict:
    """Epochs a second apart; named: GPS masks that flight left out; masks: mask, start, end of each fault."""
    check, out = np.zeros(len(named), GNSS_CHECK.dtype), np.zeros(len(named), GNSS_EXCLUDED.dtype)
    for array in (check, out):
        array["t_gps_ns"] = ZERO_NS + np.arange(len(named)) * 10**9
    check["used"], check["offered"] = 9, 1
    check["gnss_verdict"] = np.where(np.array(named) > 0, GnssVerdict.EXCLUDED, GnssVerdict.CONSISTENT)
    check["gnss_verdict"][0], check["offered"][0] = GnssVerdict.TOO_FEW, 0
    out["gps"] = named
    truth = {
        "t_true_gps_ns": np.array([ZERO_NS]),
        "gnss_fault_mask": np.array([[mask, 0, 0, 0] for mask, _, _ in masks], np.uint64).reshape(-1, 4),
        "gnss_fault_kind": np.array([kind] * len(masks), "U24"),
        "gnss_fault_start_s": np.array([start for _, start, _ in masks]),
        "gnss_fault_end_s": np.array([end for _, _, end in masks]),
    }
    return evaluation.evaluate(truth, {"gnss_check": check, "gnss_excluded": out})


def test_what_is_counted() -> None:
    """GIVEN ten epochs, a fault of G01 and G03 from 4 to 8 s that is named one epoch late and once by half, a healthy
    satellite left out at 2 s THEN each of these is counted where it belongs."""
    both = 0b101
    found = judged([0, 0, 0b10, 0, 0, both, both, 0b1, 0, 0], [(both, 4.0, 8.0)])
    assert found["epochs"] == 10
    assert found["fixes"] == 9
    assert found["verdicts"] == {"CONSISTENT": 5, "EXCLUDED": 4, "TOO_FEW": 1}
    assert found["satellites"] == 9.0
    assert found["in_vain"] == 1
    (fault,) = found["faults"]
    assert fault == {
        "kind": "step",
        "satellites": ["G01", "G03"],
        "start_s": 4.0,
        "epochs": 4,
        "named": 2,
        "named_after_s": 1.0,
    }
    assert list(pseudorange_story(found)) == [
        "G01, G03: step from 4 s; named exactly after 1 s, in 2 of 4 epochs.",
        "A satellite without such a fault was left out in 1 of 10 epochs.",
    ]
    assert fix_words(found) == "9 fixes made on board of 10 epochs of pseudoranges, 9.0 satellites each"


@pytest.mark.parametrize(("kind", "said"), [("ramp", "NEVER named"), ("lift", "the gate has to see it")])
def test_a_fault_never_named(kind: str, said: str) -> None:
    found = judged([0] * 10, [(0b1, 4.0, 8.0)], kind)
    assert said in next(iter(pseudorange_story(found)))
    assert "no epoch was judged" in next(iter(pseudorange_story(judged([0] * 3, [(0b1, 4.0, 8.0)]))))


def test_a_summary_tells_fixes_and_epochs_in_the_place_of_their_error() -> None:
    """GIVEN summaries with and without pseudoranges, and one of nothing THEN n/a stands only where nothing is known."""
    found = judged([0, 0, 0b10], [])
    text = render_verdict({"scenario": "x", "integrated": {"position_rms_m": 1.0}, "pseudoranges": found})
    assert "2 fixes made on board" in text
    assert "fixes: n/a" not in text
    assert "fix error" not in text
    assert "fixes: 3 m" in render_verdict({"integrated": {"position_rms_m": 1.0, "fix_rms_m": 3.0}})
    nothing = evaluation.evaluate({"t_true_gps_ns": np.array([0])}, {})
    assert "no fix out of 0 epochs" in render_verdict({"pseudoranges": nothing})
