"""What flight tells the other onboard systems, every tick: state, integrity, heartbeat, in this order."""

from __future__ import annotations

import struct
from typing import Any

from flightsw.can_port import CanPort
from flightsw.icd import can_codec
from flightsw.icd.can_frames import FLIGHT_HEARTBEAT, INTEGRITY, NAV_STATE, TIME_TO_FLAG
from flightsw.icd.frame_layout import FrameLayout
from flightsw.journal import Journal
from flightsw.records_io import RecordReader

_FLOAT_MAX = 3.4e38  # beyond it struct packs no float32


class Outbox:
    """One kind of frame: its buffer and alive counter."""

    __slots__ = ("buffer", "counter", "frame_id", "layout", "pack_into")

    def __init__(self, layout: FrameLayout) -> None:
        self.layout = layout
        self.frame_id = layout.frame_id
        self.buffer = bytearray(layout.length)
        self.pack_into = struct.Struct(layout.struct_format).pack_into
        self.counter = 0


class Publisher:
    """Fills, seals, journals and sends flight's frames."""

    __slots__ = ("_at", "_heartbeat", "_integrity", "_journal", "_nav_state", "_port", "_time_to_flag")

    def __init__(self, port: CanPort, journal: Journal, reader: RecordReader) -> None:
        self._port = port
        self._journal = journal
        self._nav_state = Outbox(NAV_STATE)
        self._integrity = Outbox(INTEGRITY)
        self._time_to_flag = Outbox(TIME_TO_FLAG)
        self._heartbeat = Outbox(FLIGHT_HEARTBEAT)
        self._at = reader.at

    def send(self, box: Outbox, unix_ns: int, *values: Any) -> None:
        """Fill, seal, journal and send a frame: values of its fields but the last two."""
        box.pack_into(box.buffer, 0, *values, 0, 0)  # counter and CRC follow
        can_codec.seal(box.layout, box.buffer, box.counter)
        box.counter = (box.counter + 1) & 0xFF
        self._journal.frame(unix_ns, box.frame_id, False, box.buffer)
        self._port.send(box.frame_id, box.buffer, unix_ns * 1e-9)

    def state(
        self,
        unix_ns: int,
        out: tuple[float, ...],
        nis: float,
        alerts: int,
        certificate: int,
        verdict: int,
        validity: int,
    ) -> None:
        """NAV_STATE and INTEGRITY from one reading of the output record."""
        at = self._at
        r, v = at["r_gcrf_m"], at["v_gcrf_mps"]
        t_gps_ns, mode, flag = out[at["t_gps_ns"]], out[at["mode"]], out[at["flag"]]
        self.send(self._nav_state, unix_ns, t_gps_ns, *out[r : r + 3], *out[v : v + 3], mode, validity, flag)
        self.send(
            self._integrity,
            unix_ns,
            t_gps_ns,
            out[at["bound_m"]],
            out[at["limit_m"]],
            min(out[at["bound_3d_m"]], _FLOAT_MAX),  # NaN stays NaN
            alerts,
            out[at["fix_age_s"]],
            out[at["outage_age_s"]],
            out[at["flag_age_s"]],
            nis,
            mode,
            flag,
            verdict,
            out[at["driver"]],
            min(int(out[at["streak"]]), 0xFFFF),
            out[at["da_coverage_pct"]],
            out[at["da_source"]],
            certificate,
            out[at["uncovered"]],
        )

    def time_to_flag(self, unix_ns: int, t_gps_ns: int, left_s: float, age_s: float, governing: int, lost: int) -> None:
        """TIME_TO_FLAG."""
        self.send(self._time_to_flag, unix_ns, t_gps_ns, left_s, age_s, governing, lost)

    def heartbeat(self, unix_ns: int, tick: int, counter_ns: int, slips: int, rejected: int, mode: int) -> None:
        """FLIGHT_HEARTBEAT: the last frame of a tick, and the journal's mark of it."""
        self.send(self._heartbeat, unix_ns, tick, counter_ns, slips & 0xFFFFFFFF, rejected & 0xFFFFFFFF, mode)
