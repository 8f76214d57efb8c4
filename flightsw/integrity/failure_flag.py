"""The parametric-failure flag, condition (14): raised when the bound passes the limit, latched, cleared late.

Persist, latch and STALE follow the limit checker of cFS: a watch that cannot be computed is neither healthy nor
failed, and says so. In an outage the bound of (12) dips by up to a quarter within an orbit as the along-track
direction turns, so falling back below the limit clears nothing: only fixes do.
"""

from __future__ import annotations

import math

from flightsw.icd.enums import BoundDriver, FlagState
from flightsw.kernels.registry import kernel

CLEAR = int(FlagState.CLEAR)
RAISED = int(FlagState.RAISED)
STALE = int(FlagState.STALE)
_RADIUS = int(BoundDriver.RADIUS)


@kernel
def driving(table, axis_m, radius_m):
    """The bound that the table compares with the limit."""
    return radius_m if table.flag_driver == _RADIUS else axis_m


@kernel
def evaluate(nav, table, bound_m, outage_age_s):
    """Judge the bound of one new epoch; called once for each epoch, whatever the rate of the loop."""
    if not math.isfinite(bound_m):
        if nav.flag == CLEAR:
            nav.flag = STALE
        return
    if nav.flag == STALE:
        nav.flag = CLEAR
    if bound_m > table.limit_m:
        nav.over_limit += 1
    else:
        nav.over_limit = 0
    if nav.over_limit >= table.flag_persist and nav.flag != RAISED:
        nav.flag = RAISED
        nav.flag_age_s = outage_age_s


@kernel
def clear_if_recovered(nav, table, bound_m):
    """Clear a raised flag after an accepted fix, once bound, count of fixes and mean NIS all allow it.

    Returns whether it cleared.
    """
    if (
        nav.flag == RAISED
        and bound_m <= table.clear_limit_m
        and nav.streak >= table.clear_fixes
        and nav.mean_nis >= table.clear_nis_low
        and nav.mean_nis <= table.clear_nis_high
    ):
        nav.flag = CLEAR
        nav.over_limit = 0
        nav.flag_age_s = math.nan
        return True
    return False
