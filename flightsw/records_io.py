"""Reading a whole record of eight-byte fields in one call, where field by field would cost a lookup each."""

from __future__ import annotations

import struct
from math import prod

import numpy as np


class RecordReader:
    """Unpacks one record into a flat tuple; `at[name]` is where a field begins in it."""

    __slots__ = ("_memory", "_struct", "at")

    def __init__(self, record: np.ndarray) -> None:
        dtype = record.dtype
        codes = []
        self.at: dict[str, int] = {}
        place = 0
        for name in dtype.names or ():
            base, shape = (dtype[name].base, dtype[name].shape)
            size = prod(shape)
            codes.append(f"{size}{'d' if base.kind == 'f' else 'q'}")
            self.at[name] = place
            place += size
        self._struct = struct.Struct("<" + "".join(codes))
        if self._struct.size != dtype.itemsize:
            raise ValueError(f"{dtype} has fields of other than eight bytes")
        self._memory = memoryview(record.view(np.uint8).data)

    def read(self) -> tuple[float, ...]:
        """All fields of the record as they stand now."""
        return self._struct.unpack_from(self._memory)
