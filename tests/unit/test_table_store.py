"""The A/B store of tables: one always boots, whenever power fails; and what may take an active table's place."""

from __future__ import annotations

import math
import os
import random
import signal
import struct
import time
from pathlib import Path
from typing import Any

import pytest
from certificates import KEY, certified

from flightsw.icd.table_file import TableImage, TableRefused, decode, encode
from flightsw.tables import validate
from flightsw.tables.store import TableStore, other
from flightsw.tables.validate import Policy
from ground.tables.build import build_navigation

OLD = build_navigation("paper")
NEW = build_navigation("paper", {"limit_m": 1900.0})
KILLS = int(os.environ.get("LEONAV_KILLS", "20"))


def accept(raw: bytes) -> TableImage:
    return decode(raw)


def begun(folder: Path) -> TableStore:
    store = TableStore(folder, "navigation")
    store.begin_with(OLD, decode(OLD))
    return store


def put(store: TableStore, slot: str, image: bytes) -> None:
    for _ in store.write(slot, image):
        pass


def test_a_store_boots_what_it_points_to(tmp_path: Path) -> None:
    """GIVEN a store WHEN a table is written to the other slot and then pointed to THEN each boots in its time."""
    store = begun(tmp_path)
    put(store, "b", NEW)
    booted = store.boot(accept)
    assert booted is not None
    assert (booted.table.crc32, booted.slot, booted.told) == (decode(OLD).crc32, "a", ())
    store.point("b", decode(NEW))
    booted = store.boot(accept)
    assert booted is not None
    assert (booted.table.crc32, booted.slot) == (decode(NEW).crc32, "b")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "navigation.a.tbl",
        "navigation.active",
        "navigation.b.tbl",
    ]


@pytest.mark.parametrize("harm", [b"", b"LNAVPTR1b", b"\0" * 17, None])
def test_a_damaged_pointer_or_table_falls_back_and_is_told(tmp_path: Path, harm: bytes | None) -> None:
    """GIVEN two good tables WHEN the pointer, or the table it names, is damaged or gone THEN the other boots, told."""
    store = begun(tmp_path)
    put(store, "b", NEW)
    store.point("b", decode(NEW))
    if harm is None:
        store.pointer.unlink()
    else:
        store.pointer.write_bytes(harm)
    booted = store.boot(accept)
    assert booted is not None
    assert "missing or damaged" in booted.told[0]
    store.point("b", decode(NEW))
    store.path("b").write_bytes(NEW[:-7])
    booted = store.boot(accept)
    assert booted is not None
    assert (booted.slot, len(booted.told)) == ("a", 1)
    store.path("a").unlink()
    assert store.boot(accept) is None


