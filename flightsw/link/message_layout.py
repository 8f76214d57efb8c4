"""How a MAVLink message lies on the wire, taken once from its generated class.

pymavlink makes an object of a message, with its fields, its header and a copy of its bytes, every time one is sent:
right for a ground station, most of a tick's telemetry in flight. Here values go straight into a buffer.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from operator import itemgetter
from typing import Any

from flightsw.icd import mavlink


class MessageLayout:
    """Layout of one kind of message. Values are packed in the order of its definition, arrays element by element.

    count: how many. order: puts them into the order of the wire, None where that is the same. seed: CRC_EXTRA of the
    definition.
    """

    __slots__ = ("count", "id_bytes", "name", "order", "pack", "seed")

    def __init__(self, kind: type[mavlink.MAVLink_message]) -> None:
        self.name = kind.msgname
        self.id_bytes = kind.id.to_bytes(3, "little")
        self.pack = kind.unpacker.pack
        self.seed = kind.crc_extra
        places = _places(kind)
        self.count = len(places)
        self.order: Callable[[tuple[Any, ...]], tuple[Any, ...]] | None = None
        if places != sorted(places):
            self.order = itemgetter(*places)


def _places(kind: type[mavlink.MAVLink_message]) -> list[int]:
    """Of every value on the wire, in turn: its place among the values in the order of the definition."""
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    widths = [1 if types[name] == "char" else max(1, lengths[name]) for name in kind.fieldnames]
    first = dict(zip(kind.fieldnames, accumulate(widths, initial=0), strict=False))
    width = dict(zip(kind.fieldnames, widths, strict=True))
    return [first[name] + element for name in kind.ordered_fieldnames for element in range(width[name])]
