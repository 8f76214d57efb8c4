"""Fixes, pulses and what other senders say as sealed CAN frames, sorted by arrival."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flightsw.icd.can_codec import new_buffer, seal
from flightsw.icd.can_frames import (
    ATTITUDE,
    BURN,
    CROSSLINK_EPHEMERIS,
    CROSSLINK_RANGES,
    GNSS_EPHEMERIS,
    GNSS_EPOCH,
    GNSS_POSITION,
    GNSS_RANGES,
    GNSS_VELOCITY,
    NAV_COMMAND,
    TIME_SYNC,
)
from flightsw.icd.frame_layout import FrameLayout
from hil_sim.sensors.gnss_receiver import FixSeries, PulseSeries

_LAYOUTS = {
    "sync": TIME_SYNC,
    "position": GNSS_POSITION,
    "velocity": GNSS_VELOCITY,
    "burn": BURN,
    "attitude": ATTITUDE,
    "command": NAV_COMMAND,
    "crosslink_ephemeris": CROSSLINK_EPHEMERIS,
    "crosslink_ranges": CROSSLINK_RANGES,
    "ephemeris": GNSS_EPHEMERIS,
    "ranges": GNSS_RANGES,
    "epoch": GNSS_EPOCH,
}


@dataclass
class FrameSeries:
    """Frames of a run in order of arrival: instants (m,) int64 [ns], kind (of `_LAYOUTS`), payload."""

    t_true_gps_ns: np.ndarray
    arrival_gps_ns: np.ndarray
    kind: list[str]
    payload: list[bytes]

    def keep(self, mask: np.ndarray) -> FrameSeries:
        """The frames for which mask (m,) is true."""
        rows = np.flatnonzero(mask)
        return FrameSeries(
            self.t_true_gps_ns[rows],
            self.arrival_gps_ns[rows],
            [self.kind[i] for i in rows],
            [self.payload[i] for i in rows],
        )

    @property
    def frame_id(self) -> list[int]:
        """CAN identifier of each frame."""
        return [_LAYOUTS[kind].frame_id for kind in self.kind]


def encode(fixes: FixSeries, pulses: PulseSeries) -> FrameSeries:
    """Every measurement that is sent, as frames; of equal arrival the pulse goes first, then position, velocity."""
    parts = [
        series_of("sync", _pulse_records(pulses), pulses.counter, pulses),
        series_of("position", _position_records(fixes), fixes.counter_position, fixes),
    ]
    if fixes.has_velocity:
        parts.append(series_of("velocity", _velocity_records(fixes), fixes.counter_velocity, fixes))
    return in_order(parts)


class Sent(Protocol):
    """When each row of a series was measured, when it arrives, and whether it is sent at all; (n,)."""

    @property
    def t_true_gps_ns(self) -> np.ndarray: ...

    @property
    def arrival_gps_ns(self) -> np.ndarray: ...

    @property
    def sent(self) -> np.ndarray: ...


def series_of(kind: str, records: np.ndarray, counter: np.ndarray, series: Sent) -> FrameSeries:
    """Sealed frames of the rows that are sent; records (n,) of the layout of the kind, counter (n,)."""
    sent = np.flatnonzero(series.sent)
    payloads = _sealed(_LAYOUTS[kind], records, sent, counter[sent])
    return FrameSeries(series.t_true_gps_ns[sent], series.arrival_gps_ns[sent], [kind] * len(sent), payloads)


def in_order(parts: Sequence[FrameSeries]) -> FrameSeries:
    """All frames in order of arrival; of equal arrival in the order of the parts."""
    kinds = [kind for part in parts for kind in part.kind]
    payloads = [payload for part in parts for payload in part.payload]
    arrival = np.concatenate([part.arrival_gps_ns for part in parts])
    order = np.argsort(arrival, kind="stable")
    return FrameSeries(
        np.concatenate([part.t_true_gps_ns for part in parts])[order],
        arrival[order],
        [kinds[i] for i in order],
        [payloads[i] for i in order],
    )


def _sealed(layout: FrameLayout, records: np.ndarray, rows: np.ndarray, counters: np.ndarray) -> list[bytes]:
    """Frames of the given rows. The rows are copied as bytes: numpy leaves the unused bytes of a copied record as
    they were in memory, and the CRC covers them."""
    buffer, _ = new_buffer(layout)
    raw = records.view(np.uint8).reshape(len(records), layout.length)[rows].tobytes()
    payloads = []
    for i, counter in enumerate(counters.tolist()):
        buffer[:] = raw[i * layout.length : (i + 1) * layout.length]
        seal(layout, buffer, counter)
        payloads.append(bytes(buffer))
    return payloads


def _pulse_records(pulses: PulseSeries) -> np.ndarray:
    records = np.zeros(len(pulses.t_gps_ns), dtype=TIME_SYNC.dtype)
    for name in ("t_gps_ns", "t_counter_ns", "sigma_ns", "leap_seconds", "status"):
        records[name] = getattr(pulses, name)
    return records


def _position_records(fixes: FixSeries) -> np.ndarray:
    records = np.zeros(len(fixes.t_gps_ns), dtype=GNSS_POSITION.dtype)
    for name in ("t_gps_ns", "t_counter_ns", "satellites", "fix_type"):
        records[name] = getattr(fixes, name)
    for k, axis in enumerate("xyz"):
        records[f"{axis}_itrf_m"] = fixes.r_itrf_m[:, k]
        records[f"sigma_{axis}_m"] = fixes.sigma_r_m[:, k]
    return records


def _velocity_records(fixes: FixSeries) -> np.ndarray:
    records = np.zeros(len(fixes.t_gps_ns), dtype=GNSS_VELOCITY.dtype)
    records["t_gps_ns"] = fixes.t_gps_ns
    for k, axis in enumerate("xyz"):
        records[f"v{axis}_itrf_mps"] = fixes.v_itrf_mps[:, k]
        records[f"sigma_v{axis}_mps"] = fixes.sigma_v_mps[:, k]
    return records