def test_a_pointer_with_any_bit_flipped_is_none(tmp_path: Path) -> None:
    store = begun(tmp_path)
    good = store.pointer.read_bytes()
    for bit in range(8 * len(good)):
        bad = bytearray(good)
        bad[bit // 8] ^= 1 << bit % 8
        store.pointer.write_bytes(bad)
        assert store.active() is None


def _torture(folder: Path, turns: float = math.inf) -> None:
    """Write and activate tables, for ever or so many times."""
    store = TableStore(folder, "navigation")
    slot, images = "a", (OLD, NEW)
    turn = 0
    while turn < turns:
        slot, turn = other(slot), turn + 1
        put(store, slot, images[turn % 2])
        store.point(slot, decode(images[turn % 2]))


def test_kill_9_at_any_instant_leaves_a_store_that_boots(tmp_path: Path) -> None:
    """GIVEN a process that writes and activates tables without pause WHEN it is killed at a random instant, 20 times
    (LEONAV_KILLS) THEN the store boots the table its pointer names, whole, and nothing is told.

    The instants are within the first three turns, however long this machine's disk takes for one.
    """
    store = begun(tmp_path)
    instants = random.Random(9)
    begin_s = time.monotonic()
    _torture(tmp_path, 4)
    turn_s = (time.monotonic() - begin_s) / 4
    seen = set()
    for _ in range(KILLS):
        pid = os.fork()
        if pid == 0:
            try:
                _torture(tmp_path)
            finally:
                os._exit(1)
        time.sleep(0.002 + instants.uniform(0.0, 3.0) * turn_s)
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        booted = store.boot(accept)
        assert booted is not None
        assert booted.told == ()
        assert booted.table.crc32 in (decode(OLD).crc32, decode(NEW).crc32)
        seen.add((booted.slot, *((tmp_path / f"navigation.{slot}.tbl.new").exists() for slot in "ab")))
    assert len(seen) > 1, "killed at one instant only: the test shows nothing"


# -- what may take the place of an active table

ACTIVE = decode(OLD)
WARM: dict[str, Any] = {"stimulus": b"x"}


@pytest.fixture(autouse=True)
def _no_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replays are shown in test_stimulus; the certificates here carry none that is true."""
    monkeypatch.setattr(validate.stimulus, "check_in_slices", lambda *_: iter(()))


def judged(raw: bytes, active: bytes, now: int, policy: Policy) -> TableImage:
    """The verdict in flight, all its slices taken at once."""
    work = validate.accept_in_flight(raw, decode(active), now, policy)
    while True:
        try:
            next(work)
        except StopIteration as end:
            table: TableImage = end.value
            return table


def valid(begin: int, end: int = 0) -> bytes:
    table = decode(NEW)
    return encode(table.kind, table.set_name, table.values, b"", begin, end)


def damaged() -> bytes:
    return NEW[:-1] + bytes([NEW[-1] ^ 1])


def of_another_schema() -> bytes:
    import zlib

    body = bytearray(NEW[:-4])
    body[12] ^= 1
    return bytes(body) + struct.pack("<I", zlib.crc32(body))


@pytest.mark.parametrize(
    ("raw", "active", "now", "policy", "said"),
    [
        (damaged(), OLD, 0, Policy(), "CRC-32 is wrong"),
        (of_another_schema(), OLD, 0, Policy(), "was built with schema"),
        (build_navigation("paper_table1"), OLD, 0, Policy(), "settles at 495 m"),
        (NEW, OLD, 0, Policy(KEY), "carries no certificate, and a key is given"),
        (certified(NEW, b"the key of somebody else"), OLD, 0, Policy(KEY), "HMAC of the certificate is wrong"),
        (valid(10, 20), OLD, 21, Policy(), "validity has expired"),
        (valid(10, 20), OLD, 9, Policy(), "not valid yet"),
        (valid(10, 20), OLD, 0, Policy(), "onboard time is not known"),
        (valid(10), valid(11), 30, Policy(), "older than the active"),
        (certified(NEW, issued_gps_ns=5), certified(OLD, issued_gps_ns=6), 0, Policy(KEY), "older than the active"),
        (NEW, certified(OLD), 0, Policy(), "carries no certificate, the active table does"),
        (build_navigation("j2"), OLD, 0, Policy(), "stored_da_bins = 720, active 120"),
        (build_navigation("paper", {"tick_period_ns": 200_000_000}), OLD, 0, Policy(), "tick_period_ns"),
        (build_navigation("flight_coloured"), build_navigation("flight"), 0, Policy(), "gnss_bias_sigma_m"),
    ],
)
def test_what_must_not_fly_is_refused_with_the_reason(
    raw: bytes, active: bytes, now: int, policy: Policy, said: str
) -> None:
    with pytest.raises(TableRefused, match=said):
        judged(raw, active, now, policy)


@pytest.mark.parametrize(
    ("raw", "active", "now", "policy"),
    [
        (NEW, OLD, 0, Policy()),
        (valid(10, 20), OLD, 15, Policy()),
        (valid(10), valid(11), 30, Policy(older=True)),
        (NEW, certified(OLD), 0, Policy(older=True)),
        (certified(NEW, issued_gps_ns=5), certified(OLD, issued_gps_ns=6), 0, Policy(KEY, older=True)),
        (certified(NEW, issued_gps_ns=7), certified(OLD, issued_gps_ns=6), 0, Policy(KEY)),
    ],
)
def test_what_may_fly_is_accepted(raw: bytes, active: bytes, now: int, policy: Policy) -> None:
    assert judged(raw, active, now, policy).crc32 == decode(raw).crc32
