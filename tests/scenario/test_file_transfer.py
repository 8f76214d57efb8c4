"""Files over the link: a table sent up over a bad link, whatever interrupts it; paths that lead nowhere else."""

from __future__ import annotations

import os
import random
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from certificates import certified
from link_bench import Linked
from pymavlink.dialects.v20 import common

from flightsw.icd import mavlink as m
from flightsw.icd.alerts import AlertId
from flightsw.icd.table_file import decode
from flightsw.link.file_transfer import QUEUE, SESSIONS, UPLOAD_MAX, Err, Op
from flightsw.records import INPUT, OUTPUT
from flightsw.tables import stimulus
from flightsw.tables.service import TableService
from flightsw.tables.store import TableStore
from flightsw.tables.validate import Policy
from ground.console.transfer import DATA, HEADER, Download, Listing, Transfer, Upload
from ground.tables.build import build_navigation

PAPER = 'flight.table_set="paper"'
OLD = build_navigation("paper")
NEW = build_navigation("paper", {"limit_m": 1900.0})
TABLE = "/upload/navigation.tbl"


class Ftp(Linked):
    """A linked flight with a store of tables, and the ground's end of file transfer on a wire that may lose."""

    def __init__(self, folder: Path, loss: float = 0.0, seed: int = 1, *settings: str) -> None:
        super().__init__(PAPER, "time.duration_s=3000", *settings, folder=folder / "link", logs=None)
        self.loss, self.rng = loss, random.Random(seed)
        self.store = folder / "store"
        store = TableStore(self.store, "navigation")
        if not store.pointer.exists():
            store.begin_with(OLD, decode(OLD))
        memory = self.loop.memory
        self.service = TableService(
            self.loop, memory.nav, memory.table, self.navigation, Policy(), store, "a", None, trial_ticks=20
        )
        self.loop.keep_tables(self.service)

    def send(self, payload: bytes) -> None:
        """What the ground's client wants sent."""
        kept = len(self.wire.up)
        self.now().mav.file_transfer_protocol_send(0, 1, 1, payload)
        if self.rng.random() < self.loss:
            while len(self.wire.up) > kept:
                self.wire.up.pop()

    def run(self, transfer: Transfer, ticks: int = 20_000, until: Any = None) -> Transfer:
        """Tick until it is done, or until `until` says so."""
        for _ in range(ticks):
            if transfer.done or (until is not None and until()):
                break
            transfer.step(self.k * 0.1)
            self.tick()
            for message in self.wire.heard("FILE_TRANSFER_PROTOCOL"):
                if self.rng.random() >= self.loss:
                    transfer.take(message)
        return transfer

    def request(self, op: int, data: bytes = b"", offset: int = 0, session: int = 0, size: int | None = None) -> bytes:
        """One request; the answer's payload."""
        self.seq = getattr(self, "seq", 0) + 2
        head = HEADER.pack(self.seq & 0xFFFF, session, op, len(data) if size is None else size, 0, 0, 0, offset)
        self.wire.heard()
        self.send((head + data).ljust(251, b"\0"))
        answers: list[Any] = []
        for _ in range(5):
            self.tick()
            answers += self.wire.heard("FILE_TRANSFER_PROTOCOL")
        assert len(answers) == 1
        raw = bytes(answers[0].payload)
        assert HEADER.unpack_from(raw)[0] == (self.seq + 1) & 0xFFFF
        assert HEADER.unpack_from(raw)[4] == op
        return raw

    def error(self, op: int, data: bytes = b"", **more: int) -> int:
        """The error that a request is answered with; 0 for none."""
        raw = self.request(op, data, **more)
        return 0 if raw[3] == 128 else raw[HEADER.size]


def big_table() -> bytes:
    """A table file of at least 100 kB, which flight must refuse for its content, not for its transport."""
    return NEW + np.random.default_rng(3).bytes(100_000)


