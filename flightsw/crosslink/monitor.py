"""One epoch of the inter-satellite monitor: the paper's rule, the own-satellite monitor, the network monitor.

All three read the same residuals and none waits for another. The paper's rule and the own-satellite monitor use the
links of the own satellite alone; the network monitor every link that was exchanged. A satellite is excluded with the
epoch that names it and taken in again after `clear_epochs` epochs in a row in which its links agree with all others.
"""

from __future__ import annotations

import math

from flightsw.crosslink.declare import ROOM, entry, kernel
from flightsw.crosslink.geometry import link_residual
from flightsw.crosslink.history import begin_epoch, contrast_of, enter, local_axes
from flightsw.crosslink.isolation import isolate
from flightsw.crosslink.latches import latch_majority, latch_network, latch_own, latch_slow
from flightsw.crosslink.majority import heard_by, majority
from flightsw.crosslink.own import own_verdict
from flightsw.crosslink.records import (
    EPOCH,
    HISTORY,
    MONITOR_TABLE,
    OWN_LINKS,
    PARAMETERS,
    STATE,
    TEST,
    VERDICT,
    WORK,
)
from flightsw.crosslink.subspace import subspace
from flightsw.crosslink.weighted_test import evaluate, prepare
from flightsw.kernels.registry import frozen_records, records


@kernel
def _residuals(table, epoch, test, work):
    """Residuals of the epoch's links into rows of the test; drops those of satellites without an ephemeris."""
    satellites, own = table["satellites"], table["own"]
    kept = 0
    own_links = 0
    for link in range(epoch["links"]):
        receiver, sender = epoch["receiver"][link], epoch["sender"][link]
        if not (0 <= receiver < satellites and 0 <= sender < satellites) or receiver == sender:
            continue
        if work["usable"][receiver] == 0 or work["usable"][sender] == 0:
            continue
        value = link_residual(
            epoch["r_m"],
            epoch["v_mps"],
            epoch["clock_m"],
            work["axes"],
            receiver,
            sender,
            epoch["range_m"][link],
            table["two_way"] != 0,
            work["position"],
            work["direction"],
            work["h"],
        )
        if not math.isfinite(value):
            continue
        for end in range(2):
            for k in range(4):
                test["h"][kept, end, k] = work["h"][end, k]
                test["h_bias"][kept, end, k] = work["h"][end, k]
                test["h_rate"][kept, end, k] = 0.0
        test["noise_m2"][kept] = table["sigma_range_m"] * table["sigma_range_m"]
        test["receiver"][kept], test["sender"][kept] = receiver, sender
        epoch["receiver"][kept], epoch["sender"][kept] = receiver, sender
        work["residual_m"][kept] = value
        if heard_by(own, receiver, sender, table["both"] != 0) and own_links < OWN_LINKS:
            work["own_residual_m"][own_links] = value
            own_links += 1
        kept += 1
    test["links"] = kept
    epoch["links"] = kept
    return own_links


@kernel
def _network(table, test, residual_m, state, history, verdict, work, slow):
    """Evaluate and isolate; leaves the set in work["set"]. Returns (statistic, satellite) of the largest left."""
    satellites = table["satellites"]
    threshold = table["network_slow_threshold"] if slow else table["network_threshold"]
    for satellite in range(satellites):
        work["set"][satellite] = state["faulty"][satellite]
    if not prepare(test, satellites, table["sigma_m"], table["sigma_rate_mps"]):
        return -1.0, -1
    evaluate(test, residual_m)
    largest, statistic, quiet = -1, -1.0, True
    for satellite in range(satellites):
        if work["set"][satellite] != 0:
            quiet = False
        elif test["dof"][satellite] > 0:
            if test["statistic"][satellite] > statistic:
                largest, statistic = satellite, test["statistic"][satellite]
            if test["statistic"][satellite] > threshold[test["dof"][satellite]]:
                quiet = False
    if not quiet:
        # the largest as it was before anyone was named is what the operator is told
        left, at = isolate(test, work["set"], threshold, table["faulty_max"], work["without"])
        if slow:
            latch_slow(table, work, state, verdict)
        else:
            latch_network(table, work, state, history, verdict)
        if verdict["named"] == 0:
            statistic, largest = left, at
    return statistic, largest


