"""The hash of this room's sources, part of the key of what numba caches: see flightsw/rooms.py."""

from __future__ import annotations

from pathlib import Path

from flightsw import rooms
from flightsw.rooms import entry, kernel

__all__ = ["ROOM", "entry", "kernel", "source_hash"]


def source_hash() -> str:
    """SHA-256 over the sources of this room."""
    return rooms.source_hash(Path(__file__).resolve().parent)


ROOM = rooms.number_of(source_hash())
