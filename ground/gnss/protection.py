"""The part of `ground gnss study` about protection levels: what they promise, counted where it can be counted."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flightsw.gnss.records import RESULT, SATELLITES
from flightsw.gnss.setup import Settings, build_table
from ground.gnss.scene import Batch, User, draw, judge, renew
from ground.gnss.study import chunks, rate

LEO = User(altitude_m=500_000.0)
SIGMA_LEO_M = 1.0  # dual-frequency code with broadcast ephemerides
COARSE = Settings(
    protect=True,
    p_satellite=(1e-3,) * 4,
    p_constellation=(0.0,) * 4,
    p_hmi=(1e-3,) * 3,
    p_unmonitored=0.7,
    alert_limit_m=(10.0,) * 3,
)
FINE = Settings(protect=True)
_RENEWALS = 10
SIZES = (3.0, 4.0, 5.0, 6.0, 8.0)  # of a fault, in sigmas of its normalised residual: the worst is just below the test


def errors_m(batch: Batch, result: np.ndarray) -> np.ndarray:
    """Errors (m,3) east, north, up."""
    return np.einsum("mqk,mk->mq", result["axes"], result["r_m"] - batch.truth_m)


def usable(result: np.ndarray) -> np.ndarray:
    """(m,) bool: a fix with a verdict that lets it be used."""
    return result["verdict"] <= 1


def protection_part(seed: int, epochs: int) -> dict[str, Any]:
    """Risk given a fault at its worst size, against what the mode is allowed; direct count at 1e-3; availability."""
    return {
        "direct": direct(seed, epochs),
        "worst": worst(seed, max(epochs // 50, 100)),
        "availability": availability(seed, max(epochs // 20, 100)),
    }


def direct(seed: int, epochs: int) -> dict[str, Any]:
    """Epochs in which every satellite is faulty with its prior, sizes over all scales: errors beyond the level."""
    rng = np.random.default_rng([seed, 5])
    beyond = np.zeros(3, int)
    faulty = used = 0
    batch = draw(LEO, rng, 1, sigma_m=SIGMA_LEO_M)
    for number, many in enumerate(chunks(epochs)):
        if number % _RENEWALS == 0 or many != len(batch.epochs):
            batch = draw(LEO, rng, many, sigma_m=SIGMA_LEO_M)
        else:
            renew(batch, rng, sigma_m=SIGMA_LEO_M)
        present = np.arange(SATELLITES) < batch.count[:, None]
        batch.fault[:] = present & (rng.random(present.shape) < COARSE.p_satellite[0])
        size = rng.choice((-1.0, 1.0), present.shape) * np.exp(rng.uniform(np.log(2.0), np.log(50.0), present.shape))
        batch.epochs["range_m"] += np.where(batch.fault, size * SIGMA_LEO_M, 0.0)
        result = judge(batch, COARSE)
        good = usable(result)
        beyond += ((np.abs(errors_m(batch, result)) > result["protection_m"]) & good[:, None]).sum(axis=0)
        faulty += int(batch.fault.any(axis=1).sum())
        used += int(good.sum())
    return {
        "p_hmi": COARSE.p_hmi[0],
        "faulty": faulty,
        "used": used,
        "axes": [rate(int(count), epochs) for count in beyond],
    }


def worst(seed: int, epochs: int) -> list[dict[str, Any]]:
    """One satellite faulty for certain, that which moves the vertical most, at each of SIZES; prior times the rate.

    Allowed is what the level's formula gave the mode before the fault: p_k Q((L - T_k) / sigma_k), mean of the epochs.
    """
    prior = COARSE.p_satellite[0]
    sigmas = math.sqrt(float(build_table(COARSE)["local_threshold"][0]))
    found = []
    for number, size in enumerate(SIZES):
        rng = np.random.default_rng([seed, 6, number])
        beyond = np.zeros(3, int)
        allowed = np.zeros(3)
        for many in chunks(epochs):
            batch = draw(LEO, rng, many, sigma_m=SIGMA_LEO_M)
            clean = judge(batch, COARSE)
            row, apart_m = most_moving(batch, clean)
            deviation = (clean["protection_m"] - sigmas * apart_m) / np.hypot(clean["sigma_m"], apart_m)
            allowed += prior * np.vectorize(normal_tail)(deviation).sum(axis=0) / epochs
            rows = np.arange(many)
            redundancy = np.maximum(clean["redundancy"][rows, row], 1e-3)
            fault = rng.choice((-1.0, 1.0), many) * size * SIGMA_LEO_M / np.sqrt(redundancy)
            batch.epochs["range_m"][rows, row] += fault
            result = judge(batch, COARSE)
            beyond += ((np.abs(errors_m(batch, result)) > result["protection_m"]) & usable(result)[:, None]).sum(axis=0)
        rates = [rate(int(count), epochs) for count in beyond]
        found.append(
            {
                "sigmas": size,
                "prior": prior,
                "allowed": allowed.tolist(),
                "axes": [{**one, "risk": prior * one["rate"], "risk_upper": prior * one["upper"]} for one in rates],
            }
        )
    return found


def normal_tail(z: float) -> float:
    """P(standard normal > z)."""
    return 0.5 * math.erfc(z / math.sqrt(2.0))


def most_moving(batch: Batch, clean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row (m,) whose fault moves the vertical most for the size of its normalised residual, by numpy's own algebra.

    With it (m,3) [m]: 1-sigma of the separation east, north, up of the fix without it.
    """
    answer, apart_m = np.zeros(len(batch.epochs), int), np.zeros((len(batch.epochs), 3))
    for k, epoch in enumerate(batch.epochs):
        n = int(epoch["count"])
        line = batch.truth_m[k] - epoch["r_m"][:n]
        line /= np.linalg.norm(line, axis=1)[:, None]
        clocks = (epoch["constellation"][:n, None] == np.unique(epoch["constellation"][:n])).astype(float)
        gain = np.linalg.pinv(np.concatenate((line @ clean["axes"][k].T, clocks), axis=1))[:3]
        redundancy = clean["redundancy"][k, :n]
        apart = np.where(redundancy > 1e-3, np.abs(gain) / np.sqrt(redundancy + 1e-9), 0.0) * SIGMA_LEO_M
        answer[k] = int(np.argmax(apart[2]))
        apart_m[k] = apart[:, answer[k]]
    return answer, apart_m


def availability(seed: int, epochs: int) -> dict[str, Any]:
    """Share of healthy epochs in LEO with every level below 10 m, at the priors of FINE; levels and errors."""
    rng = np.random.default_rng([seed, 7])
    parts: list[np.ndarray] = []
    errors = []
    for many in chunks(epochs):
        batch = draw(LEO, rng, many, sigma_m=SIGMA_LEO_M)
        result = judge(batch, FINE)
        parts.append(result)
        errors.append(errors_m(batch, result))
    result = np.concatenate(parts).view(RESULT)
    levels = result["protection_m"]
    return {
        "limit_m": FINE.alert_limit_m[0],
        "available": rate(int((result["available"] * usable(result)).sum()), epochs),
        "quantiles_m": np.quantile(levels, (0.5, 0.95, 0.999), axis=0).T.tolist(),
        "errors_m": np.concatenate(errors)[:20_000, 2].round(3).tolist(),
        "levels_m": levels[:20_000, 2].round(3).tolist(),
    }
