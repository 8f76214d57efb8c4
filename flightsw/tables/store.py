"""Two images of a table on disk, A and B, and a pointer to the one that flies: whole files only, one always boots.

    NAME.a.tbl  NAME.b.tbl   table files, flightsw/icd/table_file.py
    NAME.active              magic "LNAVPTR1" | slot, 'a' or 'b' | CRC-32 of that table | CRC-32 of what precedes it

Every file is written whole beside its place, forced to the disk and renamed over it. A new table goes to the slot that
does not fly; the pointer is moved only after the new table has proven itself, so power may fail at any instant.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from flightsw.icd.table_file import TableImage, TableRefused

MAGIC = b"LNAVPTR1"
SLOTS = ("a", "b")
_POINTER = struct.Struct("<8scI")
_CRC = struct.Struct("<I")
_SLICE = 16_384  # bytes handed to the disk at a time


class Booted(NamedTuple):
    """What a store boots with. told: what was found wrong on the way, in words."""

    table: TableImage
    slot: str
    told: tuple[str, ...]


class TableStore:
    """The two images of one table, `name`, in `folder`."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder = folder
        self._name = name

    def path(self, slot: str) -> Path:
        """File of a slot."""
        return self._folder / f"{self._name}.{slot}.tbl"

    @property
    def pointer(self) -> Path:
        """File that names the slot in use."""
        return self._folder / f"{self._name}.active"

    def active(self) -> str | None:
        """The slot that the pointer names; None where it is missing or damaged."""
        try:
            raw = self.pointer.read_bytes()
        except OSError:
            return None
        if len(raw) != _POINTER.size + _CRC.size or _CRC.unpack_from(raw, _POINTER.size)[0] != zlib.crc32(raw[:-4]):
            return None
        magic, slot, _ = _POINTER.unpack_from(raw)
        return slot.decode() if magic == MAGIC and slot in (b"a", b"b") else None

    def boot(self, accept: Callable[[bytes], TableImage]) -> Booted | None:
        """The table to begin with: the one pointed to, else the other one. None where neither is accepted.

        accept: opens the bytes of a file or raises TableRefused.
        """
        pointed = self.active()
        told = [] if pointed else [f"{self.pointer}: missing or damaged"]
        for slot in (pointed, *(s for s in SLOTS if s != pointed)) if pointed else SLOTS:
            assert slot is not None
            try:
                return Booted(accept(self.path(slot).read_bytes()), slot, tuple(told))
            except OSError as error:
                told.append(f"{self.path(slot)}: cannot be read ({error.strerror})")
            except TableRefused as error:
                told.append(f"{self.path(slot)}: refused: {error}")
        return None

    def write(self, slot: str, image: bytes) -> Iterator[None]:
        """Write a table into a slot, a bounded part at each turn. Raises OSError; the old file then stands."""
        yield from self._write_whole(self.path(slot), image)

    def point(self, slot: str, table: TableImage) -> None:
        """From the next start on, this slot flies."""
        body = _POINTER.pack(MAGIC, slot.encode(), table.crc32)
        for _ in self._write_whole(self.pointer, body + _CRC.pack(zlib.crc32(body))):
            pass

    def begin_with(self, image: bytes, table: TableImage) -> None:
        """Make the store's first entry."""
        self._folder.mkdir(parents=True, exist_ok=True)
        for _ in self.write(SLOTS[0], image):
            pass
        self.point(SLOTS[0], table)

    def _write_whole(self, path: Path, content: bytes) -> Iterator[None]:
        fresh = path.with_name(path.name + ".new")
        fd = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        try:
            at = 0
            while at < len(content):
                at += os.write(fd, memoryview(content)[at : at + _SLICE])
                yield
            os.fsync(fd)
        except OSError:
            with suppress(OSError):
                fresh.unlink()
            raise
        finally:
            os.close(fd)
        os.replace(fresh, path)
        folder = os.open(self._folder, os.O_RDONLY)  # the renaming itself must reach the disk
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def other(slot: str) -> str:
    """The slot that does not fly."""
    return SLOTS[1 - SLOTS.index(slot)]
