"""Which satellites to leave out: the paper's greedy rule, and the most probable explanation of the epoch.

The greedy rule drops the largest weighted squared residual; faults hide one another from it. The other one looks at
sets in order of their size: all singles and all pairs; from there on the best sets of one size (a beam) are each grown
by every satellite. From the fewest exclusions that leave a consistent rest, and sets a little larger, the most probable
is taken. Nothing that was taken first has to be kept.
"""

from __future__ import annotations

import math

from flightsw.gnss.declare import kernel
from flightsw.gnss.records import BEAM
from flightsw.gnss.residuals import FLOOR, RESIDUAL, begin, bit, largest_normalised, take_out, take_out_all


@kernel
def greedy(table, work, n, dof, result):
    """The paper's rule; returns the mask of places left out, or 0: nothing admissible helps."""
    rss = begin(work, n)
    mask, depth = 0, 0
    while dof - depth >= 2 and depth < table["faulty_max"]:
        worst, most = -1, 0.0
        for i in range(n):
            square = work["left"][i] * work["left"][i]
            if work["diagonal"][i] > FLOOR and square > most:
                worst, most = i, square
        if worst < 0:
            return 0
        rss -= take_out(work, n, depth, worst)
        mask |= bit(worst)
        depth += 1
        result["candidates"] += 1
        if rss <= table["threshold"][dof - depth]:
            return mask
    return 0


@kernel
def _offer(work, side, kept, mask, rss):
    """Put a set into the beam, in order of RSS, once; returns how many it holds."""
    masks, values = work["beam_mask"][side], work["beam_rss"][side]
    if kept == BEAM and rss >= values[BEAM - 1]:
        return kept
    for place in range(kept):
        if masks[place] == mask:
            return kept
    place = min(kept, BEAM - 1)
    while place > 0 and values[place - 1] > rss:
        masks[place] = masks[place - 1]
        values[place] = values[place - 1]
        place -= 1
    masks[place] = mask
    values[place] = rss
    return min(kept + 1, BEAM)


@kernel
def _grow(table, work, n, side, kept, result):
    """Fill the other side of the beam with the kept sets, each grown by one; returns how many it then holds."""
    grown = 0
    for place in range(kept):
        mask = work["beam_mask"][side, place]
        rss, _, _ = take_out_all(work, n, mask)
        for i in range(n):
            if work["diagonal"][i] > FLOOR:
                if result["candidates"] >= table["candidates_max"]:
                    result["out_of_budget"] = 1
                    return grown
                result["candidates"] += 1
                left = work["left"][i]
                grown = _offer(work, 1 - side, grown, mask | bit(i), rss - left * left / work["diagonal"][i])
    return grown


@kernel
def _cost(table, work, n, mask):
    """How improbable a set is: twice the negative logarithm of its posterior, but for a constant.

    Sizes of the faults are Gaussian with a variance that they share; it is estimated from them (empirical Bayes). Any
    number k of faults among n satellites is as likely as the next but for the table's odds, any set of k the same:

        RSS_E + k 2 ln odds + 2 ln C(n, k) + ln det(tau^2 S_EE),     tau^2 = mean of squared sizes S_EE^-1 r_E

    so that a small outlier among large faults costs more than among its like, and a second fault more than a sixth.
    inf: something in it has no redundancy.
    """
    rss, depth, _ = take_out_all(work, n, mask)
    size = work["size"]
    levels = work["levels"]
    members = work["member"]
    count = 0
    for i in range(n):
        if mask & bit(i):
            members[count] = i
            count += 1
    if depth != count:
        return math.inf
    squares, logs = 0.0, 0.0
    for k in range(count):
        logs += 2.0 * math.log((n - k) / (k + 1.0))
    for back in range(count):
        d = count - 1 - back
        value = levels[d, RESIDUAL]
        for e in range(d + 1, count):
            value -= levels[d, members[e]] * size[e]
        pivot = levels[d, members[d]]
        size[d] = value / pivot
        squares += size[d] * size[d]
        logs += 2.0 * math.log(pivot)
    tau2 = max(squares / count, 1.0)
    return rss + logs + count * (table["isolate_odds"] + math.log(tau2))


@kernel
def probable(table, work, n, dof, result):
    """The most probable set of those whose absence leaves a consistent rest; its mask of places, 0: there is none."""
    side, kept = 0, 1
    work["beam_mask"][0, 0], work["beam_rss"][0, 0] = 0, 0.0
    size, last = 0, table["faulty_max"]
    found, least = 0, math.inf
    rival, second = 0, math.inf
    while dof - size >= 2 and size < last and result["out_of_budget"] == 0:
        kept = _grow(table, work, n, side, kept, result)
        side = 1 - side
        size += 1
        for place in range(kept):
            mask = work["beam_mask"][side, place]
            if work["beam_rss"][side, place] > table["threshold"][dof - size]:
                break
            if found == 0:
                last = min(last, size + table["further"])
            cost = _cost(table, work, n, mask)
            if cost < second and largest_normalised(work, n)[0] <= table["local_threshold"]:
                if cost < least:
                    if found & mask != found:
                        rival, second = found, least
                    found, least = mask, cost
                elif found & mask != found and found & mask != mask:
                    rival, second = mask, cost
    if rival & found != rival and second - least < table["ambiguity"]:
        result["rival"], result["rival_gap"] = rival, second - least
    return found
