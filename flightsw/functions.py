"""Functions that run in every tick beside navigation: each has a table of its own, and runs where there is that table.

A function takes frames off the bus, does its work after the bus was drained and before navigation, and says on CAN and
MAVLink what it found. Its alerts go out with those of navigation.
"""

from __future__ import annotations

from collections.abc import Callable

from flightsw.icd.table_file import TableImage
from flightsw.services import Function, Services

Maker = Callable[[TableImage, Services], Function]


def _makers() -> dict[str, Callable[[], Maker]]:
    """By kind of table; a function's modules are imported where its table is flown, and nowhere else."""
    return {"velocity_check": _velocity_check}


def _velocity_check() -> Maker:
    from flightsw.velocity_check import VelocityCheck

    return VelocityCheck


KINDS = tuple(_makers())


def maker_of(kind: str) -> Maker:
    """Maker of the function that a kind of table belongs to; its kernels are registered with this call."""
    return _makers()[kind]()
