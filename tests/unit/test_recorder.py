"""The recorder: limited in size, divided between whole entries, whole after a kill; what is cut is read up to there."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightsw import __main__ as command_line
from flightsw import rotating_file
from flightsw.icd.log_parts import all_parts, closed_parts, lacks_beginning
from flightsw.journal import Journal
from flightsw.journal_reading import read_frames
from flightsw.rotating_file import PARTS, SMALLEST_LIMIT_BYTES, RotatingFile

NS = 1_000_000_000
LIMIT = SMALLEST_LIMIT_BYTES
LINE = 155  # characters of a frame of 64 bytes, at least


def fill(folder: Path, frames: int, limit: int | None = LIMIT) -> Journal:
    """A journal of numbered frames and messages, a slice written after each hundred; also looked at then."""
    log = Journal(folder, limit)
    for k in range(frames):
        log.frame(k * NS, 0x100, True, struct.pack("<q", k) + bytes(56))
        log.link(k * NS, b"\xfd\xc8\x00\x00" + bytes(196) + struct.pack("<q", k) + bytes(4))
        if k % 100 == 99:
            log.write_slice()
    return log


def numbers_of(path: Path) -> list[int]:
    lines = b"".join(part.read_bytes() for part in all_parts(path)).decode("ascii").splitlines()
    return [struct.unpack("<q", bytes.fromhex(line.split("##1")[1][:16]))[0] for line in lines]


@pytest.mark.parametrize(("frames", "whole"), [(1000, True), (6000, True), (20000, False)])
def test_a_limit_is_kept_and_the_newest_is_kept_whole(tmp_path: Path, frames: int, whole: bool) -> None:
    """GIVEN a limit WHEN more is recorded THEN no log is larger, the oldest parts went, and no entry is divided."""
    log = fill(tmp_path, frames)
    log.close()
    assert log.dropped == 0
    for name in ("can.log", "link.tlog"):
        size = sum(part.stat().st_size for part in all_parts(tmp_path / name))
        assert size <= LIMIT
        assert whole or size >= LIMIT * (PARTS - 4) // PARTS  # what can be kept is kept
        assert (frames * LINE > LIMIT // PARTS) == bool(closed_parts(tmp_path / name))
        assert lacks_beginning(tmp_path / name) is not whole
    numbers = numbers_of(tmp_path / "can.log")
    assert numbers == list(range(frames - len(numbers), frames))
    sequence = [struct.unpack("<q", frame[200:208])[0] for _, frame in read_frames(tmp_path / "link.tlog")]
    assert sequence == list(range(frames - len(sequence), frames))


def test_without_a_limit_there_is_one_file(tmp_path: Path) -> None:
    fill(tmp_path, 3000, None).close()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["can.log", "link.tlog"]
    assert numbers_of(tmp_path / "can.log") == list(range(3000))


def test_parts_of_a_former_run_are_taken_away(tmp_path: Path) -> None:
    """No file of two runs is ever mixed; files of other names stay."""
    fill(tmp_path, 3000).close()
    assert closed_parts(tmp_path / "can.log")
    (tmp_path / "can.notes.log").write_text("mine")
    fill(tmp_path, 3).close()
    assert numbers_of(tmp_path / "can.log") == [0, 1, 2]
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["can.log", "can.notes.log", "link.tlog"]


@settings(max_examples=30, deadline=None)
@given(st.data())
def test_a_file_under_any_failures_loses_nothing_but_its_oldest_parts(tmp_path_factory, data) -> None:
    """Against a list of entries: renames and openings fail now and then; what is read is the newest, in order."""
    folder, limit = tmp_path_factory.mktemp("log"), 1600
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rotating_file, "SMALLEST_LIMIT_BYTES", limit)
        file = RotatingFile(folder / "x.log", limit)
        rename, written = os.rename, []
        for k in range(data.draw(st.integers(0, 300))):
            entry = f"{k:06d}{'.' * data.draw(st.integers(0, 60))}\n".encode()
            assert file.write(entry) == len(entry)
            written.append(entry)
            fails = data.draw(st.integers(0, 3)) == 0

            def now_and_then(one: Path, other: Path, fails: bool = fails) -> None:
                if fails:
                    raise OSError("not now")
                rename(one, other)

            patch.setattr(os, "rename", now_and_then)
            file.turn()
    file.close()
    read = b"".join(part.read_bytes() for part in all_parts(folder / "x.log")).splitlines(keepends=True)
    assert read == written[len(written) - len(read) :]
    assert {entry.name for entry in folder.iterdir()} == {part.name for part in all_parts(folder / "x.log")}


@pytest.mark.parametrize("text", ["1", "0", "-5", "2.5", "much", "1000001"])
def test_a_limit_that_cannot_be_is_refused_in_words(text: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        command_line.main(["run", "--can", "virtual:x", "--tables", "t", "--log-limit", text])
    assert ended.value.code == 2
    assert "whole megabytes from 2 to 1000000" in capsys.readouterr().err
    with pytest.raises(ValueError, match="too few"):
        RotatingFile(Path("x.log"), LIMIT - 1)


KILLED = """
import struct, sys, time
from pathlib import Path
from flightsw.journal import Journal
log, k = Journal(Path(sys.argv[1]), 2 << 20), 0
while True:
    for _ in range(40):
        log.frame(time.time_ns(), 0x100, True, struct.pack("<q", k) + bytes(56))
        k += 1
    log.write_slice()
    print(time.time_ns(), flush=True)
    time.sleep(0.002)
"""


@pytest.mark.parametrize("attempt", range(2))
def test_a_kill_loses_less_than_a_second(tmp_path: Path, attempt: int) -> None:
    """GIVEN a process that records and writes in its slack WHEN it is killed at any moment, also while parts turn THEN
    what was noted a second before, and all before that, is in the files.
    """
    child = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    for _ in range(150 + 7 * attempt):
        last_ns = int(child.stdout.readline())
    child.send_signal(signal.SIGKILL)
    child.wait()
    child.stdout.close()
    raw = b"".join(part.read_bytes() for part in all_parts(tmp_path / "can.log"))
    lines = raw[: raw.rfind(b"\n") + 1].decode("ascii").splitlines()
    stamps_ns = [int(line[1:].split(")")[0].replace(".", "")) * 1000 for line in lines]
    assert stamps_ns == sorted(stamps_ns)
    assert stamps_ns[-1] > last_ns - NS
    numbers = [struct.unpack("<q", bytes.fromhex(line.split("##1")[1][:16]))[0] for line in lines]
    assert numbers == list(range(len(numbers)))
    assert closed_parts(tmp_path / "can.log")
