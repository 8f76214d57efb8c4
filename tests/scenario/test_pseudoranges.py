"""Pseudoranges through CAN, consistency test, exclusion and filter: faulty satellites are named and do no harm."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from gnss_bench import Row, Sender, checks, measured, satellites
from harness import Flight, fault, faults, flown, load

from flightsw.icd.alerts import AlertId
from flightsw.icd.can_frames import GNSS_EPOCH, INTEGRITY
from flightsw.icd.enums import GnssVerdict, Mode

START_S, STOP_S = 180.0, 240.0
FAULTS = (
    f'{{kind="step", constellation="gps", count=1, start_s={START_S}, duration_s=60.0, value=40.0}}',
    f'{{kind="step", constellation="glonass", count=1, start_s={START_S}, duration_s=60.0, value=-80.0}}',
    f'{{kind="step", constellation="galileo", count=1, start_s={START_S}, duration_s=60.0, value=60.0}}',
)
NO_TEST = 'flight.function_table.gnss={consistency="none"}'
ONE_RAMP = ('{kind="ramp", constellation="gps", count=1, start_s=180.0, duration_s=90.0, value=1.0}',)


@cache
def flight_with(entries: tuple[str, ...], *settings: str) -> Flight:
    """Five minutes of the scenario with these faults of satellites."""
    wrong = f"satellite_fault=[{', '.join(entries)}]"
    return flown("time.duration_s=300", wrong, *settings, name="gnss_faults")


def error_m(flight: Flight) -> np.ndarray:
    """Largest-axis error at the ticks from the fault's begin on."""
    return flight.error_m()[flight.seconds >= START_S]


def struck(flight: Flight) -> set[str]:
    """The satellites that the world has made wrong by more than noise, from its own record."""
    clean = flight_with(())
    raw, good = flight.world.raw, clean.world.raw
    assert raw is not None
    assert good is not None
    wrong = np.abs(raw.range_m - good.range_m).max(axis=0) > 1.0
    return {"GREC"[raw.system[s]] + str(raw.number[s]) for s in np.flatnonzero(wrong)}


def alert_words(flight: Flight) -> list[int]:
    """The word of alerts that the other onboard systems heard, by tick."""
    at = slice(*(INTEGRITY.dtype.fields["alerts"][1] + k for k in (0, 8)))
    return [int.from_bytes(data[at], "little") for _, found, data in flight.published if found == INTEGRITY.frame_id]


def test_a_receiver_of_pseudoranges_navigates_as_one_of_fixes_does() -> None:
    """GIVEN GPS, GLONASS and Galileo of 1 m THEN every epoch but those of false alarm gives a fix, the filter takes it
    with an NIS of 3 degrees of freedom, and the position is better than a metre.
    """
    flight = flight_with(())
    found = checks(flight)
    assert len(found) == 299
    assert np.count_nonzero(found["gnss_verdict"] != GnssVerdict.CONSISTENT) <= 3
    assert error_m(flight).max() <= 0.5
    assert flight.out["mode"][0] == Mode.INTEGRATED
    used = flight.flown[(flight.flown["fix_seen"] == 1) & (flight.seconds > 100.0)]
    assert used["fix_used"].all()
    assert 2.4 <= used["nis"].mean() <= 3.6
    # the pace of the frames leaves room: the drain limit of a tick is never reached
    assert "RECEIVE_OVERFLOW" not in flight.counts


def test_three_faulty_satellites_are_named_at_once_and_do_no_harm() -> None:
    """GIVEN three satellites wrong by 40 to 80 m for a minute THEN from the first epoch on they and no others are left
    out, the alert is up within four seconds and over half a minute after the last, and the error stays what it is
    without faults (0.1 m more at most).
    """
    flight = flight_with(FAULTS)
    found, out = checks(flight), satellites(flight)
    raw = flight.world.raw
    assert raw is not None
    age_s = (raw.t_true_gps_ns - flight.world.t_start_gps_ns) / 1e9
    during = np.flatnonzero((age_s >= START_S) & (age_s < STOP_S))
    assert len(struck(flight)) == 3
    exact = [k for k in during if out[k] == struck(flight)]
    assert exact[0] == during[0]
    assert len(exact) >= len(during) - 1
    assert found["offered"][during].sum() >= len(during) - 1
    warned_s = flight.seconds[[bool(alerts >> AlertId.GNSS_EXCLUDED & 1) for alerts in alert_words(flight)]]
    assert START_S < warned_s[0] <= START_S + 4.0
    events = flight.loop.events.newest_first()
    raised = events[(events["alert_id"] == AlertId.GNSS_EXCLUDED) & (events["active"] == 1)]
    assert raised["value"].tolist() == [3.0]  # satellites left out, not navigation's bound
    assert STOP_S + 25.0 <= warned_s[-1] <= STOP_S + 35.0
    assert error_m(flight).max() <= error_m(flight_with(())).max() + 0.1


