"""Alive counters, lost and repeated frames, a receiver that starts anew, floods: what is used and what is counted."""

import numpy as np
import pytest
from harness import Flight, Telemetry, fault, faults, flown, frame, load, reseal

from flightsw.icd.enums import RejectCause

SYNC, POSITION, VELOCITY = 0x100, 0x110, 0x111


@pytest.fixture(scope="module")
def clean() -> Flight:
    return flown()


@pytest.mark.parametrize("skipped", [1, 3, 200])
def test_a_skipped_counter_counts_a_loss_and_the_frame_is_used(clean: Flight, skipped: int) -> None:
    """GIVEN counters that jump ahead once WHEN CRC, age and content pass THEN state is that of the clean flight."""
    flight = flown(faults(fault("skip_counter", 30, value=skipped)))
    assert flight.fingerprints == clean.fingerprints
    assert flight.counts == {**clean.counts, "LOST_FRAMES": 3 * skipped}
    assert flight.loop.receiver.accepted == clean.loop.receiver.accepted


def test_lost_frames_are_counted_by_the_gap_they_leave() -> None:
    """GIVEN 5 lost positions THEN 5 are missed in the counter, 5 velocities wait in vain, and no state is touched."""
    flight = flown(faults(fault("frame_drop", 30, 5, target="position")))
    assert flight.counts["LOST_FRAMES"] == 5
    assert flight.counts["INCOMPLETE_EPOCH"] == 5
    assert np.nanmax(flight.flown["fix_age_s"]) == pytest.approx(6.1, abs=0.11)


def test_repeated_counters_are_dropped(clean: Flight) -> None:
    """GIVEN frames whose counter stands still for 5 s THEN they are dropped as repeated: the flight is deaf to them."""
    flight = flown(faults(fault("repeat_counter", 30, 5)))
    deaf = flown(faults(fault("frame_drop", 30, 5)))
    assert flight.fingerprints == deaf.fingerprints
    assert flight.counts == {**clean.counts, "REPEATED_COUNTER": 15}


def test_every_frame_sent_twice_is_used_once(clean: Flight) -> None:
    """GIVEN a bus that delivers each frame twice THEN each copy is counted and the flight is the clean one."""
    with Flight(load()) as flight:
        while flight.k < flight.world.n_ticks:
            for frame_id, payload in flight.world.frames_due(flight.k):
                flight.put(frame_id, payload)
                flight.put(frame_id, payload)
            flight.tick(with_world=False)
    assert flight.fingerprints == clean.fingerprints
    assert flight.counts == {**clean.counts, "REPEATED_COUNTER": clean.loop.receiver.accepted}


@pytest.mark.parametrize("silence_s", [0.0, 1.0, 7.0, 20.0])
@pytest.mark.parametrize("start_s", [30.0, 31.0, 257.0])
def test_a_receiver_that_resets_is_understood_within_three_frames(start_s: float, silence_s: float) -> None:
    """GIVEN a receiver, silent for a while, whose counters begin again at zero THEN its third frame at latest is used.

    Expected: the first is, but where the last counter before the reset was zero as well (at 257 s): then the second.
    """
    flight = flown(f"time.duration_s={start_s + silence_s + 20}", faults(fault("receiver_reset", start_s, silence_s)))
    first_again_s = start_s + silence_s + 0.2
    meets = start_s == 257.0
    used = flight.seconds >= first_again_s + (1.0 if meets else 0.0) + 0.15
    assert (flight.flown["fix_age_s"][used] < 1.4).all()
    assert flight.counts.get("REPEATED_COUNTER", 0) == (3 if meets else 0)
    assert flight.error_m()[-1] < 30.0


def test_halves_of_different_fixes_are_never_joined(clean: Flight) -> None:
    """GIVEN every other velocity lost THEN no position is ever joined with the velocity of another second."""
    drops = [fault("frame_drop", second, 1, target="velocity") for second in range(20, 40, 2)]
    flight = flown(faults(*drops))
    assert flight.counts["INCOMPLETE_EPOCH"] == 10
    used = flight.nav["fixes_accepted"][0]
    assert used == clean.nav["fixes_accepted"][0] - 10
    assert "GATE" not in flight.counts


def test_halves_may_come_in_either_order_and_in_different_ticks(clean: Flight) -> None:
    """GIVEN velocities before their positions, and positions one tick later THEN the same fixes are used."""
    with Flight(load()) as flight:
        held: list[tuple[int, bytes]] = []
        while flight.k < flight.world.n_ticks:
            for frame_id, payload in held:
                flight.put(frame_id, payload)
            due = flight.world.frames_due(flight.k)
            held = [one for one in due if one[0] == POSITION]
            for frame_id, payload in due:
                if frame_id != POSITION:
                    flight.put(frame_id, payload)
            flight.tick(with_world=False)
    assert flight.nav["x"].tobytes() == clean.nav["x"].tobytes()
    assert flight.nav["P"].tobytes() == clean.nav["P"].tobytes()
    assert flight.counts == clean.counts


