"""The two-way link in a whole flight: orders by a station that packs and signs with pymavlink's own code."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from link_bench import GROUND_COMPONENT, GROUND_SYSTEM, Linked, Station
from pymavlink.dialects.v20 import common, development

from flightsw.icd import mavlink as m
from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import FlagState, Mode, RejectCause, Validity, Verdict
from flightsw.icd.table_schema import NAVIGATION
from flightsw.link.parameters import OPERATIONAL, TABLE_PARAMETERS, short_names

ACCEPTED, DENIED = common.MAV_RESULT_ACCEPTED, common.MAV_RESULT_DENIED
FLIGHT_SET = 'flight.table_set="flight"'
OUTAGE = "outage=[{start_s=20.0, duration_s=30.0}]"
FLAG = (
    "outage=[{start_s=20.0, duration_s=30.0}]",
    "flight.table.limit_m=8",
    "flight.table.clear_limit_m=7.9",
)


# -- commands


def test_a_command_is_acknowledged_to_its_sender_in_the_tick_that_takes_it() -> None:
    """GIVEN flight WHEN a signed command waits on the wire THEN the tick that takes it sends the acknowledgement."""
    with Linked() as flight:
        flight.fly(until_s=2.0)
        flight.wire.heard()
        flight.now().command(common.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES)
        flight.tick()
        heard = {message.get_type(): message for message in flight.wire.heard()}
        ack = heard["COMMAND_ACK"]
        assert (ack.command, ack.result) == (520, ACCEPTED)
        assert (ack.target_system, ack.target_component) == (GROUND_SYSTEM, GROUND_COMPONENT)
        version = heard["AUTOPILOT_VERSION"]
        for bit in ("MAVLINK2", "PARAM_FLOAT", "COMMAND_INT", "FTP"):
            assert version.capabilities & getattr(common, f"MAV_PROTOCOL_CAPABILITY_{bit}")
        assert version.flight_sw_version >> 24 == 0
        assert version.flight_sw_version >> 16 & 0xFF == 1


def test_mode_command_inhibits_fixes_and_lets_them_back() -> None:
    """GIVEN flight in INTEGRATED WHEN AUTONOMOUS is ordered THEN it coasts with every fix refused by the operator; WHEN
    INTEGRATED is ordered THEN fixes are accepted again. INIT, FAILED and nonsense are denied."""
    with Linked(FLIGHT_SET) as flight:
        flight.fly(until_s=10.0)
        assert flight.out["mode"][0] == Mode.INTEGRATED
        assert flight.ask(common.MAV_CMD_DO_SET_MODE, 1.0, float(Mode.AUTONOMOUS)) == ACCEPTED
        flight.fly(until_s=20.0)
        assert flight.out["mode"][0] == Mode.AUTONOMOUS
        assert flight.counts[RejectCause.OPERATOR.name] >= 9
        assert flight.ask(common.MAV_CMD_DO_SET_MODE, 1.0, float(Mode.INTEGRATED)) == ACCEPTED
        flight.fly(until_s=30.0)
        assert flight.out["mode"][0] == Mode.INTEGRATED
        for wrong in (float(Mode.INIT), float(Mode.FAILED), 1.5, math.nan, 77.0):
            assert flight.ask(common.MAV_CMD_DO_SET_MODE, 1.0, wrong) == DENIED


def test_one_type_is_edited_and_the_filter_reset() -> None:
    """GIVEN flight WHEN velocities are rejected THEN positions still correct it; WHEN the filter is reset THEN it
    starts anew from the next fixes."""
    with Linked(FLIGHT_SET) as flight:
        flight.fly(until_s=15.0)
        assert flight.ask(m.LEONAV_CMD_EDIT, 1.0, 2.0) == ACCEPTED
        flight.fly(until_s=20.0)
        assert flight.out["mode"][0] == Mode.INTEGRATED
        assert flight.ask(m.LEONAV_CMD_EDIT, 2.0, 0.0) == DENIED
        assert flight.ask(m.LEONAV_CMD_EDIT, 0.0, 4.0) == DENIED
        assert flight.ask(m.LEONAV_CMD_RESET_FILTER) == ACCEPTED
        assert not flight.nav["initialised"][0]
        flight.fly(until_s=35.0)
        assert flight.nav["initialised"][0]


def test_the_papers_filter_edits_nothing_and_says_so() -> None:
    with Linked() as flight:
        flight.fly(until_s=1.0)
        assert flight.ask(m.LEONAV_CMD_EDIT, 0.0, 2.0) == common.MAV_RESULT_UNSUPPORTED
        assert flight.ask(common.MAV_CMD_DO_SET_MODE, 1.0, float(Mode.AUTONOMOUS)) == common.MAV_RESULT_UNSUPPORTED


def test_a_disarmed_flag_is_told_but_does_not_withdraw_the_state() -> None:
    """GIVEN two flights whose flag rises in an outage WHEN one is disarmed before THEN its state stays valid, its
    verdict is never a trusting one, an alert says so; the flag itself, bound and state are those of the other."""
    with Linked(*FLAG) as flight, Linked(*FLAG) as guarded:
        flight.fly(until_s=10.0)
        assert flight.ask(common.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == ACCEPTED
        verdicts, raised_valid, guarded_valid = set(), [], []
        guarded.fly(until_s=10.1)
        while flight.k < 500:
            flight.tick()
            guarded.tick()
            verdicts.add(flight.loop.verdict)
            if flight.out["flag"][0] == FlagState.RAISED:
                raised_valid.append(flight.loop.validity & Validity.STATE_VALID)
                guarded_valid.append(guarded.loop.validity & Validity.STATE_VALID)
        assert raised_valid
        assert all(raised_valid)
        assert not any(guarded_valid)
        assert not verdicts & {Verdict.TRUSTED, Verdict.TRUSTED_COASTING}
        assert flight.loop.alerts & 1 << AlertId.FLAG_DISARMED
        assert flight.flown.tobytes() == guarded.flown.tobytes()
        beat = flight.wire.heard("HEARTBEAT")[-1]
        assert not beat.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED
        assert flight.ask(common.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == ACCEPTED
        flight.tick()
        assert not flight.loop.alerts & 1 << AlertId.FLAG_DISARMED


def test_reboot_ends_the_loop_after_the_tick() -> None:
    with Linked() as flight:
        flight.fly(until_s=2.0)
        assert flight.ask(common.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 2.0) == DENIED
        assert not flight.loop.restart
        assert flight.ask(common.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0) == ACCEPTED
        ticks = flight.loop.tick
        flight.loop.run(50)
        assert flight.loop.tick == ticks


def test_an_unknown_command_is_unsupported_and_a_table_command_without_a_store_refused() -> None:
    with Linked() as flight:
        flight.fly(until_s=1.0)
        assert flight.ask(common.MAV_CMD_NAV_TAKEOFF) == common.MAV_RESULT_UNSUPPORTED
        for number in (m.LEONAV_CMD_TABLE_STAGE, m.LEONAV_CMD_TABLE_ACTIVATE, m.LEONAV_CMD_TABLE_ROLL_BACK):
            assert flight.ask(number) == common.MAV_RESULT_TEMPORARILY_REJECTED


def test_available_modes_are_listed_and_read_by_pymavlink() -> None:
    """GIVEN flight WHEN AVAILABLE_MODES is requested THEN pymavlink's own dialect reads four modes, two selectable."""
    with Linked() as flight:
        flight.fly(until_s=1.0)
        flight.wire.heard()
        flight.now().command(common.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_AVAILABLE_MODES, 0)
        flight.tick()
        reader = development.MAVLink(None)
        frames = [f for f in flight.wire.down if int.from_bytes(f[7:10], "little") == 435]
        modes = [reader.decode(bytearray(frame)) for frame in frames]
        assert [mode.mode_name for mode in modes] == [mode.name for mode in Mode]
        assert [mode.number_modes for mode in modes] == [4] * 4
        hidden = development.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
        assert [bool(mode.properties & hidden) for mode in modes] == [True, False, False, True]
        assert flight.ask(common.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_CURRENT_MODE) == ACCEPTED
        assert flight.ask(common.MAV_CMD_REQUEST_MESSAGE, 9) == DENIED


