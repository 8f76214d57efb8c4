"""The codec of flight against cantools reading the same DBC, in both directions, and against crccheck."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest
from crccheck.crc import Crc16Ibm3740
from hypothesis import given
from hypothesis import strategies as st

import flightsw.icd
from flightsw.icd import can_codec, enums
from flightsw.icd.can_frames import GNSS_POSITION, GNSS_VELOCITY, LAYOUTS
from flightsw.icd.frame_layout import FrameLayout

DBC = Path(flightsw.icd.__file__).with_name("sensor_bus.dbc")
DATABASE: Any = cantools.database.load_file(DBC)

each_frame = pytest.mark.parametrize("layout", LAYOUTS.values(), ids=lambda layout: layout.name)


def signal_values(layout: FrameLayout) -> st.SearchStrategy[dict[str, Any]]:
    """Any value that each signal can carry, but for counter and CRC, which seal() writes."""
    strategies: dict[str, st.SearchStrategy[Any]] = {}
    for name in layout.field_names:
        dtype = layout.dtype[name]
        if name in ("counter", "crc"):
            continue
        if dtype.kind == "f":
            strategies[name] = st.floats(width=8 * dtype.itemsize)  # type: ignore[arg-type]
        else:
            limits = np.iinfo(dtype)
            strategies[name] = st.integers(int(limits.min), int(limits.max))
    return st.fixed_dictionaries(strategies)


def same(left: float, right: float) -> bool:
    return left == right or (math.isnan(left) and math.isnan(right))


@each_frame
@given(data=st.data())
def test_what_flight_encodes_cantools_decodes(layout: FrameLayout, data: st.DataObject) -> None:
    """GIVEN any values WHEN flight fills and seals a frame THEN cantools reads the same values."""
    values = data.draw(signal_values(layout))
    counter = data.draw(st.integers(0, 1000))
    buffer, view = can_codec.new_buffer(layout)
    for name, value in values.items():
        view[name] = value
    can_codec.seal(layout, buffer, counter)
    read = DATABASE.decode_message(layout.frame_id, bytes(buffer), decode_choices=False, scaling=False)
    assert set(read) == set(layout.field_names)
    for name, value in values.items():
        assert same(read[name], value), name
    assert read["counter"] == counter % 256


@each_frame
@given(data=st.data())
def test_what_cantools_encodes_flight_decodes(layout: FrameLayout, data: st.DataObject) -> None:
    """GIVEN a frame that cantools encoded, CRC by crccheck WHEN flight decodes it THEN the values are equal,
    in the numpy view and by the struct format alike."""
    values = data.draw(signal_values(layout)) | {"counter": data.draw(st.integers(0, 255)), "crc": 0}
    bare = DATABASE.encode_message(layout.frame_id, values, scaling=False, strict=False)
    body = bare[:-2]
    crc = Crc16Ibm3740.calc(body + layout.data_id.to_bytes(2, "little"))
    payload = body + crc.to_bytes(2, "little")
    buffer, view = can_codec.new_buffer(layout)
    assert can_codec.decode_into(layout, payload, buffer) == can_codec.OK
    unpacked = dict(zip(layout.field_names, struct.unpack(layout.struct_format, payload), strict=True))
    for name, value in (values | {"crc": crc}).items():
        assert same(view[name][0], value), name
        assert same(unpacked[name], value), name


@each_frame
@given(data=st.data())
def test_seal_writes_the_crc_of_crccheck(layout: FrameLayout, data: st.DataObject) -> None:
    """GIVEN any bytes WHEN sealed THEN the CRC is CRC-16/IBM-3740 over body and data id, low byte first."""
    buffer = bytearray(data.draw(st.binary(min_size=layout.length, max_size=layout.length)))
    can_codec.seal(layout, buffer, 77)
    expected = Crc16Ibm3740.calc(bytes(buffer[:-2]) + layout.data_id.to_bytes(2, "little"))
    assert int.from_bytes(buffer[-2:], "little") == expected
    assert buffer[-3] == 77


def test_crc_check_value_of_the_standard() -> None:
    """The published check value of CRC-16/IBM-3740: '123456789' gives 0x29B1."""
    layout = GNSS_POSITION._replace(length=9, data_id_bytes=b"89", counter_offset=6, crc_offset=7)
    buffer = bytearray(b"1234567\0\0")
    can_codec.seal(layout, buffer, ord("7"))
    assert int.from_bytes(buffer[7:], "little") == 0x29B1


@each_frame
def test_every_flipped_bit_and_every_length_is_refused_and_leaves_the_record(layout: FrameLayout) -> None:
    """GIVEN a good frame WHEN any one bit flips or the length is any other THEN refused, record untouched."""
    sealed, view = can_codec.new_buffer(layout)
    view[layout.field_names[0]] = np.iinfo(layout.dtype[0]).max // 3
    can_codec.seal(layout, sealed, 9)
    good = bytes(sealed)
    record = bytearray(b"\xa5" * layout.length)
    untouched = bytes(record)
    for bit in range(8 * layout.length):
        mutated = bytearray(good)
        mutated[bit // 8] ^= 1 << bit % 8
        assert can_codec.decode_into(layout, bytes(mutated), record) == can_codec.BAD_CRC
    for length in (n for n in range(layout.length + 2) if n != layout.length):
        assert can_codec.decode_into(layout, (good + b"\0\0")[:length], record) == can_codec.BAD_LENGTH
    assert record == untouched
    assert can_codec.decode_into(layout, good, memoryview(record)) == can_codec.OK
    assert record == good


@each_frame
def test_a_frame_under_another_identifier_fails_its_crc(layout: FrameLayout) -> None:
    """GIVEN a good frame WHEN it arrives under the identifier of another one THEN it is refused."""
    buffer, _ = can_codec.new_buffer(layout)
    can_codec.seal(layout, buffer, 0)
    for other in LAYOUTS.values():
        if other is not layout:
            record, _ = can_codec.new_buffer(other)
            assert can_codec.decode_into(other, bytes(buffer), record) != can_codec.OK


@each_frame
def test_layout_equals_the_dbc(layout: FrameLayout) -> None:
    """Offsets, sizes and kinds of the generated record are those of the DBC, unused bytes included."""
    message = DATABASE.get_message_by_frame_id(layout.frame_id)
    assert (layout.name, layout.length, layout.sender) == (message.name, message.length, message.senders[0])
    assert message.is_fd
    assert layout.dtype.itemsize == layout.length == struct.calcsize(layout.struct_format)
    assert layout.dtype.fields is not None
    for signal in message.signals:
        dtype, offset = layout.dtype.fields[signal.name][:2]
        assert (8 * offset, 8 * dtype.itemsize) == (signal.start, signal.length)
        kind = "f" if signal.is_float else "i" if signal.is_signed else "u"
        assert dtype.kind == kind
    assert layout.data_id == message.dbc.attributes["E2EDataId"].value
    assert layout.data_id_bytes == layout.data_id.to_bytes(2, "little")


def test_both_halves_of_a_fix_have_their_own_protection() -> None:
    assert GNSS_POSITION.data_id != GNSS_VELOCITY.data_id
    assert len({layout.data_id for layout in LAYOUTS.values()}) == len(LAYOUTS)


@pytest.mark.parametrize(
    ("signal", "enum"),
    [
        ("mode", enums.Mode),
        ("flag_state", enums.FlagState),
        ("verdict", enums.Verdict),
        ("driver", enums.BoundDriver),
        ("da_source", enums.DaSource),
        ("uncovered", enums.Uncovered),
        ("certificate", enums.Certificate),
        ("fix_type", enums.FixType),
        ("status", enums.SyncStatus),
        ("frame", enums.BurnFrame),
        ("constellation", enums.Constellation),
        ("gnss_verdict", enums.GnssVerdict),
        ("command", enums.NavCommand),
        ("target", enums.MeasurementType),
        ("value", enums.EditMode),
    ],
)
def test_enums_equal_the_value_tables_of_the_dbc(signal: str, enum: Any) -> None:
    """Every VAL_ table of the DBC holds exactly the names and numbers of the enum."""
    tables = [
        {int(value): str(name) for value, name in s.choices.items()}
        for message in DATABASE.messages
        for s in message.signals
        if s.name == signal and s.choices
    ]
    assert tables
    for table in tables:
        assert table == {member.value: member.name for member in enum}