def test_a_flood_is_drained_in_bounded_portions() -> None:
    """GIVEN 2000 frames on the bus in one tick WHEN the table drains 64 a tick THEN each tick takes 64, none is lost to
    flight, and the navigation step runs in every tick.
    """
    with Flight(load("flight.table.drain_frames_max=64")) as flight:
        flight.fly(30.0)
        before = flight.loop.receiver.received
        for _ in range(2000):
            flight.put(0x7AA, b"flood")
        taken = []
        for _ in range(40):
            at = flight.loop.receiver.received
            flight.tick()
            taken.append(flight.loop.receiver.received - at)
        assert max(taken) == 64
        assert taken[:31] == [64] * 31
        assert flight.loop.receiver.received - before == 2000 + flight.world.frames_sent - before
        assert flight.counts["UNKNOWN_ID"] == 2000
        flight.fly()
    assert flight.flown["mode"][-1] == 1
    assert flight.flown["fix_age_s"][-1] < 1.3
    assert np.diff(flight.flown["t_gps_ns"][30:]).min() > 0


def test_more_epochs_than_a_tick_can_hold_overflow_and_are_counted() -> None:
    """GIVEN 64 pulses in one tick THEN 16 are looked at, 48 counted as overflow, and time is as before."""
    with Flight(load()) as flight:
        flight.fly(30.6)
        before = flight.nav.copy()
        last = flight.nav["clock_counter_ns"][0]
        for n in range(64):
            flight.put(SYNC, frame(SYNC, 100 + n, t_gps_ns=1, t_counter_ns=int(last) + n, sigma_ns=50.0, status=1))
        flight.tick()
        assert flight.counts["RECEIVE_OVERFLOW"] == 48
        assert flight.counts["SYNC_JUMP"] == 16
        for field in ("clock_gps_ns", "clock_drift", "clock_phase_ns", "x", "P"):
            assert flight.nav[field].tobytes() == before[field].tobytes()


@pytest.mark.parametrize(
    "kind",
    [
        {"is_extended_id": True},
        {"is_remote_frame": True, "is_fd": False, "bitrate_switch": False},
        {"is_error_frame": True},
    ],
)
def test_frames_of_another_sort_are_counted_and_nothing_else(clean: Flight, kind: dict) -> None:
    """GIVEN extended, remote or error frames under flight's identifiers THEN they count as unknown identifiers."""
    with Flight(load()) as flight:
        for _ in range(300):
            flight.put(POSITION, b"" if "is_remote_frame" in kind else bytes(8), **kind)
            flight.tick()
        flight.fly()
    assert flight.fingerprints == clean.fingerprints
    assert flight.counts == {**clean.counts, "UNKNOWN_ID": 300}


def test_what_is_refused_is_told_by_cause(clean: Flight) -> None:
    """GIVEN one frame of each sort of damage THEN LEONAV_COUNTERS shows each under its cause, and the totals agree."""
    sink = Telemetry()
    with Flight(load("flight.table.rate_counters_ticks=1"), sink=sink) as flight:
        flight.fly(30.6)
        good = frame(POSITION, 200, t_gps_ns=5)
        flight.put(POSITION, good[:-1])
        flight.put(POSITION, good[:-2] + bytes([good[-2] ^ 1, good[-1]]))
        flight.put(VELOCITY, good)
        flight.put(0x123, good)
        flight.put(SYNC, frame(SYNC, 200, status=0, t_gps_ns=5, sigma_ns=50.0))
        flight.put(SYNC, reseal(SYNC, frame(SYNC, 200, status=0), 200))
        flight.tick()
    told = sink.of("LEONAV_COUNTERS")[-1]
    counts = {cause.name: told.rejected[cause] for cause in RejectCause if told.rejected[cause]}
    assert counts == flight.counts
    assert counts == {
        **clean.counts,
        "BAD_LENGTH": 1,
        "BAD_CRC": 2,
        "UNKNOWN_ID": 1,
        "SYNC_INVALID": 1,
        "REPEATED_COUNTER": 1,
        "LOST_FRAMES": 200 - 30 - 1,
    }
    assert told.received == flight.loop.receiver.received
    assert told.accepted == flight.loop.receiver.accepted
    beats = [payload for _, frame_id, payload in flight.published if frame_id == 0x202]
    assert int.from_bytes(beats[-1][20:24], "little") == sum(counts.values())


def test_a_fix_refused_before_the_filter_has_no_innovation() -> None:
    """GIVEN a good fix, then one of NaN THEN LEONAV_INNOVATION of the second tells its cause and not the numbers of the
    first.
    """
    sink = Telemetry()
    with Flight(load("flight.table.rate_status_ticks=1", faults(fault("nan", 30, 5))), sink=sink) as flight:
        flight.fly(32.0)
    told = sink.of("LEONAV_INNOVATION")
    good, bad = told[280], told[-1]
    assert (good.used, good.cause) == (1, 0xFF)
    assert 0.0 < good.nis < 60.0
    assert (bad.used, bad.cause) == (0, RejectCause.NOT_FINITE)
    assert np.isnan([bad.nis, *bad.innovation, *bad.sigma]).all()
    assert bad.t_gps_ns > good.t_gps_ns
