"""Who may command: MAVLink 2 signatures, verified before anything is remembered of them; no message counts twice.

signature = first 48 bits of SHA-256(key, frame up to its time stamp); time stamp: 48 bits, 10 us since 2015-01-01.
A stamp must be later than the last of its sender and link, not older than a minute, not more than a minute ahead,
and later than everything that could have been accepted before the last restart: that ceiling is on the disk, ahead
of now, so that no message ever waits for the disk. After a restart flight's own stamps begin at the ceiling; a
sender that keeps its stamps beyond those it hears, as MAVLink asks, is never locked out.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from enum import IntEnum
from pathlib import Path

EPOCH_UNIX_NS = 1_420_070_400_000_000_000
UNIT_NS = 10_000
MINUTE = 60_000_000_000 // UNIT_NS
SIGNATURE_LENGTH = 13
KEY_LENGTH = 32
_STREAMS_MAX = 16
_CEILING = struct.Struct("<8sQ")
_CEILING_MAGIC = b"LNAVSIG1"
_POLL_SLICES = 50


class Refusal(IntEnum):
    """LEONAV_LINK_REFUSAL: why a message from the ground was not taken."""

    DAMAGED = 0
    UNKNOWN = 1
    WRONG_TARGET = 2
    UNSIGNED = 3
    BAD_SIGNATURE = 4
    REPLAYED = 5
    TOO_OLD = 6
    FUTURE = 7
    STREAMS = 8
    FLOOD = 9
    PEER = 10


ACCEPTED = -1


def stamp_of(unix_ns: int) -> int:
    """Time stamp of a signature."""
    return max(0, (unix_ns - EPOCH_UNIX_NS) // UNIT_NS)


def signature(key: bytes, signed_part: bytes) -> bytes:
    """The six bytes. signed_part: the frame from its magic to its time stamp."""
    return hashlib.sha256(key + signed_part).digest()[:6]


class KeyRefused(ValueError):
    """A key file that cannot be used; the text says why and what to do."""


class KeyFile:
    """Up to two keys, one a line, 64 hexadecimal digits: the first signs, both are accepted.

    To change keys: put the new one first, let the ground change, take the old one away. Flight notices in the slack; a
    file that has become unfit changes nothing.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.keys = read_keys(path)
        self._seen = path.stat().st_mtime_ns
        self._slices = 0

    def work_slice(self) -> None:
        """Look now and then whether the file has changed; a slack job."""
        self._slices += 1
        if self._slices % _POLL_SLICES:
            return
        with suppress(OSError, KeyRefused):
            changed = self._path.stat().st_mtime_ns
            if changed != self._seen:
                self.keys = read_keys(self._path)
                self._seen = changed


def read_keys(path: Path) -> tuple[bytes, ...]:
    """The keys of a file; KeyRefused where others may read it or a line is not a key."""
    try:
        if os.name == "posix" and path.stat().st_mode & 0o077:
            raise KeyRefused(f"{path}: others may read or change it; chmod 600 {path}")
        lines = path.read_text(encoding="ascii").split()
    except (OSError, UnicodeError) as error:
        raise KeyRefused(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    try:
        keys = tuple(bytes.fromhex(line) for line in lines)
    except ValueError:
        keys = ()
    if not 1 <= len(keys) <= 2 or any(len(key) != KEY_LENGTH for key in keys):
        raise KeyRefused(f"{path}: give one or two lines of 64 hexadecimal digits; `ground link key` makes one")
    return keys


class Ceiling:
    """A time stamp on the disk that no accepted message has reached yet. `value`: as it stands there."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.floor = self._read()  # everything accepted before this start was not later
        self.value = self.floor
        self.failed = 0

    def _read(self) -> int:
        try:
            raw = self._path.read_bytes()
        except FileNotFoundError:
            return 0
        body = raw[: _CEILING.size]
        if len(raw) != _CEILING.size + 4 or zlib.crc32(body) != int.from_bytes(raw[_CEILING.size :], "little"):
            raise KeyRefused(
                f"{self._path}: damaged; what was accepted before is not known: change the key, then remove this file"
            )
        return int(_CEILING.unpack(body)[1])

    def keep_ahead(self, now: int) -> None:
        """Move it up before a sender could reach it; a slack job."""
        if now + 2 * MINUTE <= self.value:
            return
        body = _CEILING.pack(_CEILING_MAGIC, now + 3 * MINUTE)
        fresh = self._path.with_name(self._path.name + ".new")
        try:
            fd = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            try:
                os.write(fd, body + zlib.crc32(body).to_bytes(4, "little"))
                os.fsync(fd)
            finally:
                os.close(fd)
            os.replace(fresh, self._path)
        except OSError:
            self.failed += 1
            return
        self.value = now + 3 * MINUTE


class Access:
    """Judges frames. `keys`: those accepted now, the first one signs; empty: nothing signed can be verified.

    bench: unsigned commands are taken, for clients that cannot sign, on loopback only (the composition root sees to
    that).
    """

    __slots__ = ("_ahead", "_ceiling", "_keys", "_streams", "bench")

    def __init__(
        self, keys: Callable[[], tuple[bytes, ...]], ceiling: Ceiling | None, unix_ns: int, bench: bool = False
    ) -> None:
        self._keys = keys
        self._ceiling = ceiling
        self._streams: dict[tuple[int, int, int], int] = {}
        self.bench = bench
        floor = ceiling.floor if ceiling is not None else 0
        self._ahead = max(0, floor + 1 - stamp_of(unix_ns))

    @property
    def signing_key(self) -> bytes | None:
        """The key that flight signs with."""
        keys = self._keys()
        return keys[0] if keys else None

    def now(self, unix_ns: int) -> int:
        """Flight's own time stamp, never below one it may have used before."""
        return stamp_of(unix_ns) + self._ahead

    def keep_ahead(self, unix_ns: int) -> None:
        """Keep the ceiling on the disk ahead of now; a slack job."""
        if self._ceiling is not None:
            self._ceiling.keep_ahead(self.now(unix_ns))

    def verify(self, frame: bytes, unix_ns: int) -> int:
        """ACCEPTED and remembered, or the Refusal. frame: a whole signed frame whose checksum is right."""
        found = frame[-6:]
        signed_part = frame[:-6]
        for key in self._keys():
            if hmac.compare_digest(signature(key, signed_part), found):
                break
        else:
            return Refusal.BAD_SIGNATURE
        stamp = int.from_bytes(frame[-12:-6], "little")
        now = self.now(unix_ns)
        sender = (frame[5], frame[6], frame[-13])
        last = self._streams.get(sender)
        if last is not None and stamp <= last:
            return Refusal.REPLAYED
        floor = self._ceiling.floor if self._ceiling is not None else 0
        if stamp <= floor or stamp < now - MINUTE:
            return Refusal.TOO_OLD
        if stamp > now + MINUTE or (self._ceiling is not None and stamp > self._ceiling.value):
            return Refusal.FUTURE
        if last is None and len(self._streams) >= _STREAMS_MAX and not self._forget(now):
            return Refusal.STREAMS
        self._streams[sender] = stamp
        return ACCEPTED

    def _forget(self, now: int) -> bool:
        """Drop a sender whose last stamp is too old to be taken again: nothing of it can be replayed."""
        for sender, last in self._streams.items():
            if last < now - MINUTE:
                del self._streams[sender]
                return True
        return False
