"""The own-satellite monitor: the weighted test with the links of the own satellite alone.

Its residuals know the direction of every link, so that an error is not diluted by links across it, as in the paper's
rule. What they cannot always know is whose the error is: where one neighbour's fault alone would explain them as well,
the verdict is SUSPECT, and only what remains beyond the threshold whichever neighbour is left out is FAULT.
"""

from __future__ import annotations

from flightsw.crosslink.declare import kernel
from flightsw.crosslink.records import NEIGHBOURS, PARAMETERS
from flightsw.crosslink.weighted_test import evaluate, exclude, prepare, restore, statistic_left

NOT_JUDGED, CLEAR, SUSPECT, FAULT, SMALL = -1, 0, 1, 2, 3  # SMALL: below the threshold, too large to count as clear


@kernel
def own_verdict(table, epoch, test, own, residual_m, work, verdict, slow):
    """Judge the own satellite from the rows of `test` that it is an end of; `own` is a test of its own.

    residual_m: of the rows of `test`. Returns NOT_JUDGED, CLEAR, SMALL, SUSPECT or FAULT; fills the verdict's statistic.
    """
    me = table["own"]
    kept = 0
    for link in range(test["links"]):
        receiver, sender = test["receiver"][link], test["sender"][link]
        if (receiver != me and sender != me) or kept == NEIGHBOURS:
            continue
        end = 0 if receiver == me else 1
        other = sender if receiver == me else receiver
        if epoch["healthy"][other] == 0:
            continue
        # locally the own satellite is 0, the neighbour of row k is k + 1
        own["receiver"][kept] = 0
        own["sender"][kept] = kept + 1
        for k in range(PARAMETERS):
            own["h"][kept, 0, k] = test["h"][link, end, k]
            own["h"][kept, 1, k] = test["h"][link, 1 - end, k]
            own["h_bias"][kept, 0, k] = test["h_bias"][link, end, k]
            own["h_bias"][kept, 1, k] = test["h_bias"][link, 1 - end, k]
            own["h_rate"][kept, 0, k] = test["h_rate"][link, end, k]
            own["h_rate"][kept, 1, k] = test["h_rate"][link, 1 - end, k]
        own["noise_m2"][kept] = test["noise_m2"][link]
        own["column"][kept] = residual_m[link]
        work["peer"][kept] = other
        kept += 1
    own["links"] = kept
    if not slow:
        verdict["own_statistic"], verdict["own_dof"], verdict["own_peer"] = -1.0, 0, -1
    # a few links cannot tell whose fault it is, but must not be silent: with one, everything is suspect
    if kept == 0 or not prepare(own, kept + 1, table["sigma_m"], table["sigma_rate_mps"]):
        return NOT_JUDGED
    evaluate(own, own["column"])
    dof = own["dof"][0]
    statistic = own["statistic"][0]
    if slow:
        verdict["own_slow_statistic"] = statistic
    else:
        verdict["own_statistic"], verdict["own_dof"] = statistic, dof
    threshold = table["own_slow_threshold"] if slow else table["own_threshold"]
    if dof == 0 or not statistic > threshold[dof]:
        return CLEAR if statistic < table["clear_threshold"][dof] else SMALL
    least, peer = 2.0, -1
    for row in range(kept):
        restore(own)
        exclude(own, row + 1)
        value, left = statistic_left(own, 0)
        ratio = value / threshold[left] if left > 0 else 0.0
        if ratio < least:
            least, peer = ratio, row
    if least > 1.0:
        return FAULT
    verdict["own_peer"] = work["peer"][peer]
    return SUSPECT
