"""Checkpoints: what they hold, what is refused, and a file that is whole whenever the power fails."""

from __future__ import annotations

import os
import signal
import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightsw import checkpoint
from flightsw.checkpoint import (
    TRANSIENT_FIELDS,
    TRANSIENT_PREFIXES,
    Capture,
    CheckpointRefused,
    CheckpointWriter,
    Resume,
    capture,
    restore,
    saved_fields,
)
from flightsw.records import NAV

CRC = 0xC0FFEE11
NS = 1_000_000_000
SAVED = saved_fields(NAV)
TRANSIENT = [name for name in NAV.names or () if name not in SAVED]


def filled(seed: int) -> np.ndarray:
    """A record with other numbers in every field, and a state."""
    rng = np.random.default_rng(seed)
    nav = np.zeros(1, NAV)
    for name in NAV.names or ():
        shape = nav[name].shape
        integer = nav[name].dtype.kind == "i"
        nav[name] = rng.integers(1, 2**62, shape) if integer else rng.standard_normal(shape)
    nav["initialised"], nav["clock_valid"] = 1, 1
    return nav


def differing(one: np.ndarray, other: np.ndarray) -> set[str]:
    return {name for name in NAV.names or () if one[name].tobytes() != other[name].tobytes()}


def test_what_is_saved_is_the_filter_and_its_history() -> None:
    assert {"x", "UD", "P", "P_bound", "history_x", "history_UD", "t_gps_ns", "t_fix_gps_ns", "flag", "mode"} <= set(
        SAVED
    )
    assert {"da_mean", "edit_ordered", "burn_dv_mps"} <= set(SAVED)
    assert {"clock_p", "clock_gps_ns", "pulse_chain", "candidate_x", "rejected", "fixes_accepted"} <= set(TRANSIENT)
    for name in (*TRANSIENT_FIELDS, *TRANSIENT_PREFIXES):
        assert any(one.startswith(name) for one in TRANSIENT), f"{name} names no field of NAV any more"
    # a counter reading or a pulse of the process before would poison the clock of this one
    assert not [name for name in SAVED if "counter_ns" in name]


@given(st.integers(0, 1000), st.integers(1001, 2000))
def test_a_restored_record_has_the_saved_fields_to_the_bit_and_its_own_others(old: int, new: int) -> None:
    before, after = filled(old), filled(new)
    mine = after.copy()
    restore(after, capture(before, CRC), CRC)
    assert not set(SAVED) & differing(before, after)
    assert not set(TRANSIENT) & differing(mine, after)


def refused(image: bytes, said: str, crc: int = CRC, dtype: np.dtype = NAV) -> None:
    nav = filled(3) if dtype == NAV else np.zeros(1, dtype)
    before = nav.copy()
    with pytest.raises(CheckpointRefused, match=said):
        restore(nav, image, crc)
    assert nav.tobytes() == before.tobytes()


IMAGE = capture(filled(1), CRC)