# -- streams


def test_a_message_interval_is_set_got_and_returned_to_the_default() -> None:
    """GIVEN the default rates WHEN an interval of 0.5 s is set THEN so many messages come; 0 restores; -1 stops."""
    number = m.MAVLINK_MSG_ID_LEONAV_COVARIANCE
    with Linked() as flight:
        flight.fly(until_s=1.0)

        def count(seconds: float) -> int:
            flight.wire.heard()
            flight.fly(until_s=flight.k * 0.1 + seconds)
            return len(flight.wire.heard("LEONAV_COVARIANCE"))

        assert count(4.0) == 4
        assert flight.ask(common.MAV_CMD_SET_MESSAGE_INTERVAL, number, 500_000.0) == ACCEPTED
        assert count(4.0) == 8
        assert flight.ask(common.MAV_CMD_SET_MESSAGE_INTERVAL, number, -1.0) == ACCEPTED
        assert count(4.0) == 0
        flight.now().command(common.MAV_CMD_GET_MESSAGE_INTERVAL, number)
        flight.tick()
        assert flight.wire.heard("MESSAGE_INTERVAL")[-1].interval_us == -1
        assert flight.ask(common.MAV_CMD_SET_MESSAGE_INTERVAL, number, 0.0) == ACCEPTED
        assert count(4.0) == 4


