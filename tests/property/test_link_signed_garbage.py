"""Nonsense that carries the right signature: an operator's tool gone wrong must not bring flight down.

Everything up to the handlers lets it in, so that it is the handlers that are tried: commands, parameters, files,
states. `make fuzz` sends ten million bytes of it, this lane a tenth (LEONAV_FUZZ_BYTES).
"""

from __future__ import annotations

import os
import random
import struct
from pathlib import Path

import numpy as np
from link_bench import KEY, Linked
from pymavlink.dialects.v20 import common
from test_link_garbage import ARM

from flightsw.icd import mavlink as m
from flightsw.icd.enums import Validity
from flightsw.link.access import signature

KINDS = (
    *(m.MAVLINK_MSG_ID_COMMAND_LONG, m.MAVLINK_MSG_ID_COMMAND_INT, m.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL),
    *(m.MAVLINK_MSG_ID_PARAM_SET, m.MAVLINK_MSG_ID_PARAM_REQUEST_READ, m.MAVLINK_MSG_ID_PARAM_REQUEST_LIST),
    *(m.MAVLINK_MSG_ID_TIMESYNC, m.MAVLINK_MSG_ID_LEONAV_STATE_UPLOAD, m.MAVLINK_MSG_ID_HEARTBEAT),
)
COMMANDS = tuple(
    value for name, value in vars(m).items() if name.startswith(("MAV_CMD_", "LEONAV_CMD_")) and isinstance(value, int)
)
NUMBERS = (0.0, 1.0, -1.0, 2.0, 7.0, 1e9, -1e9, 3.4e38, float("nan"), float("inf"), float("-inf"), 1e-40)
PATHS = (b"/log", b"/upload", b"/upload/navigation.tbl", b"/upload/active.tbl", b"/upload/../x", b"/log/can.log", b"/")
FRAMES_PER_TICK, FRAMES_PER_STEP = 16, 256  # a whole tick, navigation with it, now and then
TOTAL = int(os.environ.get("LEONAV_FUZZ_BYTES", "1000000"))


def payload(rng: random.Random, kind: int) -> bytes:
    """A payload of a kind: half of them nonsense throughout, half with some fields that lead further in."""
    length = struct.calcsize(m.mavlink_map[kind].unpacker.format)
    made = bytearray(rng.randbytes(length))
    if rng.random() < 0.5:
        if kind in (m.MAVLINK_MSG_ID_COMMAND_LONG, m.MAVLINK_MSG_ID_COMMAND_INT):
            struct.pack_into("<4f", made, 0, *rng.choices(NUMBERS, k=4))
            struct.pack_into("<H", made, 28, rng.choice(COMMANDS))
            made[30:32] = b"\x01\x01"
        elif kind == m.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL:
            name = rng.choice(PATHS)
            made[0:3] = b"\x00\x01\x01"
            made[5:9] = bytes((rng.randrange(4), rng.randrange(20), rng.choice((0, len(name), 239, 255)), 0))
            made[15 : 15 + len(name)] = name
        elif kind in (m.MAVLINK_MSG_ID_PARAM_SET, m.MAVLINK_MSG_ID_PARAM_REQUEST_READ):
            struct.pack_into("<f", made, 0, rng.choice(NUMBERS))
            made[4:6] = b"\x01\x01"
    return bytes(made[: rng.randrange(1, length + 1)] if rng.random() < 0.2 else made)


def frame(rng: random.Random, kind: int, sequence: int, stamp: int) -> bytes:
    """A whole frame, checksum and signature right."""
    body = payload(rng, kind)
    head = struct.pack("<BBBBBBB", 0xFD, len(body), 1, 0, sequence & 0xFF, 255, 190) + kind.to_bytes(3, "little")
    crc = common.x25crc(head[1:] + body + bytes((m.mavlink_map[kind].crc_extra,))).crc
    whole = head + body + crc.to_bytes(2, "little") + b"\x00" + stamp.to_bytes(6, "little")
    return whole + signature(KEY, whole)


def test_signed_nonsense_is_answered_or_refused_and_nothing_else(tmp_path: Path) -> None:
    """GIVEN a flight with folders of its own WHEN TOTAL bytes of signed nonsense come through whole ticks THEN no tick
    raises, nothing is written outside its folders, no list or window outgrows its bounds, what flight publishes stays a
    state or is said not to be one, and the next good order is obeyed."""
    rng = random.Random(23)
    total = frames = 0
    inside = tmp_path / "link"
    with Linked("time.duration_s=36000", folder=inside, logs=None) as flight:
        flight.fly(until_s=2.0)
        stamp = flight.now().mav.signing.timestamp
        before = flight.ground.uplink.accepted
        while total < TOTAL:
            stamp = max(stamp, flight.now().mav.signing.timestamp)
            for _ in range(FRAMES_PER_TICK):
                stamp += 1
                frames += 1
                flight.wire.up.append(frame(rng, rng.choice(KINDS), frames, stamp))
                total += len(flight.wire.up[-1])
            flight.ground.receive()
            flight.ground.answer()
            flight.ground.work_slice()
            if frames % FRAMES_PER_STEP == 0:
                flight.tick()
                told = flight.out[0]
                known = told["validity"] & Validity.INITIALISED
                assert np.isfinite(told["r_gcrf_m"]).all() or not known
            flight.wire.down.clear()
            flight.loop.restart = False  # the supervisor's part
        taken = flight.ground.uplink.accepted - before
        flight.station.mav.signing.timestamp = stamp + 1
        assert flight.ask(ARM, 1.0) == common.MAV_RESULT_ACCEPTED, flight.refused
        kept = [path for path in tmp_path.rglob("*") if path.is_file()]
    print(f"{total} bytes in {frames} signed frames, {taken} of them taken, {len(kept)} files kept")
    assert taken > frames // 4
    assert flight.refused.get("BAD_SIGNATURE", 0) == 0
    assert all(path.is_relative_to(inside) for path in kept)
    assert sum(path.stat().st_size for path in kept) < 100_000_000
