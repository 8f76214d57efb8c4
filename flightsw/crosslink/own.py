"""The own-satellite monitor: the weighted test with the links of the own satellite alone.

Its residuals know the direction of every link, so that an error is not diluted by links across it, as in the paper's
rule. What they cannot always know is whose the error is: where one neighbour's fault alone would explain them as well,
the verdict is SUSPECT, and only what remains beyond the threshold whichever neighbour is left out is FAULT.
"""

from __future__ import annotations

from flightsw.crosslink.declare import kernel
from flightsw.crosslink.records import OWN_LINKS, PARAMETERS
from flightsw.crosslink.weighted_test import evaluate, exclude, prepare, restore, statistic_left

NOT_JUDGED, CLEAR, SUSPECT, FAULT, SMALL = -1, 0, 1, 2, 3  # SMALL: below the threshold, too large to count as clear


@kernel
def own_verdict(table, epoch, test, own, residual_m, work, verdict, slow):
    """Judge the own satellite from the rows of `test` that it is an end of; `own` is a test of its own.

    residual_m: of the rows of `test`. Returns NOT_JUDGED, CLEAR, SMALL, SUSPECT or FAULT and fills the statistic.
    """
    me = table["own"]
    kept, peers = 0, 0
    for link in range(test["links"]):
        receiver, sender = test["receiver"][link], test["sender"][link]
        if (receiver != me and sender != me) or kept == OWN_LINKS:
            continue
        end = 0 if receiver == me else 1
        other = sender if receiver == me else receiver
        if epoch["healthy"][other] == 0:
            continue
        # locally the own satellite is 0, its neighbours count from 1
        number = 0
        for known in range(1, peers + 1):
            if work["peer"][known] == other:
                number = known
        if number == 0:
            peers += 1
            number = peers
            work["peer"][number] = other
        own["receiver"][kept] = 0
        own["sender"][kept] = number
        for k in range(PARAMETERS):
            own["h"][kept, 0, k] = test["h"][link, end, k]
            own["h"][kept, 1, k] = test["h"][link, 1 - end, k]
            own["h_bias"][kept, 0, k] = test["h_bias"][link, end, k]
            own["h_bias"][kept, 1, k] = test["h_bias"][link, 1 - end, k]
            own["h_rate"][kept, 0, k] = test["h_rate"][link, end, k]
            own["h_rate"][kept, 1, k] = test["h_rate"][link, 1 - end, k]
        own["noise_m2"][kept] = test["noise_m2"][link]
        own["column"][kept] = residual_m[link]
        kept += 1
    own["links"] = kept
    if not slow:
        verdict["own_statistic"], verdict["own_dof"], verdict["own_peer"] = -1.0, 0, -1
    # a few links cannot tell whose fault it is, but must not be silent: with one, everything is suspect
    if kept == 0 or not prepare(own, peers + 1, table["sigma_m"], table["sigma_rate_mps"], not slow):
        return NOT_JUDGED
    threshold = table["own_slow_threshold"] if slow else table["own_threshold"]
    judged, number = decide(own, own["column"], threshold, table["clear_threshold"])
    if slow:
        verdict["own_slow_statistic"] = own["statistic"][0]
    else:
        verdict["own_statistic"], verdict["own_dof"] = own["statistic"][0], own["dof"][0]
    if judged == SUSPECT:
        verdict["own_peer"] = work["peer"][number]
    return judged


@kernel
def decide(own, residual_m, threshold, clear_threshold):
    """CLEAR, SMALL, SUSPECT or FAULT from a test made ready, and the neighbour that explains most, or -1.

    residual_m: by row; threshold, clear_threshold (5): by degrees of freedom.
    """
    evaluate(own, residual_m)
    dof = own["dof"][0]
    statistic = own["statistic"][0]
    if dof == 0:
        return NOT_JUDGED, -1
    if not statistic > threshold[dof]:
        return CLEAR if statistic < clear_threshold[dof] else SMALL, -1
    least, peer = 2.0, -1
    for number in range(1, own["columns"] // PARAMETERS):
        restore(own)
        exclude(own, number)
        value, left = statistic_left(own, 0)
        ratio = value / threshold[left] if left > 0 else 0.0
        if ratio < least:
            least, peer = ratio, number
    if least > 1.0:
        return FAULT, peer
    return SUSPECT, peer
