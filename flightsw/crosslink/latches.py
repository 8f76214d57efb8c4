"""What is found is held, and given up only after a number of epochs in a row that speak for it."""

from __future__ import annotations

from flightsw.crosslink.declare import kernel
from flightsw.crosslink.majority import RELIABLE, UNRELIABLE
from flightsw.crosslink.own import CLEAR, FAULT, NOT_JUDGED, SUSPECT
from flightsw.crosslink.records import PARAMETERS


@kernel
def latch_majority(table, state, verdict):
    """The paper's verdict, latched."""
    if verdict["majority"] == UNRELIABLE:
        state["majority"], state["majority_clear"] = 1, 0
    elif verdict["majority"] == RELIABLE and state["majority"] != 0:
        state["majority_clear"] += 1
        if state["majority_clear"] >= table["clear_epochs"]:
            state["majority"] = 0


@kernel
def latch_own(table, state, history, judged, slow):
    """The own satellite's state: rises at once; falls when all ages and enough epochs in a row are clear."""
    if judged in (SUSPECT, FAULT):
        state["own_clear"] = 0
        state["own_state"] = max(state["own_state"], judged)
        if slow:
            state["own_slow"] = table["onsets"]
        return
    if judged == NOT_JUDGED and not slow:
        return
    if slow:
        if state["own_slow"] > 0:
            state["own_slow"] -= 1
        return
    state["own_clear"] = state["own_clear"] + 1 if judged == CLEAR else 0
    if state["own_state"] != CLEAR and state["own_clear"] >= table["clear_epochs"] and state["own_slow"] == 0:
        state["own_state"] = CLEAR
        history["since"][table["own"]] = history["block"] + 1  # what it holds of the fault is no new one


@kernel
def latch_network(table, work, state, history, verdict):
    """Exclude whom the isolation has named; take in again who has agreed with all others for long enough."""
    for satellite in range(table["satellites"]):
        if work["set"][satellite] == 2:
            state["faulty"][satellite], state["clear"][satellite] = 1, 0
            verdict["named"] |= 1 << satellite
        elif work["set"][satellite] == 1:
            value = work["without"][satellite]
            if 0.0 <= value < table["clear_threshold"][PARAMETERS]:
                state["clear"][satellite] += 1
            elif value >= 0.0:
                state["clear"][satellite] = 0
            if state["clear"][satellite] >= table["clear_epochs"] and state["slow"][satellite] == 0:
                state["faulty"][satellite] = 0
                verdict["included"] |= 1 << satellite
                history["since"][satellite] = history["block"] + 1


@kernel
def latch_slow(table, work, state, verdict):
    """The same for slow faults: over when every age has been tried without a finding, or there is a new ephemeris."""
    for satellite in range(table["satellites"]):
        if work["set"][satellite] == 2:
            state["faulty"][satellite], state["clear"][satellite] = 1, 0
            state["slow"][satellite], state["slow_clear"][satellite] = 1, 0
            verdict["named"] |= 1 << satellite
        elif work["set"][satellite] == 1 and state["slow"][satellite] != 0:
            if work["without"][satellite] < table["clear_threshold"][PARAMETERS]:
                state["slow_clear"][satellite] += 1
            else:
                state["slow_clear"][satellite] = 0
            if state["slow_clear"][satellite] >= table["onsets"]:
                state["slow"][satellite] = 0