@kernel
def _monitored(table, network, exchanged, verdict):
    """Bit mask of the satellites whose error shows in every direction, by the network's links or by the own ones."""
    full = PARAMETERS - 1 if table["two_way"] != 0 else PARAMETERS
    mask = 0
    if verdict["own_dof"] == full:
        mask |= 1 << table["own"]
    if exchanged > 0 and network["ready"] != 0:
        for satellite in range(table["satellites"]):
            if network["dof"][satellite] == full:
                mask |= 1 << satellite
    return mask


@kernel
def _contrasts(table, epoch, history, test, work, onset_blocks):
    """Growth of every pair of this epoch into rows of the test."""
    kept = 0
    for link in range(epoch["links"]):
        value = contrast_of(
            history,
            test,
            kept,
            epoch["receiver"][link],
            epoch["sender"][link],
            onset_blocks,
            table["block_epochs"] * table["epoch_s"],
            table["sigma_range_m"],
            table["two_way"] != 0,
            work,
        )
        if not math.isnan(value):
            work["contrast_m"][kept] = value
            kept += 1
    test["links"] = kept


def _declare(room):
    @entry(
        frozen_records(MONITOR_TABLE),
        records(EPOCH),
        records(STATE),
        records(HISTORY),
        records(TEST),
        records(TEST),
        records(WORK),
        records(VERDICT),
    )
    def monitor_epoch(tables, epochs, states, histories, networks, owns, works, verdicts):
        """Judge one epoch; every argument is an array of one record. Allocates nothing; any content gives a verdict."""
        table, epoch, state, history = tables[0], epochs[0], states[0], histories[0]
        network, own, work, verdict = networks[0], owns[0], works[0], verdicts[0]
        satellites = table["satellites"]
        verdict["t_gps_ns"] = epoch["t_gps_ns"]
        verdict["named"] = 0
        verdict["included"] = 0
        local_axes(epoch, work["usable"], work["axes"], satellites)
        begin_epoch(history, epoch, satellites)
        own_links = _residuals(table, epoch, network, work)
        links = network["links"]
        verdict["links"], verdict["own_links"] = links, own_links
        verdict["majority"] = majority(work["own_residual_m"], own_links, table["majority_threshold_m"])
        latch_majority(table, state, verdict)
        judged = own_verdict(table, epoch, network, own, work["residual_m"], work, verdict, False)
        latch_own(table, state, history, judged, False)

        exchanged = 0
        for link in range(links):
            if epoch["receiver"][link] != table["own"] and epoch["sender"][link] != table["own"]:
                exchanged += 1
        verdict["network_ready"] = 1 if exchanged > 0 else 0
        verdict["network_statistic"], verdict["network_worst"] = -1.0, -1
        if exchanged > 0:
            statistic, worst = _network(table, network, work["residual_m"], state, history, verdict, work, False)
            subspace(table, network, state, work, verdict)
            verdict["network_statistic"], verdict["network_worst"] = statistic, worst
        verdict["monitored"] = _monitored(table, network, exchanged, verdict)

        enter(
            history, epoch, work["residual_m"], links, work["usable"], work["axes"], satellites, table["block_epochs"]
        )
        verdict["slow_age_s"] = math.nan
        verdict["own_slow_statistic"] = -1.0
        verdict["network_slow_statistic"], verdict["network_slow_worst"] = -1.0, -1
        if 0 <= history["onset"] < table["onsets"] and history["block"] > 1:
            onset_blocks = table["onset_blocks"][history["onset"]]
            verdict["slow_age_s"] = onset_blocks * table["block_epochs"] * table["epoch_s"]
            history["onset"] += 1
            _contrasts(table, epoch, history, network, work, onset_blocks)
            judged = own_verdict(table, epoch, network, own, work["contrast_m"], work, verdict, True)
            latch_own(table, state, history, judged, True)
            if exchanged > 0:
                statistic, worst = _network(table, network, work["contrast_m"], state, history, verdict, work, True)
                verdict["network_slow_statistic"], verdict["network_slow_worst"] = statistic, worst
        mask = 0
        for satellite in range(satellites):
            if state["faulty"][satellite] != 0:
                mask |= 1 << satellite
        verdict["faulty"] = mask
        verdict["majority_latched"] = state["majority"]
        verdict["own_state"] = state["own_state"]
        state["epochs"] += 1
        state["code"] = room

    return monitor_epoch


monitor_epoch = _declare(ROOM)
