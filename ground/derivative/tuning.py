"""Settings for the paper's scenario, sought on seeds that no report uses, by random descent of the worst share."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from flightsw.derivative.setup import BankSettings, LagSettings, Model
from ground.derivative import scenario, tracks

# velocity straight, yawing [m/s], acceleration straight, yawing [m/s^2]
CAUSAL_LIMITS = (0.019, 0.065, 0.003, 0.010)
SMOOTHED_LIMITS = (0.010, 0.010, 0.010, 0.010)
LAG_S = 30.0
_WIDTH = 0.7  # of a trial step, in natural logarithms
_STAY_S = 1000.0  # a longer mean stay would say that this track never turns again
_SEARCH = 1 << 32  # the streams of the search itself


def _bank(words: np.ndarray, order: int) -> BankSettings:
    """q of quiet, turning, jumping; their stays; the weight with which the jump is entered."""
    q, stay, enter = np.exp(words[:3]).tolist(), np.exp(words[3:6]).tolist(), math.exp(words[6])
    return BankSettings(
        (Model(2, q[0], stay[0]), Model(order, q[1], stay[1]), Model(2, q[2], stay[2], enter)),
    )


def shares(settings: BankSettings | LagSettings, seed: int, runs: int) -> np.ndarray:
    """RMS figures over their limits (4,), pooled over tuning runs."""
    true = scenario.truth()
    causal = isinstance(settings, BankSettings)
    total = np.zeros(4)
    for run in range(runs):
        z = (true.y_m + scenario.errors(scenario.tuning_stream(seed, run), len(true.t_s)))[:, None]
        if isinstance(settings, BankSettings):
            track = tracks.causal(settings, true.t_s, z, np.ones_like(z))
        else:
            track = tracks.smoothed(settings, true.t_s, z, np.ones_like(z))
        found = scenario.judge(track.mean[:, 0], 0.0 if causal else LAG_S)
        total += np.square(found[:4])
    return np.asarray(np.sqrt(total / runs) / (CAUSAL_LIMITS if causal else SMOOTHED_LIMITS))


def tune(seed: int, runs: int, trials: int, advance: Callable[[int], None]) -> tuple[BankSettings, np.ndarray]:
    """Best bank found and its shares. advance is told of every trial."""
    rng = np.random.default_rng(scenario.tuning_stream(seed, _SEARCH))
    order = 5
    best = np.log([1e-9, 1e-9, 1.0, 300.0, 300.0, 2.0, 0.1])
    found = shares(_bank(best, order), seed, runs)
    for _ in range(trials):
        words = best + _WIDTH * rng.standard_normal(len(best)) * (rng.random(len(best)) < 0.4)
        words[3:5] = np.minimum(words[3:5], math.log(_STAY_S))
        new = order if rng.random() < 0.85 else int(rng.integers(3, 7))
        rivals = shares(_bank(words, new), seed, runs)
        if max(rivals) < max(found):
            best, order, found = words, new, rivals
        advance(1)
    return _bank(best, order), found
