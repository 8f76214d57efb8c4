"""How this room declares its compiled functions, so that an older one can never be served from numba's cache.

numba's cache looks at the file of a function only, not at those of its callees. Here callees are therefore never cached
by themselves, they are compiled into the entry that calls them; and every entry is a closure over ROOM, a hash of the
room's sources, which numba makes part of the key of what it caches.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flightsw.kernels import registry  # before numba: it names the cache folder

import numba  # isort: skip


def source_hash() -> str:
    """SHA-256 over the sources of this room."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).resolve().parent.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


ROOM = int(source_hash()[:15], 16)
entry = registry.entry


def kernel(function: Callable[..., Any]) -> Any:
    """Declare a function that only other kernels call; compiled into its caller, with the registry's options."""
    return numba.njit(nogil=True, fastmath=False, error_model="numpy")(function)
