"""Functions that run in every tick beside navigation: each has a table of its own, and runs where there is that table.

A function takes frames off the bus, does its work after the bus was drained and before navigation, and says on CAN and
MAVLink what it found. Its alerts go out with those of navigation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, Protocol

from flightsw.icd.table_file import TableImage

if TYPE_CHECKING:
    from flightsw.link.downlink import Downlink
    from flightsw.link.mavlink_out import MavlinkOut
    from flightsw.publishing import Publisher
    from flightsw.sensing.can_receiver import CanReceiver
    from flightsw.sensing.epoch_assembly import EpochAssembly


class Services(NamedTuple):
    """What the loop lends to a function.

    receiver: `listen` to a kind of frame. assembly: where fixes for navigation are put. publisher: `send` a frame of
    its own from an `Outbox`. downlink: `add` a message of its own, written to link. unix_ns: log time of this tick.
    reading: the output record of navigation's last step, `places` of its fields.
    """

    receiver: CanReceiver
    assembly: EpochAssembly
    publisher: Publisher
    downlink: Downlink
    link: MavlinkOut
    unix_ns: Callable[[], int]
    counter_ns: Callable[[], int]
    reading: Callable[[], tuple[float, ...]]
    places: dict[str, int]


class Function(Protocol):
    """One function. conditions, happened: bits by alert id, of what holds now and of what happened in this tick."""

    name: str
    budget_us: float
    conditions: int
    happened: int

    def run(self) -> None:
        """Work of one tick. Sets `conditions` and `happened`."""


Maker = Callable[[TableImage, Services], Function]


def _makers() -> dict[str, Callable[[], Maker]]:
    """By kind of table; a function's modules are imported where its table is flown, and nowhere else."""
    return {"gnss": _pseudoranges}


def _pseudoranges() -> Maker:
    from flightsw.pseudoranges.function import make

    return make


KINDS = tuple(_makers())


def maker_of(kind: str) -> Maker:
    """Maker of the function that a kind of table belongs to; its kernels are registered with this call."""
    return _makers()[kind]()
