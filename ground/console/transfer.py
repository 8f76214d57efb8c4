"""Files to and from flight by MAVLink FTP, without any socket: what to send next, given what was heard and the time.

An upload goes on where an earlier one ended, if what flight holds is the beginning of the same file; both ways end with
a CRC-32 of the whole. Several requests are under way at a time; what is lost is sent again.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from typing import Any

HEADER = struct.Struct("<HBBBBBBI")
PAYLOAD, DATA = 251, 239
TERMINATE, RESET, LIST, OPEN_RO, READ, CREATE, WRITE = 1, 2, 3, 4, 5, 6, 7
OPEN_WO, CRC32, ACK = 11, 14, 128
SIZE_ERROR, END_OF_FILE, NOT_FOUND = 3, 6, 10
WINDOW = 16
TIMEOUT_S = 0.7
RETRIES = 20
ERRORS = {
    1: "refused",
    2: "disk error",
    3: "wrong size",
    4: "session lost",
    5: "no free session",
    6: "end of file",
    7: "unknown request",
    9: "write protected",
    10: "no such file",
}


def crc32(data: bytes) -> int:
    """CRC-32 as MAVLink FTP has it: from zero, without the final inversion of zlib's."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _offset(payload: bytes) -> int:
    return int(HEADER.unpack_from(payload)[7])


class Transfer:
    """One conversation. `done`: it has ended; `error`: why it failed, empty where it did not.

    send: takes the 251 bytes of a FILE_TRANSFER_PROTOCOL payload.
    """

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._seq = 0
        self._session = 0
        self._waiting: dict[int, tuple[bytes, float, int]] = {}  # seq -> payload, sent at, times
        self._awaited: tuple[int, Callable[[int, bytes], None]] | None = None
        self.done = False
        self.error = ""
        self.total = 0
        self.moved = 0

    # -- one request at a time

    def _ask(self, opcode: int, data: bytes, then: Callable[[int, bytes], None], offset: int = 0) -> None:
        """Send a request and wait for its answer: `then` is called with the error, 0 for none, and the data."""
        self._waiting.clear()
        self._awaited = (self._put(opcode, data, offset), then)

    def _put(self, opcode: int, data: bytes, offset: int, size: int | None = None) -> int:
        self._seq = (self._seq + 2) & 0xFFFF  # flight answers with the number after it
        length = len(data) if size is None else size
        head = HEADER.pack(self._seq, self._session, opcode, length, 0, 0, 0, offset)
        self._waiting[self._seq] = ((head + data).ljust(PAYLOAD, b"\0"), -1.0, 0)
        return self._seq

    def step(self, now_s: float) -> None:
        """Send what is due at this time."""
        due = sorted(self._waiting.items(), key=lambda item: _offset(item[1][0]))
        for seq, (payload, sent_s, times) in due:
            if sent_s >= 0.0 and now_s - sent_s < TIMEOUT_S:
                continue
            if times > RETRIES:
                self._fail("flight does not answer")
                return
            self._waiting[seq] = (payload, now_s, times + 1)
            self._send(payload)

    def take(self, message: Any) -> None:
        """A FILE_TRANSFER_PROTOCOL message was heard."""
        raw = bytes(message.payload)
        seq, session, opcode, size, asked, _, _, offset = HEADER.unpack_from(raw)
        seq = (seq - 1) & 0xFFFF
        if self.done or self._waiting.pop(seq, None) is None:
            return
        data = raw[HEADER.size :][:size]
        error = 0 if opcode == ACK else (data[0] if data else 1)
        if self._awaited is not None and self._awaited[0] == seq:
            then, self._awaited = self._awaited[1], None
            if not error and asked in (OPEN_RO, OPEN_WO, CREATE):
                self._session = session
            then(error, data)
        else:
            self._moved(error, offset, data)

    def _moved(self, error: int, offset: int, data: bytes) -> None:
        """One of several requests under way was answered."""

    def _fail(self, why: str) -> None:
        self.done, self.error = True, why
        self._waiting.clear()

    def _fail_with(self, error: int, what: str) -> None:
        self._fail(f"{what}: {ERRORS.get(error, f'error {error}')}")


