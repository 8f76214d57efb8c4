"""GPS time that jumps, rolls over, gains a leap second or runs backwards never moves flight's state or clock."""

from functools import cache

import numpy as np
import pytest
from harness import Flight, fault, faults, flown

from flightsw.icd.alerts import AlertId

START_S = 40.0
AFTER_S = 15.0
TIME_CAUSES = {"TIME_STALE", "TIME_FUTURE", "TIME_JUMP", "TIME_REPEATED", "SYNC_JUMP", "SYNC_INVALID", "CLOCK_UNSET"}

# name -> (fault, value, seconds from the window's start to its first wrong stamp)
WRONG_TIMES = {
    "jump of 1 s": ("time_jump", {"value": 1.0}, 0.0),
    "jump of -1 s": ("time_jump", {"value": -1.0}, 0.0),
    "jump of 1 ms": ("time_jump", {"value": 1e-3}, 0.0),
    "jump of -1 ms": ("time_jump", {"value": -1e-3}, 0.0),
    "jump of 1 ms, fixes only": ("time_jump", {"value": 1e-3, "target": "position"}, 0.0),
    "jump of 1 ms, pulses only": ("sync_jump", {"value": 1e-3}, 0.0),
    "jump of 1 s, pulses only": ("sync_jump", {"value": 1.0}, 0.0),
    "10-bit week rollover": ("week_rollover", {}, 0.0),
    "leap second": ("leap_second", {}, 0.0),
    "leap second missed": ("leap_second", {"value": -1.0}, 0.0),
    # mirrored at its first stamp, which is still the true time
    "backwards": ("time_backwards", {}, 1.0),
}


def settings(duration_s: float, fault_entry: str) -> tuple[str, ...]:
    return (f"time.duration_s={START_S + duration_s + AFTER_S}", faults(fault_entry))


@cache
def deaf_twin(start_s: float, duration_s: float, target: str) -> Flight:
    """The same flight to which the frames with the wrong times never came."""
    lost = [fault("frame_drop", start_s, duration_s - (start_s - START_S), target=one) for one in target.split("+")]
    return flown(f"time.duration_s={START_S + duration_s + AFTER_S}", faults(*lost))


@pytest.mark.parametrize("duration_s", [1.0, 60.0])
@pytest.mark.parametrize("name", WRONG_TIMES)
def test_wrong_time_changes_no_state(name: str, duration_s: float) -> None:
    """GIVEN settled flight WHEN stamps are wrong for a while THEN state, covariances, clock, bound and flag are at
    every tick, to the bit, those of a flight that never got the frames; the frames are counted as wrong in time, and
    true time is accepted with its first fix, within 1.2 s of the fault's end (10 s are allowed).
    """
    kind, more, delay_s = WRONG_TIMES[name]
    flight = flown(*settings(duration_s, fault(kind, START_S, duration_s, **more)))
    target = "sync" if kind == "sync_jump" else "position+velocity" if more.get("target") else "all"
    twin = deaf_twin(START_S + delay_s, duration_s, target)
    assert flight.fingerprints == twin.fingerprints
    for field in ("t_gps_ns", "r_gcrf_m", "v_gcrf_mps", "bound_m", "flag", "mode", "fix_age_s", "validity"):
        assert flight.flown[field].tobytes() == twin.flown[field].tobytes(), field

    affected = int(duration_s - delay_s) * (1 if "only" in name else 2)
    assert set(flight.counts) <= TIME_CAUSES | {"LOST_FRAMES"}
    counted = sum(flight.counts[cause] for cause in flight.counts if cause in TIME_CAUSES - {"CLOCK_UNSET"})
    assert counted == affected, flight.counts
    after = flight.seconds >= START_S + duration_s + 1.0
    assert (flight.flown["fix_age_s"][after] < 1.4).all()


@pytest.mark.parametrize("name", ["jump of 1 ms", "jump of 1 s", "jump of 1 ms, pulses only", "leap second"])
def test_wrong_time_is_announced(name: str) -> None:
    """WHEN a stamp disagrees with the onboard clock THEN the alert TIME_JUMP_REJECTED is raised in that tick."""
    kind, more, _ = WRONG_TIMES[name]
    flight = flown(*settings(1.0, fault(kind, START_S, 1.0, **more)))
    rows = flight.loop.events.records
    told = rows[rows["alert_id"] == AlertId.TIME_JUMP_REJECTED]
    if name == "jump of 1 s":
        assert {"TIME_FUTURE", "SYNC_JUMP"} <= set(flight.counts)
    assert len(told) >= 1
    assert abs((told["t_gps_ns"][0] - flight.world.t_start_gps_ns) / 1e9 - START_S) < 0.5


