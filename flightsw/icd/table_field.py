"""What a table's schema is made of: fields with shape, unit, range, default and reason; a number and a hash."""

from __future__ import annotations

import hashlib
from typing import NamedTuple

import numpy as np


class Field(NamedTuple):
    """One field of a table: `kind` is a numpy scalar kind ('f8' or 'i8'), `default` None means required."""

    name: str
    kind: str
    shape: tuple[int, ...]
    unit: str
    minimum: float
    maximum: float
    default: float | None
    why: str
    group: str = ""  # section of the set file that holds it; not part of the hash


class Schema(NamedTuple):
    """A kind of table: its number in the file, its fields in order."""

    name: str
    number: int
    fields: tuple[Field, ...]

    @property
    def dtype(self) -> np.dtype:
        """Packed little-endian numpy dtype of the payload."""
        return np.dtype([(f.name, "<" + f.kind, f.shape) for f in self.fields])

    @property
    def hash(self) -> int:
        """First eight bytes of SHA-256 over names, kinds, shapes, units and ranges."""
        text = "\n".join(f"{f.name} {f.kind} {f.shape} {f.unit} {f.minimum!r} {f.maximum!r}" for f in self.fields)
        return int.from_bytes(hashlib.sha256(f"{self.name}\n{text}".encode()).digest()[:8], "big")
