"""One epoch of the inter-satellite monitor: the paper's rule, the own-satellite monitor, the network monitor.

All three read the same residuals and none waits for another. The paper's rule and the own-satellite monitor use the
links of the own satellite alone; the network monitor every link that was exchanged. A satellite is excluded with the
epoch that names it and taken in again after `clear_epochs` epochs in a row in which its links agree with all others.

An epoch in which nobody is faulty is judged in one step, any other in two: the search for those who are takes as long
again. The search for faults that grew slowly, and what no range can show, may wait: they follow in steps of their own,
each as long as a tick can spare, and are done before the next epoch.
"""

from __future__ import annotations

import math

import numpy as np

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
from flightsw.crosslink.subspace import has_changed, subspace
from flightsw.crosslink.weighted_test import evaluate, prepare
from flightsw.kernels.registry import I8, frozen_records, records

_LINKS_A_STEP = 144  # whose contrasts are made in one step
_NO_SEARCH, _OF_EPOCH, _OF_GROWTH = 0, 1, 2  # work["search"]


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
def _weigh(table, test, residual_m, state, work, slow):
    """Evaluate every satellite's statistic. Returns (statistic, satellite) of the largest that is not excluded, and
    whether anyone is, or is to be sought."""
    satellites = table["satellites"]
    threshold = table["network_slow_threshold"] if slow else table["network_threshold"]
    for satellite in range(satellites):
        work["set"][satellite] = state["faulty"][satellite]
    if not prepare(test, satellites, table["sigma_m"], table["sigma_rate_mps"], not slow):
        return -1.0, -1, False
    evaluate(test, residual_m)
    largest, statistic, sought = -1, -1.0, False
    for satellite in range(satellites):
        if work["set"][satellite] != 0:
            sought = True
        elif test["dof"][satellite] > 0:
            if test["statistic"][satellite] > statistic:
                largest, statistic = satellite, test["statistic"][satellite]
            if test["statistic"][satellite] > threshold[test["dof"][satellite]]:
                sought = True
    return statistic, largest, sought


@kernel
def _search(table, test, state, history, verdict, work, slow):
    """Who is faulty, latched; leaves the set in work["set"]. Nobody new is named: the largest left is what is told,
    else the largest as it was before anyone was."""
    threshold = table["network_slow_threshold"] if slow else table["network_threshold"]
    statistic, largest = isolate(test, work["set"], threshold, table["faulty_max"], work["without"])
    if slow:
        latch_slow(table, work, state, verdict)
    else:
        latch_network(table, work, state, history, verdict)
    if verdict["named"] == 0:
        if slow:
            verdict["network_slow_statistic"], verdict["network_slow_worst"] = statistic, largest
        else:
            verdict["network_statistic"], verdict["network_worst"] = statistic, largest


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
def _faulty(table, state, verdict):
    """What is latched, into the verdict."""
    mask = 0
    for satellite in range(table["satellites"]):
        if state["faulty"][satellite] != 0:
            mask |= 1 << satellite
    verdict["faulty"] = mask
    verdict["majority_latched"] = state["majority"]
    verdict["own_state"] = state["own_state"]


@kernel
def _finish(table, epoch, state, history, network, work, verdict):
    """The epoch is judged; its residuals join the history. Leaves how many steps are to follow."""
    satellites, links = table["satellites"], network["links"]
    work["subspace"] = 1 if work["exchanged"] > 0 and has_changed(network, state) else 0
    verdict["monitored"] = _monitored(table, network, work["exchanged"], verdict)
    enter(history, epoch, work["residual_m"], links, work["usable"], work["axes"], satellites, table["block_epochs"])
    verdict["slow_age_s"] = math.nan
    verdict["own_slow_statistic"] = -1.0
    verdict["network_slow_statistic"], verdict["network_slow_worst"] = -1.0, -1
    verdict["left"] = work["subspace"]
    if 0 <= history["onset"] < table["onsets"] and history["block"] > 1:
        work["onset_blocks"] = table["onset_blocks"][history["onset"]]
        history["onset"] += 1
        work["contrasted"], work["kept"] = 0, 0
        verdict["left"] += (links + _LINKS_A_STEP - 1) // _LINKS_A_STEP + 1
    verdict["judged"] = 1
    state["epochs"] += 1


