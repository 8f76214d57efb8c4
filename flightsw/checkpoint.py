"""Warm restart: the filter's part of NAV in a file, written in the slack, put back once onboard time is known again.

    magic "LNAVCKP1" | format u16 | hash of the saved fields u64 | CRC-32 of the navigation table u32
    | GPS time of the epoch i64 [ns] | payload length u32 | payload | CRC-32 of everything before it

Little-endian; nothing may follow. The payload is every field of NAV in its order but those that belong to the process
which wrote it: the clock and its pulses (the counter begins anew; pulses set time within seconds), fixes, positions and
attitudes that waited for others, and counts. As no fix is counted yet, the state is offered to nobody before one has
confirmed it. A file is written beside the old one and renamed: one whole file is there whenever power fails.
"""

from __future__ import annotations

import hashlib
import os
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

MAGIC = b"LNAVCKP1"
FORMAT = 1
_HEADER = struct.Struct("<8sHQIqI")
_CRC = struct.Struct("<I")
_SLICE = 16_384  # bytes handed to the disk by one slice of slack work

# Fields of NAV that are not saved: by how their names begin, and by name.
TRANSIENT_PREFIXES = ("clock_", "pulse_", "candidate_", "arc_", "attitude_")
TRANSIENT_FIELDS = ("start_count", "fixes_accepted", "rejected")


class CheckpointRefused(ValueError):
    """A checkpoint that may not be used; the text says why and what to do."""


def saved_fields(dtype: np.dtype) -> tuple[str, ...]:
    """Names of the fields that a checkpoint holds, in order."""
    names = dtype.names or ()
    return tuple(n for n in names if not n.startswith(TRANSIENT_PREFIXES) and n not in TRANSIENT_FIELDS)


def _packed(dtype: np.dtype) -> np.dtype:
    return np.dtype([(name, dtype[name].base.str, dtype[name].shape) for name in saved_fields(dtype)])


def _hash(packed: np.dtype) -> int:
    text = "\n".join(f"{name} {packed[name].base.str} {packed[name].shape}" for name in packed.names or ())
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")


class Capture:
    """One image, allocated once and filled again by every `take`. nav: the record (1,) that it is taken from."""

    __slots__ = ("_fields", "_head", "_nav", "_payload", "image")

    def __init__(self, nav: np.ndarray, table_crc32: int) -> None:
        packed = _packed(nav.dtype)
        self._nav = nav
        self._fields = packed.names or ()
        self._head = (MAGIC, FORMAT, _hash(packed), table_crc32)
        self.image = bytearray(_HEADER.size + packed.itemsize + _CRC.size)
        self._payload = np.frombuffer(self.image, packed, 1, _HEADER.size)

    def belongs_to(self, table_crc32: int) -> None:
        """From now on the state is that of another navigation table."""
        self._head = (*self._head[:3], table_crc32)

    def take(self) -> None:
        """Copy the state as it stands into `image`."""
        for name in self._fields:
            self._payload[name] = self._nav[name]
        _HEADER.pack_into(self.image, 0, *self._head, int(self._nav["t_gps_ns"][0]), self._payload.nbytes)
        crc_at = len(self.image) - _CRC.size
        _CRC.pack_into(self.image, crc_at, zlib.crc32(memoryview(self.image)[:crc_at]))


def capture(nav: np.ndarray, table_crc32: int) -> bytes:
    """A checkpoint of the record `nav` (1,) flown with this navigation table, once."""
    one = Capture(nav, table_crc32)
    one.take()
    return bytes(one.image)


def decode(image: bytes, dtype: np.dtype, table_crc32: int) -> tuple[int, np.ndarray]:
    """GPS time [ns] of the epoch and the saved fields (1,) of an image; CheckpointRefused says why not."""
    packed = _packed(dtype)
    if len(image) < _HEADER.size + _CRC.size:
        raise CheckpointRefused(f"{len(image)} bytes are too few for a checkpoint")
    magic, version, schema_hash, crc32, t_gps_ns, length = _HEADER.unpack_from(image)
    if magic != MAGIC:
        raise CheckpointRefused("not a leonav checkpoint (magic is wrong); name another file")
    if version != FORMAT:
        raise CheckpointRefused(f"checkpoint format {version}, this software reads {FORMAT}")
    crc_at = _HEADER.size + length
    if len(image) != crc_at + _CRC.size:
        raise CheckpointRefused(f"{len(image)} bytes, header announces {crc_at + _CRC.size}")
    if zlib.crc32(memoryview(image)[:crc_at]) != _CRC.unpack_from(image, crc_at)[0]:
        raise CheckpointRefused("CRC-32 is wrong: the file is damaged")
    if schema_hash != _hash(packed) or length != packed.itemsize:
        raise CheckpointRefused(
            f"holds fields {schema_hash:016x}, this software has {_hash(packed):016x}: another version wrote it"
        )
    if crc32 != table_crc32:
        raise CheckpointRefused(
            f"was flown with navigation table {crc32:08x}, here is {table_crc32:08x}; load that table"
        )
    fields = np.frombuffer(image, packed, 1, _HEADER.size)
    if not fields["initialised"][0] or not np.isfinite(fields["x"]).all():
        raise CheckpointRefused("holds no state")
    return t_gps_ns, fields


