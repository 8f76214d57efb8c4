"""Declares compiled functions, compiles them all before the loop starts, and forbids compiling afterwards.

`kernel` declares a function that other kernels call; `entry(...)` declares one that Python calls, with the
types it is called with. Nothing compiles on import: `warm_up` does it, in order of declaration, so that callees
come first, and then closes every entry against new types.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flightsw.kernels import kernel_cache

kernel_cache.configure()

import numba  # noqa: E402  (numba reads its cache folder when it is imported)
from numba import types  # noqa: E402

Progress = Callable[[int, int, str], None]

F8 = types.float64
I8 = types.int64
VECTOR = types.Array(types.float64, 1, "C")
MATRIX = types.Array(types.float64, 2, "C")
TIMES = types.Array(types.int64, 1, "C")

_OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    # fastmath would make isnan(nan) False; the numpy error model makes 0/0 a NaN that the checks catch,
    # where Python's would raise inside the tick.
    "fastmath": False,
    "error_model": "numpy",
    # nobody calls a kernel from C; the wrapper for that would be compiled for every one of them
    "no_cfunc_wrapper": True,
}
_entries: list[tuple[Any, tuple[Any, ...]]] = []


def kernel(function: Callable[..., Any]) -> Any:
    """Declare a function that only other kernels call; compiled with its caller."""
    return numba.njit(**_OPTIONS)(function)


def records(dtype: np.dtype) -> Any:
    """The type of a C-contiguous array of records, as an argument of an entry."""
    return types.Array(numba.from_dtype(dtype), 1, "C")


def frozen_records(dtype: np.dtype) -> Any:
    """As `records`, for arrays that flight may read but not write (tables)."""
    return types.Array(numba.from_dtype(dtype), 1, "C", readonly=True)


def entry(*argument_types: Any) -> Callable[[Callable[..., Any]], Any]:
    """Declare a function that Python calls with exactly these types."""

    def declare(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**_OPTIONS)(function)
        _entries.append((dispatcher, argument_types))
        return dispatcher

    return declare


def warm_up(progress: Progress | None = None) -> None:
    """Compile or load every declared entry, then refuse to compile for any other types.

    Raises whatever numba raises for a function that does not compile.
    """
    for index, (dispatcher, argument_types) in enumerate(_entries):
        if progress is not None:
            progress(index, len(_entries), dispatcher.py_func.__name__)
        if not hasattr(dispatcher, "compile"):  # NUMBA_DISABLE_JIT: plain Python, for coverage
            continue
        if not dispatcher.signatures:
            dispatcher.compile(argument_types)
            dispatcher.disable_compile()
    if progress is not None:
        progress(len(_entries), len(_entries), "ready")