@pytest.mark.parametrize("interval_us", [-1.0, 2e6, math.nan])
def test_heartbeat_and_integrity_cannot_be_silenced(interval_us: float) -> None:
    with Linked() as flight:
        flight.fly(until_s=1.0)
        for number in (m.MAVLINK_MSG_ID_HEARTBEAT, m.MAVLINK_MSG_ID_LEONAV_INTEGRITY):
            assert flight.ask(common.MAV_CMD_SET_MESSAGE_INTERVAL, number, interval_us) == DENIED


def test_timesync_answers_with_flights_time() -> None:
    with Linked() as flight:
        flight.fly(until_s=1.0)
        flight.wire.heard()
        flight.now().mav.timesync_send(0, 123_456_789)
        flight.now().mav.timesync_send(99, 5)  # an answer to somebody: not for flight to answer
        flight.tick()
        (answer,) = flight.wire.heard("TIMESYNC")
        assert answer.ts1 == 123_456_789
        assert answer.tc1 == flight.loop.unix_ns()


# -- parameters


def parameters(flight: Linked) -> dict[str, tuple[int, float]]:
    flight.wire.heard()
    flight.now().mav.param_request_list_send(1, 1)
    found: dict[str, tuple[int, float]] = {}
    for _ in range(40):
        flight.tick()
        for message in flight.wire.heard("PARAM_VALUE"):
            assert message.param_type == common.MAV_PARAM_TYPE_REAL32
            assert message.param_count == len(OPERATIONAL) + len(TABLE_PARAMETERS)
            found[message.param_id] = (message.param_index, message.param_value)
    return found


def test_all_parameters_are_listed_and_agree_with_the_table_that_flies() -> None:
    """GIVEN a table WHEN the list is asked for THEN every scalar of it comes once, as float32 of what flies."""
    with Linked("flight.table.limit_m=1234.5") as flight:
        flight.fly(until_s=1.0)
        found = parameters(flight)
        assert sorted(index for index, _ in found.values()) == list(range(len(OPERATIONAL) + len(TABLE_PARAMETERS)))
        for short, name in TABLE_PARAMETERS:
            assert found[short.decode()][1] == np.float32(flight.navigation.values[name][0]), name
        assert found["T_LIMIT_M"][1] == 1234.5
        assert len(TABLE_PARAMETERS) == sum(field.shape == () for field in NAVIGATION.fields)


