"""What the consistency test of pseudoranges says where it can say little: few satellites, poor levels, a spoofer."""

from __future__ import annotations

import numpy as np
import pytest
from gnss_bench import checks, satellites
from harness import Flight, flown

from flightsw.icd.alerts import AlertId
from flightsw.icd.can_frames import INTEGRITY
from flightsw.icd.enums import FlagState, GnssVerdict

BASE = ("satellite_fault=[]", "time.duration_s=60")


def fly(*settings: str) -> Flight:
    return flown(*BASE, *settings, name="gnss_faults")


def raised(flight: Flight, alert: AlertId) -> np.ndarray:
    """(n,) bool by tick: the alert stands in the word that the other onboard systems hear."""
    data = b"".join(data for _, found, data in flight.published if found == INTEGRITY.frame_id)
    return (np.frombuffer(data, INTEGRITY.dtype)["alerts"] >> np.uint64(alert)) & np.uint64(1) == 1


@pytest.mark.parametrize("offer", [0, 1])
def test_a_fix_that_nothing_can_contradict_is_offered_only_where_the_table_says_so(offer: int) -> None:
    """GIVEN five satellites of two constellations THEN epochs are UNTESTED, the fix is offered only by a table that
    wants it, and the alert is up where it is not.
    """
    few = ('pseudoranges.constellations=["gps", "galileo"]', "pseudoranges.mask_deg=40")
    flight = fly(*few, f"flight.function_table.gnss={{offer_untested={offer}}}")
    found = checks(flight)
    untested = found["gnss_verdict"] == GnssVerdict.UNTESTED
    assert untested.sum() >= 40
    assert (found["offered"][untested] == offer).all()
    assert (found["dof"][untested] == 0).all()
    assert raised(flight, AlertId.GNSS_UNTESTED).any() == (not offer)
    assert not raised(flight, AlertId.GNSS_EXCLUDED).any()


@pytest.mark.parametrize("hold", [0, 1])
def test_a_level_beyond_its_limit_is_told_and_holds_the_fix_back_only_by_table(hold: int) -> None:
    """GIVEN limits of 3 m, less than any level, THEN the alert stands, no epoch is available, and the fixes are offered
    all the same unless the table holds them back (docs/adr/0019).
    """
    tight = "alert_limit_east_m=2.0, alert_limit_north_m=2.0, alert_limit_up_m=3.0"
    flight = fly(f"flight.function_table.gnss={{{tight}, hold_beyond_limit={hold}}}")
    found = checks(flight)
    assert not found["available"].any()
    tested = found["gnss_verdict"] <= GnssVerdict.EXCLUDED
    assert tested.sum() >= 55
    assert (found["offered"][tested] == 1 - hold).all()
    assert (found["protection_up_m"][tested] > found["limit_up_m"][tested]).all()
    stands = raised(flight, AlertId.GNSS_PROTECTION)
    third = 3.0 / (flight.period_ns * 1e-9)
    assert third <= np.flatnonzero(stands)[0] <= third + 20
    assert stands[np.flatnonzero(stands)[0] :].all()


def test_alerts_do_not_chatter() -> None:
    """GIVEN a satellite that is wrong in every other epoch THEN it is named in each, and the alert, which wants three
    in a row, never stands.
    """
    entries = ", ".join(
        f'{{kind="step", constellation="gps", count=1, start_s={s}.5, duration_s=1.0, value=60.0}}'
        for s in range(10, 50, 2)
    )
    flight = flown("time.duration_s=60", f"satellite_fault=[{entries}]", name="gnss_faults")
    assert sum(bool(names) for names in satellites(flight)) >= 20
    assert not raised(flight, AlertId.GNSS_EXCLUDED).any()


def test_ranges_that_all_agree_on_a_wrong_place_are_for_navigation_to_doubt() -> None:
    """GIVEN a spoofer whose ranges agree on a place that rises by 1 m/s THEN the consistency test leaves nothing out,
    as it must; the gate refuses the fixes, and the flag is up when the state is given up for them, within 90 s.
    """
    lifted = 'satellite_fault=[{kind="lift", start_s=180.0, duration_s=100.0, value=1.0}]'
    flight = flown("time.duration_s=280", lifted, name="gnss_faults")
    assert sum(bool(names) for names in satellites(flight)[179:]) <= 2
    assert flight.counts["GATE"] >= 10
    up = flight.seconds[flight.flown["flag"] == FlagState.RAISED]
    assert 180.0 < up[up > 180.0][0] <= 270.0
