"""Nonsense into the link: nothing raises, nothing grows, the budget of a tick holds, and the next good message is
understood. `make fuzz` sends ten million bytes of each kind, this lane half of that (LEONAV_FUZZ_BYTES).
"""

from __future__ import annotations

import itertools
import os
import random
import sys
import time
from collections import deque

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from link_bench import KEY, Linked, Station, Wire
from pymavlink.dialects.v20 import common

from flightsw.icd import mavlink
from flightsw.link.access import Access
from flightsw.link.uplink import CHUNKS_PER_TICK, FRAMES_PER_TICK, LONGEST, Uplink

ARM = common.MAV_CMD_COMPONENT_ARM_DISARM
TOTAL = int(os.environ.get("LEONAV_FUZZ_BYTES", "5000000"))
PIECE = 1400


def good_frames(station: Station) -> list[bytes]:
    """One frame of every kind that flight takes."""
    mav = station.mav
    mav.heartbeat_send(6, 8, 0, 0, 4)
    mav.param_request_list_send(1, 1)
    mav.param_request_read_send(1, 1, b"LNK_REPEAT_S", -1)
    station.parameter(b"LNK_REPEAT_S", 2.0)
    mav.timesync_send(0, 7)
    station.command(ARM, 1.0)
    mav.command_int_send(1, 1, 0, ARM, 0, 0, 1.0, 0, 0, 0, 0, 0, 0.0)
    mav.file_transfer_protocol_send(0, 1, 1, [0] * 251)
    return station.packed


def mutate(rng: random.Random, frame: bytes) -> bytes:
    data = bytearray(frame)
    for _ in range(rng.choice((1, 1, 2, 5, 30))):
        how = rng.randrange(5)
        at = rng.randrange(len(data)) if data else 0
        if how == 0 and data:
            data[at] ^= 1 << rng.randrange(8)
        elif how == 1 and data:
            del data[at : at + rng.randrange(1, 9)]
        elif how == 2:
            data[at:at] = rng.randbytes(rng.randrange(1, 9))
        elif how == 3:
            data[at:at] = b"\xfd" * rng.randrange(1, 20)
        elif data:
            data[at] = rng.randrange(256)
    return bytes(data)


def pieces(rng: random.Random, frames: list[bytes], total: int) -> list[bytes]:
    """Random, mutated, cut and run-together bytes: so many in all, in pieces as datagrams are."""
    made, size = [], 0
    while size < total:
        kind = rng.randrange(4)
        if kind == 0:
            piece = rng.randbytes(PIECE)
        elif kind == 1:
            piece = b"\xfd" * PIECE
        else:
            parts: list[bytes] = []
            while sum(map(len, parts)) < PIECE:
                parts.append(mutate(rng, rng.choice(frames)))
            piece = b"".join(parts)[:PIECE]
        made.append(piece)
        size += len(piece)
    return made


@pytest.mark.parametrize("stream", [False, True], ids=["datagrams", "stream"])
def test_a_flood_of_nonsense(stream: bool) -> None:
    """GIVEN a whole flight WHEN TOTAL random and mutated bytes come, 20 pieces a tick THEN no tick raises or looks at
    more than its budget, what is kept between ticks stays below one frame and one piece, the flag stays armed, and a
    good order now and then is obeyed."""
    rng = random.Random(11)
    with Linked("time.duration_s=1200", key=KEY, stream=stream) as flight:
        frames = good_frames(Station(key=None)) + good_frames(Station(key=bytes(32)))
        flight.fly(until_s=1.0)
        worst_kept = looked = total = 0
        worst_s, good = 0.0, 0
        waiting = deque(pieces(rng, frames, TOTAL))
        while waiting or flight.wire.up:
            if not flight.wire.up:
                batch = [waiting.popleft() for _ in range(min(20, len(waiting)))]
                total += sum(map(len, batch))
                flight.wire.up.extend(batch)
            began = time.perf_counter()
            flight.ground.receive()
            worst_s = max(worst_s, time.perf_counter() - began)
            looked = max(looked, FRAMES_PER_TICK - flight.ground.uplink._frames_left)
            worst_kept = max(worst_kept, len(flight.wire.source.rest or b""))
            flight.wire.down.clear()
            if not flight.wire.up and rng.random() < 0.05:
                good += 1
                for _ in range(8):
                    flight.tick()
                assert flight.ask(ARM, 1.0) == common.MAV_RESULT_ACCEPTED, flight.refused
        assert flight.loop.armed
    assert good > TOTAL // 1_000_000
    print(
        f"{total} bytes, {good} good orders obeyed among them, at most {looked} frames looked at in a tick, "
        f"{worst_s * 1e3:.1f} ms, {worst_kept} bytes kept"
    )
    assert total >= TOTAL
    assert looked <= FRAMES_PER_TICK
    assert worst_kept <= LONGEST


