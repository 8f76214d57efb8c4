"""The parameter protocol: a few operational parameters that may be set, and the table in force to be read.

What a certificate stands for is read-only here: it changes by a new table alone. A refused value is answered with the
old one, as the protocol has it. All are REAL32: clients disagree on how integers travel.
"""

from __future__ import annotations

import math
import os
import struct
import zlib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd import mavlink as m
from flightsw.icd.table_schema import NAVIGATION
from flightsw.link.mavlink_out import MavlinkOut
from flightsw.link.message_layout import MessageLayout
from flightsw.link.uplink import Sender

NAME_LENGTH = 16
_PARAM_VALUE = MessageLayout(m.MAVLink_param_value_message)
_REAL32 = m.MAV_PARAM_TYPE_REAL32
_FLOAT = struct.Struct("<f")
_LARGEST = 3.4028234663852886e38


class Operational(NamedTuple):
    """A parameter that the ground may set while flight runs."""

    name: str
    minimum: float
    maximum: float
    default: float
    why: str


OPERATIONAL = (
    Operational("LNK_REPEAT_S", 0.1, 60.0, 1.0, "s between repeats of an alert that nobody has acknowledged"),
    Operational("LNK_PARAMS_TICK", 1.0, 50.0, 10.0, "parameters sent in a tick when all are asked for"),
    Operational("LNK_FTP_TICK", 1.0, 50.0, 8.0, "messages of file transfer sent in a tick"),
)


def short_names(names: Iterable[str], limit: int = NAME_LENGTH - 2) -> dict[str, str]:
    """Names of table fields cut to fit: later vowels go first, then the end; each different. Prefixed with T_."""
    taken: dict[str, str] = {}
    for name in names:
        text = name.upper()
        for place in range(len(text) - 1, 0, -1):
            if len(text) <= limit:
                break
            if text[place] in "AEIOU" and text[place - 1] != "_":
                text = text[:place] + text[place + 1 :]
        text = text[:limit]
        count = 2
        while text in taken.values():
            text = text[: limit - 1] + str(count)
            count += 1
        taken[name] = text
    return {name: f"T_{text}" for name, text in taken.items()}


_SHORT = short_names(field.name for field in NAVIGATION.fields if field.shape == ())
TABLE_PARAMETERS = tuple((short.encode("ascii"), name) for name, short in _SHORT.items())


class Parameters:
    """The list, in a fixed order: operational ones, then the scalars of the navigation table.

    table: the record (1,) that flies. path: where operational values are kept; None, nowhere.
    """

    __slots__ = ("_dirty", "_index", "_next", "_out", "_path", "_table", "failed", "told", "values")

    def __init__(self, out: MavlinkOut, table: np.ndarray, path: Path | None) -> None:
        self._out = out
        self._table = table
        self._path = path
        self.values = [parameter.default for parameter in OPERATIONAL]
        self.told: list[str] = []  # what was found wrong with the file, in words
        if path is not None:
            self._load(path)
        self._dirty = False
        self._next = -1  # of the list that is being sent
        names = [p.name.encode("ascii") for p in OPERATIONAL] + [short for short, _ in TABLE_PARAMETERS]
        self._index = {name: index for index, name in enumerate(names)}
        self.failed = 0

    def value(self, name: str) -> float:
        """An operational parameter."""
        return self.values[self._index[name.encode("ascii")]]

    def __len__(self) -> int:
        return len(self._index)

    # -- the protocol

    def request_list(self, message: Any, sender: Sender) -> None:
        """PARAM_REQUEST_LIST: begin anew; `send_some` goes on with it."""
        del message, sender
        self._next = 0

    def request_read(self, message: Any, sender: Sender) -> None:
        """PARAM_REQUEST_READ by index, or by name where the index is -1; one that is not there is not answered."""
        del sender
        index = int(message.param_index)
        if index == -1:
            index = self._index.get(_name(message.param_id), -1)
        if 0 <= index < len(self._index):
            self._send(index)

    def set(self, message: Any, sender: Sender) -> None:
        """PARAM_SET: answered with what holds now, taken or not."""
        del sender
        index = self._index.get(_name(message.param_id), -1)
        if index < 0:
            return
        value = float(message.param_value)
        if index < len(OPERATIONAL) and message.param_type == _REAL32 and math.isfinite(value):
            limits = OPERATIONAL[index]
            if _float32(limits.minimum) <= value <= _float32(limits.maximum):
                self._dirty = self._dirty or self.values[index] != value
                self.values[index] = value
        self._send(index)

    def send_some(self) -> None:
        """A part of the list that was asked for."""
        if self._next < 0:
            return
        stop = min(len(self._index), self._next + int(self.values[1]))
        for index in range(self._next, stop):
            self._send(index)
        self._next = stop if stop < len(self._index) else -1

    def _send(self, index: int) -> None:
        if index < len(OPERATIONAL):
            name, value = OPERATIONAL[index].name.encode("ascii"), self.values[index]
        else:
            name, field = TABLE_PARAMETERS[index - len(OPERATIONAL)]
            value = min(max(float(self._table[field][0]), -_LARGEST), _LARGEST)
        self._out.send(_PARAM_VALUE, name, value, _REAL32, len(self._index), index)

    # -- the file

    def _load(self, path: Path) -> None:
        try:
            text = path.read_bytes()
        except FileNotFoundError:
            return
        except OSError as error:
            self.told.append(f"{path}: cannot be read ({error.strerror}); parameters are those of the software")
            return
        body, _, check = text.rpartition(b"crc32 ")
        try:
            if zlib.crc32(body) != int(check, 16):
                raise ValueError
            found = {name: float(value) for name, value in (line.split() for line in body.decode("ascii").splitlines())}
        except ValueError:
            self.told.append(f"{path}: damaged; parameters are those of the software")
            return
        for index, parameter in enumerate(OPERATIONAL):
            value = found.get(parameter.name, parameter.default)
            if parameter.minimum <= value <= parameter.maximum:
                self.values[index] = value

    def save_slice(self) -> None:
        """Write the file whole beside its place and rename it, when something has changed; a slack job."""
        if not self._dirty or self._path is None:
            return
        self._dirty = False
        pairs = zip(OPERATIONAL, self.values, strict=True)
        body = "".join(f"{parameter.name} {value!r}\n" for parameter, value in pairs).encode("ascii")
        fresh = self._path.with_name(self._path.name + ".new")
        try:
            fd = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            try:
                os.write(fd, body + b"crc32 %08x\n" % zlib.crc32(body))
                os.fsync(fd)
            finally:
                os.close(fd)
            os.replace(fresh, self._path)
        except OSError:
            self.failed += 1
            with suppress(OSError):
                fresh.unlink()


def _float32(value: float) -> float:
    return float(_FLOAT.unpack(_FLOAT.pack(value))[0])


def _name(text: str | bytes) -> bytes:
    return text.encode("ascii", "replace") if isinstance(text, str) else bytes(text)
