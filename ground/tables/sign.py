"""Certificates on the ground: attach one to a table and sign it, verify one, make a key, compare two tables."""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from flightsw.icd.certificate import (
    CERTIFICATE,
    Block,
    CertificateRefused,
    attach,
    check_key,
    content_crc32,
    hash_text,
    open_certificate,
)
from flightsw.icd.table_file import TableImage
from flightsw.icd.table_saturation import saturation
from flightsw.icd.table_schema import NAVIGATION, SCHEMAS
from ground.errors import OperatorError
from ground.tables.certificate_file import read_certificate
from ground.tables.gps_time import GPS_EPOCH_UNIX_NS, GPS_MINUS_UTC_NS, format_gps

NEW_KEY_BYTES = 32


def read_key(path: Path) -> bytes:
    """The key of a file. Raises OperatorError where it cannot be read or is too short."""
    try:
        return check_key(path.read_bytes(), str(path))
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read: {error.strerror or error}") from error
    except CertificateRefused as error:
        raise OperatorError(str(error)) from error


def make_key(path: Path) -> None:
    """A new random key, as hexadecimal text that only its owner may read; an existing file is never replaced."""
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(secrets.token_hex(NEW_KEY_BYTES) + "\n")
    except FileExistsError:
        raise OperatorError(f"{path}: exists; a key in use is not replaced: name another file") from None
    except OSError as error:
        raise OperatorError(f"{path}: cannot be written: {error.strerror or error}") from error


def sign(
    table: TableImage, certificate: Path, stimulus: bytes, key: bytes | None, issued_gps_ns: int | None = None
) -> bytes:
    """Image of the table with the certificate of a certificate.json, and the stimulus (empty: keep the table's own).

    issued_gps_ns: when; None for now. Raises OperatorError where the certificate does not belong to the table.
    """
    values = read_certificate(certificate)
    values["issued_gps_ns"] = now_gps_ns() if issued_gps_ns is None else issued_gps_ns
    try:
        if not stimulus and table.certificate:
            carried = open_certificate(table, None)
            stimulus = carried.stimulus if carried else b""
        return attach(table, values, stimulus, key)
    except CertificateRefused as error:
        raise OperatorError(f"{certificate}: {error}") from error


def now_gps_ns() -> int:
    """GPS time now, as good as this machine's clock."""
    return time.time_ns() - GPS_EPOCH_UNIX_NS + GPS_MINUS_UTC_NS


def verify(table: TableImage, key: bytes | None, where: str) -> Block | None:
    """The certificate of a table, checked as flight checks it. Raises OperatorError with the reason."""
    try:
        block = open_certificate(table, key)
    except CertificateRefused as error:
        raise OperatorError(f"{where}: refused: {error}") from error
    if table.kind == NAVIGATION.name:
        age_s = float(block.values["certified_age_s"][0]) if block is not None else 0.0
        if found := saturation(table.values, age_s):
            raise OperatorError(f"{where}: refused: {'; also '.join(found)}")
    return block


def render_certificate(block: Block | None) -> list[str]:
    """A certificate in words, for the operator."""
    if block is None:
        return ["certificate  none: UNCERTIFIED"]
    record = block.values[0]
    grade = {0: "none: UNCERTIFIED, a stimulus only", 1: "QUICK: not to be shown as certified", 2: "FULL"}
    lines = [f"certificate  {grade[int(record['grade'])]}, {'signed' if block.signed else 'not signed'}"]
    lines += [f"stimulus     {len(block.stimulus)} bytes" if block.stimulus else "stimulus     none", ""]
    for field in CERTIFICATE.fields[1:]:
        value = record[field.name]
        if field.name.endswith("_sha256"):
            text = hash_text(value)[:16] + "..." if np.any(value) else "none"
        elif field.name == "table_crc32":
            text = f"{int(value):08x}"
        elif field.unit == "GPS ns":
            text = format_gps(int(value)).removesuffix(" GPS")
        else:
            text = " ".join(f"{one:g}" for one in np.ravel(value) if one or not field.shape) or "none"
        unit = "" if field.unit in ("1", "count", "CRC-32", "GPS ns", "8 bytes each") else field.unit
        lines.append(f"  {field.name:<24} {text:>24} {unit:<14} {field.why}")
    return lines


def differences(one: TableImage, other: TableImage) -> list[str]:
    """What differs between two tables of one kind, a line each; empty where both would fly alike."""
    if one.kind != other.kind:
        return [f"kind: {one.kind} | {other.kind}"]
    return list(_different(one, other))


def _different(one: TableImage, other: TableImage) -> Iterator[str]:
    for name in ("set_name", "valid_from_gps_ns", "valid_to_gps_ns"):
        a, b = getattr(one, name), getattr(other, name)
        if a != b:
            yield f"{name}: {a} | {b}"
    for field in SCHEMAS[one.kind].fields:
        a, b = np.ravel(one.values[field.name][0]), np.ravel(other.values[field.name][0])
        for index in np.flatnonzero(a != b):
            place = f"{field.name}[{index}]" if field.shape else field.name
            yield f"{place}: {a[index]!s} | {b[index]!s} {field.unit}".removesuffix(" 1")
    if one.certificate != other.certificate:
        words = [render_certificate(open_certificate(table, None))[0].split(None, 1)[1] for table in (one, other)]
        yield f"certificate: {words[0]} | {words[1]}" + ("" if words[0] != words[1] else " (contents differ)")


def describe(table: TableImage) -> str:
    """Identity of a table in one line."""
    return f"{table.kind} table, set {table.set_name}, CRC-32 {table.crc32:08x}, content {content_crc32(table):08x}"
