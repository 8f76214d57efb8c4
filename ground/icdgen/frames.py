"""From sensor_bus.dbc to flightsw/icd/can_frames.py; refuses what flight cannot pack."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import cantools

from ground.errors import OperatorError

# struct code and numpy code by (float, signed, bits)
_CODES = {
    (False, False, 8): ("B", "u1"),
    (False, True, 8): ("b", "i1"),
    (False, False, 16): ("H", "<u2"),
    (False, True, 16): ("h", "<i2"),
    (False, False, 32): ("I", "<u4"),
    (False, True, 32): ("i", "<i4"),
    (False, False, 64): ("Q", "<u8"),
    (False, True, 64): ("q", "<i8"),
    (True, True, 32): ("f", "<f4"),
    (True, True, 64): ("d", "<f8"),
}
_CAN_FD_LENGTHS = (8, 12, 16, 20, 24, 32, 48, 64)


class Signal(NamedTuple):
    """One byte-aligned signal of a frame."""

    name: str
    offset: int
    struct_code: str
    numpy_code: str
    bytes: int
    unit: str
    comment: str
    choices: dict[int, str]


class Frame(NamedTuple):
    """One frame of the DBC, checked."""

    name: str
    frame_id: int
    length: int
    data_id: int
    sender: str
    cycle_ms: int
    comment: str
    signals: tuple[Signal, ...]

    @property
    def struct_format(self) -> str:
        """Little-endian struct format of the whole frame, gaps as pad bytes."""
        text, at = "<", 0
        for signal in self.signals:
            gap = signal.offset - at
            text += (f"{gap}x" if gap else "") + signal.struct_code
            at = signal.offset + signal.bytes
        return text + (f"{self.length - at}x" if at < self.length else "")


class Bus(NamedTuple):
    """The whole DBC: version, frames by ascending identifier."""

    version: str
    frames: tuple[Frame, ...]


def read_bus(dbc: Path) -> Bus:
    """Read and check a DBC. Raises OperatorError with file, frame, signal and remedy."""
    try:
        database = cantools.database.load_file(dbc)
    except Exception as error:  # cantools raises many kinds, all about the text of the file
        raise OperatorError(f"{dbc}: not a readable DBC: {error}") from error
    if not isinstance(database, cantools.database.can.Database):
        raise OperatorError(f"{dbc}: not a CAN database")
    frames = tuple(sorted((_frame(dbc, m) for m in database.messages), key=lambda f: f.frame_id))
    data_ids = [f.data_id for f in frames]
    for frame in frames:
        if data_ids.count(frame.data_id) > 1:
            raise OperatorError(f"{dbc}: {frame.name}: E2EDataId {frame.data_id:#06x} is used twice; choose another")
    return Bus(database.version or "", frames)


def _frame(dbc: Path, message: cantools.database.can.Message) -> Frame:
    where = f"{dbc}: {message.name}"
    if not message.is_fd or message.is_extended_frame:
        raise OperatorError(f'{where}: set VFrameFormat to 14 ("StandardCAN_FD")')
    if message.length not in _CAN_FD_LENGTHS:
        raise OperatorError(f"{where}: {message.length} bytes is no CAN FD length; choose from {_CAN_FD_LENGTHS}")
    attributes = message.dbc.attributes if message.dbc else {}
    if "E2EDataId" not in attributes:
        raise OperatorError(f"{where}: give it a data id (BA_ E2EDataId)")
    if len(message.senders) != 1:
        raise OperatorError(f"{where}: needs exactly one sender, has {len(message.senders)}")
    signals = tuple(sorted((_signal(where, s) for s in message.signals), key=lambda s: s.offset))
    by_name = {s.name: s for s in signals}
    for name, offset, code in (("counter", message.length - 3, "B"), ("crc", message.length - 2, "H")):
        found = by_name.get(name)
        if found is None or found.offset != offset or found.struct_code != code:
            raise OperatorError(
                f"{where}: the convention wants `{name}` at byte {offset}, {'u8' if code == 'B' else 'u16'}"
            )
    return Frame(
        name=message.name,
        frame_id=message.frame_id,
        length=message.length,
        data_id=int(attributes["E2EDataId"].value),
        sender=message.senders[0],
        cycle_ms=message.cycle_time or 0,
        comment=message.comment or "",
        signals=signals,
    )


def _signal(where: str, signal: cantools.database.can.Signal) -> Signal:
    where = f"{where}.{signal.name}"
    if signal.byte_order != "little_endian":
        raise OperatorError(f"{where}: must be little-endian (@1)")
    if signal.start % 8:
        raise OperatorError(f"{where}: starts at bit {signal.start}, must be byte-aligned (a multiple of 8)")
    if signal.scale != 1 or signal.offset != 0:
        raise OperatorError(f"{where}: scaled signals are not packed by flight; use factor 1, offset 0")
    if signal.is_multiplexer or signal.multiplexer_ids:
        raise OperatorError(f"{where}: multiplexed signals are not packed by flight; use a frame of its own")
    codes = _CODES.get((signal.is_float, signal.is_float or signal.is_signed, signal.length))
    if codes is None:
        raise OperatorError(f"{where}: {signal.length} bits; use 8, 16, 32 or 64 (float: 32 or 64)")
    return Signal(
        name=signal.name,
        offset=signal.start // 8,
        struct_code=codes[0],
        numpy_code=codes[1],
        bytes=signal.length // 8,
        unit=signal.unit or "",
        comment=signal.comment or "",
        choices={int(k): str(v) for k, v in (signal.choices or {}).items()},
    )


def render_frames(bus: Bus) -> str:
    """Text of can_frames.py."""
    lines = [
        '"""CAN frame layouts. GENERATED from sensor_bus.dbc by `ground icd generate`: edit the DBC."""',
        "",
        "from __future__ import annotations",
        "",
        "import numpy as np",
        "",
        "from flightsw.icd.frame_layout import FrameLayout as FrameLayout",
        "",
        f'ICD_VERSION = "{bus.version}"',
        "",
    ]
    for frame in bus.frames:
        lines += _render_frame(frame)
    lines.append("LAYOUTS: dict[int, FrameLayout] = {")
    lines += [f"    {frame.name}.frame_id: {frame.name}," for frame in bus.frames]
    lines += ["}", ""]
    return "\n".join(lines)


def _render_frame(frame: Frame) -> list[str]:
    at = {s.name: s.offset for s in frame.signals}
    names = [f'        "{s.name}",' for s in frame.signals]
    low, high = frame.data_id & 0xFF, frame.data_id >> 8
    return [
        f"{frame.name} = FrameLayout(",
        f'    name="{frame.name}",',
        f"    frame_id=0x{frame.frame_id:03X},",
        f"    length={frame.length},",
        f"    data_id=0x{frame.data_id:04X},",
        f"    data_id_bytes=bytes((0x{low:02X}, 0x{high:02X})),",
        f'    sender="{frame.sender}",',
        f'    struct_format="{frame.struct_format}",',
        "    field_names=(",
        *names,
        "    ),",
        "    dtype=np.dtype(",
        "        {",
        '            "names": [',
        *(f"        {line}" for line in names),
        "            ],",
        '            "formats": [',
        *(f'                "{s.numpy_code}",' for s in frame.signals),
        "            ],",
        '            "offsets": [',
        *(f"                {s.offset},  # {s.name} [{s.unit or '-'}]" for s in frame.signals),
        "            ],",
        f'            "itemsize": {frame.length},',
        "        }",
        "    ),",
        f"    counter_offset={at['counter']},",
        f"    crc_offset={at['crc']},",
        ")",
        "",
    ]
