"""Outage, failure flag, return to service: ages, latch, conditions to clear, and how soon the news is out."""

import struct
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from harness import Flight, Telemetry, fault, faults, flown, load, read_tlog

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import DaSource, FlagState, Mode, Validity, Verdict

OUTAGE = "outage=[{start_s=60.0, duration_s=40.0}]"
LONG = "outage=[{start_s=60.0, duration_s=600.0}]"
NO_LIMIT = "flight.table.limit_m=1e6"
BACK_S = 660.0


@cache
def soon() -> tuple[str, str]:
    """A limit that the bound passes halfway through the long outage and never before, whatever the set's tuning."""
    bound_m = flown("time.duration_s=661", LONG, NO_LIMIT).flown["bound_m"]
    limit_m = float(bound_m[3600])
    assert np.nanmax(bound_m[:3000]) < limit_m < bound_m[6500]
    return f"flight.table.limit_m={limit_m}", f"flight.table.clear_limit_m={limit_m}"


def first(flags: np.ndarray) -> int:
    found = np.flatnonzero(flags)
    assert len(found), "never happened"
    return int(found[0])


def test_autonomous_after_the_time_out_and_ages_from_the_last_accepted_fix() -> None:
    """GIVEN an outage at 60 s WHEN 3 s have passed since the fix of 59 s THEN AUTONOMOUS, and both ages count from
    that fix; fixes come back at 100.2 s and the mode is INTEGRATED after the third.
    """
    flight = flown("time.duration_s=120", OUTAGE)
    mode, age_s, outage_s = (flight.flown[name] for name in ("mode", "fix_age_s", "outage_age_s"))
    seconds = flight.seconds
    last_fix_s = 59.0
    expected_s = seconds - last_fix_s
    inside = (seconds >= 60.5) & (seconds <= 100.1)
    assert age_s[inside] == pytest.approx(expected_s[inside], abs=1e-3)
    assert seconds[60 * 10 + first(mode[600:] == Mode.AUTONOMOUS)] == pytest.approx(62.1, abs=0.11)
    coasting = (seconds >= 62.2) & (seconds <= 100.1)
    assert (mode[coasting] == Mode.AUTONOMOUS).all()
    assert outage_s[coasting] == pytest.approx(expected_s[coasting], abs=1e-3)
    assert (outage_s[(seconds > 4) & (seconds < 62)] == 0.0).all()
    again = (seconds >= 100.4) & (seconds < 102.1)
    assert (mode[again] == Mode.AUTONOMOUS).all()
    assert (outage_s[again] == 0.0).all()
    assert (mode[seconds >= 102.4] == Mode.INTEGRATED).all()
    alerts = flight.loop.events.records
    told = {int(i): [int(a) for a in alerts["active"][alerts["alert_id"] == i]] for i in set(alerts["alert_id"])}
    assert told[AlertId.OUTAGE_START] == [1, 0]


@pytest.mark.parametrize(
    ("entry", "cause"),
    [
        (fault("nan", 30, 20), "NOT_FINITE"),
        (fault("absurd", 30, 20), "OUT_OF_RANGE"),
        (fault("bit_flip", 30, 20, target="position"), "BAD_CRC"),
        (fault("position_step", 30, 9, value=3000.0), "GATE"),
        (fault("velocity_step", 30, 9, value=30.0), "GATE"),
    ],
)
def test_autonomous_also_when_fixes_arrive_but_are_refused(entry: str, cause: str) -> None:
    """GIVEN fixes that keep coming and are all refused THEN the outage began with the last accepted one, as if there
    were none: AUTONOMOUS 3 s after it, age growing, state the model's.
    """
    flight = flown(faults(entry))
    seconds, age_s, mode = flight.seconds, flight.flown["fix_age_s"], flight.flown["mode"]
    inside = (seconds >= 32.2) & (seconds <= 38.9)
    assert flight.counts[cause] >= 9
    assert (mode[inside] == Mode.AUTONOMOUS).all()
    assert age_s[inside] == pytest.approx(seconds[inside] - 29.0, abs=1e-3)
    assert flight.flown["outage_age_s"][inside] == pytest.approx(seconds[inside] - 29.0, abs=1e-3)
    assert flight.error_m()[inside].max() < 30.0


