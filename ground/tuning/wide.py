"""How kernels in lanes are compiled: in the processor's widest vectors, products and sums contracted.

LLVM halves the vectors of processors with AVX-512 unless a function asks for more, since old ones slowed down; lanes
gain half as much again. Contraction (a b + c rounded once) changes last bits and nothing else: unlike the rest of
fastmath it keeps NaN. What flies is compiled by the registry, without either.

Callees are not cached by themselves, they are compiled into the entry that calls them; an entry is a closure over
SOURCES, which numba makes part of its key, so that an older step can never be served (as in flightsw/crosslink).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.kernels import registry  # before numba: it names the cache folder

import numba  # isort: skip
from numba.core import types  # isort: skip
from numba.core.extending import lower_builtin, type_callable  # isort: skip

OPTIONS: dict[str, Any] = {"nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}
_LINE_BYTES = 64
_FILES = ("wide.py", "lanes_step.py", "recursion.py", "ensemble.py")
SOURCES = int(
    hashlib.sha256(b"".join(Path(__file__).with_name(name).read_bytes() for name in _FILES)).hexdigest()[:15], 16
)


def wide() -> None:
    """In a kernel: let this function have vectors of 512 bits, where the processor has them. Changes no result."""


@type_callable(wide)
def _type_wide(context: Any) -> Callable[[], Any]:
    del context
    return lambda: types.none


@lower_builtin(wide)
def _lower_wide(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    del signature, arguments
    # llvmlite knows attributes without a value only; a set prints whatever it holds
    set.add(builder.function.attributes, '"prefer-vector-width"="512"')
    return context.get_dummy_value()


def kernel(function: Callable[..., Any]) -> Any:
    """Declare a function in lanes that only others call."""
    return numba.njit(**OPTIONS)(function)


entry = registry.entry


def scratch(rows: int, size: int) -> np.ndarray:
    """Zeros (rows, size) that begin a line of the cache: a wide vector across two lines costs twice."""
    room = np.zeros(rows * size + _LINE_BYTES // 8)
    first = -room.ctypes.data % _LINE_BYTES // 8
    return room[first : first + rows * size].reshape(rows, size)
