"""A smoother that answers a fixed time late, of one chain, by the adjoint recursion of Bryson and Frazier.

The filter keeps what each epoch's measurement said; from the newest back to the epoch asked for, the adjoint gathers
what the later measurements say of it (G. J. Bierman, Int. J. Control 18 (1973) 1: modified Bryson-Frazier). Nothing is
inverted, steps may differ in length, and an epoch costs a bounded time: the epochs within the lag, at most LAG.
"""

from __future__ import annotations

import math

from flightsw.derivative.chain import begin, driven, predict, transition, update
from flightsw.derivative.declare import ROOM, entry, kernel
from flightsw.derivative.records import LAG, LAG_STATE, LAG_TABLE, STATES
from flightsw.kernels.registry import F8, I8, VECTOR, frozen_records, records


@kernel
def _gather(n, state, place, axis):
    """The adjoint over the measurement of an epoch: from after it to before it."""
    gain, adjoint, information = state["gain"][place, axis], state["adjoint"], state["information"]
    turn, square = state["turn"], state["square"]
    variance = state["variance"][place, axis]
    # turn = I - K H: only its first column differs from the unit matrix
    for i in range(n):
        for j in range(n):
            turn[i, j] = 1.0 if i == j else 0.0
        turn[i, 0] -= gain[i]
    first = 0.0
    for i in range(n):
        first += turn[i, 0] * adjoint[i]
    adjoint[0] = first - state["misfit"][place, axis] / variance
    for i in range(n):  # information turn
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += information[i, k] * turn[k, j]
            square[i, j] = total
    for i in range(n):  # turn' of it
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += turn[k, i] * square[k, j]
            information[i, j] = total
    information[0, 0] += 1.0 / variance


@kernel
def _carry(n, state, dt_s):
    """The adjoint over a step of time: from after it to before it."""
    phi, adjoint, information = state["phi"], state["adjoint"], state["information"]
    carried, square = state["carried"], state["square"]
    transition(n, dt_s, phi)
    for i in range(n):
        total = 0.0
        for k in range(i + 1):
            total += phi[k, i] * adjoint[k]
        carried[i] = total
    for i in range(n):
        adjoint[i] = carried[i]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(j + 1):
                total += information[i, k] * phi[k, j]
            square[i, j] = total
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(i + 1):
                total += phi[k, i] * square[k, j]
            information[i, j] = total


@kernel
def _answer(n, state, axis, age):
    """Mean and covariance of the epoch that lies `age` places back, with all that came later."""
    adjoint, information = state["adjoint"], state["information"]
    for i in range(n):
        adjoint[i] = 0.0
        for j in range(n):
            information[i, j] = 0.0
    place = state["newest"]
    for _ in range(age):
        _gather(n, state, place, axis)
        before = (place - 1) % LAG
        _carry(n, state, state["t_s"][place] - state["t_s"][before])
        place = before
    _gather(n, state, place, axis)
    x, p, square = state["x"][place, axis], state["P"][place, axis], state["square"]
    mean, covariance = state["mean"][axis], state["covariance"][axis]
    for i in range(n):
        total = 0.0
        for k in range(n):
            total += p[i, k] * adjoint[k]
        mean[i] = x[i] - total
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += p[i, k] * information[k, j]
            square[i, j] = total
    for i in range(n):
        for j in range(i + 1):
            total = p[i, j]
            for k in range(n):
                total -= square[i, k] * p[k, j]
            covariance[i, j] = covariance[j, i] = total
    state["t_answer_s"] = state["t_s"][place]


@entry(frozen_records(LAG_TABLE), records(LAG_STATE), F8, VECTOR, VECTOR)
def lagged_epoch(tables, states, t_s, z, sigma):
    """One epoch: positions z (axes,) at t_s [s] with their sigmas. Returns 1 where an answer is ready, 0 not yet.

    -1: refused (not finite, not later than the last), nothing changed. A gap begins anew.
    """
    _ = ROOM
    table, state = tables[0], states[0]
    n, axes = table["order"], table["axes"]
    for axis in range(axes):
        if not (math.isfinite(z[axis]) and sigma[axis] > 0.0 and sigma[axis] < math.inf):
            return -1
    if not math.isfinite(t_s):
        return -1
    newest = state["newest"]
    fresh = state["count"] == 0 or t_s - state["t_s"][newest] > table["gap_s"]
    if not fresh and not t_s > state["t_s"][newest]:
        return -1
    if fresh:
        state["count"] = 0
        state["epochs"] = 0
    else:
        dt_s = t_s - state["t_s"][newest]
        transition(n, dt_s, state["phi"])
        driven(n, dt_s, table["q"], state["noise"])
    place = (newest + 1) % LAG
    state["t_s"][place] = t_s
    for axis in range(axes):
        x, p, r = state["x_now"][axis], state["P_now"][axis], sigma[axis] * sigma[axis]
        if fresh:  # as if it were known to a hundred sigmas before: the first measurement is one like all others
            begin(STATES, n, z[axis], 1e4 * r, table["start_sigma"], x, p)
        else:
            predict(n, state["phi"], state["noise"], x, p, state["square"])
        for i in range(n):
            state["x"][place, axis, i] = x[i]
            for j in range(n):
                state["P"][place, axis, i, j] = p[i, j]
        misfit, variance = update(n, z[axis], r, x, p, state["gain"][place, axis])
        state["misfit"][place, axis] = misfit
        state["variance"][place, axis] = variance
    state["newest"] = place
    state["count"] = min(state["count"] + 1, LAG)
    state["epochs"] += 1
    state["ready"] = 0
    age = 0
    while age < state["count"] and t_s - state["t_s"][(place - age) % LAG] < table["lag_s"] * (1.0 - 1e-9):
        age += 1
    if age == state["count"] and state["count"] < LAG:
        return 0
    age = min(age, LAG - 1)
    for axis in range(axes):
        _answer(n, state, axis, age)
    state["ready"] = 1
    return 1


@entry(frozen_records(LAG_TABLE), records(LAG_STATE), I8)
def lagged_look(tables, states, age):
    """Answer for the epoch `age` places back, with what has come since; 1, or 0 where there is no such epoch."""
    _ = ROOM
    table, state = tables[0], states[0]
    if age < 0 or age >= state["count"]:
        state["ready"] = 0
        return 0
    for axis in range(table["axes"]):
        _answer(table["order"], state, axis, age)
    state["ready"] = 1
    return 1
