"""The binary table file: whole and in range, or refused."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightsw.icd.table_file import MAGIC, TableRefused, decode, encode
from flightsw.icd.table_schema import EARTH_ORIENTATION, NAVIGATION, SCHEMAS, Field, Schema
from ground.tables.build import build_navigation

HEADER_BYTES = 76


def values_of(schema: Schema) -> np.ndarray:
    """Values in range, different from zero wherever the range allows."""
    values = np.zeros(1, schema.dtype)
    for field in schema.fields:
        middle = 0.5 * (field.minimum + min(field.maximum, field.minimum + 1e15))
        values[field.name] = int(middle) if field.kind == "i8" else middle
    return values


def earth_orientation_image() -> bytes:
    values = values_of(EARTH_ORIENTATION)
    generator = np.random.default_rng(1)
    values["nodes"] = generator.uniform(-20.0, 20.0, values["nodes"].shape)
    return encode("earth_orientation", "iers", values, b"", 10, 20)


def sealed(body: bytes) -> bytes:
    return body + struct.pack("<I", zlib.crc32(body))


def fields() -> list[Any]:
    return [pytest.param(s, f, id=f"{s.name}.{f.name}") for s in SCHEMAS.values() for f in s.fields]


def test_an_8_kb_table_with_any_one_bit_flipped_is_refused() -> None:
    """GIVEN a table of 7.8 kB WHEN any single bit flips (all 62 thousand of them) THEN it is refused."""
    image = bytearray(earth_orientation_image())
    assert len(image) > 7700
    decode(bytes(image))
    for position in range(len(image)):
        for bit in range(8):
            image[position] ^= 1 << bit
            with pytest.raises(TableRefused):
                decode(image)
            image[position] ^= 1 << bit
    decode(bytes(image))


def test_an_8_kb_table_cut_anywhere_is_refused() -> None:
    """GIVEN a table of 7.8 kB WHEN it is cut after any byte THEN it is refused."""
    image = earth_orientation_image()
    for length in range(len(image)):
        with pytest.raises(TableRefused):
            decode(image[:length])


def test_any_trailing_byte_is_refused() -> None:
    """GIVEN a table WHEN anything follows it, also its own tail or a second table THEN it is refused."""
    image = earth_orientation_image()
    for tail in (*(bytes([value]) for value in range(256)), image[-4:], image, b"\0" * 4096):
        with pytest.raises(TableRefused):
            decode(image + tail)


@pytest.mark.parametrize("schema", SCHEMAS.values(), ids=lambda s: s.name)
def test_round_trip(schema: Schema) -> None:
    """GIVEN values WHEN encoded and decoded THEN equal, read-only, with identity and certificate."""
    values = values_of(schema)
    table = decode(encode(schema.name, "a set", values, b"certificate", 5, 6))
    assert table.values.tobytes() == values.tobytes()
    assert table.values.shape == (1,)
    assert not table.values.flags.writeable
    assert table[:2] == (schema.name, "a set")
    assert (table.certificate, table.valid_from_gps_ns, table.valid_to_gps_ns) == (b"certificate", 5, 6)


def test_layout_is_the_documented_one() -> None:
    """The header read by hand, field by field, at the offsets of docs/icd.md; the CRC is zlib's."""
    values = values_of(NAVIGATION)
    image = encode("navigation", "paper", values, b"abc", 1, 2)
    assert image[:8] == MAGIC == b"LNAVTBL1"
    assert int.from_bytes(image[8:10], "little") == 1
    assert int.from_bytes(image[10:12], "little") == NAVIGATION.number
    assert int.from_bytes(image[12:20], "little") == NAVIGATION.hash
    assert image[20:52] == b"paper" + bytes(27)
    assert (image[52], image[60]) == (1, 2)
    assert int.from_bytes(image[68:72], "little") == 3
    assert int.from_bytes(image[72:76], "little") == NAVIGATION.dtype.itemsize
    assert image[76 : 76 + NAVIGATION.dtype.itemsize] == values.tobytes()
    assert image[-7:-4] == b"abc"
    assert int.from_bytes(image[-4:], "little") == zlib.crc32(image[:-4]) == decode(image).crc32


def outside(field: Field) -> list[float]:
    if field.kind == "f8":
        infinity = float("inf")
        below, above = np.nextafter(field.minimum, -infinity), np.nextafter(field.maximum, infinity)
        return [float("nan"), infinity, -infinity, float(below), float(above)]
    return [int(field.minimum) - 1, int(field.maximum) + 1]


