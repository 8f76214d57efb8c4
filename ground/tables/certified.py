"""A set and the certified table that stands beside it: SET.toml, SET.tbl.

The file is the table as it was certified and signed, whole, so that one flipped bit anywhere is noticed. Beside a set
that was changed since it is not used: that set flies uncertified until it is certified anew.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from flightsw.icd.certificate import CertificateRefused, open_certificate
from flightsw.icd.table_file import TableImage, TableRefused, decode
from ground.errors import OperatorError
from ground.tables.build import build_navigation, find_set

SUFFIX = ".tbl"


def build_certified(name_or_path: str | Path) -> tuple[bytes, str]:
    """Binary navigation table of a set with its certificate, and in words why it has none; "" where it has.

    Raises OperatorError with file, key and remedy for a set of which no table can be made.
    """
    bare = build_navigation(name_or_path)
    beside = find_set(name_or_path).with_suffix(SUFFIX)
    if not beside.is_file():
        return bare, f"no certified table stands beside the set ({beside.name})"
    try:
        image = beside.read_bytes()
        held = decode(image)
        open_certificate(held, None)
    except (OSError, TableRefused, CertificateRefused) as error:
        return bare, f"{beside}: not used: {error}"
    if not _same(held, decode(bare)):
        return bare, f"{beside}: not used: the set was changed since it was certified; certify it anew"
    return image, ""


def keep_beside(image: bytes, set_file: Path) -> Path:
    """Put a certified table beside the set it was made from; returns the file.

    Raises OperatorError where it has no certificate, or was not made from this set.
    """
    table = decode(image)
    if not table.certificate:
        raise OperatorError(f"set {table.set_name}: the table carries no certificate; sign it first")
    if not _same(table, decode(build_navigation(set_file))):
        raise OperatorError(f"{set_file}: is not the set that this table was made from; certify a table of this one")
    beside = set_file.with_suffix(SUFFIX)
    partial = beside.with_suffix(f".{os.getpid()}.partial")
    try:
        partial.write_bytes(image)
        os.replace(partial, beside)
    except OSError as error:
        raise OperatorError(f"{beside}: cannot be written: {error.strerror or error}") from error
    return beside


def _same(one: TableImage, other: TableImage) -> bool:
    """Whether two tables say the same to flight, certificates apart."""
    return one.kind == other.kind and one.set_name == other.set_name and np.array_equal(one.values, other.values)
