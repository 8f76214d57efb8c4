"""A causal filter over several models of motion: interacting multiple models.

H. A. P. Blom and Y. Bar-Shalom, IEEE Trans. AC-33 (1988) 780. The models are chains of different length and noise. All
axes share the model, since it is one vehicle that turns. A model that lacks a derivative takes it over from the others
as it is, so that a quiet model does not pull the acceleration of a manoeuvring one to zero (T. Yuan, Y. Bar-Shalom,
P. Willett, E. Mozeson, S. Pollak, D. Hardiman, IEEE Trans. AES-48 (2012) 2117, unbiased mixing).
"""

from __future__ import annotations

import math

from flightsw.derivative.chain import begin, driven, predict, transition, update
from flightsw.derivative.declare import ROOM, entry, kernel
from flightsw.derivative.records import BANK, BANK_TABLE, STATES
from flightsw.kernels.registry import F8, VECTOR, frozen_records, records

_LEAST = 1e-12  # probability that no model falls below: it could never come back
_TWO_PI = 2.0 * math.pi


@kernel
def _chances(table, bank, dt_s):
    """Probabilities of going from model to model in a step, and of each after it."""
    models = table["models"]
    for i in range(models):
        leave = 1.0 - math.exp(-dt_s / table["stay_s"][i])
        for j in range(models):
            bank["jump"][i, j] = 1.0 - leave if i == j else leave * table["enter"][i, j]
    for j in range(models):
        total = 0.0
        for i in range(models):
            total += bank["jump"][i, j] * bank["weight"][i]
        bank["ahead"][j] = max(total, _LEAST)


@kernel
def _mix(table, bank, j, axis):
    """What model j begins its step with: all models' states, weighted by the chance that they became j.

    Where model i lacks a derivative, it stands in with that of j, uncorrelated with its own states.
    """
    n = table["order"][j]
    x, p, own = bank["x_mixed"][j, axis], bank["P_mixed"][j, axis], bank["P"][j, axis]
    for s in range(n):
        x[s] = 0.0
        for t in range(n):
            p[s, t] = 0.0
    for i in range(table["models"]):
        share = bank["jump"][i, j] * bank["weight"][i] / bank["ahead"][j]
        known = min(n, table["order"][i])
        for s in range(n):
            x[s] += share * (bank["x"][i, axis, s] if s < known else bank["x"][j, axis, s])
    for i in range(table["models"]):
        share = bank["jump"][i, j] * bank["weight"][i] / bank["ahead"][j]
        known = min(n, table["order"][i])
        for s in range(n):
            ds = (bank["x"][i, axis, s] if s < known else bank["x"][j, axis, s]) - x[s]
            for t in range(s + 1):
                dt = (bank["x"][i, axis, t] if t < known else bank["x"][j, axis, t]) - x[t]
                between = 0.0
                if s < known:
                    between = bank["P"][i, axis, s, t]
                elif t >= known:
                    between = own[s, t]
                p[s, t] += share * (between + ds * dt)
    for s in range(n):
        for t in range(s):
            p[t, s] = p[s, t]


@kernel
def _combine(table, bank):
    """Mean and covariance over the models; a model's missing derivatives are zero, and known to be."""
    for axis in range(table["axes"]):
        mean, covariance = bank["mean"][axis], bank["covariance"][axis]
        for s in range(STATES):
            mean[s] = 0.0
            for t in range(STATES):
                covariance[s, t] = 0.0
        for i in range(table["models"]):
            for s in range(table["order"][i]):
                mean[s] += bank["weight"][i] * bank["x"][i, axis, s]
        for i in range(table["models"]):
            n = table["order"][i]
            for s in range(STATES):
                ds = (bank["x"][i, axis, s] if s < n else 0.0) - mean[s]
                for t in range(STATES):
                    dt = (bank["x"][i, axis, t] if t < n else 0.0) - mean[t]
                    own = bank["P"][i, axis, s, t] if s < n and t < n else 0.0
                    covariance[s, t] += bank["weight"][i] * (own + ds * dt)


@kernel
def _start(table, bank, z, sigma):
    models = table["models"]
    for i in range(models):
        bank["weight"][i] = 1.0 / models
        for axis in range(table["axes"]):
            variance = sigma[axis] * sigma[axis]
            begin(
                STATES,
                table["order"][i],
                z[axis],
                variance,
                table["start_sigma"],
                bank["x"][i, axis],
                bank["P"][i, axis],
            )
    bank["epochs"] = 1
    bank["nis"] = math.nan
    _combine(table, bank)


@entry(frozen_records(BANK_TABLE), records(BANK), F8, VECTOR, VECTOR)
def bank_epoch(tables, banks, dt_s, z, sigma):
    """One epoch: positions z (axes,) with their sigmas, dt_s after the last. Returns 0 done, 1 begun anew, -1 refused.

    Refused, and nothing changed: a number that is not finite, a step that is not positive, a sigma that is not.
    """
    _ = ROOM
    table, bank = tables[0], banks[0]
    for axis in range(table["axes"]):
        if not (math.isfinite(z[axis]) and sigma[axis] > 0.0 and sigma[axis] < math.inf):
            return -1
    if bank["epochs"] == 0 or dt_s > table["gap_s"]:
        _start(table, bank, z, sigma)
        return 1
    if not dt_s > 0.0:
        return -1
    models, axes = table["models"], table["axes"]
    _chances(table, bank, dt_s)
    for j in range(models):
        for axis in range(axes):
            _mix(table, bank, j, axis)
    predicted = 0.0
    for axis in range(axes):  # misfit against what all models together expect
        mean, spread = 0.0, 0.0
        for j in range(models):
            n = table["order"][j]
            transition(n, dt_s, bank["phi"])
            value = 0.0
            for s in range(n):
                value += bank["phi"][0, s] * bank["x_mixed"][j, axis, s]
            mean += bank["ahead"][j] * value
            spread += bank["ahead"][j] * value * value
        predicted += (z[axis] - mean) ** 2 / (sigma[axis] * sigma[axis] + max(spread - mean * mean, 0.0))
    bank["nis"] = predicted / axes
    largest = -math.inf
    for j in range(models):
        n = table["order"][j]
        transition(n, dt_s, bank["phi"])
        driven(n, dt_s, table["q"][j], bank["noise"])
        likelihood = 0.0
        for axis in range(axes):
            x, p = bank["x"][j, axis], bank["P"][j, axis]
            for s in range(n):
                x[s] = bank["x_mixed"][j, axis, s]
                for t in range(n):
                    p[s, t] = bank["P_mixed"][j, axis, s, t]
            predict(n, bank["phi"], bank["noise"], x, p, bank["square"])
            misfit, variance = update(n, z[axis], sigma[axis] * sigma[axis], x, p, bank["gain"])
            likelihood -= 0.5 * (misfit * misfit / variance + math.log(_TWO_PI * variance))
        bank["logarithm"][j] = likelihood + math.log(bank["ahead"][j])
        largest = max(largest, bank["logarithm"][j])
    total = 0.0
    for j in range(models):
        bank["weight"][j] = max(math.exp(bank["logarithm"][j] - largest), _LEAST)
        total += bank["weight"][j]
    for j in range(models):
        bank["weight"][j] /= total
    bank["epochs"] += 1
    _combine(table, bank)
    return 0