def test_names_are_short_different_and_stay_what_they_are() -> None:
    names = short_names(field.name for field in NAVIGATION.fields if field.shape == ())
    assert len(set(names.values())) == len(names)
    assert max(map(len, names.values())) <= 16
    assert names["limit_m"] == "T_LIMIT_M"


@pytest.mark.parametrize(
    ("value", "taken"),
    [(2.5, True), (0.1, True), (60.0, True), (0.05, False), (61.0, False), (math.nan, False), (math.inf, False)],
)
def test_an_operational_parameter_is_range_checked_echoed_and_kept(tmp_path: Path, value: float, taken: bool) -> None:
    """GIVEN a parameter WHEN it is set THEN the echo has what holds now; a restart has the same value."""
    with Linked(folder=tmp_path) as flight:
        flight.fly(until_s=1.0)
        flight.wire.heard()
        flight.now().parameter(b"LNK_REPEAT_S", value)
        flight.tick()
        (echo,) = flight.wire.heard("PARAM_VALUE")
        assert echo.param_value == pytest.approx(value if taken else 1.0)
        flight.tick()
    with Linked(folder=tmp_path) as again:
        assert again.ground.parameters.value("LNK_REPEAT_S") == pytest.approx(value if taken else 1.0)


def test_a_certified_field_is_read_only() -> None:
    """GIVEN the table's limit WHEN PARAM_SET wants another THEN the old one is echoed and flies on."""
    with Linked("flight.table.limit_m=1234.5") as flight:
        flight.fly(until_s=1.0)
        flight.wire.heard()
        flight.now().parameter(b"T_LIMIT_M", 9000.0)
        flight.tick()
        (echo,) = flight.wire.heard("PARAM_VALUE")
        assert (echo.param_id, echo.param_value) == ("T_LIMIT_M", 1234.5)
        assert flight.loop.memory.table["limit_m"][0] == 1234.5


def test_wrong_type_name_and_index_change_nothing(tmp_path: Path) -> None:
    with Linked(folder=tmp_path) as flight:
        flight.fly(until_s=1.0)
        flight.wire.heard()
        flight.now().parameter(b"LNK_REPEAT_S", 5.0, common.MAV_PARAM_TYPE_INT32)
        flight.now().parameter(b"NO_SUCH", 5.0)
        flight.now().mav.param_request_read_send(1, 1, b"NO_SUCH", -1)
        flight.now().mav.param_request_read_send(1, 1, b"", 9999)
        flight.now().mav.param_request_read_send(1, 1, b"LNK_FTP_TICK", -1)
        flight.tick()
        echoes = [(e.param_id, e.param_value) for e in flight.wire.heard("PARAM_VALUE")]
        assert echoes == [("LNK_REPEAT_S", 1.0), ("LNK_FTP_TICK", 8.0)]


def test_a_damaged_parameter_file_is_told_and_not_used(tmp_path: Path) -> None:
    with Linked(folder=tmp_path) as flight:
        flight.fly(until_s=1.0)
        flight.now().parameter(b"LNK_REPEAT_S", 7.0)
        flight.tick()
    path = tmp_path / "parameters.txt"
    good = path.read_bytes()
    for at in range(0, len(good) - 1, 7):
        path.write_bytes(good[:at] + bytes((good[at] ^ 1,)) + good[at + 1 :])
        with Linked(folder=tmp_path) as again:
            held = again.ground.parameters
            assert held.value("LNK_REPEAT_S") == 1.0
            assert "damaged" in held.told[0]
    path.write_bytes(good)
    with Linked(folder=tmp_path) as again:
        assert again.ground.parameters.value("LNK_REPEAT_S") == 7.0


# -- alerts and events


