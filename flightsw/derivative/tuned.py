"""The paper's algorithm: y+ = C y + K z with a Kalman-type gain, its Q tuned by J while it runs, then constant.

A. S. Devyatisilnyy, A. V. Shurygin, A. K. Stotsenko. J = (z - H x)^2 + (x2,k - x2,k+1)^2 + (x3,k - x3,k+1)^2. Read word
by word, the argmin of J of one epoch is degenerate: a gain of one makes the residual after the update zero whatever z
is, and the other terms are a thousand times smaller. Here J has the residual before the update, is summed from
`settle_epochs` to `tune_epochs`, and the minimum is sought among given Q, none of them zero. Each Q has its filter;
all run side by side, so that the tuning needs no second pass. H, not H_p, is in the gain: the prediction has made the
step already.
"""

from __future__ import annotations

import math

from flightsw.derivative.chain import predict, transition, update
from flightsw.derivative.declare import ROOM, entry, kernel
from flightsw.derivative.records import STATES, TUNED, TUNED_TABLE
from flightsw.kernels.registry import F8, frozen_records, records


@kernel
def _prepare(table, tuned, z):
    """Units: d of the two-stage normalisation, or ones; transition in them; every candidate at its start."""
    n = table["order"]
    d = tuned["d"]
    power = 1.0
    for i in range(n):
        if table["normalised"] != 0:
            if i > 0:
                power *= table["step_s"] / i
            d[i] = table["norm"][i] * power * (table["scale"] if i > 0 else 1.0)
        else:
            d[i] = 1.0
    transition(n, table["step_s"], tuned["phi"])
    for i in range(n):
        for j in range(i, n):
            if i == 0 and j > 0:
                tuned["phi"][i, j] *= table["scale"]
            tuned["phi"][i, j] *= d[i] / d[j]
    for c in range(table["candidates"]):
        tuned["cost"][c] = 0.0
        for i in range(STATES):
            tuned["x"][c, i] = 0.0
            for j in range(STATES):
                tuned["P"][c, i, j] = 0.0
        tuned["x"][c, 0] = z * d[0]
        for i in range(n):
            tuned["P"][c, i, i] = table["start_p"][i] * d[i] * d[i]
    tuned["chosen"] = tuned["frozen"] = 0
    if table["fixed"] != 0:
        tuned["frozen"] = 1
        for i in range(n):
            tuned["gain"][0, i] = table["gain"][i] * d[i] / d[0]


@kernel
def _epoch(table, tuned, c, z):
    """One epoch of a candidate in normalised units; returns its J in physical ones."""
    n, d = table["order"], tuned["d"]
    x, p, before = tuned["x"][c], tuned["P"][c], tuned["before"]
    for i in range(n):
        before[i] = x[i]
    if tuned["frozen"] != 0:
        for i in range(n):
            total = 0.0
            for j in range(i, n):
                total += tuned["phi"][i, j] * x[j]
            x[i] = total
        misfit = z * d[0] - x[0]
        for i in range(n):
            x[i] += tuned["gain"][c, i] * misfit
    else:
        for i in range(n):
            tuned["noise"][i, i] = table["q"][c, i] * d[i] * d[i]
        predict(n, tuned["phi"], tuned["noise"], x, p, tuned["square"])
        misfit, _ = update(n, z * d[0], table["r"] * d[0] * d[0], x, p, tuned["gain"][c])
    cost = (misfit / d[0]) ** 2
    for i in range(1, min(n, 3)):
        cost += ((x[i] - before[i]) / d[i]) ** 2
    return cost


@entry(frozen_records(TUNED_TABLE), records(TUNED), F8)
def tuned_epoch(tables, states, z):
    """One epoch with position z. Returns 0 while it tunes, 1 with a constant gain, -1 refused."""
    _ = ROOM
    table, tuned = tables[0], states[0]
    if not math.isfinite(z):
        return -1
    n, d = table["order"], tuned["d"]
    if tuned["epochs"] == 0:
        _prepare(table, tuned, z)
    elif tuned["frozen"] != 0:
        _epoch(table, tuned, tuned["chosen"], z)
    else:
        best = 0
        for c in range(table["candidates"]):
            cost = _epoch(table, tuned, c, z)
            if tuned["epochs"] >= table["settle_epochs"]:
                tuned["cost"][c] += cost
            if tuned["cost"][c] < tuned["cost"][best]:
                best = c
        tuned["chosen"] = best
        if tuned["epochs"] >= table["tune_epochs"]:
            tuned["frozen"] = 1
    tuned["epochs"] += 1
    c = tuned["chosen"]
    for i in range(n):
        tuned["mean"][i] = tuned["x"][c, i] / d[i]
        tuned["gain_now"][i] = tuned["gain"][c, i] * d[0] / d[i]
    return tuned["frozen"]
