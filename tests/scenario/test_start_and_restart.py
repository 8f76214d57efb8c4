"""How navigation starts, recovers from a wrong start, and restarts from fixes it had rejected."""

import numpy as np
import pytest
from harness import Flight, fault, faults, flown

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import FlagState, Mode, Validity

WRONG_STARTS = {
    "5 km": [fault("position_step", 0, 3, value=5000.0)],
    "100 m/s": [fault("velocity_step", 0, 3, value=100.0, axis="y")],
    "both": [fault("position_step", 0, 3, value=-5000.0, axis="z"), fault("velocity_step", 0, 3, value=-100.0)],
}


def events(flight: Flight) -> list[int]:
    rows = flight.loop.events.records
    return [int(row["alert_id"]) for row in rows[rows["sequence"] > 0]]


@pytest.mark.parametrize("rate_hz", [1, 5])
@pytest.mark.parametrize("init_fixes", [1, 3])
@pytest.mark.parametrize("name", WRONG_STARTS)
def test_a_wrong_first_fix_is_recovered_from_within_60_s(name: str, init_fixes: int, rate_hz: int) -> None:
    """GIVEN first fixes wrong by 5 km or 100 m/s, the paper's one-fix start or three agreeing ones THEN after 60 s the
    flag is down, the mode INTEGRATED, the error within the bound and below 100 m.

    With one fix the state is wrong until ten agreeing rejected fixes replace it; the flag is up meanwhile.
    """
    flight = flown(
        "time.duration_s=62",
        f"gnss.rate_hz={rate_hz}",
        f"flight.table.init_fixes={init_fixes}",
        faults(*WRONG_STARTS[name]),
    )
    assert flight.flown["flag"][600] == FlagState.CLEAR
    assert flight.flown["mode"][600] == Mode.INTEGRATED
    late = flight.seconds >= 60.0
    assert flight.error_m()[late].max() < 100.0
    assert (flight.error_m()[late] <= flight.flown["bound_m"][late]).all()
    # three fixes a second apart outlast the wrong ones; five a second are wrong often enough to agree
    replaced = init_fixes == 1 or rate_hz == 5
    assert (AlertId.REINITIALISED in events(flight)) == replaced
    if replaced:
        restart = int(np.flatnonzero(flight.flown["flag"] == FlagState.RAISED)[0])
        assert flight.error_m()[restart] < 100.0
    if rate_hz == 1:
        # no second fix has confirmed the wrong start: it was never offered
        offered = flight.flown["validity"] & Validity.STATE_VALID != 0
        assert (flight.error_m()[offered] <= flight.flown["bound_m"][offered]).mean() > 0.99
        assert flight.error_m()[offered].max() < 100.0


def test_the_default_start_is_not_fooled_by_one_wrong_fix() -> None:
    """GIVEN the first usable fix wrong by 5 km and three agreeing ones asked for THEN the start waits for good ones."""
    flight = flown(faults(*WRONG_STARTS["5 km"]))
    ready = flight.flown["validity"] & Validity.INITIALISED != 0
    assert flight.error_m()[ready].max() < 60.0
    assert AlertId.REINITIALISED not in events(flight)


def test_ten_agreeing_rejected_fixes_restart_the_state() -> None:
    """GIVEN a satellite whose fixes suddenly agree with each other 3 km from the state WHEN the tenth comes THEN alert,
    flag, mode FAILED and the state unreliable; the state is theirs; after 30 accepted ones the flag clears.
    """
    flight = flown("time.duration_s=140", faults(fault("position_step", 60, 80, value=3000.0)))
    seconds, flags = flight.seconds, flight.flown["flag"]
    raised = int(np.flatnonzero(flags == FlagState.RAISED)[0])
    assert seconds[raised] == pytest.approx(69.25, abs=0.11)  # the fixes of 60 s to 69 s are ten
    assert flight.counts["GATE"] == 10
    assert flight.flown["mode"][raised] == Mode.FAILED
    assert flight.flown["validity"][raised] & Validity.STATE_VALID == 0
    assert AlertId.REINITIALISED in events(flight)
    error_m = flight.error_m()
    assert error_m[raised - 1] < 30.0
    assert error_m[raised + 300] == pytest.approx(3000.0, abs=1500.0)  # largest GCRF axis of a step along one of ITRF
    cleared = raised + int(np.flatnonzero(flags[raised:] == FlagState.CLEAR)[0])
    assert seconds[cleared] == pytest.approx(99.25, abs=0.11)
    assert AlertId.FLAG_CLEARED in events(flight)
    assert flight.flown["mode"][-1] == Mode.INTEGRATED


def test_rejected_fixes_that_do_not_agree_restart_nothing() -> None:
    """GIVEN 20 s of fixes each wrong by another amount THEN none is used, the state is the model's, no restart."""
    steps = [fault("position_step", 30 + n, 1, value=(-1.0) ** n * (2000.0 + 700.0 * n)) for n in range(20)]
    flight = flown("time.duration_s=80", faults(*steps))
    assert flight.counts["GATE"] == 20
    assert AlertId.REINITIALISED not in events(flight)
    assert flight.error_m()[100:].max() < 60.0
    assert flight.flown["mode"][-1] == Mode.INTEGRATED


def test_nine_agreeing_rejected_fixes_are_not_enough() -> None:
    flight = flown("time.duration_s=80", faults(fault("position_step", 30, 9, value=3000.0)))
    assert flight.counts["GATE"] == 9
    assert AlertId.REINITIALISED not in events(flight)
    assert flight.error_m()[100:].max() < 60.0


def test_the_papers_start_takes_the_first_fix() -> None:
    """GIVEN init_fixes = 1 THEN the first fix after time is known starts the filter (the third pulse, at 2 s)."""
    flight = flown("flight.table.init_fixes=1")
    ready = np.flatnonzero(flight.flown["validity"] & Validity.INITIALISED != 0)[0]
    assert flight.seconds[ready] == pytest.approx(2.25, abs=0.11)
    slower = flown("flight.table.init_fixes=5")
    ready = np.flatnonzero(slower.flown["validity"] & Validity.INITIALISED != 0)[0]
    assert slower.seconds[ready] == pytest.approx(6.25, abs=0.11)


def test_nothing_is_published_as_valid_before_the_start() -> None:
    flight = flown()
    before = flight.flown["validity"] & Validity.INITIALISED == 0
    assert before[:20].all()
    assert np.isnan(flight.flown["r_gcrf_m"][before]).all()
    assert np.isnan(flight.flown["bound_m"][before]).all()
    assert (flight.flown["mode"][before] == Mode.INIT).all()