def test_without_the_test_the_same_faults_end_aiding() -> None:
    """GIVEN the same faults and no consistency test THEN nothing is left out, the filter's gate refuses the fixes of
    that minute, and navigation goes on alone; with it, no fix is refused.
    """
    flight, tested = flight_with(FAULTS, NO_TEST), flight_with(FAULTS)
    assert not any(satellites(flight))
    refused = [f.counts.get("GATE", 0) + f.counts.get("STARTING", 0) for f in (flight, tested)]
    assert refused[0] >= 55
    assert refused[1] == 0
    assert flight.flown["mode"].max() >= Mode.AUTONOMOUS
    assert tested.flown["mode"].max() == Mode.INTEGRATED


def test_a_ramp_is_named_before_it_has_moved_the_state() -> None:
    """GIVEN a satellite that runs away by 1 m/s THEN it is left out within 10 s, and the error stays as without; where
    there is no consistency test the filter follows it, and the error is ten times as large.
    """
    flight = flight_with(ONE_RAMP)
    out = satellites(flight)
    raw = flight.world.raw
    assert raw is not None
    age_s = (raw.t_true_gps_ns - flight.world.t_start_gps_ns) / 1e9
    named = next(k for k, names in enumerate(out) if age_s[k] >= START_S and names == struck(flight))
    assert age_s[named] <= START_S + 10.0
    assert error_m(flight).max() <= error_m(flight_with(())).max() + 0.1
    assert error_m(flight_with(ONE_RAMP, NO_TEST)).max() >= 10.0 * error_m(flight).max()


def test_the_solution_begins_at_the_predicted_place_while_that_is_trusted() -> None:
    """GIVEN a flight that navigates THEN its epochs are solved from within 50 km of the fix, in four steps at most;
    before there was a state they began at the centre of the Earth and took more.
    """
    with Flight(load("time.duration_s=120", "satellite_fault=[]", name="gnss_faults")) as flight:
        (function,) = flight.loop._functions
        memory = function._memory  # type: ignore[attr-defined]
        flight.fly(20.0)
        assert memory.epoch["start_known"][0] == 0
        cold = int(memory.result["iterations"][0])
        flight.fly()
        assert memory.epoch["start_known"][0] == 1
        assert np.linalg.norm(memory.epoch["start_m"][0] - memory.result["r_m"][0]) <= 50e3
        assert memory.result["iterations"][0] <= 4 < cold


@cache
def settled() -> Flight:
    """A flight that navigates, and from then on hears the test alone."""
    with Flight(load("time.duration_s=200", "satellite_fault=[]", name="gnss_faults")) as flight:
        flight.fly(100.0)
        play(flight)
    return flight


VERDICTS: dict[str, tuple[int, int]] = {}


def play(flight: Flight) -> None:
    """Every bad input that must have a verdict, one epoch each; VERDICTS: name -> (verdict, offered)."""
    sender, rng = Sender(flight), np.random.default_rng(5)
    rows = measured(flight, 101)
    nan = float("nan")
    unknown = [Row(3, k + 1, 2.3e7 + 1e5 * k, 1.0) for k in range(64 - len(rows))]
    bad: dict[str, list[Row]] = {
        "none": [],
        "three": rows[:3],
        "all NaN": [row._replace(range_m=nan) for row in rows],
        "NaN sigma": [row._replace(sigma_m=nan) for row in rows],
        "infinite": [row._replace(range_m=float("inf")) for row in rows],
        "one NaN": [rows[0]._replace(range_m=nan), *rows[1:]],
        "all twice": [*rows, *rows][:64],
        "one twice": [*rows, rows[0]],
        "wrong constellation": [row._replace(system=9) for row in rows],
        "number 0 and 255": [row._replace(number=255 if k % 2 else 0) for k, row in enumerate(rows)],
        "negative sigma": [row._replace(sigma_m=-1.0) for row in rows],
        "64, most without a place": [*rows, *unknown],
        "65": [*rows, *unknown, rows[0]],
        "all faulty": [row._replace(range_m=row.range_m + rng.uniform(-5e3, 5e3)) for row in rows],
        "all faulty by thousands of km": [row._replace(range_m=float(rng.uniform(1.9e7, 5e7))) for row in rows],
        "huge": [row._replace(range_m=1e300) for row in rows],
    }
    for k, (name, changed) in enumerate(bad.items()):
        before = len(checks(flight))
        sender.epoch(101 + k, _carried(flight, changed, rows, 101 + k))
        after = checks(flight)
        assert len(after) == before + 1, name
        VERDICTS[name] = (int(after["gnss_verdict"][-1]), int(after["offered"][-1]))