class Upload(Transfer):
    """A file to flight."""

    def __init__(self, send: Callable[[bytes], None], path: str, data: bytes) -> None:
        super().__init__(send)
        self._path = path.encode("ascii")
        self._data = data
        self.total = len(data)
        self.resumed_at = 0
        self._next = 0
        self._tries = 0
        self._ask(RESET, b"", lambda error, _: self._look())

    def _look(self) -> None:
        self._ask(OPEN_WO, self._path, self._opened)

    def _opened(self, error: int, data: bytes) -> None:
        if error == NOT_FOUND:
            self._begin()
            return
        if error or len(data) < 4:
            self._fail_with(error, "opening")
            return
        (held,) = struct.unpack_from("<I", data)
        if not 0 < held <= len(self._data):
            self._begin()
            return
        wanted = crc32(self._data[:held])
        self._ask(CRC32, self._path, lambda e, d: self._compared(e, d, wanted, held))

    def _compared(self, error: int, data: bytes, wanted: int, held: int) -> None:
        if error or data[:4] != struct.pack("<I", wanted):
            self._begin()
            return
        self.resumed_at = self._next = self.moved = held
        self._go_on()

    def _begin(self) -> None:
        self._tries += 1
        if self._tries > 3:
            self._fail("three times what arrived was not what was sent")
            return
        self._ask(RESET, b"", lambda error, _: self._ask(CREATE, self._path, self._created))

    def _created(self, error: int, data: bytes) -> None:
        if error:
            self._fail_with(error, "creating")
            return
        self._next = self.moved = 0
        self._go_on()

    def _go_on(self) -> None:
        while self._next < len(self._data) and len(self._waiting) < WINDOW:
            piece = self._data[self._next : self._next + DATA]
            self._put(WRITE, piece, self._next)
            self._next += len(piece)
        if not self._waiting:
            self._ask(TERMINATE, b"", lambda error, _: self._ask(CRC32, self._path, self._checked))

    def _moved(self, error: int, offset: int, data: bytes) -> None:
        if error:  # a piece before this one was lost: that one at once, and this one after it
            if error not in (1, SIZE_ERROR):
                self._look() if error == 4 else self._fail_with(error, "writing")
                return
            if self._waiting:
                first = min(self._waiting, key=lambda seq: _offset(self._waiting[seq][0]))
                payload, _, times = self._waiting[first]
                self._waiting[first] = (payload, -1.0, times)
            self._put(WRITE, self._data[offset : offset + DATA], offset)
            return
        self.moved += len(self._data[offset : offset + DATA])
        self._go_on()

    def _checked(self, error: int, data: bytes) -> None:
        if error or data[:4] != struct.pack("<I", crc32(self._data)):
            self._begin()
            return
        self.done = True


class Download(Transfer):
    """A file from flight; `content` once it is done."""

    def __init__(self, send: Callable[[bytes], None], path: str) -> None:
        super().__init__(send)
        self._path = path.encode("ascii")
        self._pieces: dict[int, bytes] = {}
        self._next = 0
        self.content = b""
        self._ask(RESET, b"", lambda error, _: self._ask(OPEN_RO, self._path, self._opened))

    def _opened(self, error: int, data: bytes) -> None:
        if error or len(data) < 4:
            self._fail_with(error, "opening")
            return
        (self.total,) = struct.unpack_from("<I", data)
        self._go_on()

    def _go_on(self) -> None:
        while self._next < self.total and len(self._waiting) < WINDOW:
            self._put(READ, b"", self._next, min(DATA, self.total - self._next))
            self._next += DATA
        if not self._waiting:
            self.content = b"".join(self._pieces[at] for at in sorted(self._pieces))
            self._ask(TERMINATE, b"", lambda error, _: self._end())

    def _moved(self, error: int, offset: int, data: bytes) -> None:
        if error:
            self._fail_with(error, "reading")
            return
        self._pieces[offset] = data
        self.moved += len(data)
        self._go_on()

    def _end(self) -> None:
        if len(self.content) != self.total:
            self._fail("what arrived is not whole")
        self.done = True


class Listing(Transfer):
    """The entries of a folder: (name, size), size None for a folder; `entries` once it is done."""

    def __init__(self, send: Callable[[bytes], None], path: str) -> None:
        super().__init__(send)
        self._path = path.encode("ascii")
        self.entries: list[tuple[str, int | None]] = []
        self._more()

    def _more(self) -> None:
        self._ask(LIST, self._path, self._listed, len(self.entries))

    def _listed(self, error: int, data: bytes) -> None:
        if error == END_OF_FILE:
            self.done = True
            return
        if error:
            self._fail_with(error, "listing")
            return
        for raw in data.split(b"\0"):
            name, _, size = raw[1:].decode("ascii", "replace").partition("\t")
            if raw:
                self.entries.append((name, int(size) if size.isdigit() else None))
        self._more()
