"""What a field of a parameter table is, and a kind of table made of fields."""

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


def real(name: str, unit: str, low: float, high: float, default: float | None, why: str, *shape: int) -> Field:
    """A field of real numbers."""
    return Field(name, "f8", shape, unit, low, high, default, why)


def whole(name: str, unit: str, low: int, high: int, default: int | None, why: str) -> Field:
    """A field that holds a whole number."""
    return Field(name, "i8", (), unit, low, high, default, why)


def group(name: str, *fields: Field) -> tuple[Field, ...]:
    """Fields of one section of the set file."""
    return tuple(field._replace(group=name) for field in fields)
