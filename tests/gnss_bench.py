"""Epochs of pseudoranges put on a flight's bus by a test, from what the world measured, changed as the test likes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from harness import Flight, frame

from flightsw.icd.can_frames import GNSS_CHECK, GNSS_EPOCH, GNSS_EXCLUDED, GNSS_RANGES, GNSS_USED

PER_FRAME = 3


class Row(NamedTuple):
    """One measured satellite."""

    system: int
    number: int
    range_m: float
    sigma_m: float


def measured(flight: Flight, epoch: int) -> list[Row]:
    """The rows of an epoch of the world."""
    raw = flight.world.raw
    assert raw is not None
    return [
        Row(int(raw.system[s]), int(raw.number[s]), float(raw.range_m[epoch, s]), float(raw.sigma_m[epoch, s]))
        for s in np.flatnonzero(raw.seen[epoch])
    ]


class Sender:
    """A receiver of the test's own, with alive counters of its own."""

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        self.counter = 77

    def put(self, frame_id: int, **values: float) -> None:
        """One frame."""
        self.counter += 1
        self.flight.put(frame_id, frame(frame_id, self.counter & 0xFF, **values))

    def ranges(self, t_gps_ns: int, rows: Sequence[Row]) -> None:
        """GNSS_RANGES of the rows, three a frame."""
        for first in range(0, len(rows), PER_FRAME):
            values: dict[str, float] = {"t_gps_ns": t_gps_ns, "count": len(rows[first : first + PER_FRAME])}
            for k, row in enumerate(rows[first : first + PER_FRAME]):
                values |= {f"range_{k}_m": row.range_m, f"sigma_{k}_m": row.sigma_m}
                values |= {f"satellite_{k}": row.number, f"constellation_{k}": row.system}
            self.put(GNSS_RANGES.frame_id, **values)

    def wait(self, index: int) -> None:
        """Tick until the epoch of the world with this index has been measured."""
        flight, raw = self.flight, self.flight.world.raw
        assert raw is not None
        while flight.world.counter_ns(flight.k) <= int(raw.t_counter_ns[index]):
            flight.tick(with_world=False)

    def whole(self, index: int, rows: Sequence[Row], count: int | None = None, later_ns: int = 0) -> int:
        """A whole epoch in the place of that of the world with this index, or so much later. Its time [ns]."""
        raw = self.flight.world.raw
        assert raw is not None
        t_gps_ns, t_counter_ns = int(raw.t_gps_ns[index]) + later_ns, int(raw.t_counter_ns[index]) + later_ns
        self.ranges(t_gps_ns, rows)
        told = len(rows) if count is None else count
        self.put(GNSS_EPOCH.frame_id, t_gps_ns=t_gps_ns, t_counter_ns=t_counter_ns, count=told)
        return t_gps_ns

    def epoch(self, index: int, rows: Sequence[Row], count: int | None = None) -> int:
        """Wait for it, then send a whole epoch, and tick until all is said of it. Its time [ns]."""
        self.wait(index)
        t_gps_ns = self.whole(index, rows, count)
        for _ in range(3):  # solved; searched for who is to be left out, if somebody is; its levels
            self.flight.tick(with_world=False)
        return t_gps_ns


def checks(flight: Flight) -> np.ndarray:
    """Every GNSS_CHECK that flight has published, in order."""
    return _records(flight, GNSS_CHECK)


def satellites(flight: Flight, excluded: bool = True) -> list[set[str]]:
    """Satellites of every epoch that were left out, or used: 'G17' and so on."""
    records = _records(flight, GNSS_EXCLUDED if excluded else GNSS_USED)
    columns = zip("GREC", ("gps", "glonass", "galileo", "beidou"), strict=True)
    masks = {letter: records[name].tolist() for letter, name in columns}
    return [
        {f"{letter}{bit + 1}" for letter, column in masks.items() for bit in range(64) if column[k] >> bit & 1}
        for k in range(len(records))
    ]


def _records(flight: Flight, layout: object) -> np.ndarray:
    frame_id, dtype = layout.frame_id, layout.dtype  # type: ignore[attr-defined]
    return np.frombuffer(b"".join(data for _, found, data in flight.published if found == frame_id), dtype)