def _carried(flight: Flight, changed: list[Row], rows: list[Row], epoch: int) -> list[Row]:
    """The rows as they are at another epoch: what was changed stays changed by as much."""
    then = {(row.system, row.number): row.range_m for row in rows}
    now = {(row.system, row.number): row.range_m for row in measured(flight, epoch)}
    return [
        row._replace(range_m=row.range_m + now.get((row.system, row.number), 0.0) - then[row.system, row.number])
        if (row.system, row.number) in then and (row.system, row.number) in now
        else row
        for row in changed
    ]


@pytest.mark.parametrize(
    ("name", "verdict", "offered"),
    [
        ("none", GnssVerdict.TOO_FEW, 0),
        ("three", GnssVerdict.TOO_FEW, 0),
        ("all NaN", GnssVerdict.TOO_FEW, 0),
        ("NaN sigma", GnssVerdict.TOO_FEW, 0),
        ("infinite", GnssVerdict.TOO_FEW, 0),
        ("one NaN", GnssVerdict.CONSISTENT, 1),
        ("one twice", GnssVerdict.CONSISTENT, 1),
        ("all twice", GnssVerdict.TOO_FEW, 0),
        ("wrong constellation", GnssVerdict.TOO_FEW, 0),
        ("number 0 and 255", GnssVerdict.TOO_FEW, 0),
        ("negative sigma", GnssVerdict.TOO_FEW, 0),
        ("64, most without a place", GnssVerdict.CONSISTENT, 1),
        ("65", GnssVerdict.TOO_MANY, 0),
        ("all faulty", GnssVerdict.INCONSISTENT, 0),
        ("huge", GnssVerdict.TOO_FEW, 0),
    ],
)
def test_every_bad_input_has_a_clear_verdict(name: str, verdict: GnssVerdict, offered: int) -> None:
    """GIVEN a flight that navigates WHEN the bus brings it this epoch THEN it says this verdict, and goes on."""
    flight = settled()
    assert VERDICTS[name] == (verdict, offered)
    assert flight.out["mode"][0] in (Mode.INTEGRATED, Mode.AUTONOMOUS)


def test_all_faulty_by_thousands_of_kilometres_gives_no_fix() -> None:
    """GIVEN ranges that fit no place THEN whatever the words, nothing is handed to navigation."""
    settled()
    verdict, offered = VERDICTS["all faulty by thousands of km"]
    assert verdict in (GnssVerdict.INCONSISTENT, GnssVerdict.NO_SOLUTION, GnssVerdict.TOO_FEW)
    assert not offered


def test_incomplete_epochs_are_counted_and_judged_by_nobody() -> None:
    """GIVEN a receiver whose frames vanish now and then THEN what is incomplete is counted, what is whole goes on, and
    an epoch whose ends are lost takes no row of the next.
    """
    dropped = faults(fault("frame_drop", 100, 60, probability=0.1, target="ranges"))
    flight = flown("time.duration_s=200", "satellite_fault=[]", dropped, name="gnss_faults")
    found = checks(flight)
    incomplete = flight.counts["INCOMPLETE_EPOCH"]
    assert 10 <= incomplete <= 60
    assert len(found) + incomplete == 199
    assert set(found["gnss_verdict"].tolist()) <= {GnssVerdict.CONSISTENT, GnssVerdict.EXCLUDED, GnssVerdict.AMBIGUOUS}
    assert flight.error_m()[flight.seconds >= 150.0].max() <= 1.0


@pytest.mark.parametrize(("shift_s", "cause"), [(+2.0, "TIME_FUTURE"), (-3.0, "TIME_STALE")])
def test_an_epoch_of_another_time_is_refused(shift_s: float, cause: str) -> None:
    """GIVEN an epoch latched in the future or seconds ago THEN it is counted under its cause and never judged."""
    with Flight(load("time.duration_s=60", "satellite_fault=[]", name="gnss_faults")) as flight:
        flight.fly(10.0)
        sender, before = Sender(flight), len(checks(flight))
        now_ns = flight.world.counter_ns(flight.k)
        sender.ranges(4711, measured(flight, 9))
        shifted_ns = now_ns + round(shift_s * 1e9)
        sender.put(GNSS_EPOCH.frame_id, t_gps_ns=4711, t_counter_ns=shifted_ns, count=len(measured(flight, 9)))
        flight.tick(with_world=False)
        assert len(checks(flight)) == before
        assert flight.counts[cause] == 1


def test_a_fault_of_a_whole_constellation_is_its_clock() -> None:
    """GIVEN all of Galileo wrong by the same 500 m THEN nothing is left out and nothing moves: it is that clock."""
    common = ('{kind="step", constellation="galileo", start_s=180.0, duration_s=60.0, value=500.0}',)
    flight = flight_with(common)
    assert sum(bool(names) for names in satellites(flight)) <= 3
    assert error_m(flight).max() <= error_m(flight_with(())).max() + 0.1