def test_a_good_frame_behind_a_false_beginning_is_understood() -> None:
    """GIVEN a stream whose garbage looks like the beginning of a long frame WHEN a good order follows and then silence
    THEN it is obeyed within a few ticks."""
    with Linked(stream=True) as flight:
        flight.fly(until_s=1.0)
        flight.wire.up.append(b"\xfd\xff\x00\x00\x00\x01\x02")
        flight.now().command(ARM, 0.0)
        for _ in range(6):
            flight.tick()
        assert not flight.loop.armed


def test_a_flood_waits_for_the_next_tick() -> None:
    """GIVEN more datagrams than a tick takes WHEN one tick passes THEN the rest still waits in the socket."""
    with Linked() as flight:
        flight.fly(until_s=1.0)
        flight.wire.up.extend([b"\x00"] * 1000)
        flight.tick()
        assert len(flight.wire.up) == 1000 - CHUNKS_PER_TICK


@given(data=st.binary(max_size=600), cuts=st.lists(st.integers(0, 600), max_size=5), place=st.integers(0, 600))
@settings(max_examples=300)
def test_any_bytes_however_cut_do_not_hide_a_good_frame(data: bytes, cuts: list[int], place: int) -> None:
    """GIVEN any bytes WHEN a good order is put among them as a datagram, or into a stream however it is cut THEN it is
    taken once; as a datagram always, in a stream once a silence has ended what was begun."""
    station = Station(key=KEY).at(1_600_000_000_000_000_000)
    station.command(ARM, 0.0)
    frame = station.packed[0]
    for stream in (False, True):
        wire = Wire(stream=stream)
        uplink = Uplink(wire, Access(lambda: (KEY,), None, 1_600_000_000_000_000_000), 1, 1, lambda *_: None)
        taken: list[object] = []
        uplink.take(mavlink.MAVLINK_MSG_ID_COMMAND_LONG, lambda message, _, taken=taken: taken.append(message), True)
        if stream:
            whole = data[:place] + frame + data[place:]
            edges = sorted({0, len(whole), *(cut for cut in cuts if cut < len(whole))})
            wire.up.extend(whole[a:b] for a, b in itertools.pairwise(edges))
        else:
            wire.up.extend((data[:place], frame, data[place:]))
        for _ in range(1500):
            uplink.poll(1_600_000_000_000_000_000)
            if taken and not wire.source.rest:
                break
        assert len(taken) == 1


def test_nothing_grows_under_a_steady_flood() -> None:
    rng = random.Random(3)
    frames = good_frames(Station(key=bytes(32)))
    flood = pieces(rng, frames, 200_000)
    with Linked("time.duration_s=300") as flight:
        flight.fly(until_s=2.0)

        def round_of(count: int) -> int:
            for k in range(count):
                flight.wire.up.extend(flood[k % len(flood) : k % len(flood) + 3])
                flight.ground.receive()
                flight.ground.answer()
                flight.wire.down.clear()
                flight.wire.up.clear()
            return sys.getallocatedblocks()

        round_of(500)
        before = round_of(500)
        after = round_of(2000)
    assert after - before < 100
