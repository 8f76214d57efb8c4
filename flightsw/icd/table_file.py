"""The binary table file: one image format for every kind of table, refused unless whole and in range.

    magic "LNAVTBL1" | format u16 | kind u16 | schema hash u64 | set name, 32 bytes ASCII, zero-padded
    | valid from i64, valid to i64 [GPS ns; valid to 0: without end] | certificate length u32
    | payload length u32 | payload | certificate | CRC-32 of everything before it

Little-endian throughout; nothing may follow. CRC-32 (zlib) sees every error burst up to 32 bits.
"""

from __future__ import annotations

import struct
import zlib
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_schema import SCHEMAS, Schema

MAGIC = b"LNAVTBL1"
FORMAT = 1
SET_NAME_BYTES = 32

_HEADER = struct.Struct("<8sHHQ32sqqII")
_CRC = struct.Struct("<I")
_BY_NUMBER = {schema.number: schema for schema in SCHEMAS.values()}


class TableRefused(ValueError):
    """A table that may not be used; the text says why and what to do."""


class TableImage(NamedTuple):
    """A table that passed every check. values: shape (1,), dtype of the schema, read-only."""

    kind: str
    set_name: str
    values: np.ndarray
    certificate: bytes
    valid_from_gps_ns: int
    valid_to_gps_ns: int
    crc32: int


def encode(
    kind: str,
    set_name: str,
    values: np.ndarray,
    certificate: bytes = b"",
    valid_from_gps_ns: int = 0,
    valid_to_gps_ns: int = 0,
) -> bytes:
    """Binary image of a table.

    values: shape (1,), dtype `SCHEMAS[kind].dtype`. Validity in GPS ns, valid_to 0 means without end.
    Raises TableRefused when a value, the name or the validity is out of range.
    """
    schema = SCHEMAS.get(kind)
    if schema is None:
        raise TableRefused(f"table kind {kind!r} is unknown; known: {', '.join(SCHEMAS)}")
    name = _encode_name(set_name)
    _check_validity(valid_from_gps_ns, valid_to_gps_ns)
    if values.dtype != schema.dtype or values.shape != (1,):
        raise TableRefused(f"{kind} table: values must have shape (1,) and the dtype of its schema")
    check_ranges(schema, values)
    payload = values.tobytes()
    header = _HEADER.pack(
        MAGIC,
        FORMAT,
        schema.number,
        schema.hash,
        name,
        valid_from_gps_ns,
        valid_to_gps_ns,
        len(certificate),
        len(payload),
    )
    image = header + payload + certificate
    return image + _CRC.pack(zlib.crc32(image))


def decode(image: bytes | bytearray) -> TableImage:
    """Check an image and open it. Raises TableRefused with the reason; never returns a partial table."""
    if len(image) < _HEADER.size + _CRC.size:
        raise TableRefused(f"{len(image)} bytes are too few for a table; copy the file again")
    magic, version, number, schema_hash, name, start, stop, certificate_length, payload_length = _HEADER.unpack_from(
        image
    )
    if magic != MAGIC:
        raise TableRefused("not a leonav table (magic is wrong)")
    if version != FORMAT:
        raise TableRefused(f"table format {version}, this software reads {FORMAT}; build the table again")
    payload_end = _HEADER.size + payload_length
    crc_at = payload_end + certificate_length
    if len(image) != crc_at + _CRC.size:
        raise TableRefused(f"{len(image)} bytes, header announces {crc_at + _CRC.size}; copy the file again")
    (crc,) = _CRC.unpack_from(image, crc_at)
    if zlib.crc32(memoryview(image)[:crc_at]) != crc:
        raise TableRefused("CRC-32 is wrong: the file is damaged; copy it again")
    schema = _BY_NUMBER.get(number)
    if schema is None:
        raise TableRefused(f"table kind number {number} is unknown to this software")
    if schema_hash != schema.hash:
        raise TableRefused(
            f"{schema.name} table was built with schema {schema_hash:016x}, this software has "
            f"{schema.hash:016x}; build the table again"
        )
    if payload_length != schema.dtype.itemsize:
        raise TableRefused(f"{schema.name} payload: {payload_length} bytes, not {schema.dtype.itemsize}")
    set_name = _decode_name(name)
    _check_validity(start, stop)
    payload = bytes(image[_HEADER.size : payload_end])
    values = np.frombuffer(payload, dtype=schema.dtype)  # a view of bytes: read-only
    check_ranges(schema, values)
    certificate = bytes(image[payload_end:crc_at])
    return TableImage(schema.name, set_name, values, certificate, start, stop, crc)


def check_ranges(schema: Schema, values: np.ndarray) -> None:
    """Raise TableRefused for the first field of `values` (1,) that is NaN or outside its range."""
    for field in schema.fields:
        for index, value in enumerate(np.ravel(values[field.name][0])):
            # written so that NaN, which compares false with everything, is refused
            if not (field.minimum <= value <= field.maximum):
                place = f"{field.name}[{index}]" if field.shape else field.name
                raise TableRefused(
                    f"{schema.name} table: {place} = {value!s} is outside "
                    f"[{field.minimum!r}, {field.maximum!r}] {field.unit}"
                )


def _encode_name(set_name: str) -> bytes:
    if not set_name or not set_name.isascii() or not set_name.isprintable():
        raise TableRefused(f"set name {set_name!r} must be printable ASCII and not empty")
    if len(set_name) > SET_NAME_BYTES:
        raise TableRefused(f"set name {set_name!r} is longer than {SET_NAME_BYTES} characters; shorten it")
    return set_name.encode("ascii").ljust(SET_NAME_BYTES, b"\0")


def _decode_name(raw: bytes) -> str:
    text = raw.rstrip(b"\0")
    try:
        set_name = text.decode("ascii")
    except UnicodeDecodeError:
        set_name = ""
    if not set_name or not set_name.isprintable():  # a zero inside the name is not printable either
        raise TableRefused("set name is not printable, zero-padded ASCII; build the table again")
    return set_name


def _check_validity(valid_from_gps_ns: int, valid_to_gps_ns: int) -> None:
    if not (0 <= valid_from_gps_ns < 2**63 and 0 <= valid_to_gps_ns < 2**63):
        raise TableRefused("validity lies before the GPS epoch or beyond an int64 of nanoseconds")
    if valid_to_gps_ns and valid_to_gps_ns <= valid_from_gps_ns:
        raise TableRefused(f"validity ends ({valid_to_gps_ns}) before it begins ({valid_from_gps_ns})")