@kernel
def _judge(table, epoch, state, history, network, own, work, verdict):
    """The epoch by itself, all three monitors, to the end unless someone is to be sought."""
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
    work["exchanged"] = exchanged
    verdict["network_ready"] = 1 if exchanged > 0 else 0
    verdict["network_statistic"], verdict["network_worst"] = -1.0, -1
    work["search"] = _NO_SEARCH
    if exchanged > 0:
        statistic, worst, sought = _weigh(table, network, work["residual_m"], state, work, False)
        verdict["network_statistic"], verdict["network_worst"] = statistic, worst
        if sought:
            work["search"] = _OF_EPOCH
    if work["search"] == _NO_SEARCH:
        _finish(table, epoch, state, history, network, work, verdict)
    else:
        verdict["left"] = 1


@kernel
def _contrasts(table, epoch, history, test, work):
    """Growth of some more pairs of this epoch into rows of the test."""
    kept = work["kept"]
    after = min(work["contrasted"] + _LINKS_A_STEP, epoch["links"])
    for link in range(work["contrasted"], after):
        value = contrast_of(
            history,
            test,
            kept,
            epoch["receiver"][link],
            epoch["sender"][link],
            work["onset_blocks"],
            table["block_epochs"] * table["epoch_s"],
            table["sigma_range_m"],
            table["two_way"] != 0,
            work,
        )
        if not math.isnan(value):
            work["contrast_m"][kept] = value
            kept += 1
    work["contrasted"], work["kept"] = after, kept


@kernel
def _go_on(table, epoch, state, history, network, own, work, verdict):
    """One step more: the search for the faulty, subspace, contrasts of some links, their test, and its search."""
    verdict["left"] -= 1
    if work["search"] == _OF_EPOCH:
        work["search"] = _NO_SEARCH
        _search(table, network, state, history, verdict, work, False)
        _finish(table, epoch, state, history, network, work, verdict)
    elif work["search"] == _OF_GROWTH:
        work["search"] = _NO_SEARCH
        _search(table, network, state, history, verdict, work, True)
    elif work["subspace"] != 0:
        work["subspace"] = 0
        subspace(table, network, work, verdict)
    elif work["contrasted"] < epoch["links"]:
        _contrasts(table, epoch, history, network, work)
    else:
        network["links"] = work["kept"]
        verdict["slow_age_s"] = work["onset_blocks"] * table["block_epochs"] * table["epoch_s"]
        judged = own_verdict(table, epoch, network, own, work["contrast_m"], work, verdict, True)
        latch_own(table, state, history, judged, True)
        if work["exchanged"] > 0:
            statistic, worst, sought = _weigh(table, network, work["contrast_m"], state, work, True)
            verdict["network_slow_statistic"], verdict["network_slow_worst"] = statistic, worst
            if sought:
                work["search"] = _OF_GROWTH
                verdict["left"] += 1


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
        I8,
    )
    def monitor_step(tables, epochs, states, histories, networks, owns, works, verdicts, fresh):
        """Judge the epoch if it is fresh, otherwise take the next step that it waits for: verdict["left"] of them.

        Every other argument is an array of one record. Allocates nothing; any content gives a verdict.
        """
        table, epoch, state, history = tables[0], epochs[0], states[0], histories[0]
        network, own, work, verdict = networks[0], owns[0], works[0], verdicts[0]
        verdict["judged"] = 0
        if fresh != 0:
            _judge(table, epoch, state, history, network, own, work, verdict)
        elif verdict["left"] > 0:
            _go_on(table, epoch, state, history, network, own, work, verdict)
        _faulty(table, state, verdict)
        state["code"] = room

    return monitor_step


monitor_step = _declare(ROOM)


def monitor_epoch(*arguments: np.ndarray) -> None:
    """An epoch with all its steps, for those who are in no hurry; arguments as of `monitor_step` but the last."""
    left = arguments[-1]["left"]
    monitor_step(*arguments, 1)
    while left[0] > 0:
        monitor_step(*arguments, 0)