def test_a_table_flies_up_over_a_link_that_loses_a_tenth(tmp_path: Path) -> None:
    """GIVEN 10 % loss both ways WHEN a table is sent up, staged and activated THEN what flies is, byte for byte, what
    was sent, read back over the same link; and the pointer moves after the trial."""
    with Ftp(tmp_path, 0.1) as flight:
        flight.fly(until_s=10.0)
        sent = flight.run(Upload(flight.send, TABLE, NEW))
        assert sent.done
        assert not sent.error
        flight.loss = 0.0
        assert flight.ask(m.LEONAV_CMD_TABLE_STAGE, 0.0) == common.MAV_RESULT_ACCEPTED
        for _ in range(400):
            if flight.service.staged is not None:
                break
            flight.tick()
        assert flight.ask(m.LEONAV_CMD_TABLE_ACTIVATE) == common.MAV_RESULT_ACCEPTED
        flight.tick()
        assert flight.loop.memory.table["limit_m"][0] == 1900.0
        assert flight.ask(m.LEONAV_CMD_TABLE_STAGE, 0.0) == common.MAV_RESULT_ACCEPTED  # refused by event: on trial
        flight.loss = 0.1
        back = flight.run(Download(flight.send, "/upload/active.tbl"))
        assert isinstance(back, Download)
        assert back.content == NEW
        while flight.service.on_trial:
            flight.tick()
        flight.fly(until_s=flight.k * 0.1 + 3.0)
        booted = TableStore(flight.store, "navigation").boot(decode)
        assert booted is not None
        assert booted.table.crc32 == decode(NEW).crc32


def test_a_hundred_kilobytes_arrive_whole(tmp_path: Path) -> None:
    """GIVEN 10 % loss both ways WHEN 100 kB are sent up THEN they are on flight's disk byte for byte; as a table they
    are refused with the reason on the link, and the old table flies on."""
    data = big_table()
    with Ftp(tmp_path, 0.1) as flight:
        flight.fly(until_s=5.0)
        began = flight.k
        sent = flight.run(Upload(flight.send, TABLE, data))
        took_s = (flight.k - began) * 0.1
        print(f"{len(data)} bytes over a link that loses 10 % each way: {took_s:.1f} s of flight time")
        assert sent.done
        assert not sent.error
        assert (tmp_path / "link" / "upload" / "navigation.tbl").read_bytes() == data
        flight.loss = 0.0
        flight.wire.heard()
        flight.now().command(m.LEONAV_CMD_TABLE_STAGE, 0.0)
        flight.fly(until_s=flight.k * 0.1 + 3.0)
        heard = flight.wire.heard()
        assert [a for a in heard if a.get_type() == "LEONAV_ALERT" and a.alert_id == AlertId.TABLE_REFUSED]
        said = "".join(t.text for t in heard if t.get_type() == "STATUSTEXT" and t.id)
        assert "header announces" in said
        assert flight.service.dump() == OLD
        assert took_s < 120.0


def big_certified_table() -> bytes:
    """NEW with a certificate whose stimulus makes it a file of a hundred kilobytes: 200 steps, and in them a number in
    every field that the step has no reason to read."""
    rng = np.random.default_rng(11)
    inputs = np.zeros(stimulus.STEPS_MAX, INPUT)
    for name in INPUT.names or ():
        if INPUT[name].base.kind == "f":
            inputs[name] = rng.normal(size=inputs[name].shape)
    inputs["counter_now_ns"] = np.arange(len(inputs)) * 10**9
    memory = stimulus.memory_for(decode(NEW).values)
    outputs = np.zeros(len(inputs), OUTPUT)
    for k in range(len(inputs)):
        stimulus.say(memory, inputs[k : k + 1])
        outputs[k] = memory.output[0]
    return certified(NEW, None, stimulus.encode(inputs, outputs), certified_age_s=2000.0)


def test_a_certified_table_of_a_hundred_kilobytes_is_verified_and_flies(tmp_path: Path) -> None:
    """GIVEN 10 % loss both ways WHEN a certified table of 100 kB is sent up, staged and activated THEN its certificate
    and all 200 steps of its stimulus have been verified on board, it flies, and what is read back is what was sent."""
    data = big_certified_table()
    with Ftp(tmp_path, 0.1) as flight:
        flight.fly(until_s=5.0)
        began = flight.k
        sent = flight.run(Upload(flight.send, TABLE, data))
        assert (sent.done, sent.error) == (True, "")
        print(f"{len(data)} bytes of a certified table up in {(flight.k - began) * 0.1:.1f} s at 10 % loss each way")
        flight.loss = 0.0
        assert flight.ask(m.LEONAV_CMD_TABLE_STAGE, 0.0) == common.MAV_RESULT_ACCEPTED
        while flight.service.staged is None:
            assert flight.k - began < 10_000, flight.service.reason
            flight.tick()
        assert flight.ask(m.LEONAV_CMD_TABLE_ACTIVATE) == common.MAV_RESULT_ACCEPTED
        flight.tick()
        assert flight.loop.memory.table["limit_m"][0] == 1900.0
        assert flight.loop.certificate == 2
        while flight.service.on_trial:
            flight.tick()
        flight.loss = 0.1
        back = flight.run(Download(flight.send, "/upload/active.tbl"))
        assert isinstance(back, Download)
        assert back.content == data
    assert len(data) >= 100_000


