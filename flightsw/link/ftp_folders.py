"""Where files come from and go to: two folders, one level deep, plain files only.

A path is one folder and one plain name; nothing else is a path: no dot at its beginning, no "..", no link.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path

LOG, UPLOAD = "log", "upload"
FOLDERS = (LOG, UPLOAD)
ACTIVE_FILE = "active.tbl"  # what flies, made when it is opened
UPLOADS_MAX = 8
_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,63}")


class Err(IntEnum):
    """Errors of a NAK."""

    FAIL = 1
    ERRNO = 2
    SIZE = 3
    SESSION = 4
    NO_SESSION = 5
    EOF = 6
    UNKNOWN = 7
    EXISTS = 8
    PROTECTED = 9
    NOT_FOUND = 10


class Refused(Exception):
    """A request that is answered with NAK."""

    def __init__(self, error: int, errno: int = 0) -> None:
        super().__init__(error)
        self.data = bytes((error, errno)) if error == Err.ERRNO else bytes((error,))


class Folders:
    """log, upload: the two folders, None where there is none. active: bytes of the table that flies."""

    def __init__(self, log: Path | None, upload: Path | None, active: Callable[[], bytes]) -> None:
        self._folders = {name: path for name, path in ((LOG, log), (UPLOAD, upload)) if path is not None}
        if upload is not None:
            upload.mkdir(parents=True, exist_ok=True)
        self._active = active

    def _parts(self, raw: bytes) -> list[str]:
        text = raw.partition(b"\0")[0]
        if not text.isascii():
            raise Refused(Err.NOT_FOUND)
        path = text.decode("ascii")
        parts = path.removeprefix("/").split("/") if path not in ("", "/", ".") else []
        if parts and parts[-1] == "":
            parts.pop()
        if len(parts) > 2 or any(_NAME.fullmatch(part) is None for part in parts):
            raise Refused(Err.NOT_FOUND)
        return parts

    def file(self, raw: bytes, writes: bool = False) -> Path:
        """The file that a request names. Raises Refused where it is none of ours, or may not be written."""
        parts = self._parts(raw)
        if len(parts) != 2 or parts[0] not in self._folders:
            raise Refused(Err.NOT_FOUND)
        if writes and (parts[0] != UPLOAD or parts[1] == ACTIVE_FILE):
            raise Refused(Err.PROTECTED)
        return self._folders[parts[0]] / parts[1]

    def is_active(self, path: Path) -> bool:
        """Whether this is the table that flies, which is no file."""
        return path.name == ACTIVE_FILE and path.parent == self._folders.get(UPLOAD)

    def entries(self, raw: bytes) -> list[str]:
        """What a request to list a folder is answered with: D and a name, or F, name, tab and size."""
        parts = self._parts(raw)
        if not parts:
            return [f"D{name}" for name in FOLDERS if name in self._folders]
        if len(parts) > 1 or parts[0] not in self._folders:
            raise Refused(Err.NOT_FOUND)
        found = []
        with os.scandir(self._folders[parts[0]]) as entries:
            for entry in entries:
                if entry.is_file(follow_symlinks=False) and _NAME.fullmatch(entry.name):
                    found.append(f"F{entry.name}\t{entry.stat(follow_symlinks=False).st_size}")
        if parts[0] == UPLOAD:
            found.append(f"F{ACTIVE_FILE}\t{len(self._active())}")
        return sorted(found)

    def full(self) -> bool:
        """Whether no other file may be put into /upload."""
        return len(self.entries(UPLOAD.encode())) > UPLOADS_MAX


def open_plain(path: Path, flags: int) -> tuple[int, int]:
    """Descriptor and size of a plain file. Raises Refused where it is missing, a link or anything else."""
    try:
        fd = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644)
    except FileNotFoundError:
        raise Refused(Err.NOT_FOUND) from None
    status = os.fstat(fd)
    if not stat.S_ISREG(status.st_mode):
        os.close(fd)
        raise Refused(Err.NOT_FOUND)
    return fd, status.st_size