def test_frames_held_up_for_longer_than_latency_allows_are_stale() -> None:
    """GIVEN fixes that arrive 5 s late THEN they are counted stale, change nothing, and autonomy begins after 3 s."""
    flight = flown("time.duration_s=70", faults(fault("late", START_S, 8.0, value=5.0, target="position")))
    twin = flown(
        "time.duration_s=70",
        faults(
            fault("frame_drop", START_S, 8.0, target="position"), fault("frame_drop", START_S, 8.0, target="velocity")
        ),
    )
    assert flight.fingerprints[: 10 * 45] == twin.fingerprints[: 10 * 45]
    assert np.isfinite(flight.error_m()[-1])
    assert flight.counts.get("TIME_STALE", 0) + flight.counts.get("TIME_REPEATED", 0) >= 3


def test_a_wrong_clock_from_the_start_is_found_out() -> None:
    """GIVEN a receiver whose time is wrong by an hour from power-up WHEN true time comes THEN flight does not follow at
    once, restarts its clock from pulses that agree for as long as the table asks, and flies on with true time.

    Expected: 20 pulses (set in the table) after the change the clock is restarted, the alert and the flag are raised,
    and the error is that of the fixes again.
    """
    flight = flown(
        "time.duration_s=150",
        "flight.table.clock_restart_pulses=20",
        faults(fault("time_jump", 0.0, 30.0, value=3600.0)),
    )
    alerts = flight.loop.events.records["alert_id"]
    assert AlertId.CLOCK_REINITIALISED in alerts
    error_m = flight.error_m()
    assert error_m[-300:].max() < 30.0
    stamps_s = (flight.flown["t_gps_ns"] - flight.world.t_true_gps_ns) / 1e9
    assert stamps_s[250] == pytest.approx(3600.0, abs=1e-3)
    assert stamps_s[-1] == pytest.approx(0.0, abs=1e-5)
    restarted = int(np.flatnonzero(np.abs(stamps_s[100:]) < 1.0)[0]) + 100
    assert flight.seconds[restarted] == pytest.approx(50.2, abs=1.5)
    assert (flight.flown["flag"][restarted : restarted + 200] == 1).all()


LASTING_S = 300.0  # clock_restart_pulses of the schema, at one a second


@pytest.mark.parametrize(("jump_s", "outage_s"), [(2e-5, 0.0), (-5e-5, 0.0), (1e-3, 0.0), (1e-2, 60.0), (1e-3, 2000.0)])
def test_a_lasting_jump_of_time_is_never_taken_in_silence(jump_s: float, outage_s: float) -> None:
    """GIVEN flight on a calibrated clock, or just back from an outage WHEN GPS time has jumped for good THEN its own
    time stays where it was for 300 s of pulses that agree; then the alert and the flag say that time was set anew, and
    until then the published state is never moved by what the jump is along the track (0.15 m to 76 m).
    """
    start_s = 100.0 + outage_s
    outage = f"outage=[{{start_s=100.0, duration_s={outage_s}}}]" if outage_s else "outage=[]"
    duration_s = start_s + LASTING_S + 20.0
    flight = flown(f"time.duration_s={duration_s}", outage, faults(fault("time_jump", start_s, 1e4, value=jump_s)))
    rows = flight.loop.events.records
    told = rows[rows["alert_id"] == AlertId.CLOCK_REINITIALISED]["t_gps_ns"]
    assert len(told) == 1
    restarted = int(np.flatnonzero(flight.seconds >= start_s + LASTING_S - 3.0)[0])
    stamps_s = (flight.flown["t_gps_ns"] - flight.world.t_true_gps_ns) / 1e9
    settled = flight.seconds >= 20.0
    before = settled & (np.arange(flight.k) < restarted)
    # the simulated oscillator walks 1e-10 s in a second; its drift is known to some 1e-9
    assert np.abs(stamps_s[before]).max() < 1e-6 + 3e-9 * outage_s
    assert stamps_s[-1] == pytest.approx(jump_s, abs=2e-6)
    assert AlertId.TIME_JUMP_REJECTED in rows["alert_id"]
    after = int(np.flatnonzero(np.abs(stamps_s[restarted:] - jump_s) < 5e-6)[0]) + restarted
    assert (flight.flown["flag"][after : after + 50] == 1).all()