def test_flag_latches_while_the_bound_falls_back() -> None:
    """GIVEN an outage of an orbit, in which the bound of (12) falls back by a quarter as the orbit turns, and a limit
    just below a peak WHEN the bound is below the limit and the limit to clear again THEN the flag stays up, the mode
    FAILED, the age of the flag as it was: no fix, no all-clear.
    """
    settings = (
        "time.duration_s=6600",
        "outage=[{start_s=600.0, duration_s=5900.0}]",
        "flight.table.tick_period_ns=1000000000",
        "flight.table.latency_max_s=3.0",
    )
    outage = slice(610, 6490)
    bound_m = flown(*settings, NO_LIMIT).flown["bound_m"][outage]
    low = int(np.argmin(bound_m / np.maximum.accumulate(bound_m)))
    peak = int(np.argmax(bound_m[:low]))
    assert bound_m[low] < 0.9 * bound_m[peak], "the bound of this table does not fall back: choose another case"
    limit_m = 0.99 * bound_m[peak]
    flight = flown(*settings, f"flight.table.limit_m={limit_m}", f"flight.table.clear_limit_m={limit_m}")
    flags = flight.flown["flag"][outage]
    raised = first(flags == FlagState.RAISED)
    assert raised <= peak
    assert np.count_nonzero(flight.flown["bound_m"][outage][raised:] < limit_m) > 100
    assert (flags[raised:] == FlagState.RAISED).all()
    assert (flight.flown["mode"][outage][raised:] == Mode.FAILED).all()
    assert len(set(flight.flown["flag_age_s"][outage][raised:])) == 1


@pytest.mark.parametrize(
    ("condition", "after_fixes"),
    [
        ("flight.table.clear_fixes=30", 30),
        ("flight.table.clear_fixes=45", 45),
        ("flight.table.clear_limit_m=0.1", None),
        ("flight.table.clear_nis_high=0.001", None),
        ("flight.table.clear_nis_low=2.9", None),
    ],
)
def test_the_flag_clears_by_bound_count_and_consistency_together(condition: str, after_fixes: int | None) -> None:
    """GIVEN a flag raised in an outage WHEN fixes return THEN it clears with the 30th accepted fix in a row (or as many
    as the table asks), and never while bound or mean NIS are not where the table wants them.
    """
    flight = flown("time.duration_s=730", LONG, *soon(), condition)
    flags, seconds = flight.flown["flag"], flight.seconds
    assert 3500 < first(flags == FlagState.RAISED) < 3700
    after = seconds >= BACK_S + 0.4
    assert (flight.flown["validity"][flags == FlagState.RAISED] & Validity.STATE_VALID == 0).all()
    if after_fixes is None:
        assert (flags[after] == FlagState.RAISED).all()
        assert (flight.flown["mode"][after] == Mode.FAILED).all()
        return
    cleared = first((flags == FlagState.CLEAR) & after)
    assert seconds[cleared] == pytest.approx(BACK_S + after_fixes - 1 + 0.25, abs=0.11)
    assert flight.flown["streak"][cleared] == after_fixes
    assert (flags[cleared:] == FlagState.CLEAR).all()
    assert (flight.flown["mode"][cleared:] == Mode.INTEGRATED).all()
    assert np.isnan(flight.flown["flag_age_s"][cleared:]).all()


def test_one_rejected_fix_begins_the_count_anew() -> None:
    """GIVEN 20 good fixes, one far off, then good ones THEN the flag clears 30 good fixes after the bad one."""
    flight = flown("time.duration_s=730", LONG, *soon(), faults(fault("position_step", 680, 1, value=5e4)))
    assert flight.counts["GATE"] == 1
    cleared = first((flight.flown["flag"] == FlagState.CLEAR) & (flight.seconds >= BACK_S + 0.4))
    assert flight.seconds[cleared] == pytest.approx(680.0 + 30 + 0.25, abs=0.11)


