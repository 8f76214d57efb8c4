"""The console's link: datagrams and logs, whole, damaged, cut and foreign."""

from __future__ import annotations

import random
import socket
from pathlib import Path
from typing import Any

import pytest
from console_story import START_UNIX_S, alert, frames, heartbeat, integrity, write_tlog
from hypothesis import given
from hypothesis import strategies as st

from flightsw.icd import mavlink
from ground.console.link import FrameDecoder, UdpLink
from ground.console.tlog import RECORDS_PER_CALL, TlogLink, read_tlog
from ground.errors import OperatorError


def packed(message: Any, sequence: int = 0) -> bytes:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sender.seq = sequence
    return bytes(message.pack(sender))


def names(decoder: FrameDecoder, data: bytes) -> list[str]:
    return [message.get_type() for message in decoder.datagram(data)]


def test_several_frames_in_one_datagram_are_all_heard() -> None:
    decoder = FrameDecoder()

    assert names(decoder, packed(heartbeat()) + packed(integrity(), 1)) == ["HEARTBEAT", "LEONAV_INTEGRITY"]
    assert decoder.statistics.frames == 2


def test_a_cut_frame_does_not_swallow_the_next_datagram() -> None:
    """GIVEN half a frame at the end of a datagram WHEN a good one follows THEN the good one is heard whole."""
    decoder = FrameDecoder()

    assert names(decoder, packed(integrity())[:20]) == []
    assert names(decoder, packed(heartbeat(), 1)) == ["HEARTBEAT"]
    assert decoder.statistics.damaged == 1


def test_a_flipped_bit_costs_only_its_frame() -> None:
    good = packed(heartbeat(), 1)
    for position in range(12, len(packed(integrity()))):
        bad = bytearray(packed(integrity()))
        bad[position] ^= 0x10
        decoder = FrameDecoder()

        assert names(decoder, bytes(bad) + good) == ["HEARTBEAT"]
        assert decoder.statistics.damaged >= 1


def test_an_unknown_message_is_counted_and_not_believed() -> None:
    strange = bytearray(packed(integrity()))
    strange[7:10] = (61999).to_bytes(3, "little")
    decoder = FrameDecoder()

    assert names(decoder, bytes(strange) + packed(heartbeat(), 1)) == ["HEARTBEAT"]
    assert decoder.statistics.unknown == 1


def test_gaps_in_the_sequence_are_counted_as_lost() -> None:
    decoder = FrameDecoder()
    for sequence in (250, 251, 254, 1):  # 252, 253 and 255, 0 are missing
        list(decoder.datagram(packed(heartbeat(), sequence)))

    assert decoder.statistics.lost == 4


@given(st.binary(max_size=400))
def test_random_bytes_never_raise_and_the_next_message_is_heard(noise: bytes) -> None:
    decoder = FrameDecoder()
    list(decoder.datagram(noise))

    assert names(decoder, packed(alert(3, 1, 2))) == ["LEONAV_ALERT"]


def test_a_large_datagram_of_magic_bytes_is_worked_off() -> None:
    """GIVEN 60 kB that look like the start of a frame at every byte THEN it ends, with nothing heard."""
    decoder = FrameDecoder()

    assert names(decoder, b"\xfd" * 60_000) == []


def test_udp_is_heard_with_the_receive_clock() -> None:
    link = UdpLink("127.0.0.1", 0, lambda: 1234.5)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sender.sendto(packed(heartbeat()), ("127.0.0.1", link.port))
        heard = []
        for _ in range(1_000_000):
            heard += link.receive()
            if heard:
                break
        assert [(r.time_s, r.message.get_type()) for r in heard] == [(1234.5, "HEARTBEAT")]
        with pytest.raises(OperatorError, match="another console runs there"):
            UdpLink("127.0.0.1", link.port, lambda: 0.0)
    finally:
        sender.close()
        link.close()


class Clock:
    """A clock that a test moves."""

    def __init__(self) -> None:
        self.now_s = 50.0

    def __call__(self) -> float:
        return self.now_s


def test_a_log_is_replayed_at_its_own_times(tmp_path: Path) -> None:
    """GIVEN speed 10 WHEN 2 s pass THEN the first 20 s of the log have been heard, and no later ones."""
    clock = Clock()
    link = TlogLink(write_tlog(tmp_path / "link.tlog", 60), 10.0, clock)
    clock.now_s += 2.0
    heard = link.receive()

    assert heard[-1].time_s == START_UNIX_S + 20.0
    assert len(heard) == sum(t_us <= (START_UNIX_S + 20) * 10**6 for t_us, _ in frames(60))
    link.pause(True)
    clock.now_s += 100.0
    assert link.receive() == []
    assert link.now_s() == START_UNIX_S + 20.0
    link.pause(False)
    clock.now_s += 100.0
    assert link.receive()[-1].time_s == START_UNIX_S + 60.0
    assert link.finished()
    assert link.now_s() == START_UNIX_S + 60.0  # the end of a log is not a silent link


def test_a_log_faster_than_the_screen_waits_instead_of_running_ahead(tmp_path: Path) -> None:
    clock = Clock()
    link = TlogLink(write_tlog(tmp_path / "link.tlog"), 1e4, clock)
    clock.now_s += 10.0
    heard = link.receive()

    assert len(heard) == RECORDS_PER_CALL
    assert link.now_s() == pytest.approx(heard[-1].time_s)
    total = sum(1 for _ in frames())
    for _ in range(-(-total // RECORDS_PER_CALL) - 1):
        assert not link.finished()
        clock.now_s += 10.0
        assert 0 < len(link.receive()) <= RECORDS_PER_CALL
    assert link.finished()


@pytest.mark.parametrize("cut", [1, 7, 8, 15, 30])
def test_a_log_cut_by_a_crash_keeps_every_whole_record(tmp_path: Path, cut: int) -> None:
    path = write_tlog(tmp_path / "link.tlog", 10)
    whole, _, _ = read_tlog(path)
    path.write_bytes(path.read_bytes()[:-cut])
    records, skipped, remarks = read_tlog(path)

    assert records == whole[: len(records)]
    assert len(records) >= len(whole) - 2
    assert skipped > 0
    (remark,) = remarks
    assert remark.startswith(f"the log ends within a message, {skipped} bytes of it: flight was killed")


def test_damage_inside_a_log_is_skipped_and_said(tmp_path: Path) -> None:
    path = write_tlog(tmp_path / "link.tlog", 20)
    whole, _, _ = read_tlog(path)
    data = path.read_bytes()
    path.write_bytes(data[:500] + random.Random(1).randbytes(333) + data[500:])
    records, skipped, remarks = read_tlog(path)

    assert skipped >= 333
    assert remarks == (f"{skipped} damaged bytes of the log skipped",)
    assert set(whole[:3]) <= set(records)
    assert records[-1] == whole[-1]
    assert len(set(whole) - set(records)) <= 2


@given(st.binary(max_size=300))
def test_garbage_is_no_log(tmp_path_factory: Any, data: bytes) -> None:
    path = tmp_path_factory.mktemp("garbage") / "link.tlog"
    path.write_bytes(data)

    with pytest.raises(OperatorError, match=r"link\.tlog"):
        TlogLink(path, 1.0, lambda: 0.0)


def test_an_absent_log_is_named(tmp_path: Path) -> None:
    with pytest.raises(OperatorError, match=r"absent\.tlog: cannot be read"):
        read_tlog(tmp_path / "absent.tlog")
