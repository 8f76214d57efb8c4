"""How a room of compiled functions declares them, so that an older one can never be served from numba's cache.

numba's cache looks at the file of a function only, not at those of its callees. Callees are therefore never cached by
themselves, they are compiled into the entry that calls them; and every entry is a closure over its room's ROOM, a hash
of the room's sources, which numba makes part of the key of what it caches.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flightsw.kernels import registry  # before numba: it names the cache folder

import numba  # isort: skip

entry = registry.entry
_OPTIONS: dict[str, Any] = {"nogil": True, "fastmath": False, "error_model": "numpy", "no_cfunc_wrapper": True}


def kernel(function: Callable[..., Any]) -> Any:
    """Declare a function that only other kernels call; compiled into its caller, with the registry's options."""
    return numba.njit(**_OPTIONS)(function)


def source_hash(folder: Path, but: tuple[str, ...] = ()) -> str:
    """SHA-256 over this file and the sources in a folder, in order of their names; but: names that are left out."""
    digest = hashlib.sha256(Path(__file__).resolve().read_bytes())
    for path in sorted(folder.glob("*.py")):
        if path.name not in but:
            digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def number_of(digest: str) -> int:
    """Of a hash, what fits an int64 and a closure."""
    return int(digest[:15], 16)
