"""A receiver of one frequency through CAN: flight's model takes most of the ionosphere off, faults are still named."""

from __future__ import annotations

import numpy as np
from gnss_bench import checks
from harness import Flight, flown

from flightsw.icd.enums import GnssVerdict
from ground.reports.pseudoranges import fix_words, pseudorange_story
from hil_sim.pseudoranges import evaluation

TWO = '{kind="step", constellation="all", count=2, start_s=180.0, duration_s=60.0, value=60.0}'


def fly(*settings: str) -> Flight:
    return flown("time.duration_s=300", f"satellite_fault=[{TWO}]", "outage=[]", *settings, name="single_frequency")


def rms_m(flight: Flight) -> float:
    return float(np.sqrt(np.mean(flight.error_m()[flight.seconds > 100.0] ** 2)))


def test_the_model_takes_most_of_it_off_and_the_test_still_works() -> None:
    """GIVEN a day side of 5 m vertical delay and two satellites wrong by 60 m WHEN flown with and without the model
    THEN with it the position is better and the faults are named exactly in nine epochs of ten; what the summary says
    of it counts the same."""
    good, bare = fly(), fly("flight.function_table.gnss.iono_share=0")
    assert rms_m(good) < 0.7 * rms_m(bare)
    found = checks(good)
    told = np.concatenate([[data for _, frame, data in good.published if frame == 0x212]])
    named = np.frombuffer(b"".join(told.tolist()), evaluation_dtype())
    truth = good.world.truth_arrays()
    judged = evaluation.evaluate(truth, {"gnss_check": found, "gnss_excluded": named})
    assert judged["epochs"] == len(found) == 299
    assert judged["fixes"] >= 0.97 * 299
    assert judged["in_vain"] <= 5
    (fault,) = judged["faults"]
    assert len(fault["satellites"]) == 2
    assert fault["epochs"] == 60
    assert fault["named"] >= 54
    assert fault["named_after_s"] <= 3.0
    clean = np.count_nonzero(found["gnss_verdict"] == GnssVerdict.CONSISTENT)
    assert clean >= 235
    assert "fixes made on board" in str(fix_words(judged))
    said = list(pseudorange_story(judged))
    assert fault["satellites"][0] in said[0]
    assert "named exactly after" in said[0]


def evaluation_dtype() -> np.dtype:
    from flightsw.icd.can_frames import GNSS_EXCLUDED

    return GNSS_EXCLUDED.dtype
