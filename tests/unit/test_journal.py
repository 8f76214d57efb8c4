"""The journal's rings and lines: order, overflow that drops the oldest and counts, nothing without a folder."""

from __future__ import annotations

import struct
from collections import deque

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightsw import journal
from flightsw.journal import Journal, Ring, candump_line

NS = 1_000_000_000


@given(st.integers(1, 7), st.lists(st.one_of(st.none(), st.integers(-(2**63), 2**63 - 1)), max_size=60))
def test_a_ring_is_a_bounded_queue_that_drops_its_oldest(slots, actions):
    """Against collections.deque: None takes one out, a number goes in."""
    ring, model, dropped = Ring(struct.Struct("<q"), slots), deque(), 0
    for action in actions:
        if action is not None:
            ring.push(action)
            model.append(action)
            if len(model) > slots:
                model.popleft()
                dropped += 1
        elif model:
            assert ring.pop() == (model.popleft(),)
        assert (ring.count, ring.dropped) == (len(model), dropped)


def test_overflow_keeps_the_newest_frames_in_order(tmp_path):
    log = Journal(tmp_path)
    extra = 37
    total = journal._CAN_SLOTS + extra
    for k in range(total):
        log.frame(k * NS, 0x100, True, struct.pack("<q", k))
    assert log.dropped == extra
    log.close()
    lines = (tmp_path / "can.log").read_text().splitlines()
    assert len(lines) == journal._CAN_SLOTS
    payloads = [bytes.fromhex(line.split("##1")[1].split()[0]) for line in lines]
    assert [struct.unpack("<q", p)[0] for p in payloads] == list(range(extra, total))


def test_a_slice_of_slack_writes_a_bounded_part(tmp_path):
    log = Journal(tmp_path)
    for k in range(2000):
        log.frame(k, 0x100, False, b"x")
    log.write_slice()
    assert len((tmp_path / "can.log").read_text().splitlines()) == journal._SLICE
    log.close()
    assert len((tmp_path / "can.log").read_text().splitlines()) == 2000


def test_link_log_is_time_and_message(tmp_path):
    log = Journal(tmp_path)
    messages = [bytes([k]) * (10 + k) for k in range(200)]
    for k, message in enumerate(messages):
        log.link(1_700_000_000 * NS + k * 1500, message)
    log.close()
    expected = b"".join(struct.pack(">Q", 1_700_000_000_000_000 + k * 1500 // 1000) + m for k, m in enumerate(messages))
    assert (tmp_path / "link.tlog").read_bytes() == expected


@pytest.mark.parametrize("received", [True, False])
@pytest.mark.parametrize("length", [0, 1, 8, 32, 64])
def test_lines_are_what_python_can_reads(tmp_path, received, length):
    payload = bytes(range(length))
    path = tmp_path / "one.log"
    path.write_text(candump_line(1_600_000_000 * NS + 123_456_789, 0x1A5, received, payload))
    (message,) = can.CanutilsLogReader(path)
    assert message.timestamp == pytest.approx(1_600_000_000.123456, abs=1e-6)
    assert message.arbitration_id == 0x1A5
    assert not message.is_extended_id
    assert message.is_fd
    assert message.bitrate_switch
    assert message.is_rx == received
    assert bytes(message.data) == payload


def test_without_a_folder_nothing_is_kept_and_nothing_is_dropped():
    log = Journal(None)
    for k in range(3 * journal._CAN_SLOTS):
        log.frame(k, 0x100, True, b"abc")
        if k % 100 == 0:
            log.write_slice()
    log.close()
    assert log.dropped == 0
