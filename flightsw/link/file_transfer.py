"""MAVLink FTP, both ways, in two folders: /log to be read, /upload to be written and read.

Requests wait in a bounded queue for the slack, where the disk is touched, a bounded part at a time. A request that is
sent again is answered again without being done again. An upload is resumed where OpenFileWO says its file ends.

    payload: seq u16, session u8, opcode u8, size u8, request's opcode u8, burst complete u8, 0, offset u32, data
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

from flightsw.icd import mavlink as m
from flightsw.link.ftp_folders import Err, Folders, Refused, open_plain
from flightsw.link.mavlink_out import MavlinkOut
from flightsw.link.message_layout import MessageLayout
from flightsw.link.uplink import Sender

HEADER = struct.Struct("<HBBBBBBI")
PAYLOAD, DATA = 251, 239
UPLOAD_MAX = 1 << 20  # bytes of one file
QUEUE = 32
SESSIONS = 4
_BURST_MESSAGES = 200
_FILE_TRANSFER = MessageLayout(m.MAVLink_file_transfer_protocol_message)
_CRC_SLICE = 1 << 16
_ACK, _NAK = 128, 129


class Op(IntEnum):
    """Opcodes of requests."""

    NONE = 0
    TERMINATE = 1
    RESET = 2
    LIST = 3
    OPEN_RO = 4
    READ = 5
    CREATE = 6
    WRITE = 7
    REMOVE = 8
    OPEN_WO = 11
    TRUNCATE = 12
    CRC32 = 14
    BURST = 15


class Request(NamedTuple):
    """A request as it came."""

    sender: Sender
    seq: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes


class _Session:
    __slots__ = ("data", "fd", "path", "sender", "size", "writes")

    def __init__(self, sender: Sender, fd: int, size: int, writes: bool, path: Path | None, data: bytes = b"") -> None:
        self.sender = sender
        self.fd = fd
        self.size = size
        self.writes = writes
        self.path = path
        self.data = data

    def read(self, offset: int, size: int) -> bytes:
        if self.fd < 0:
            return self.data[offset : offset + size]
        return os.pread(self.fd, min(size, max(0, self.size - offset)), offset)

    def close(self) -> None:
        if self.fd >= 0:
            with suppress(OSError):
                os.close(self.fd)
            self.fd = -1


class FileTransfer:
    """The server. log, upload: the two folders, None where there is none. active: bytes of the table that flies."""

    def __init__(
        self,
        out: MavlinkOut,
        log: Path | None,
        upload: Path | None,
        active: Callable[[], bytes],
        per_tick: Callable[[], float],
    ) -> None:
        self._out = out
        self._folders = Folders(log, upload, active)
        self._active = active
        self._per_tick = per_tick
        self._queue: deque[Request] = deque()
        self._sessions: dict[int, _Session] = {}
        self._burst: Iterator[None] | None = None
        self._job: Iterator[None] | None = None
        self._last: dict[Sender, tuple[Request, bytes]] = {}
        self.dropped = 0

    # -- in the tick

    def take(self, message: Any, sender: Sender) -> None:
        """FILE_TRANSFER_PROTOCOL: put the request aside for the slack."""
        if len(self._queue) >= QUEUE:
            self.dropped += 1
            return
        raw = bytes(message.payload)
        seq, session, opcode, size, _, _, _, offset = HEADER.unpack_from(raw)
        self._queue.append(Request(sender, seq, session, opcode, size, offset, raw[HEADER.size :][: min(size, DATA)]))

    # -- in the slack

    def work_slice(self) -> None:
        """Answer a few requests, or go on with a burst or a checksum."""
        for _ in range(int(self._per_tick())):
            if self._job is not None:
                if next(self._job, True):
                    self._job = None
                return
            if self._queue:
                self._answer(self._queue.popleft())
            elif self._burst is not None:
                if next(self._burst, True):
                    self._burst = None
            else:
                return

    def close(self) -> None:
        """Close every file."""
        for session in self._sessions.values():
            session.close()
        self._sessions.clear()
        self._burst = self._job = None

    def _answer(self, request: Request) -> None:
        last = self._last.get(request.sender)
        if last is not None and last[0] == request and request.opcode != Op.BURST:
            self._send(request.sender, last[1])
            return
        handler = _HANDLERS.get(request.opcode)
        try:
            if handler is None:
                raise Refused(Err.UNKNOWN)
            data = handler(self, request)
        except Refused as refused:
            self._reply(request, _NAK, refused.data)
            return
        except OSError as error:
            self._reply(request, _NAK, bytes((Err.ERRNO, (error.errno or 0) & 0xFF)))
            return
        if data is not None:
            self._reply(request, _ACK, data)

    def _reply(self, request: Request, opcode: int, data: bytes, session: int = -1) -> None:
        number = request.session if session < 0 else session
        seq = (request.seq + 1) & 0xFFFF
        body = HEADER.pack(seq, number, opcode, len(data), request.opcode, 0, 0, request.offset) + data
        if len(self._last) >= SESSIONS and request.sender not in self._last:
            self._last.pop(next(iter(self._last)))
        self._last[request.sender] = (request, body)
        self._send(request.sender, body)

    def _send(self, to: Sender, body: bytes) -> None:
        self._out.send(_FILE_TRANSFER, 0, to.system, to.component, *body.ljust(PAYLOAD, b"\0"))

    # -- files

    def _list(self, request: Request) -> bytes:
        entries = self._folders.entries(request.data)
        listing = b""
        for entry in entries[request.offset :]:
            raw = entry.encode("ascii") + b"\0"
            if len(listing) + len(raw) > DATA:
                break
            listing += raw
        if not listing:
            raise Refused(Err.EOF)
        return listing

    # -- sessions

    def _begin(self, request: Request, session: _Session) -> None:
        """Give it a number, and tell number and size. Clients that choose the number themselves get theirs."""
        held = self._sessions.get(request.session)
        if held is not None and held.sender == request.sender:  # forgotten by its client
            self._sessions.pop(request.session).close()
            self._burst = None
        if len(self._sessions) >= SESSIONS:
            session.close()
            raise Refused(Err.NO_SESSION)
        numbers = (request.session, *range(SESSIONS))
        free = next(number for number in numbers if number not in self._sessions)
        self._sessions[free] = session
        self._reply(request, _ACK, struct.pack("<I", session.size), free)

    def _session(self, request: Request, writes: bool) -> _Session:
        session = self._sessions.get(request.session)
        if session is None or session.sender != request.sender or session.writes != writes:
            raise Refused(Err.SESSION)
        return session

    def _none(self, request: Request) -> bytes:
        del request
        return b""

    def _terminate(self, request: Request) -> bytes:
        session = self._sessions.get(request.session)
        if session is None or session.sender != request.sender:
            raise Refused(Err.SESSION)
        if session.writes:
            os.fsync(session.fd)
        self._sessions.pop(request.session).close()
        self._burst = None
        return b""

    def _reset(self, request: Request) -> bytes:
        for number in [k for k, held in self._sessions.items() if held.sender == request.sender]:
            self._sessions.pop(number).close()
        self._burst = None
        return b""

    def _open_ro(self, request: Request) -> None:
        path = self._folders.file(request.data)
        if self._folders.is_active(path):
            data = self._active()
            self._begin(request, _Session(request.sender, -1, len(data), False, None, data))
            return
        fd, size = open_plain(path, os.O_RDONLY)
        self._begin(request, _Session(request.sender, fd, size, False, path))

    def _create(self, request: Request) -> None:
        path = self._folders.file(request.data, writes=True)
        if not path.exists() and self._folders.full():
            raise Refused(Err.FAIL)
        fd, _ = open_plain(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        self._begin(request, _Session(request.sender, fd, 0, True, path))

    def _open_wo(self, request: Request) -> None:
        fd, size = open_plain(self._folders.file(request.data, writes=True), os.O_RDWR)
        self._begin(request, _Session(request.sender, fd, size, True, None))

    def _read(self, request: Request) -> bytes:
        data = self._session(request, False).read(request.offset, min(request.size or DATA, DATA))
        if not data:
            raise Refused(Err.EOF)
        return data

    def _write(self, request: Request) -> bytes:
        session = self._session(request, True)
        if len(request.data) != request.size or not request.data:
            raise Refused(Err.SIZE)
        if request.offset + len(request.data) > UPLOAD_MAX or request.offset > session.size:
            raise Refused(Err.FAIL)  # too large, or with a hole
        os.pwrite(session.fd, request.data, request.offset)
        session.size = max(session.size, request.offset + len(request.data))
        return struct.pack("<I", len(request.data))

    def _truncate(self, request: Request) -> bytes:
        path = self._folders.file(request.data, writes=True)
        fd, size = open_plain(path, os.O_RDWR)
        try:
            if request.offset > size:
                raise Refused(Err.FAIL)
            os.ftruncate(fd, request.offset)
        finally:
            os.close(fd)
        return b""

    def _remove(self, request: Request) -> bytes:
        path = self._folders.file(request.data, writes=True)
        try:
            path.unlink()
        except FileNotFoundError:
            raise Refused(Err.NOT_FOUND) from None
        return b""

    def _crc32(self, request: Request) -> None:
        path = self._folders.file(request.data)
        if self._folders.is_active(path):
            self._reply(request, _ACK, struct.pack("<I", _crc(self._active())))
            return
        fd, size = open_plain(path, os.O_RDONLY)
        self._job = self._crc_of(request, fd, size)

    def _crc_of(self, request: Request, fd: int, size: int) -> Iterator[None]:
        crc, at = 0, 0
        try:
            while at < size:
                piece = os.pread(fd, min(_CRC_SLICE, size - at), at)
                if not piece:
                    break
                crc, at = _crc(piece, crc), at + len(piece)
                yield
        except OSError as error:
            self._reply(request, _NAK, bytes((Err.ERRNO, (error.errno or 0) & 0xFF)))
            return
        finally:
            os.close(fd)
        self._reply(request, _ACK, struct.pack("<I", crc))

    def _burst_read(self, request: Request) -> None:
        session = self._session(request, False)
        if request.offset >= session.size:
            raise Refused(Err.EOF)
        self._burst = self._stream(request, session)

    def _stream(self, request: Request, session: _Session) -> Iterator[None]:
        """One message at a turn; the last of a burst says so, and the client asks for the next."""
        step = min(request.size or DATA, DATA)
        offset = request.offset
        for number in range(1, _BURST_MESSAGES + 1):
            try:
                data = session.read(offset, step)
            except OSError:
                data = b""
            if not data:
                return
            last = number == _BURST_MESSAGES or offset + len(data) >= session.size
            seq = (request.seq + number) & 0xFFFF
            head = HEADER.pack(seq, request.session, _ACK, len(data), Op.BURST, int(last), 0, offset)
            self._send(request.sender, head + data)
            offset += len(data)
            if last:
                return
            yield


_Handler = Callable[[FileTransfer, Request], bytes | None]
_HANDLERS: dict[int, _Handler] = {
    Op.NONE: FileTransfer._none,
    Op.TERMINATE: FileTransfer._terminate,
    Op.RESET: FileTransfer._reset,
    Op.LIST: FileTransfer._list,
    Op.OPEN_RO: FileTransfer._open_ro,
    Op.READ: FileTransfer._read,
    Op.CREATE: FileTransfer._create,
    Op.WRITE: FileTransfer._write,
    Op.REMOVE: FileTransfer._remove,
    Op.OPEN_WO: FileTransfer._open_wo,
    Op.TRUNCATE: FileTransfer._truncate,
    Op.CRC32: FileTransfer._crc32,
    Op.BURST: FileTransfer._burst_read,
}


def _crc(data: bytes, crc: int = 0) -> int:
    """CRC-32 as MAVLink FTP has it: from zero, without the final inversion of zlib's."""
    return zlib.crc32(data, crc ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
