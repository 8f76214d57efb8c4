"""Faults a scenario may inject: what each one's `value` means and may be. Applied in faults.py."""

from __future__ import annotations

from typing import NamedTuple

CAN_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
RECEIVER_TARGETS = ("all", "position", "velocity", "sync")
PSEUDORANGES = ("ranges", "epoch", "ephemeris")  # frames of a receiver that sends these
TARGETS = (*RECEIVER_TARGETS, "burn", "attitude", "command", *PSEUDORANGES)
ON_THE_BUS = ("frame_drop", "bit_flip", "truncate")  # the kinds that strike frames of any sender


class FaultKind(NamedTuple):
    """`value` None: the kind takes no value. `default` None: the value must be given."""

    why: str
    value: str | None = None
    default: float | None = None
    minimum: float = 0.0
    maximum: float = 0.0


KINDS: dict[str, FaultKind] = {
    # -- content of a fix
    "position_step": FaultKind("position displaced along an ITRF axis", "metres", None, -1e9, 1e9),
    "velocity_step": FaultKind("velocity displaced along an ITRF axis", "metres per second", None, -1e6, 1e6),
    "position_ramp": FaultKind("position drifts along an ITRF axis, velocity does not", "m/s", None, -1e6, 1e6),
    "consistent_ramp": FaultKind("position drifts along an ITRF axis, and velocity with it", "m/s", None, -1e6, 1e6),
    "nan": FaultKind("position and velocity of an axis become NaN"),
    "absurd": FaultKind("position component replaced", "metres", 1e12, -1e300, 1e300),
    "frozen_fix": FaultKind("position and velocity stay what they were; hold_time keeps the time stamp too"),
    # -- time
    "time_jump": FaultKind("GPS time of fixes and pulses jumps", "seconds", None, -1e6, 1e6),
    "sync_jump": FaultKind("GPS time of pulses alone jumps", "seconds", None, -1e6, 1e6),
    "week_rollover": FaultKind("GPS week counted modulo 1024: time falls back 1024 weeks"),
    "leap_second": FaultKind("GPS time wrong by leap seconds", "seconds", 1.0, -30.0, 30.0),
    "time_backwards": FaultKind("GPS time of fixes and pulses runs backwards"),
    "late": FaultKind("frames arrive later", "extra seconds", None, 0.0, 3600.0),
    # -- sequence
    "repeat_counter": FaultKind("the frame counter stands still"),
    "skip_counter": FaultKind("the frame counter jumps ahead once", "counts", 1.0, 1.0, 255.0),
    "receiver_reset": FaultKind("silence for the duration, then the frame counter restarts at zero"),
    # -- frames on the bus
    "frame_drop": FaultKind("frames vanish, each with the given probability"),
    "bit_flip": FaultKind("one random bit of a frame is flipped"),
    "truncate": FaultKind("frames are cut short", "bytes kept", 32.0, 0.0, 48.0),
}
