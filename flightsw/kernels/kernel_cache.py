"""Where compiled kernels are cached, so that a stale one can never be served.

numba's own cache looks at the file of a function only: it does not notice an edit in a callee's file, and it
serves kernels without bounds checks to a run that asked for them. The folder is therefore keyed by everything
that decides the machine code, and a change of any of it starts from an empty folder. Within it nothing depends on
where the package lies (`cache_locator.py`): a second copy of the same sources finds its kernels compiled.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import platform
import sys
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent
_COMPILED_ROOMS = ("kernels", "nav", "integrity")
_LOCATORS = "flightsw.kernels.cache_locator.PackageLocator,UserProvidedCacheLocator"
_COMPILED_FILES = ("records.py", "modes.py", "icd/alerts.py", "icd/enums.py", "icd/table_field.py")


def compiled_sources() -> list[Path]:
    """Every source file whose text can end in machine code, in a fixed order."""
    rooms = [path for room in _COMPILED_ROOMS for path in sorted((_PACKAGE / room).glob("*.py"))]
    schemas = sorted((_PACKAGE / "icd").glob("*_schema.py"))
    return rooms + [_PACKAGE / name for name in _COMPILED_FILES if (_PACKAGE / name).exists()] + schemas


def source_hash() -> str:
    """SHA-256 over the compiled sources; names the flight code in `run.json`."""
    digest = hashlib.sha256()
    for path in compiled_sources():
        digest.update(path.relative_to(_PACKAGE).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def cache_folder() -> Path:
    """The folder for this source, these versions, this machine and these options."""
    base = os.environ.get("LEONAV_CACHE_DIR") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache"), "leonav"
    )
    key = [
        source_hash(),
        *(importlib.metadata.version(name) for name in ("numba", "numpy", "llvmlite")),
        sys.version,
        platform.machine(),
        platform.processor(),
        os.environ.get("NUMBA_CPU_NAME", ""),
        os.environ.get("NUMBA_BOUNDSCHECK", "0"),
    ]
    return Path(base) / "kernels" / hashlib.sha256("\n".join(key).encode()).hexdigest()[:24]


def configure() -> Path:
    """Point numba at the folder; must run before the first kernel is declared."""
    folder = cache_folder()
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    os.environ["NUMBA_CACHE_LOCATOR_CLASSES"] = _LOCATORS
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)
        sys.modules["numba"].config.CACHE_LOCATOR_CLASSES = _LOCATORS
    return folder
