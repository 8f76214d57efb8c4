"""The hash of this room's sources, part of the key of what numba caches: see flightsw/crosslink/declare.py."""

from __future__ import annotations

import hashlib
from pathlib import Path

from flightsw.crosslink.declare import entry, kernel

__all__ = ["ROOM", "entry", "kernel", "source_hash"]


def source_hash() -> str:
    """SHA-256 over the sources of this room that are compiled."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).resolve().parent.glob("*.py")):
        if path.name == "setup.py":  # settings, before any tick
            continue
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


ROOM = int(source_hash()[:15], 16)
