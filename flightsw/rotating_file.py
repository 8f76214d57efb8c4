"""A file that begins anew at a limit: what is full gets a number, and the oldest go before all of it is too large.

Used in the slack: each call costs a few system calls and no more. What was written is the kernel's, so the death of the
process loses none of it; a loss of power may.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from flightsw.icd.log_parts import closed_parts, part_path

PARTS = 8
SMALLEST_LIMIT_BYTES = 2 << 20  # an eighth of it still holds a slice of the journal


class RotatingFile:
    """Append-only. limit_bytes: of all parts together, from SMALLEST_LIMIT_BYTES; None: one file without an end.

    Parts that a former run left under this name are taken away, as its file is.
    """

    __slots__ = ("_fd", "_kept", "_limit_bytes", "_next", "_path", "_size")

    def __init__(self, path: Path, limit_bytes: int | None = None) -> None:
        if limit_bytes is not None and limit_bytes < SMALLEST_LIMIT_BYTES:
            raise ValueError(f"{path}: {limit_bytes} bytes are too few; give at least {SMALLEST_LIMIT_BYTES}")
        self._path = path
        self._limit_bytes = limit_bytes
        self._kept: list[tuple[Path, int]] = []  # closed parts and their sizes, oldest first
        self._next = 1
        self._size = 0
        for _, part in closed_parts(path):
            part.unlink()
        self._fd = _create(path)

    def write(self, data: bytes) -> int:
        """Bytes taken, from the beginning; OSError where the disk takes none."""
        written = os.write(self._fd, data)
        self._size += written
        return written

    def turn(self) -> None:
        """Begin a new part if this one is full; to be called between whole entries.

        Where the disk refuses, the present part goes on and the next call tries again.
        """
        if self._limit_bytes is None or self._size < self._limit_bytes // PARTS:
            return
        fresh, part = self._path.with_name(self._path.name + ".new"), part_path(self._path, self._next)
        try:
            fd = _create(fresh)
        except OSError:
            return
        try:
            os.rename(self._path, part)
            os.rename(fresh, self._path)
        except OSError:
            os.close(fd)
            with suppress(OSError):
                fresh.unlink()
            return
        os.close(self._fd)
        self._kept.append((part, self._size))
        self._fd, self._size, self._next = fd, 0, self._next + 1
        # two parts of room: the one that is being filled, and the entries that make it too full
        while self._kept and sum(size for _, size in self._kept) > self._limit_bytes - 2 * (self._limit_bytes // PARTS):
            with suppress(OSError):
                self._kept[0][0].unlink()
            del self._kept[0]

    def close(self) -> None:
        """Close the file."""
        with suppress(OSError):
            os.close(self._fd)


def _create(path: Path) -> int:
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
