"""What a generated CAN frame constant holds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class FrameLayout(NamedTuple):
    """Layout of one CAN FD frame: little-endian, every signal byte-aligned.

    struct_format: `struct` format of the whole frame; unused bytes are pad bytes.
    dtype: packed numpy record over the whole frame, itemsize == length; unused bytes lie between fields.
    The last three bytes are the alive counter (u8) and the CRC (u16); data_id enters the CRC only.
    """

    name: str
    frame_id: int
    length: int
    data_id: int
    data_id_bytes: bytes
    sender: str
    struct_format: str
    field_names: tuple[str, ...]
    dtype: np.dtype
    counter_offset: int
    crc_offset: int
