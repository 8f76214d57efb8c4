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
    NOT_CERTIFIED = 4  # nothing was proven for this table, or not for here and now


class Uncovered(IntEnum):
    """What keeps a certified table's state outside of what was proven (DBC signal `uncovered`); the first that does."""

    NOTHING = 0  # covered, or there is no certificate
    HEIGHT = 1
    AGE = 2  # of the outage
    ACTIVITY = 3  # of the Sun
    OVERRULED = 4  # fixes replaced a converged state against its bound; until the operator resets the filter
    CONVERGENCE = 5  # not yet aided for long enough since the start, a burn, or a fix of a kind that was not flown


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
    POSITION_3D = 4  # no velocity frame belongs to it


class SyncStatus(IntEnum):
    """Whether the timing source vouches for a pulse (DBC signal `status` of TIME_SYNC)."""

    INVALID = 0
    VALID = 1


class BurnFrame(IntEnum):
    """Axes of an announced velocity change (DBC signal `frame` of BURN)."""

    GCRF = 0
    RTN = 1  # radial, along-track, cross-track at each instant of the burn


class StateFrame(IntEnum):
    """Axes of a state that the ground sends (telemetry, `frame` of LEONAV_STATE_UPLOAD)."""

    GCRF = 0
    ITRF = 1  # velocity as seen from the turning Earth


class NavCommand(IntEnum):
    """What navigation is told to do (DBC signal `command` of NAV_COMMAND)."""

    EDIT = 1  # how measurements of one type are edited from now on
    RESET_FILTER = 2  # forget the state and start from the next good fixes


class MeasurementType(IntEnum):
    """Kind of measurement that the filter takes and edits on its own (DBC signal `target` of NAV_COMMAND)."""

    POSITION = 0
    VELOCITY = 1


class EditMode(IntEnum):
    """How measurements of a type are edited (DBC signal `value` of NAV_COMMAND)."""

    AUTO = 0  # the gate decides
    ACCEPT = 1  # used whatever the gate says
    REJECT = 2  # tested and recorded, never used
    INHIBIT = 3  # not even tested


class FaultKind(IntEnum):
    """What the monitor of slow faults holds most likely (telemetry, `monitor_kind`)."""

    MANOEUVRE = 0  # velocity has changed, and position with it
    POSITION_RAMP = 1
    POSITION_STEP = 2
    VELOCITY_BIAS = 3


class Governing(IntEnum):
    """What ends the time in which the state may be trusted without GNSS (DBC signal `governing`)."""

    NOT_READY = 0  # nothing to predict from yet
    BOUND = 1  # the bound crosses the limit
    CERTIFIED_AGE = 2  # nothing is proven beyond it
    EARTH_ORIENTATION = 3  # the table of Earth orientation ends
    HORIZON = 4  # none of these as far as was looked
    FLAG = 5  # the flag is up


class CrosslinkState(IntEnum):
    """What the inter-satellite links say of the own satellite's message (DBC signal `own_state`)."""

    NOT_JUDGED = 0
    CLEAR = 1
    SUSPECT = 2  # wrong, or one neighbour's is
    FAULT = 3


class CrosslinkMajority(IntEnum):
    """Majority rule over the own links (DBC signal `majority`)."""

    NO_VERDICT = 0
    RELIABLE = 1
    UNRELIABLE = 2


class Constellation(IntEnum):
    """Whose satellite it is: each has a clock of its own (DBC signal `constellation`)."""

    GPS = 0
    GLONASS = 1
    GALILEO = 2
    BEIDOU = 3


class GnssVerdict(IntEnum):
    """What became of an epoch of pseudoranges (DBC signal `gnss_verdict`).

    Only CONSISTENT and EXCLUDED have a fix that a test has passed.
    """

    CONSISTENT = 0
    EXCLUDED = 1  # consistent without the satellites named
    AMBIGUOUS = 2  # as EXCLUDED, but another set explains the epoch nearly as well
    UNTESTED = 3  # a fix, with as many unknowns as satellites: nothing can contradict it
    INCONSISTENT = 4  # and no admissible exclusion helps
    TOO_FEW = 5  # usable satellites for a solution
    NO_SOLUTION = 6  # satellites without a geometry, or ranges without a place
    TOO_MANY = 7  # more rows than an epoch can hold, or fewer than none
    NO_EPOCH = 8  # none has been judged yet


class RejectCause(IntEnum):
    """Why a frame, a pulse or a fix did not change the state; index into the 32 counters of telemetry."""

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
    OPERATOR = 23  # by the operator's editing
    SLOW_FAULT = 24  # while the monitor of slow faults excludes this type
    BURN_LATE = 25  # announced so late that it cannot be caught up
    BURN_INVALID = 26
    ATTITUDE_INVALID = 27
    COMMAND_INVALID = 28
    STARTING = 29  # good, but aiding starts only after several good fixes in a row
    UPLOAD_INVALID = 30  # a state from the ground that is none, or not for the filter that flies


REJECT_CAUSES = 32  # length of the counter array on the link; causes beyond it need a new message
