"""What the loop lends to a function that runs beside navigation, and what it expects of one."""

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
    """One function. conditions, happened: bits by alert id, of what holds now and of what happened in this tick.

    values: by alert id, the number that goes with it (flightsw/icd/alerts.py, QUANTITIES); asked when it is told.
    """

    name: str
    budget_us: float
    conditions: int
    happened: int
    values: dict[int, Callable[[], float]]

    def run(self) -> None:
        """Work of one tick. Sets `conditions` and `happened`."""


Maker = Callable[[TableImage, Services], Function]