@pytest.mark.parametrize("seed", range(12))
def test_an_upload_that_is_interrupted_anywhere_resumes_or_leaves_nothing_half_applied(
    tmp_path: Path, seed: int
) -> None:
    """GIVEN an upload over a bad link WHEN flight or ground dies anywhere in it THEN what flies is the old table; sent
    again it goes on where what had arrived ends, and arrives whole."""
    rng = random.Random(seed)
    data = NEW + rng.randbytes(30_000)
    with Ftp(tmp_path, 0.1, seed) as flight:
        flight.fly(until_s=2.0)
        upload = Upload(flight.send, TABLE, data)
        stop = rng.randrange(1, 40)
        flight.run(upload, ticks=stop)
        assert flight.service.dump() == OLD
        if rng.random() < 0.5:  # the ground dies, flight goes on
            again = Upload(flight.send, TABLE, data)
            flight.run(again)
            assert again.done
            assert not again.error
            assert (tmp_path / "link" / "upload" / "navigation.tbl").read_bytes() == data
            return
    with Ftp(tmp_path, 0.1, seed) as flight:  # flight dies
        assert flight.service.dump() == OLD
        flight.fly(until_s=2.0)
        heard = flight.wire.down[-1]
        flight.station.mav.signing.timestamp = int.from_bytes(heard[-12:-6], "little") + 1000
        path = tmp_path / "link" / "upload" / "navigation.tbl"
        held = path.stat().st_size if path.exists() else 0
        again = Upload(flight.send, TABLE, data)
        flight.run(again)
        assert again.done
        assert not again.error
        assert again.resumed_at == held
        assert path.read_bytes() == data


def test_another_file_of_the_same_name_is_not_gone_on_with(tmp_path: Path) -> None:
    with Ftp(tmp_path) as flight:
        flight.fly(until_s=1.0)
        (tmp_path / "link" / "upload" / "navigation.tbl").write_bytes(b"x" * 5000)
        upload = Upload(flight.send, TABLE, NEW)
        flight.run(upload)
        assert upload.done
        assert upload.resumed_at == 0
        assert (tmp_path / "link" / "upload" / "navigation.tbl").read_bytes() == NEW


def test_a_listing_names_folders_and_files_with_their_sizes(tmp_path: Path) -> None:
    with Ftp(tmp_path) as flight:
        flight.fly(until_s=1.0)
        folder = tmp_path / "link" / "upload"
        for k in range(30):
            (folder / f"file_with_a_rather_long_name_{k:02d}.bin").write_bytes(b"x" * k)
        os.symlink("/etc/passwd", folder / "link.tbl")
        (folder / "sub").mkdir()
        (folder / ".hidden").write_bytes(b"x")
        root = flight.run(Listing(flight.send, "/"))
        assert isinstance(root, Listing)
        assert root.entries == [("upload", None)]
        files = flight.run(Listing(flight.send, "/upload"))
        assert isinstance(files, Listing)
        expected = [(f"file_with_a_rather_long_name_{k:02d}.bin", k) for k in range(30)]
        assert sorted(files.entries) == sorted([*expected, ("active.tbl", len(OLD))])


BAD_PATHS = (
    b"/etc/passwd", b"/upload/../secret", b"/upload/..", b"..", b"../upload/x", b"/upload//x", b"/upload/sub/x",
    b"/upload/.hidden", b"/secret", b"secret", b"/log/x", b"/upload/a\\b", b"/upload/\xff", b"/upload/" + b"a" * 65,
    b"//upload/x", b"/upload/x y", b"/upload/%2e%2e", b"/upload/link.tbl", b"/upload/fifo", b"/upload/sub", b"",
)  # fmt: skip


@pytest.mark.parametrize("path", BAD_PATHS)
@pytest.mark.parametrize("op", [Op.OPEN_RO, Op.OPEN_WO, Op.CREATE, Op.REMOVE, Op.TRUNCATE, Op.CRC32])
def test_no_path_leads_out_of_the_two_folders(tmp_path: Path, path: bytes, op: int) -> None:
    """GIVEN a secret beside the folders, a link to it, a pipe WHEN any of these paths is asked for THEN it is refused,
    nothing waits, and the secret is what it was."""
    folder = tmp_path / "link" / "upload"
    folder.mkdir(parents=True)
    secret = tmp_path / "link" / "secret"
    secret.write_bytes(b"secret")
    os.symlink(secret, folder / "link.tbl")
    os.mkfifo(folder / "fifo")
    (folder / "sub").mkdir()
    with Ftp(tmp_path) as flight:
        flight.tick()
        error = flight.error(op, path)
        if op == Op.REMOVE and path in (b"/upload/link.tbl", b"/upload/fifo"):
            assert error == 0  # the link goes, not what it leads to
        else:
            assert error in (Err.NOT_FOUND, Err.ERRNO, Err.PROTECTED)
        assert secret.read_bytes() == b"secret"
        assert sorted(p.name for p in (tmp_path / "link").iterdir()) == ["secret", "signature.ceiling", "upload"]


