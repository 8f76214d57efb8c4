"""The key that console and flight share: what is sent is signed with it, what is heard is verified with it first.

The stamps of what the console sends stay beyond those it hears, so that flight takes them after a restart too.
"""

from __future__ import annotations

import hashlib
import hmac
import os
from collections.abc import Callable
from pathlib import Path

from ground.errors import OperatorError

EPOCH_UNIX_S = 1_420_070_400
UNITS_PER_S = 100_000
KEY_LENGTH = 32
SIGNED = 0x01


def read_key(path: Path) -> tuple[bytes, ...]:
    """The keys of a file, the one that signs first; OperatorError where it cannot be used."""
    try:
        if os.name == "posix" and path.stat().st_mode & 0o077:
            raise OperatorError(f"--key {path}: others may read or change it; chmod 600 {path}")
        keys = tuple(bytes.fromhex(line) for line in path.read_text(encoding="ascii").split())
    except OSError as error:
        raise OperatorError(f"--key {path}: cannot be read ({error.strerror})") from None
    except ValueError:
        keys = ()
    if not 1 <= len(keys) <= 2 or any(len(key) != KEY_LENGTH for key in keys):
        raise OperatorError(f"--key {path}: give one or two lines of 64 hexadecimal digits")
    return keys


class Verifier:
    """Judges frames by their signature. `heard`: latest stamp that was verified; `refused`: counts those that were not.

    A stamp that is not later than the last of its sender is a replay. clock: Unix seconds.
    """

    def __init__(self, keys: tuple[bytes, ...], clock: Callable[[], float]) -> None:
        self._keys = keys
        self._clock = clock
        self._last: dict[tuple[int, int, int], int] = {}
        self.heard = 0
        self.sent = 0
        self.refused = 0

    @property
    def signing_key(self) -> bytes:
        """The key to sign with."""
        return self._keys[0]

    def accept(self, frame: bytes) -> bool:
        """Whether a whole frame is signed with our key and new."""
        if not frame[2] & SIGNED or not any(
            hmac.compare_digest(hashlib.sha256(key + frame[:-6]).digest()[:6], frame[-6:]) for key in self._keys
        ):
            self.refused += 1
            return False
        stamp = int.from_bytes(frame[-12:-6], "little")
        sender = (frame[5], frame[6], frame[-13])
        if stamp <= self._last.get(sender, 0):
            self.refused += 1
            return False
        self._last[sender] = stamp
        self.heard = max(self.heard, stamp)
        return True

    def next_stamp(self) -> int:
        """The stamp of the next frame to send."""
        now = int((self._clock() - EPOCH_UNIX_S) * UNITS_PER_S)
        self.sent = max(now, self.heard + 1, self.sent + 1)
        return self.sent
