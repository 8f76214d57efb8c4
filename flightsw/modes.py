"""The mode machine: a transition table, read by one compiled line.

INIT        no state yet: fixes that agree with each other are awaited
INTEGRATED  the filter is corrected by fixes
AUTONOMOUS  no accepted fix for longer than the time-out: the state coasts on the model
FAILED      the parametric-failure flag is raised; fixes may be coming in, but the state is not offered as valid
"""

from __future__ import annotations

import numpy as np

from flightsw.icd.enums import FlagState, Mode
from flightsw.kernels.registry import kernel

INIT = int(Mode.INIT)
INTEGRATED = int(Mode.INTEGRATED)
AUTONOMOUS = int(Mode.AUTONOMOUS)
FAILED = int(Mode.FAILED)
_RAISED = int(FlagState.RAISED)

# Conditions, in order of precedence.
LOST, FLAGGED, COASTING, CORRECTED, AS_BEFORE = range(5)

# TRANSITIONS[mode, condition] -> mode
TRANSITIONS = np.array(
    [
        # LOST  FLAGGED COASTING    CORRECTED   AS_BEFORE
        [INIT, FAILED, AUTONOMOUS, INTEGRATED, INTEGRATED],  # INIT: a state exists now, or LOST holds
        [INIT, FAILED, AUTONOMOUS, INTEGRATED, INTEGRATED],  # INTEGRATED
        [INIT, FAILED, AUTONOMOUS, INTEGRATED, AUTONOMOUS],  # AUTONOMOUS
        [INIT, FAILED, AUTONOMOUS, INTEGRATED, AUTONOMOUS],  # FAILED: the flag has just cleared
    ],
    dtype=np.int64,
)


@kernel
def next_mode(mode, initialised, flag, coasting, corrected):
    """The mode after this step.

    Args: mode before; whether a state exists; the flag; whether the last accepted fix is older than the
    time-out; whether enough fixes in a row have been accepted.
    """
    if not initialised:
        condition = LOST
    elif flag == _RAISED:
        condition = FLAGGED
    elif coasting:
        condition = COASTING
    elif corrected:
        condition = CORRECTED
    else:
        condition = AS_BEFORE
    return TRANSITIONS[mode, condition]
