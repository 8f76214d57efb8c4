"""Where in the cache folder the kernels of a file lie: by its place in the package, not by that of the package.

The folder is keyed by the text of all of them (`kernel_cache.py`). numba, which looks at one file only, takes the path
of the whole into its own key, and compiles everything anew for every copy of the same sources. Kernels of other
packages, whose callees the key does not cover, keep that.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from numba.core.caching import UserProvidedCacheLocator

_PACKAGE = Path(__file__).resolve().parent.parent


class PackageLocator(UserProvidedCacheLocator):
    """numba's locator in a folder that is given, for the files of this package."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """None for a file of another package: numba then asks the next locator."""
        if not Path(py_file).resolve().is_relative_to(_PACKAGE):
            return None
        return super().from_function(py_func, py_file)

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Room of the file, as a name of one folder."""
        room = Path(py_file).resolve().parent.relative_to(_PACKAGE.parent)
        return "_".join(room.parts) or os.curdir