def restore(nav: np.ndarray, image: bytes, table_crc32: int) -> None:
    """Put a checkpoint into the record `nav` (1,); what is not saved stays. Refused as a whole or not at all."""
    _, fields = decode(image, nav.dtype, table_crc32)
    for name in fields.dtype.names or ():
        nav[name] = fields[name]


class Resume:
    """A checkpoint that waits for onboard time: without it nobody can say how old it is.

    image: as `capture` made it. max_age_s: an older state is dropped, since flight would be long in catching up with
    it. Raises CheckpointRefused.
    """

    __slots__ = ("_max_age_ns", "_t_gps_ns", "_table_crc32", "age_s", "image", "image_sha256", "max_age_s", "pending")

    def __init__(self, image: bytes, dtype: np.dtype, table_crc32: int, max_age_s: float) -> None:
        self._t_gps_ns, _ = decode(image, dtype, table_crc32)
        self.image = image
        self._table_crc32 = table_crc32
        self._max_age_ns = round(max_age_s * 1e9)
        self.max_age_s = max_age_s
        self.image_sha256 = hashlib.sha256(image).hexdigest()
        self.pending = True
        self.age_s = float("nan")  # when onboard time was known

    @property
    def dropped(self) -> bool:
        """Whether the state was too old, or of the future, and flight starts from fixes."""
        return not self.pending and not 0.0 <= self.age_s <= self.max_age_s

    def settle(self, nav: np.ndarray, t_now_gps_ns: int) -> None:
        """Put the state into `nav`, or drop it, now that it is t_now. Called once, between steps."""
        self.pending = False
        age_ns = t_now_gps_ns - self._t_gps_ns
        self.age_s = age_ns * 1e-9
        if 0 <= age_ns <= self._max_age_ns:
            restore(nav, self.image, self._table_crc32)


class CheckpointWriter:
    """A slack job: every `period_ns` of the counter the state goes to the file, a bounded slice at a time.

    nav: the record (1,). counter_ns: gives the counter of the present tick. whole: write a file in one slice, for
    lockstep. A file that cannot be written is given up and counted; the next period tries again.
    """

    __slots__ = (
        "_at",
        "_capture",
        "_counter_ns",
        "_due_ns",
        "_fd",
        "_fresh",
        "_nav",
        "_path",
        "_period_ns",
        "_slice",
        "failed",
        "written",
    )

    def __init__(
        self,
        path: Path,
        nav: np.ndarray,
        table_crc32: int,
        period_ns: int,
        counter_ns: Callable[[], int],
        whole: bool,
    ) -> None:
        self._path = path
        self._fresh = path.with_name(path.name + ".new")
        self._nav = nav
        self._capture = Capture(nav, table_crc32)
        self._counter_ns = counter_ns
        self._period_ns = period_ns
        self._due_ns = -1
        self._slice = len(self._capture.image) if whole else _SLICE
        self._fd = -1
        self._at = 0
        self.written = 0
        self.failed = 0

    def belongs_to(self, table_crc32: int) -> None:
        """From now on checkpoints are of another navigation table; one that is being written is finished."""
        self.close()
        self._capture.belongs_to(table_crc32)

    def write_slice(self) -> None:
        """Begin when it is time, or go on with what is begun."""
        if self._fd < 0 and not self._begin():
            return
        self._go_on()

    def close(self) -> None:
        """Finish what is begun."""
        while self._fd >= 0:
            self._go_on()

    def _begin(self) -> bool:
        now_ns = self._counter_ns()
        if self._due_ns < 0:
            self._due_ns = now_ns + self._period_ns
        if now_ns < self._due_ns or not (self._nav["initialised"][0] and self._nav["clock_valid"][0]):
            return False
        self._due_ns = now_ns + self._period_ns
        self._capture.take()
        self._at = 0
        try:
            # Each write goes to the disk as it is made: were all of it left to fsync, that would hold up a tick.
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_DSYNC
            self._fd = os.open(self._fresh, flags, 0o644)
        except OSError:
            self.failed += 1
        return self._fd >= 0

    def _go_on(self) -> None:
        image = self._capture.image
        try:
            if self._at < len(image):
                self._at += os.write(self._fd, memoryview(image)[self._at : self._at + self._slice])
            if self._at == len(image):
                os.fsync(self._fd)
                self._end()
                os.replace(self._fresh, self._path)
                self.written += 1
        except OSError:
            self._end()
            self.failed += 1
            with suppress(OSError):
                self._fresh.unlink()

    def _end(self) -> None:
        if self._fd >= 0:
            fd, self._fd = self._fd, -1
            os.close(fd)
