"""Functions that run in every tick beside navigation: each has a table of its own, and runs where there is that table.

A function takes frames off the bus, does its work after the bus was drained and before navigation, and says on CAN and
MAVLink what it found. Its alerts go out with those of navigation.
"""

from __future__ import annotations

from collections.abc import Callable

from flightsw.services import Function as Function
from flightsw.services import Maker as Maker
from flightsw.services import Services as Services


def _makers() -> dict[str, Callable[[], Maker]]:
    """By kind of table; a function's modules are imported where its table is flown, and nowhere else."""
    return {"gnss": _pseudoranges, "crosslink": _crosslink, "velocity_check": _velocity_check}


def _pseudoranges() -> Maker:
    from flightsw.pseudoranges.function import make

    return make


def _crosslink() -> Maker:
    from flightsw import crosslink_function

    return crosslink_function.make


def _velocity_check() -> Maker:
    from flightsw.velocity_check import VelocityCheck

    return VelocityCheck


KINDS = tuple(_makers())


def maker_of(kind: str) -> Maker:
    """Maker of the function that a kind of table belongs to; its kernels are registered with this call."""
    return _makers()[kind]()