def test_the_log_is_read_only_and_the_active_table_is_no_file(tmp_path: Path) -> None:
    with Ftp(tmp_path) as flight:
        flight.tick()
        assert flight.error(Op.CREATE, b"/upload/active.tbl") == Err.PROTECTED
        assert flight.error(Op.REMOVE, b"/upload/active.tbl") == Err.PROTECTED
        raw = flight.request(Op.CRC32, b"/upload/active.tbl")
        (crc,) = struct.unpack_from("<I", raw, HEADER.size)
        assert crc == zlib.crc32(OLD, 0xFFFFFFFF) ^ 0xFFFFFFFF


def test_unknown_requests_wrong_sessions_and_wild_writes_are_refused(tmp_path: Path) -> None:
    with Ftp(tmp_path) as flight:
        flight.tick()
        for op in (9, 10, 13, 16, 99, 255):
            assert flight.error(op, b"/upload/x") == Err.UNKNOWN
        assert flight.error(Op.READ, session=2) == Err.SESSION
        assert flight.error(Op.WRITE, b"x", session=2) == Err.SESSION
        assert flight.error(Op.TERMINATE, session=9) == Err.SESSION
        session = flight.request(Op.CREATE, b"/upload/x")[2]
        assert flight.error(Op.READ, session=session) == Err.SESSION  # opened to write
        assert flight.error(Op.WRITE, b"x", session=session, offset=1) == Err.FAIL  # a hole
        assert flight.error(Op.WRITE, b"x", session=session, offset=UPLOAD_MAX) == Err.FAIL
        assert flight.error(Op.WRITE, b"", session=session) == Err.SIZE
        assert flight.error(Op.WRITE, b"abc", session=session) == 0
        assert flight.error(Op.TRUNCATE, b"/upload/x", offset=2) == 0
        assert flight.error(Op.TERMINATE, session=session) == 0
        assert (tmp_path / "link" / "upload" / "x").read_bytes() == b"ab"


def test_forgotten_sessions_and_a_flood_of_requests_are_bounded(tmp_path: Path) -> None:
    """GIVEN a client that opens and never closes WHEN it opens more THEN the one of that number gives way, and there
    are at most four; WHEN requests flood THEN at most a queue of them waits."""
    with Ftp(tmp_path) as flight:
        flight.tick()
        (tmp_path / "link" / "upload" / "x").write_bytes(b"x")
        for _ in range(10):
            assert flight.error(Op.OPEN_RO, b"/upload/x") == 0
        assert len(flight.ground.files._sessions) == 1
        for number in range(1, SESSIONS):
            assert flight.error(Op.OPEN_RO, b"/upload/x", session=number) == 0
        assert flight.error(Op.OPEN_RO, b"/upload/x", session=77) == Err.NO_SESSION
        assert len(flight.ground.files._sessions) == SESSIONS
        for k in range(500):
            flight.send(HEADER.pack(k, 0, Op.LIST, 1, 0, 0, 0, 0).ljust(251, b"/"))
        for _ in range(20):
            flight.tick()
            assert len(flight.ground.files._queue) <= QUEUE


def test_a_request_sent_twice_is_done_once(tmp_path: Path) -> None:
    with Ftp(tmp_path) as flight:
        flight.tick()
        (tmp_path / "link" / "upload" / "x").write_bytes(b"x")
        head = HEADER.pack(40, 0, Op.OPEN_RO, 9, 0, 0, 0, 0)
        for _ in range(3):
            flight.send((head + b"/upload/x").ljust(251, b"\0"))
        flight.tick()
        flight.tick()
        answers = [bytes(a.payload) for a in flight.wire.heard("FILE_TRANSFER_PROTOCOL")]
        assert len(answers) == 3
        assert len(set(answers)) == 1
        assert len(flight.ground.files._sessions) == 1


def test_unsigned_transfer_is_refused(tmp_path: Path) -> None:
    with Ftp(tmp_path) as flight:
        flight.tick()
        flight.station.mav.signing.sign_outgoing = False
        flight.send(HEADER.pack(1, 0, Op.CREATE, 9, 0, 0, 0, 0) + b"/upload/x".ljust(DATA, b"\0"))
        flight.fly(until_s=1.0)
        assert flight.refused == {"UNSIGNED": 1}
        assert not list((tmp_path / "link" / "upload").iterdir())