@pytest.mark.parametrize(("schema", "field"), fields())
def test_a_field_out_of_range_is_refused_on_both_sides(schema: Schema, field: Field) -> None:
    """GIVEN one field NaN, infinite or one step outside its range WHEN encoded, or decoded from an image whose
    CRC is right THEN refused, naming the field; the ends of the range themselves pass."""
    for value in (field.minimum, field.maximum):
        values = values_of(schema)
        values[field.name] = value
        decode(encode(schema.name, "x", values))
    good = encode(schema.name, "x", values_of(schema))
    for value in outside(field):
        values = values_of(schema)
        if field.shape:  # the last cell only: no cell may be overlooked
            values[field.name].reshape(-1)[-1] = value
        else:
            values[field.name] = value
        with pytest.raises(TableRefused, match=field.name):
            encode(schema.name, "x", values)
        forged = sealed(good[:HEADER_BYTES] + values.tobytes())
        with pytest.raises(TableRefused, match=field.name):
            decode(forged)


@pytest.mark.parametrize(
    ("offset", "raw", "said"),
    [
        (0, b"LNAVTBL2", "magic"),
        (8, b"\x02\x00", "format 2"),
        (10, b"\x7f\x00", "kind number 127"),
        (10, b"\x02\x00", "schema"),
        (12, b"\x00", "build the table again"),
        (20, b"\x00", "printable"),
        (22, b"\x00", "printable"),
        (20, b"\xff", "printable"),
        (51, b"x", "printable"),
        (52, b"\x09" + bytes(7) + b"\x08" + bytes(7), "ends"),
        (59, b"\x80", "before the GPS epoch"),
    ],
)
def test_a_wrong_header_with_a_right_crc_is_refused(offset: int, raw: bytes, said: str) -> None:
    """GIVEN a header that is wrong in one place, CRC right WHEN decoded THEN refused, saying what is wrong."""
    body = bytearray(encode("navigation", "paper", values_of(NAVIGATION))[:-4])
    body[offset : offset + len(raw)] = raw
    with pytest.raises(TableRefused, match=said):
        decode(sealed(bytes(body)))


@pytest.mark.parametrize("length", [0, NAVIGATION.dtype.itemsize - 8, NAVIGATION.dtype.itemsize + 8])
def test_a_payload_of_another_length_is_refused(length: int) -> None:
    header = bytearray(encode("navigation", "paper", values_of(NAVIGATION))[:HEADER_BYTES])
    header[72:76] = length.to_bytes(4, "little")
    with pytest.raises(TableRefused, match="payload"):
        decode(sealed(bytes(header) + bytes(length)))


@pytest.mark.parametrize("name", ["", "x" * 33, "gegen\u00fcber", "two\nlines", "zero\0inside"])
def test_a_name_that_does_not_fit_is_refused(name: str) -> None:
    with pytest.raises(TableRefused, match="set name"):
        encode("navigation", name, values_of(NAVIGATION))


@pytest.mark.parametrize("span", [(-1, 0), (0, -1), (5, 5), (6, 5), (2**63, 0), (0, 2**63)])
def test_an_impossible_validity_is_refused(span: tuple[int, int]) -> None:
    with pytest.raises(TableRefused, match="validity"):
        encode("navigation", "x", values_of(NAVIGATION), b"", *span)


def test_values_of_another_kind_are_refused() -> None:
    with pytest.raises(TableRefused, match="dtype"):
        encode("navigation", "x", values_of(EARTH_ORIENTATION))
    with pytest.raises(TableRefused, match="shape"):
        encode("navigation", "x", np.concatenate([values_of(NAVIGATION)] * 2))
    with pytest.raises(TableRefused, match="unknown"):
        encode("navigatoin", "x", values_of(NAVIGATION))


@given(st.binary(max_size=400), st.booleans())
def test_no_bytes_raise_anything_but_refusal(raw: bytes, with_magic: bool) -> None:
    """GIVEN any bytes, also with a true magic and a true CRC WHEN decoded THEN TableRefused, nothing else."""
    for image in (raw, sealed(MAGIC + raw if with_magic else raw)):
        with pytest.raises(TableRefused):
            decode(image)


@given(data=st.data())
def test_any_change_of_a_shipped_table_is_refused(data: st.DataObject) -> None:
    """GIVEN a shipped table WHEN up to 32 neighbouring bits change THEN refused: CRC-32 sees every such burst."""
    image = build_navigation("paper")
    start = data.draw(st.integers(0, 8 * len(image) - 32))
    pattern = data.draw(st.integers(1, 2**32 - 1))
    changed = int.from_bytes(image, "little") ^ (pattern << start)
    with pytest.raises(TableRefused):
        decode(changed.to_bytes(len(image), "little"))
