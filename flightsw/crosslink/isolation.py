"""Who is faulty: satellites are named one after the other, each with those before it estimated, then looked at again.

Forward, the satellite with the most significant statistic joins the set until none is beyond its threshold. Backward,
a member that the others explain away leaves it. A greedy search alone names a healthy neighbour now and then; the look
back is what makes the set exact.
"""

from __future__ import annotations

from flightsw.crosslink.declare import kernel
from flightsw.crosslink.records import PARAMETERS
from flightsw.crosslink.weighted_test import exclude, restore, statistic_left


@kernel
def _worst(test, satellites, members, threshold):
    """(satellite outside the set whose statistic is largest against its threshold, that ratio, the statistic)."""
    worst, most, found = -1, 0.0, 0.0
    for satellite in range(satellites):
        if members[satellite] == 0:
            value, dof = statistic_left(test, satellite)
            if dof > 0:
                ratio = value / threshold[dof]
                if ratio > most:
                    worst, most, found = satellite, ratio, value
    return worst, most, found


@kernel
def _exclude_all(test, satellites, members, but):
    restore(test)
    for satellite in range(satellites):
        if members[satellite] != 0 and satellite != but:
            exclude(test, satellite)


@kernel
def isolate(test, members, threshold, limit, without):
    """Let `members` (satellites,), 1 for those excluded beforehand, grow to the set that explains an evaluated epoch.

    threshold (5): by degrees of freedom. limit: members that the set may have. without (satellites,) receives, for each
    member, its statistic with all others estimated, -1 where nothing is left of it. Members with 1 were there before
    and stay; those named here get 2. Returns (statistic, satellite) of the largest that stays outside; (-1, -1): none.
    """
    satellites = test["columns"] // PARAMETERS
    count = 0
    restore(test)
    for satellite in range(satellites):
        if members[satellite] != 0:
            exclude(test, satellite)
            count += 1
    worst, ratio, statistic = _worst(test, satellites, members, threshold)
    added = 0
    while worst >= 0 and ratio > 1.0 and count < limit:
        members[worst] = 2
        exclude(test, worst)
        count += 1
        added += 1
        worst, ratio, statistic = _worst(test, satellites, members, threshold)
    if added > 1:  # the last one needs no second look
        for _ in range(added):
            weakest, least = -1, 1.0
            for satellite in range(satellites):
                if members[satellite] == 2:
                    _exclude_all(test, satellites, members, satellite)
                    value, dof = statistic_left(test, satellite)
                    ratio = value / threshold[dof] if dof > 0 else 0.0
                    if ratio < least:
                        weakest, least = satellite, ratio
            if weakest < 0:
                break
            members[weakest] = 0
        _exclude_all(test, satellites, members, -1)
        worst, ratio, statistic = _worst(test, satellites, members, threshold)
    for satellite in range(satellites):
        without[satellite] = -1.0
    for satellite in range(satellites):
        if members[satellite] != 0:
            _exclude_all(test, satellites, members, satellite)
            value, dof = statistic_left(test, satellite)
            without[satellite] = value if dof > 0 else -1.0
    if worst < 0:
        statistic = -1.0
    return statistic, worst
