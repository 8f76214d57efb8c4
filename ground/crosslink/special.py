"""What ranges cannot show, and what they show badly: rank, common errors, a whole plane, weakest directions."""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import NormalDist
from typing import Any

import numpy as np

from flightsw.crosslink.monitor import monitor_epoch
from flightsw.crosslink.setup import MonitorMemory
from ground.crosslink.judge import judge, mask_of
from ground.crosslink.scene import PERIOD_S, Setting, fill_epoch, ready
from hil_sim.truth.constellation.broadcast import DIRECTIONS, CommonRotation, broadcast
from hil_sim.truth.constellation.crosslinks import Ranging, both, once

_ROTATION_RAD = 1e-5  # 255 m along the orbit, were it one satellite's
_TRANSLATION_M = (300.0, -200.0, 100.0)
_CLOCK_M = 3000.0
_GEOMETRIES = 24
_JUMP_M = 70.0


def cases(setting: Setting, seed: int) -> dict[str, Any]:
    """Figures of all of these, as a document."""
    return {
        "rank": {
            name: _rank(replace(setting, both=both_ways, two_way=two_way))
            for name, both_ways, two_way in (
                ("one way, once", False, False),
                ("one way, both", True, False),
                ("two ways", False, True),
            )
        },
        "common": _common(setting, seed),
        "plane": _plane(setting, seed),
        "certain_jump_m": _certain(setting, seed),
        "known": {
            name: _known(replace(setting, both=both_ways), seed)
            for name, both_ways in (("every pair once", False), ("every pair both ways", True))
        },
    }


def _rank(setting: Setting) -> dict[str, int]:
    memory, pairs = ready(setting, 0.0)
    verdict = memory.verdict[0]
    return {
        "links": len(pairs),
        "rank": int(verdict["rank"]),
        "parameters": int(verdict["parameters"]),
        "undetectable": int(verdict["undetectable"]),
    }


def _common(setting: Setting, seed: int) -> dict[str, float]:
    """Change of the largest statistic by errors that all satellites share, with the same noise."""
    found = {}
    base = _statistics(setting, seed, None)
    for name in ("rotation", "translation", "clock"):
        found[name] = float(np.abs(_statistics(setting, seed, name) - base).max())
    return found


def _statistics(setting: Setting, seed: int, common: str | None) -> np.ndarray:
    rng = np.random.default_rng(seed)
    walker = setting.walker
    memory = MonitorMemory(setting.monitor())
    r, v = walker.states(0.0)
    seen = setting.view.pairs(r)
    errors, _ = setting.errors.draw(walker.total, rng)
    pairs, ranges = Ranging(setting.range_sigma_m, two_way=setting.two_way).measure(
        walker, 0.0, both(seen) if setting.both else once(seen), np.zeros(walker.total), rng
    )
    position, clock = broadcast(r, v, errors)
    said_v = v.copy()
    if common == "rotation":
        turned = CommonRotation(_ROTATION_RAD, (0.3, -0.5, 0.8))
        position = position + turned.displacement_m(0.0, r)
        said_v = v + turned.displacement_m(0.0, v)
    elif common == "translation":
        position = position + np.array(_TRANSLATION_M)
    elif common == "clock":
        clock = clock + _CLOCK_M
    fill_epoch(memory, 0.0, position, said_v, clock, pairs, ranges)
    monitor_epoch(*memory.arguments())
    return np.array(memory.network["statistic"][0, : walker.total])


def _plane(setting: Setting, seed: int) -> list[dict[str, Any]]:
    """A plane whose satellites are all wrong alike: how often anything is found, and exactly it."""
    rng = np.random.default_rng(seed)
    walker = setting.walker
    members = np.flatnonzero(walker.plane == 0)
    sigma = np.tile(setting.errors.sigma_m, walker.total)
    rows = []
    for direction, name in enumerate(DIRECTIONS):
        found, exact, trials = 0, 0, 0
        for _ in range(_GEOMETRIES):
            memory, pairs = ready(setting, float(rng.uniform(0.0, PERIOD_S)))
            errors = rng.standard_normal((20, len(sigma))) * sigma
            errors[:, 4 * members + direction] += 70.0
            judged = judge(memory, errors, setting.range_sigma_m * rng.standard_normal((20, len(pairs))))
            found += int((judged["named"] != 0).sum())
            exact += int((judged["named"] == mask_of(members)).sum())
            trials += len(judged)
        rows.append(
            {"case": f"plane, {name} 70 m each", "trials": trials, "found": found / trials, "exact": exact / trials}
        )
    return rows


def _certain(setting: Setting, seed: int) -> dict[str, dict[str, float]]:
    """Jump [m] found and named in one epoch with 0.999, by direction: median and largest over satellites, geometries.

    From the information M of a satellite: noncentrality of a jump of 1 m is M's diagonal element.
    """
    rng = np.random.default_rng(seed)
    jumps: dict[str, list[float]] = {name: [] for name in DIRECTIONS}
    own: dict[str, list[float]] = {name: [] for name in DIRECTIONS}
    for _ in range(_GEOMETRIES):
        memory, _ = ready(setting, float(rng.uniform(0.0, PERIOD_S)))
        wanted = float(memory.table["certain_noncentrality"][0])
        diagonal = np.array(memory.network["diagonal"][0])
        mine = np.array(memory.own["diagonal"][0])
        for k, name in enumerate(DIRECTIONS):
            for satellite in range(setting.walker.total):
                if diagonal[4 * satellite + k] > 0.0:
                    jumps[name].append(math.sqrt(wanted / diagonal[4 * satellite + k]))
            if mine[k] > 0.0:
                own[name].append(math.sqrt(wanted / mine[k]))
    return {
        name: {
            "median": float(np.median(jumps[name])),
            "largest": float(np.max(jumps[name])),
            "own_median": float(np.median(own[name])),
        }
        for name in DIRECTIONS
        if jumps[name]
    }


def _known(setting: Setting, seed: int) -> dict[str, dict[str, float]]:
    """What no test of one epoch can better: jumps of 70 m found by one that knows satellite, direction and sign.

    The matched filter is the most powerful test at its false-alarm rate (Neyman and Pearson), here a satellite's share
    of that of the constellation. Mean and least over satellites and geometries.
    """
    rng = np.random.default_rng(seed)
    shares: dict[str, list[float]] = {name: [] for name in DIRECTIONS}
    limit = NormalDist().inv_cdf(1.0 - setting.p_false_alarm / setting.walker.total)
    for _ in range(_GEOMETRIES):
        memory, _ = ready(setting, float(rng.uniform(0.0, PERIOD_S)))
        information = np.array(memory.network["diagonal"][0])
        for k, name in enumerate(DIRECTIONS):
            for satellite in range(setting.walker.total):
                length = _JUMP_M * math.sqrt(information[4 * satellite + k])
                shares[name].append(NormalDist().cdf(length - limit))
    return {name: {"mean": float(np.mean(one)), "least": float(np.min(one))} for name, one in shares.items()}
