"""Values of the interface: every number here also stands in sensor_bus.dbc (a test holds the two together).

Plain integers at run time (`IntEnum`), so that compiled code and struct layouts use them directly.
Numbers are never reused: a value that falls out of use keeps its place.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


class Mode(IntEnum):
    """Navigation mode (DBC signal `mode`)."""

    INIT = 0
    INTEGRATED = 1
    AUTONOMOUS = 2
    FAILED = 3


class FlagState(IntEnum):
    """Parametric-failure flag (DBC signal `flag_state`). STALE: it could not be computed, trust nothing."""

    CLEAR = 0
    RAISED = 1
    STALE = 2


class Verdict(IntEnum):
    """The one word for users of the state (DBC signal `verdict`)."""

    NOT_READY = 0
    TRUSTED = 1
    TRUSTED_COASTING = 2
    DO_NOT_USE = 3


class Validity(IntFlag):
    """Bits of the DBC signal `validity`."""

    STATE_VALID = 1
    TIME_VALID = 2
    INITIALISED = 4


class BoundDriver(IntEnum):
    """Which bound is compared with the limit (DBC signal `driver`)."""

    AXIS = 0
    RADIUS = 1


class DaSource(IntEnum):
    """Where the flown dA comes from (DBC signal `da_source`)."""

    NONE = 0
    FILTER = 1
    STORED = 2
    HELD = 3


class Certificate(IntEnum):
    """What stands behind the navigation table (DBC signal `certificate`)."""

    UNCERTIFIED = 0
    QUICK = 1
    FULL = 2


class FixType(IntEnum):
    """Kind of fix (DBC signal `fix_type`)."""

    NONE = 0
    FIX_2D = 2
    FIX_3D = 3


class SyncStatus(IntEnum):
    """Whether the timing source vouches for a pulse (DBC signal `status` of TIME_SYNC)."""

    INVALID = 0
    VALID = 1


class RejectCause(IntEnum):
    """Why a frame, a pulse or a fix did not change the state; index into the 24 counters of telemetry."""

    BAD_LENGTH = 0
    BAD_CRC = 1
    UNKNOWN_ID = 2
    REPEATED_COUNTER = 3
    LOST_FRAMES = 4
    INCOMPLETE_EPOCH = 5
    NOT_FINITE = 6
    OUT_OF_RANGE = 7
    FIX_TYPE = 8
    SATELLITES = 9
    SIGMA = 10
    TIME_STALE = 11
    TIME_FUTURE = 12
    TIME_JUMP = 13
    TIME_REPEATED = 14
    SYNC_JUMP = 15
    SYNC_INVALID = 16
    GATE = 17
    CLOCK_UNSET = 18
    RECEIVE_OVERFLOW = 19
    EARTH_ORIENTATION = 20
    SINGULAR = 21
    BUS_ERROR = 22
    SPARE = 23


REJECT_CAUSES = 24  # length of the counter array on the link; causes beyond it need a new message
