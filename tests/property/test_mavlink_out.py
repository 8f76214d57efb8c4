"""What flight puts on the link is what pymavlink would have: any message of the dialect, any values, signed or not."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightsw.icd import mavlink as m
from flightsw.journal import Journal
from flightsw.link.mavlink_out import SYSTEM_ID, MavlinkOut
from flightsw.link.message_layout import MessageLayout

KINDS = [kind for _, kind in sorted(m.mavlink_map.items())]
INTEGERS = {"B": (0, 255), "b": (-128, 127), "H": (0, 65535), "h": (-32768, 32767)}
INTEGERS |= {"I": (0, 2**32 - 1), "i": (-(2**31), 2**31 - 1), "Q": (0, 2**64 - 1), "q": (-(2**63), 2**63 - 1)}
CODES = {"uint8_t": "B", "int8_t": "b", "uint16_t": "H", "int16_t": "h", "uint32_t": "I", "int32_t": "i"}
CODES |= {"uint64_t": "Q", "int64_t": "q"}


class Ear:
    """A sink that keeps what it hears."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []

    def send(self, message: bytes | bytearray) -> None:
        self.heard.append(bytes(message))

    def close(self) -> None: ...


def flight_and_pymavlink() -> tuple[MavlinkOut, Ear, m.MAVLink]:
    ear = Ear()
    theirs = m.MAVLink(None, srcSystem=SYSTEM_ID, srcComponent=m.MAV_COMP_ID_AUTOPILOT1)
    return MavlinkOut(ear, Journal(None), lambda: 0), ear, theirs


def element(kind: str) -> st.SearchStrategy[Any]:
    if kind in CODES:
        return st.just(0) | st.integers(*INTEGERS[CODES[kind]])
    width = 32 if kind == "float" else 64
    return st.just(0.0) | st.floats(width=width, allow_nan=False) | st.just(math.nan)


@st.composite
def messages(draw: st.DrawFn) -> tuple[type[m.MAVLink_message], list[Any]]:
    """A kind of message and a value of each of its fields, in the order of the definition."""
    kind = draw(st.sampled_from(KINDS))
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    fields: list[Any] = []
    for name, of in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        n = lengths[name]
        if of == "char":
            fields.append(draw(st.binary(max_size=max(1, n))))
        elif n:
            fields.append(draw(st.lists(element(of), min_size=n, max_size=n)))
        else:
            fields.append(draw(element(of)))
    return kind, fields


def spread(fields: list[Any]) -> list[Any]:
    """Arrays element by element."""
    return [value for field in fields for value in (field if isinstance(field, list) else [field])]


@given(st.lists(messages(), min_size=1, max_size=4), st.none() | st.binary(min_size=32, max_size=32))
def test_bytes_are_those_of_pymavlink(told: list[tuple[type[m.MAVLink_message], list[Any]]], key: bytes | None) -> None:
    """GIVEN any messages, signed or not WHEN flight sends them THEN every byte is the one that pymavlink packs."""
    flight, ear, theirs = flight_and_pymavlink()
    if key is not None:
        flight.sign(key, 123_456_789)
        theirs.signing.secret_key, theirs.signing.sign_outgoing, theirs.signing.timestamp = key, True, 123_456_789
    for count, (kind, fields) in enumerate(told):
        expected = kind(*fields).pack(theirs)
        theirs.seq = (theirs.seq + 1) % 256
        flight.send(MessageLayout(kind), *spread(fields))
        assert ear.heard[count] == expected
    assert flight.messages == len(told)


def test_sequence_numbers_go_round() -> None:
    """GIVEN flight WHEN it has sent 256 messages THEN numbers begin anew, and a parser hears every message."""
    flight, ear, _ = flight_and_pymavlink()
    layout = MessageLayout(m.MAVLink_system_time_message)
    for k in range(600):
        flight.send(layout, k, 0)
    parser = m.MAVLink(None)
    heard = [parser.parse_char(message) for message in ear.heard]
    assert [message.time_unix_usec for message in heard if message is not None] == list(range(600))
    assert [message[4] for message in ear.heard] == [k % 256 for k in range(600)]


def test_a_message_with_nothing_in_it_keeps_one_byte() -> None:
    """GIVEN a message of zeros WHEN it is sent THEN a byte of it is left, and nothing of the one before it."""
    flight, ear, theirs = flight_and_pymavlink()
    flight.send(MessageLayout(m.MAVLink_system_time_message), 2**64 - 1, 2**32 - 1)
    flight.send(MessageLayout(m.MAVLink_system_time_message), 0, 0)
    theirs.seq = 1
    assert ear.heard[1] == m.MAVLink_system_time_message(0, 0).pack(theirs)
    assert ear.heard[1][1] == 1


@pytest.mark.parametrize("kind", [m.MAVLink_system_time_message, m.MAVLink_leonav_state_result_message])
@pytest.mark.parametrize("values", [(1,), (1, 2, 3, 4), ("1", 2, 3), (2**64, 2, 3)])
def test_values_that_do_not_fit_are_a_defect(kind: type[m.MAVLink_message], values: tuple[Any, ...]) -> None:
    """GIVEN too few, too many or impossible values WHEN they are sent THEN it is refused and nothing goes out."""
    flight, ear, _ = flight_and_pymavlink()
    with pytest.raises((ValueError, struct.error)):
        flight.send(MessageLayout(kind), *values)
    assert not ear.heard
    assert flight.messages == 0


def test_too_many_values_are_none_of_a_message_whose_order_differs_on_the_wire() -> None:
    """GIVEN a message that the wire has in another order WHEN a value too many is sent THEN it is not just left out."""
    flight, ear, _ = flight_and_pymavlink()
    with pytest.raises(ValueError, match="HEARTBEAT has 6 values, not 7"):
        flight.send(MessageLayout(m.MAVLink_heartbeat_message), *range(7))
    assert not ear.heard
