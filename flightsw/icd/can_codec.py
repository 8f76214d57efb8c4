"""Frames in and out of preallocated records: length, alive counter, CRC. Nothing is formatted or logged.

Protection after AUTOSAR E2E Profile 5 (PRS_E2EProtocol): CRC-16/CCITT-FALSE (poly 0x1021, start 0xFFFF)
over the frame up to the CRC, followed by a 16-bit data id, low byte first, that is not transmitted: a frame
delivered under a wrong identifier fails its CRC. It guards against accident, not against an attacker.
"""

from __future__ import annotations

from binascii import crc_hqx

import numpy as np

from flightsw.icd.frame_layout import FrameLayout

OK = 0
BAD_LENGTH = 1
BAD_CRC = 2

_CRC_START = 0xFFFF


def new_buffer(layout: FrameLayout) -> tuple[bytearray, np.ndarray]:
    """A zeroed frame and a record view of it, shape (1,), of `layout.dtype`; both share memory."""
    buffer = bytearray(layout.length)
    return buffer, np.frombuffer(buffer, dtype=layout.dtype)


def decode_into(layout: FrameLayout, payload: bytes | bytearray, buffer: bytearray | memoryview) -> int:
    """Check a received payload and copy it into `buffer`.

    Returns OK, BAD_LENGTH or BAD_CRC; `buffer` (layout.length bytes) is untouched unless OK.
    """
    if len(payload) != layout.length:
        return BAD_LENGTH
    at = layout.crc_offset
    crc = crc_hqx(layout.data_id_bytes, crc_hqx(payload[:at], _CRC_START))
    if payload[at] != crc & 0xFF or payload[at + 1] != crc >> 8:
        return BAD_CRC
    buffer[:] = payload
    return OK


def seal(layout: FrameLayout, buffer: bytearray, counter: int) -> None:
    """Write the alive counter (modulo 256) and the CRC into a filled frame, in place."""
    buffer[layout.counter_offset] = counter & 0xFF
    at = layout.crc_offset
    crc = crc_hqx(layout.data_id_bytes, crc_hqx(buffer[:at], _CRC_START))
    buffer[at] = crc & 0xFF
    buffer[at + 1] = crc >> 8
