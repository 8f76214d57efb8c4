"""The certificate block of a table: what was proven about it, where that holds, and how to recognise both.

    magic "LNAVCRT1" | format u16 | zero u16 | schema hash u64 | stimulus length u32 | record length u32
    | record: the fields below in order, packed | stimulus | HMAC-SHA256, 32 bytes; zero: unsigned

Little-endian; nothing may follow. The HMAC covers the whole table file before it: header, payload, record, stimulus. A
certificate names the CRC-32 of its table as it was without a certificate, so it cannot be carried to another one.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
import zlib
from typing import NamedTuple

import numpy as np

from flightsw.icd.enums import Certificate
from flightsw.icd.table_file import TableImage, TableRefused, check_ranges, encode
from flightsw.icd.table_schema import Field, Schema

MAGIC = b"LNAVCRT1"
FORMAT = 1
MAC_BYTES = 32
KEY_BYTES_MIN = 16
UNSIGNED = bytes(MAC_BYTES)
LIMITS = 4

_HEADER = struct.Struct("<8sHHQII")
_FILE_CRC = 4


def _real(name: str, unit: str, low: float, high: float, why: str, *shape: int) -> Field:
    return Field(name, "f8", shape, unit, low, high, None, why)


def _whole(name: str, unit: str, low: int, high: int, why: str, *shape: int) -> Field:
    return Field(name, "i8", shape, unit, low, high, None, why)


CERTIFICATE = Schema(
    "certificate",
    0,  # no kind of table: it stands within one
    (
        _whole("grade", "0 UNCERTIFIED, 1 QUICK, 2 FULL", 0, 2, "how much was flown to prove it"),
        _whole("table_crc32", "CRC-32", 0, 2**32 - 1, "of the table without certificate: the one that was certified"),
        _whole("issued_gps_ns", "GPS ns", 0, 2**62, "when it was attached: of two tables the later one is newer"),
        _whole("attempt", "count", 0, 10**6, "number of the attempt; earlier ones failed"),
        _whole("ensemble_sha256", "8 bytes each", -(2**63), 2**63 - 1, "of the outages flown", 4),
        _whole("stimulus_sha256", "8 bytes each", -(2**63), 2**63 - 1, "of the stimulus as stored; 0: none", 4),
        _whole("outages", "count", 0, 10**9, "independent outages flown"),
        _whole("violations", "count", 0, 10**9, "of them, those in which the error ever exceeded the bound"),
        _real("clopper_pearson_upper", "1", 0.0, 1.0, "upper 95 % limit of violations per outage"),
        _real("altitude_min_km", "km", 0.0, 1e5, "envelope: height above 6378.137 km"),
        _real("altitude_max_km", "km", 0.0, 1e5, "envelope: height above 6378.137 km"),
        _real("certified_age_s", "s", 0.0, 1e8, "envelope: age of an outage up to which the bound was proven"),
        _real("f107_min", "sfu", 0.0, 1e3, "envelope: solar activity, of the force table in use"),
        _real("f107_max", "sfu", 0.0, 1e3, "envelope: solar activity, of the force table in use"),
        _real("fix_sigma_min_m", "m", 0.0, 1e6, "envelope: position sigma that fixes claim"),
        _real("fix_sigma_max_m", "m", 0.0, 1e6, "envelope: position sigma that fixes claim"),
        _real("velocity_sigma_min_mps", "m/s", 0.0, 1e4, "envelope: velocity sigma that fixes claim"),
        _real("velocity_sigma_max_mps", "m/s", 0.0, 1e4, "envelope: the same; 0: no fixes with velocity"),
        _whole("positions_alone", "0 no, 1 yes", 0, 1, "envelope: whether fixes without velocity are covered"),
        _real(
            "convergence_s",
            "s",
            0.0,
            1e7,
            "envelope: covered fixes since the start, or since a burn or fix that is not",
        ),
        _whole("burns", "0 no, 1 yes", 0, 1, "envelope: whether announced burns are covered"),
        _real("limits_m", "m", 0.0, 1e9, "permitted errors for which the flag was judged; 0: unused", LIMITS),
    ),
)


_RANGES = (
    ("altitude_min_km", "altitude_max_km"),
    ("f107_min", "f107_max"),
    ("fix_sigma_min_m", "fix_sigma_max_m"),
    ("velocity_sigma_min_mps", "velocity_sigma_max_mps"),
)


class CertificateRefused(TableRefused):
    """A certificate that may not be used, and its table neither; the text says why and what to do."""


class Block(NamedTuple):
    """An opened certificate. values: shape (1,), dtype of CERTIFICATE, read-only. stimulus: as stored."""

    values: np.ndarray
    stimulus: bytes
    mac: bytes

    @property
    def grade(self) -> Certificate:
        """Its grade."""
        return Certificate(int(self.values["grade"][0]))

    @property
    def signed(self) -> bool:
        """Whether it carries an HMAC; says nothing about whose."""
        return self.mac != UNSIGNED


def hash_words(digest: bytes) -> np.ndarray:
    """A SHA-256 (32 bytes) as the four words of a field."""
    return np.frombuffer(digest, "<i8")


def hash_text(words: np.ndarray) -> str:
    """The four words of a field as the usual 64 digits."""
    return np.ascontiguousarray(words, "<i8").tobytes().hex()


def encode_block(values: np.ndarray, stimulus: bytes = b"") -> bytes:
    """An unsigned block. values: (1,) of CERTIFICATE.dtype; the hash of the stimulus is filled in.

    Raises CertificateRefused where a value is out of range or two contradict each other.
    """
    values = values.copy()
    values["stimulus_sha256"][0] = hash_words(hashlib.sha256(stimulus).digest()) if stimulus else 0
    _check(values)
    head = _HEADER.pack(MAGIC, FORMAT, 0, CERTIFICATE.hash, len(stimulus), values.nbytes)
    return head + values.tobytes() + stimulus + UNSIGNED


def decode_block(raw: bytes) -> Block:
    """Check a block and open it. Raises CertificateRefused with the reason."""
    if len(raw) < _HEADER.size + MAC_BYTES:
        raise CertificateRefused(f"certificate of {len(raw)} bytes is too short; sign the table again")
    magic, version, zero, schema_hash, stimulus_length, record_length = _HEADER.unpack_from(raw)
    if magic != MAGIC:
        raise CertificateRefused("certificate block is of another kind (magic is wrong); sign the table again")
    if version != FORMAT or zero:
        raise CertificateRefused(f"certificate format {version}, this software reads {FORMAT}; sign the table again")
    if schema_hash != CERTIFICATE.hash or record_length != CERTIFICATE.dtype.itemsize:
        raise CertificateRefused(
            f"certificate was made with schema {schema_hash:016x}, this software has {CERTIFICATE.hash:016x}; "
            "sign the table again"
        )
    stimulus_at = _HEADER.size + record_length
    mac_at = stimulus_at + stimulus_length
    if len(raw) != mac_at + MAC_BYTES:
        raise CertificateRefused(f"certificate of {len(raw)} bytes, its header announces {mac_at + MAC_BYTES}")
    values = np.frombuffer(raw[_HEADER.size : stimulus_at], CERTIFICATE.dtype)
    _check(values)
    stimulus = raw[stimulus_at:mac_at]
    digest = hashlib.sha256(stimulus).digest() if stimulus else bytes(32)
    if not np.array_equal(values["stimulus_sha256"][0], hash_words(digest)):
        raise CertificateRefused("the stimulus is not the one that the certificate names")
    return Block(values, stimulus, raw[mac_at:])


def _check(values: np.ndarray) -> None:
    try:
        check_ranges(CERTIFICATE, values)
    except TableRefused as error:
        raise CertificateRefused(str(error)) from error
    record = values[0]
    for low, high in _RANGES:
        if record[low] > record[high]:
            raise CertificateRefused(f"certificate: {low} = {record[low]:g} exceeds {high} = {record[high]:g}")
    if record["violations"] > record["outages"]:
        raise CertificateRefused(f"certificate: {record['violations']} violations in {record['outages']} outages")
    if record["grade"] and not (record["outages"] and record["certified_age_s"] > 0.0):
        raise CertificateRefused("certificate: a grade without outages flown, or for no age at all; certify again")


def content_crc32(table: TableImage) -> int:
    """CRC-32 of a table as it is without its certificate."""
    return zlib.crc32(_image(table, b"")[:-_FILE_CRC])


def attach(table: TableImage, values: np.ndarray, stimulus: bytes, key: bytes | None) -> bytes:
    """Image of a table with this certificate in place of what it carried, signed where a key is given.

    Raises CertificateRefused where the certificate is that of another table, or grades a table without a stimulus.
    """
    block = encode_block(values, stimulus)
    image = _image(table, block)
    if key is not None:
        mac = _mac(key, image[: -_FILE_CRC - MAC_BYTES])
        image = _image(table, block[:-MAC_BYTES] + mac)
    open_certificate(table._replace(certificate=block), None)
    return image


def open_certificate(table: TableImage, key: bytes | None) -> Block | None:
    """The certificate of a table, or None for a table that carries none and needs none.

    With a key, a table must carry a certificate that was signed with it. Raises CertificateRefused with the reason.
    """
    if not table.certificate:
        if key is not None:
            raise CertificateRefused(
                f"set {table.set_name} carries no certificate, and a key is given; sign it with `ground table sign`"
            )
        return None
    block = decode_block(table.certificate)
    named, own = int(block.values["table_crc32"][0]), content_crc32(table)
    if named != own:
        raise CertificateRefused(
            f"the certificate is that of table {named:08x}, this one is {own:08x} (set {table.set_name}); "
            "certify this table, or load that one"
        )
    if block.grade != Certificate.UNCERTIFIED and not block.stimulus:
        raise CertificateRefused(
            f"certificate of grade {block.grade.name} without a stimulus: nobody could tell whether this software "
            "computes what was certified; make one with `ground stimulus`"
        )
    if key is not None:
        if not block.signed:
            raise CertificateRefused("the certificate is not signed, and a key is given; sign it with that key")
        image = _image(table, table.certificate)
        if not hmac.compare_digest(block.mac, _mac(key, image[: -_FILE_CRC - MAC_BYTES])):
            raise CertificateRefused(
                "HMAC of the certificate is wrong: another key signed it, or table or certificate were changed since"
            )
    return block


def check_key(key: bytes, where: str) -> bytes:
    """The bytes of a key file without white space at its end; CertificateRefused where they are too few."""
    key = key.strip()
    if len(key) < KEY_BYTES_MIN:
        raise CertificateRefused(
            f"{where}: a key of {len(key)} bytes; give at least {KEY_BYTES_MIN}: `ground table key` makes one"
        )
    return key


def _image(table: TableImage, block: bytes) -> bytes:
    return encode(table.kind, table.set_name, table.values, block, table.valid_from_gps_ns, table.valid_to_gps_ns)


def _mac(key: bytes, message: bytes) -> bytes:
    return hmac.digest(key, message, "sha256")