def test_an_open_alert_is_repeated_until_it_is_acknowledged() -> None:
    """GIVEN an outage WHEN nobody acknowledges its alert THEN it comes once a second with the same number; an
    acknowledgement of another number changes nothing; the right one ends it; raised again, it is open again."""
    with Linked("outage=[{start_s=10.0, duration_s=10.0}, {start_s=30.0, duration_s=8.0}]") as flight:
        flight.fly(until_s=18.0)
        told = [a for a in flight.wire.heard("LEONAV_ALERT") if a.alert_id == AlertId.OUTAGE_START]
        assert len({a.sequence for a in told}) == 1
        assert len(told) >= 4
        assert flight.ask(m.LEONAV_CMD_ACKNOWLEDGE_ALERT, told[0].sequence + 50.0) == DENIED
        assert flight.ask(m.LEONAV_CMD_ACKNOWLEDGE_ALERT, float(told[0].sequence)) == ACCEPTED
        flight.wire.heard()
        flight.fly(until_s=29.0)
        heard = flight.wire.heard("LEONAV_ALERT")
        assert not [a for a in heard if a.alert_id == AlertId.OUTAGE_START and a.active]
        flight.fly(until_s=37.0)
        again = [a for a in flight.wire.heard("LEONAV_ALERT") if a.alert_id == AlertId.OUTAGE_START and a.active]
        assert again
        assert again[0].sequence > told[0].sequence
        assert flight.ground.alerts.bits & 1 << AlertId.OUTAGE_START


def test_lost_events_are_noticed_by_their_number_and_sent_again() -> None:
    """GIVEN events that were not heard WHEN LEONAV_LINK is read and the missing numbers asked for THEN they come again
    as they were told first."""
    with Linked(OUTAGE) as flight:
        flight.fly(until_s=30.0)
        heard = flight.wire.heard()
        first = {a.sequence: repr(a.to_dict()) for a in reversed(heard) if a.get_type() == "LEONAV_ALERT"}
        newest = [a for a in heard if a.get_type() == "LEONAV_LINK"][-1].event_sequence
        assert newest == max(first)
        assert flight.ask(m.LEONAV_CMD_REQUEST_EVENTS, 1.0, float(newest)) == ACCEPTED
        flight.now().command(m.LEONAV_CMD_REQUEST_EVENTS, 1.0, float(newest))
        flight.tick()
        again = {a.sequence: repr(a.to_dict()) for a in flight.wire.heard("LEONAV_ALERT")}
        assert again == first
        assert flight.ask(m.LEONAV_CMD_REQUEST_EVENTS, newest + 1.0, newest + 9.0) == DENIED


def test_one_numbering_serves_every_listener() -> None:
    """GIVEN lists, repeats and streams mixed WHEN sequence numbers are followed THEN none is missing."""
    with Linked(OUTAGE) as flight:
        flight.fly(until_s=25.0)
        parameters_asked = flight.now()
        parameters_asked.mav.param_request_list_send(1, 1)
        flight.fly(until_s=35.0)
        numbers = [frame[4] for frame in flight.wire.down]
        assert len(numbers) > 600
        assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(numbers))


def test_a_foreign_station_in_the_bench_profile_is_obeyed_unsigned() -> None:
    """GIVEN the bench profile WHEN an unsigned command comes THEN it is obeyed and LEONAV_LINK says that this is so."""
    with Linked(key=None, bench=True) as flight:
        flight.fly(until_s=1.0)
        assert flight.ask(common.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == ACCEPTED
        flight.fly(until_s=3.0)
        assert flight.wire.heard("LEONAV_LINK")[-1].bench == 1


def test_a_station_of_another_target_is_not_obeyed() -> None:
    with Linked() as flight:
        flight.fly(until_s=1.0)
        station: Station = flight.now()
        for target in ((2, 1), (1, 190), (255, 1)):
            station.command(common.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, target=target)
        flight.tick()
        assert flight.loop.armed
        assert flight.refused == {"WRONG_TARGET": 3}
        assert not flight.wire.heard("COMMAND_ACK")