def test_the_alert_leaves_in_the_tick_in_which_the_flag_is_raised(tmp_path: Path) -> None:
    """GIVEN an outage WHEN INTEGRITY on the bus first shows the flag THEN in the same tick LEONAV_ALERT and its text
    are in link.tlog, in the same tick the state loses its validity, and the bound on the bus is above the limit.
    """
    with Flight(load("time.duration_s=400", LONG, *soon()), tmp_path) as flight:
        flight.fly()
    flags = [(tick, payload) for tick, frame_id, payload in flight.published if frame_id == 0x201]
    tick, payload = next((tick, payload) for tick, payload in flags if payload[49] == FlagState.RAISED)
    bound_m, limit_m = struct.unpack_from("<df", payload, 8)
    assert bound_m > limit_m
    assert payload[50] == Verdict.DO_NOT_USE
    nav = next(p for t, frame_id, p in flight.published if frame_id == 0x200 and t == tick)
    assert nav[57] & Validity.STATE_VALID == 0

    stamps = [
        line.split()[0].strip("()") for line in (tmp_path / "can.log").read_text().splitlines() if " 201##" in line
    ]
    tick_us = round(float(stamps[tick]) * 1e6)
    tlog = read_tlog(tmp_path / "link.tlog")
    alerts = [(us, m) for us, m in tlog if m.get_type() == "LEONAV_ALERT" and m.alert_id == AlertId.FLAG_RAISED]
    assert [(us, m.active) for us, m in alerts] == [(tick_us, 1)]
    assert alerts[0][1].value == bound_m
    texts = [us for us, m in tlog if m.get_type() == "STATUSTEXT" and "above the limit" in m.text]
    assert texts == [tick_us]


def test_sequence_numbers_of_alerts_have_no_gaps() -> None:
    sink = Telemetry()
    with Flight(load("time.duration_s=730", LONG, *soon()), sink=sink) as flight:
        flight.fly()
    assert [m.sequence for m in sink.of("LEONAV_ALERT")] == list(range(1, flight.loop.events.sequence + 1))
    sequence = [m.get_header().seq for m in sink]
    assert sequence == [n % 256 for n in range(len(sequence))]


@pytest.mark.parametrize("covered", [True, False])
def test_a_missing_stretch_of_stored_da_is_told_and_not_read_as_zero(covered: bool) -> None:
    """GIVEN less than an orbit of fixes WHEN the outage leads into a part of the orbit never flown THEN dA is held, not
    zero, the source says HELD and the alert STORED_DA_MISSING is up; without stored dA at all it is up at once.
    """
    after = 30 if covered else 10000
    flight = flown(
        "time.duration_s=400",
        "outage=[{start_s=300.0, duration_s=90.0}]",
        f"flight.table.stored_da_after_fixes={after}",
        "flight.table.gravity_model=0",
    )
    inside = (flight.seconds > 306) & (flight.seconds < 389)
    if covered:
        assert (flight.flown["da_coverage_pct"][inside] > 0).all()
    else:
        assert (flight.flown["da_coverage_pct"] == 0).all()
    held = inside & (flight.seconds > 330)
    assert (flight.flown["da_source"][held] == DaSource.HELD).all()
    da_mps2 = flight.flown["da_gcrf_mps2"]
    assert np.linalg.norm(da_mps2[held], axis=1).min() > 1e-4  # J2 unmodelled is some 1e-2 m/s2
    assert len({row.tobytes() for row in da_mps2[held]}) == 1
    bit = 1 << AlertId.STORED_DA_MISSING
    assert (flight.flown["alerts"][held] & bit != 0).all()
    assert (flight.flown["alerts"][flight.seconds < 299] & bit == 0).all()


def test_a_bound_that_cannot_be_had_is_stale_not_healthy() -> None:
    """GIVEN a loop that stood still for ten minutes and whose chain catches up 256 steps a call THEN until it has
    caught up the flag says STALE, the verdict DO_NOT_USE, the alert BOUND_STALE; afterwards the bound is back.
    """
    with Flight(
        load("time.duration_s=700", "outage=[{start_s=60.0, duration_s=640.0}]", "flight.table.limit_m=1e6")
    ) as flight:
        flight.fly(62.0)
        flight.k = round(662.0 * 10)
        flight.tick()
        stale = flight.at_ticks[flight.k - 1]
        assert (stale["flag"], stale["verdict"]) == (FlagState.STALE, Verdict.DO_NOT_USE)
        assert stale["validity"] & Validity.STATE_VALID == 0
        assert stale["alerts"] & (1 << AlertId.BOUND_STALE)
        for _ in range(3):
            flight.tick()
    now = flight.at_ticks[flight.k - 1]
    assert (now["flag"], now["verdict"]) == (FlagState.CLEAR, Verdict.TRUSTED_COASTING)
    error_m = np.abs(now["r_gcrf_m"] - flight.world.r_true_gcrf_m[flight.k - 1]).max()
    assert error_m < now["bound_m"]
