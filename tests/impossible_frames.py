"""Frames of burns, attitudes and commands: good ones, and ones whose content cannot be, under a right CRC."""

from __future__ import annotations

import random
import struct

from harness import frame

from flightsw.icd.can_frames import LAYOUTS

BURN, ATTITUDE, COMMAND = 0x120, 0x130, 0x140

# Good frames of the kinds that most worlds do not send.
UNSENT: list[tuple[int, bytes]] = [
    (
        BURN,
        frame(BURN, 7, t_start_gps_ns=1_230_000_000 * 10**9, duration_ns=20 * 10**9, dv_y_mps=1.0, sigma_y_mps=0.02),
    ),
    (ATTITUDE, frame(ATTITUDE, 8, t_gps_ns=1_230_000_000 * 10**9, q_w=1.0, sigma_rad=1e-3)),
    (COMMAND, frame(COMMAND, 9, command=2)),
]


def put_field(frame_id: int, payload: bytes, name: str, value: float) -> bytes:
    layout = LAYOUTS[frame_id]
    code, offset = layout.dtype[name].str, layout.dtype.fields[name][1]  # type: ignore[index]
    packed = struct.pack({"<i8": "<q", "<f8": "<d", "<f4": "<f", "|i1": "b", "|u1": "B"}[code], value)
    return payload[:offset] + packed + payload[offset + len(packed) :]


def impossible_burn(rng: random.Random) -> bytes:
    """A burn whose axes, times, size or error cannot be."""
    now_ns = struct.unpack_from("<q", UNSENT[0][1])[0]
    good = frame(BURN, t_start_gps_ns=now_ns + 60 * 10**9, duration_ns=10**10, dv_y_mps=0.5, burn_id=1)
    name, values = rng.choice(
        [
            ("frame", range(2, 256)),
            ("duration_ns", (0, -1, -(2**63), 2**63 - 1)),
            ("t_start_gps_ns", (0, -1, -(2**63), 2**63 - 1)),
            (f"dv_{rng.choice('xyz')}_mps", (float("nan"), float("inf"), -1e9, 1e300)),
            (f"sigma_{rng.choice('xyz')}_mps", (float("nan"), float("-inf"), -1e-3, 1e30)),
        ]
    )
    return put_field(BURN, good, name, rng.choice(values))


def impossible_attitude(rng: random.Random) -> bytes:
    """A quaternion that is none, or an error that is none."""
    name, values = rng.choice(
        [
            (f"q_{rng.choice('wxyz')}", (float("nan"), float("inf"), -2.0, 3e38)),
            ("q_w", (0.0, 0.9, 1.1)),
            ("sigma_rad", (float("nan"), float("inf"), -1e-3, 1e3)),
            ("t_gps_ns", (0, -1, -(2**63), 2**63 - 1)),
        ]
    )
    return put_field(ATTITUDE, UNSENT[1][1], name, rng.choice(values))


def impossible_command(rng: random.Random) -> bytes:
    """A command, a target or a value that does not exist."""
    command, target, value = rng.choice(
        [
            (rng.choice([0, *range(3, 256)]), rng.randrange(256), rng.randrange(256)),
            (1, rng.randint(2, 255), rng.randrange(4)),
            (1, rng.randrange(2), rng.randint(4, 255)),
        ]
    )
    return frame(COMMAND, command=command, target=target, value=value)


IMPOSSIBLE = {
    BURN: (impossible_burn, "BURN_INVALID"),
    ATTITUDE: (impossible_attitude, "ATTITUDE_INVALID"),
    COMMAND: (impossible_command, "COMMAND_INVALID"),
}
