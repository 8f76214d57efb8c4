"""The event ring: what happened, when, in a fixed number of records; and the edges of alert conditions."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from flightsw.icd.alerts import ALERTS, BOUND, QUANTITIES

EVENT = np.dtype([("sequence", "i8"), ("t_gps_ns", "i8"), ("alert_id", "i8"), ("active", "i8"), ("value", "f8")])
_CAPACITY = 256
_IDS = tuple(sorted(int(alert_id) for alert_id in ALERTS))
_WITH_BOUND = frozenset(alert_id for alert_id, quantity in QUANTITIES.items() if quantity is BOUND)

# sequence, GPS time, alert id, 1 active or happened / 0 over, value
Announce = Callable[[int, int, int, int, float], None]


class EventRing:
    """Keeps the last events and announces each once. Sequence numbers have no gaps.

    values: by alert id, what to ask for the value of those that do not carry navigation's bound; others have none.
    """

    __slots__ = ("_announce", "_conditions", "records", "sequence", "values")

    def __init__(self, announce: Announce) -> None:
        self.records = np.zeros(_CAPACITY, EVENT)
        self.sequence = 0
        self.values: dict[int, Callable[[], float]] = {}
        self._conditions = 0
        self._announce = announce

    def note(self, t_gps_ns: int, happened: int, conditions: int, bound_m: float) -> None:
        """Record what happened (bits of alert ids) and every change of a condition (bits likewise)."""
        changed = conditions ^ self._conditions
        if not happened and not changed:
            return
        self._conditions = conditions
        for alert_id in _IDS:
            bit = 1 << alert_id
            if happened & bit:
                self._add(t_gps_ns, alert_id, 1, bound_m)
            elif changed & bit:
                self._add(t_gps_ns, alert_id, 1 if conditions & bit else 0, bound_m)

    def _add(self, t_gps_ns: int, alert_id: int, active: int, bound_m: float) -> None:
        if alert_id in _WITH_BOUND:
            value = bound_m
        else:
            ask = self.values.get(alert_id)
            value = ask() if ask is not None else math.nan
        self.sequence += 1
        self.records[self.sequence % _CAPACITY] = (self.sequence, t_gps_ns, alert_id, active, value)
        self._announce(self.sequence, t_gps_ns, alert_id, active, value)

    def newest_first(self) -> np.ndarray:
        """Copy of the recorded events, newest first."""
        held = self.records[self.records["sequence"] > 0]
        return held[np.argsort(-held["sequence"])]
