"""Receiver operating characteristics: detection against false alarms, whatever the threshold, of the three monitors.

The own and the network statistic have known tails, so that their false-alarm rate is exact for any threshold (the
network's: the sum over satellites, a bound). The paper's rule flags at the middle of the ordered |dR|: its rate is
counted on healthy uploads, and ends where counting ends.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flightsw.crosslink.thresholds import chi2_quantile
from ground.campaign.seeds import tuning
from ground.crosslink.judge import Judge
from ground.crosslink.scene import PERIOD_S, Setting, ready
from hil_sim.truth.constellation.broadcast import DIRECTIONS

RATES = tuple(10.0**-k for k in range(1, 11))
JUMPS_M = (20.0, 30.0, 40.0, 50.0, 70.0)
_UPLOADS = 2000
_HEALTHY = 20_000


def curves(setting: Setting, seed: int, geometries: int) -> dict[str, Any]:
    """Detection (jump, direction, rate) of network, own and majority; None where the rate cannot be counted."""
    found = np.zeros((3, len(JUMPS_M), 4, len(RATES)))
    seeds = tuning(seed + 77)
    healthy_middles = []
    draws = []
    sigma = np.tile(setting.errors.sigma_m, setting.walker.total)
    for geometry in range(geometries):
        rng = np.random.default_rng(seeds.of_run(geometry))
        own = int(rng.integers(setting.walker.total))
        memory, pairs = ready(setting, float(rng.uniform(0.0, PERIOD_S)), own)
        h = np.array(memory.network["h"][0])[: len(pairs)]
        mine = np.flatnonzero(pairs[:, 0] == own) if setting.both else np.flatnonzero((pairs == own).any(axis=1))
        errors, noise = _draw(rng, _HEALTHY, sigma, setting.range_sigma_m, len(pairs))
        healthy_middles.append(_middle(errors, noise, h, pairs, mine))
        draws.append((rng, own, memory, pairs, h, mine))
    healthy = np.sort(np.concatenate(healthy_middles))
    dof4 = np.array([chi2_quantile(rate, 4) for rate in RATES])
    share = np.array([chi2_quantile(rate / setting.walker.total, 4) for rate in RATES])
    counted = [rate * len(healthy) >= 5.0 for rate in RATES]
    middle = np.array([healthy[min(int(np.ceil((1.0 - rate) * len(healthy))), len(healthy) - 1)] for rate in RATES])
    for rng, own, memory, pairs, h, mine in draws:
        judge = Judge(memory).judge
        for a, jump in enumerate(JUMPS_M):
            for direction in range(4):
                errors, noise = _draw(rng, _UPLOADS, sigma, setting.range_sigma_m, len(pairs))
                errors[:, 4 * own + direction] += jump
                judged = judge(errors, noise)
                found[0, a, direction] += (judged["statistic"][:, None] > share).mean(axis=0) / geometries
                found[1, a, direction] += (judged["own_statistic"][:, None] > dof4).mean(axis=0) / geometries
                values = _middle(errors, noise, h, pairs, mine)
                found[2, a, direction] += (values[:, None] > middle).mean(axis=0) / geometries
    return {
        "rates": list(RATES),
        "jumps_m": list(JUMPS_M),
        "directions": list(DIRECTIONS),
        "network": found[0].tolist(),
        "own": found[1].tolist(),
        "majority": [
            [[value if known else None for value, known in zip(row, counted, strict=True)] for row in rows]
            for rows in found[2].tolist()
        ],
        "majority_thresholds_m": middle.tolist(),
    }


def _draw(
    rng: np.random.Generator, k: int, sigma: np.ndarray, range_sigma_m: float, links: int
) -> tuple[np.ndarray, np.ndarray]:
    return rng.standard_normal((k, len(sigma))) * sigma, range_sigma_m * rng.standard_normal((k, links))


def _middle(errors: np.ndarray, noise: np.ndarray, h: np.ndarray, pairs: np.ndarray, mine: np.ndarray) -> np.ndarray:
    """The |dR| (k,) at which a strict majority of the own links begins."""
    shaped = errors.reshape(len(errors), -1, 4)
    dr = noise[:, mine].copy()
    for end in range(2):
        dr += np.einsum("klj,lj->kl", shaped[:, pairs[mine, end]], h[mine, end])
    ordered = np.sort(np.abs(dr), axis=1)
    return ordered[:, len(mine) - (len(mine) // 2 + 1)]
