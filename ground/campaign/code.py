"""What code makes the figures of a run: the modules of this project that a module imports, directly or through others.

A certificate names it by its hash. A change to the link, to the console or to another flight function does not touch
an outage, and does not touch the hash; one to navigation, its tables or the simulated world does.
"""

from __future__ import annotations

import ast
import hashlib
from functools import lru_cache
from pathlib import Path

import flightsw

_ROOT = Path(flightsw.__file__).resolve().parents[1]
_PACKAGES = ("flightsw", "ground", "hil_sim")


@lru_cache(maxsize=4)
def hash_of(*modules: str) -> str:
    """SHA-256 over the sources of modules and of all that they import, as far as it is of this project."""
    digest = hashlib.sha256()
    for name in imported_by(*modules):
        path = _source(name)
        assert path is not None
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def imported_by(*modules: str) -> list[str]:
    """Names of the modules and of all that they import, sorted; read from the sources, whatever is loaded already.

    Imports within functions count. Raises LookupError for a module that is none of this project's.
    """
    found: set[str] = set()
    waiting = list(modules)
    for name in modules:
        if _source(name) is None:
            raise LookupError(f"{name}: no module of {', '.join(_PACKAGES)}")
    while waiting:
        name = waiting.pop()
        path = _source(name)
        if name in found or path is None:
            continue
        found.add(name)
        waiting.extend(_imports(path.read_bytes()))
        if "." in name:
            waiting.append(name.rpartition(".")[0])
    return sorted(found)


def _imports(source: bytes) -> list[str]:
    """Names that may be modules: of `from a import b` both a and a.b."""
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.extend(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.append(node.module)
            names.extend(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def _source(name: str) -> Path | None:
    if name.partition(".")[0] not in _PACKAGES:
        return None
    place = _ROOT / name.replace(".", "/")
    for path in (place.with_suffix(".py"), place / "__init__.py"):
        if path.is_file():
            return path
    return None