@given(st.integers(0, 8 * len(IMAGE) - 1))
def test_one_flipped_bit_anywhere_is_refused(bit: int) -> None:
    image = bytearray(IMAGE)
    image[bit // 8] ^= 1 << bit % 8
    refused(bytes(image), ".")


@given(st.one_of(st.integers(0, len(IMAGE) - 1), st.integers(0, 100)))
def test_one_cut_short_is_refused(length: int) -> None:
    refused(IMAGE[:length], "bytes")


def test_each_reason_is_told() -> None:
    refused(IMAGE + b"\0", "header announces")
    refused(b"LNAVTBL1" + IMAGE[8:], "magic")
    refused(IMAGE[:60] + bytes([IMAGE[60] ^ 1]) + IMAGE[61:], "CRC-32 is wrong")
    refused(IMAGE, "navigation table c0ffee11, here is 00000005", crc=5)
    refused(resealed(IMAGE, 8, b"\x02\x00"), "format 2")
    names = [name for name in NAV.names or () if name != "over_limit"]
    other = np.dtype([(name, NAV[name]) for name in names], align=True)
    refused(IMAGE, "another version wrote it", dtype=other)
    nothing = filled(1)
    nothing["initialised"] = 0
    refused(capture(nothing, CRC), "holds no state")
    broken = filled(1)
    broken["x"][0, 2] = np.nan
    refused(capture(broken, CRC), "holds no state")


def resealed(image: bytes, place: int, patch: bytes) -> bytes:
    body = bytearray(image[:-4])
    body[place : place + len(patch)] = patch
    return bytes(body) + checkpoint._CRC.pack(checkpoint.zlib.crc32(body))


def test_a_field_that_changes_its_shape_changes_the_schema() -> None:
    fields = [(n, NAV[n].base, (7,) if n == "history_t_gps_ns" else NAV[n].shape) for n in NAV.names or ()]
    refused(IMAGE, "another version wrote it|header announces", dtype=np.dtype(fields, align=True))


def test_a_capture_is_filled_in_place() -> None:
    nav = filled(1)
    one = Capture(nav, CRC)
    image = one.image
    one.take()
    assert bytes(image) == capture(nav, CRC)
    nav["x"] = 4.0
    one.take()
    assert one.image is image
    assert bytes(image) == capture(nav, CRC)


# -- the wait for time


@pytest.mark.parametrize(("age_s", "taken"), [(0.0, True), (600.0, True), (601.0, False), (-1.0, False), (1e9, False)])
def test_a_state_is_taken_if_it_is_not_too_old_nor_of_the_future(age_s: float, taken: bool) -> None:
    before = filled(1)
    before["t_gps_ns"] = 1_300_000_000 * NS
    resume = Resume(capture(before, CRC), NAV, CRC, 600.0)
    assert resume.pending
    nav = filled(2)
    mine = nav.copy()
    resume.settle(nav, 1_300_000_000 * NS + round(age_s * 1e9))
    assert not resume.pending
    assert resume.dropped is not taken
    assert resume.age_s == pytest.approx(age_s)
    assert not differing(nav, mine) or taken
    assert not set(SAVED) & differing(nav, before) or not taken


# -- the writer


class Bench:
    """A writer and a counter that a test moves."""

    def __init__(self, path: Path, whole: bool = False, period_s: int = 10) -> None:
        self.now_ns = 5 * NS
        self.nav = filled(1)
        self.path = path
        self.writer = CheckpointWriter(path, self.nav, CRC, period_s * NS, lambda: self.now_ns, whole)
        self.writer.write_slice()  # the first slice sets the due time

    def after(self, seconds: int) -> Bench:
        self.now_ns += seconds * NS
        return self

    def file(self) -> bytes:
        return self.path.read_bytes()


def test_a_file_grows_slice_by_slice_and_appears_whole(tmp_path: Path) -> None:
    """GIVEN a period of 10 s THEN nothing is written before; then each slice writes a bounded part beside the file,
    which appears with the last; what navigation does meanwhile is in the next one."""
    bench = Bench(tmp_path / "nav.ckpt")
    bench.after(9).writer.write_slice()
    assert list(tmp_path.iterdir()) == []
    at_capture = capture(bench.nav, CRC)
    bench.after(1)
    sizes = []
    while not bench.path.exists():
        bench.writer.write_slice()
        bench.nav["x"] = 7.0
        fresh = tmp_path / "nav.ckpt.new"
        sizes.append(fresh.stat().st_size if fresh.exists() else len(bench.file()))
    assert len(sizes) == -(-len(at_capture) // checkpoint._SLICE) > 3
    assert np.diff([0, *sizes]).max() <= checkpoint._SLICE
    assert bench.file() == at_capture
    assert [path.name for path in tmp_path.iterdir()] == ["nav.ckpt"]
    bench.after(9).writer.write_slice()
    assert bench.file() == at_capture
    bench.after(1)
    for _ in sizes:
        bench.writer.write_slice()
    assert bench.file() == capture(bench.nav, CRC)
    assert (bench.writer.written, bench.writer.failed) == (2, 0)


def test_in_lockstep_a_file_is_written_in_one_slice(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "nav.ckpt", whole=True).after(10)
    bench.writer.write_slice()
    assert bench.file() == capture(bench.nav, CRC)


@pytest.mark.parametrize("name", ["initialised", "clock_valid"])
def test_without_a_state_and_its_time_nothing_is_written(tmp_path: Path, name: str) -> None:
    bench = Bench(tmp_path / "nav.ckpt", whole=True).after(100)
    bench.nav[name] = 0
    bench.writer.write_slice()
    assert list(tmp_path.iterdir()) == []
    bench.nav[name] = 1
    bench.writer.write_slice()
    assert bench.writer.written == 1


def test_a_disk_that_takes_nothing_is_counted_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a good file WHEN the folder goes, or the disk is full THEN it is counted, no slice raises, the good file
    stays, and the next period writes again."""
    bench = Bench(tmp_path / "nav.ckpt").after(10)
    while not bench.writer.written:
        bench.writer.write_slice()
    good = bench.file()

    def full(fd: int, data: bytes) -> int:
        del fd, data
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(checkpoint.os, "write", full)
        bench.after(10).writer.write_slice()
        bench.writer.write_slice()
    assert bench.writer.failed == 1
    assert bench.file() == good
    assert [path.name for path in tmp_path.iterdir()] == ["nav.ckpt"]
    (tmp_path / "nav.ckpt.new").mkdir()  # it cannot be opened for writing
    bench.after(10).writer.write_slice()
    assert bench.writer.failed == 2
    (tmp_path / "nav.ckpt.new").rmdir()
    bench.nav["x"] = 9.0
    bench.after(10).writer.write_slice()
    bench.writer.close()
    assert bench.writer.written == 2
    assert bench.file() == capture(bench.nav, CRC)


def write_for_ever(path: Path) -> None:  # pragma: no cover
    """What the process to be killed does: one checkpoint after the other, each of the number that is its time."""
    nav = filled(1)
    now = count(step=NS)
    writer = CheckpointWriter(path, nav, CRC, 1, lambda: next(now), False)
    for k in count(1):
        nav["t_gps_ns"], nav["x"], nav["history_x"] = k, float(k), float(k)
        writer.write_slice()


def test_killed_at_any_moment_a_whole_file_is_left(tmp_path: Path) -> None:
    """GIVEN a process that writes one checkpoint after the other WHEN it is killed in the middle, 25 times THEN the
    file is whole each time, and one of those that it wrote: the state is that of its time."""
    path = tmp_path / "nav.ckpt"
    rng = np.random.default_rng(4)
    torn = 0
    for _ in range(25):
        child = os.fork()
        if child == 0:  # pragma: no cover
            try:
                write_for_ever(path)
            finally:
                os._exit(1)
        while not path.exists():
            time.sleep(1e-3)
        time.sleep(rng.uniform(0.0, 0.02))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        torn += path.with_name("nav.ckpt.new").exists()
        nav = np.zeros(1, NAV)
        restore(nav, path.read_bytes(), CRC)
        assert nav["t_gps_ns"][0] > 0
        assert (nav["x"] == nav["t_gps_ns"][0]).all()
        assert (nav["history_x"] == nav["t_gps_ns"][0]).all()
    assert torn > 5, "the kills all fell between two files: the test has seen nothing"
