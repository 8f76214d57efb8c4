"""Many uploads of ephemerides, healthy and faulty, each judged in one epoch by all three monitors.

A run is one geometry, at a random instant of the orbit, seen from one random satellite: `healthy` uploads without a
fault, and for every case of CASES `faulty` uploads in which that satellite, or several, broadcast it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flightsw.crosslink.own import FAULT, SUSPECT
from ground.campaign import store
from ground.campaign.seeds import Seeds, tuning
from ground.crosslink.judge import Judge, mask_of
from ground.crosslink.scene import PERIOD_S, Setting, ready
from hil_sim.truth.constellation.broadcast import DIRECTIONS

BATCH = 1000  # what stays in the processor's cache
BIN = 0.5
BINS = 200  # of the histograms of statistics

Arrays = dict[str, np.ndarray]


class Case(NamedTuple):
    """A jump: of one satellite in one direction, or, with direction -1, of several, each in a random one."""

    direction: int
    jump_m: float
    satellites: int = 1

    @property
    def name(self) -> str:
        """For tables."""
        if self.direction >= 0:
            return f"{DIRECTIONS[self.direction]} {self.jump_m:g} m"
        return f"{self.satellites} satellites, {self.jump_m:g} m each"


JUMPS_M = (20.0, 30.0, 40.0, 50.0, 70.0, 300.0, 700.0)
CASES = (
    *(Case(direction, jump) for jump in JUMPS_M for direction in range(4)),
    *(Case(-1, jump, count) for count in (2, 3, 4) for jump in (70.0, 300.0)),
)


@dataclass(frozen=True)
class Uploads:
    """What is drawn, and from which seeds; picklable."""

    setting: Setting = field(default_factory=lambda: Setting(both=True))
    seeds: Seeds = field(default_factory=lambda: tuning(1))
    healthy: int = 50_000
    faulty: int = 200


def work(uploads: Uploads, first: int, last: int) -> Arrays:
    """Figures of runs first to last, stacked; for the campaign's executor."""
    return store.stacked(one(uploads, run) for run in range(first, last + 1))


def one(uploads: Uploads, run: int) -> Arrays:
    """Counts of one run. c cases, b bins.

    healthy, majority_false, own_false, network_false: uploads, and those flagged (anyone's, own, anyone's)
    link_beyond: uploads in which a link of the own satellite exceeds the paper's threshold
    network_histogram, own_histogram (b,): statistics of healthy uploads, bins of BIN
    dof: of the own satellite's statistic
    faulty (c,), majority, named, exact, own_fault, own_suspect (c,): uploads of each case, and how they were judged
    """
    setting = uploads.setting
    rng = np.random.default_rng(uploads.seeds.of_run(run))
    t_s = float(rng.uniform(0.0, PERIOD_S))
    satellites = setting.walker.total
    own = int(rng.integers(satellites))
    memory, pairs = ready(setting, t_s, own)
    judge = Judge(memory).judge
    sigma = np.tile(setting.errors.sigma_m, satellites)
    counts = dict.fromkeys(("healthy", "majority_false", "own_false", "network_false", "link_beyond"), 0)
    network, mine = np.zeros(BINS, np.int64), np.zeros(BINS, np.int64)
    while counts["healthy"] < uploads.healthy:
        k = min(BATCH, uploads.healthy - counts["healthy"])
        judged = judge(*_draw(rng, k, sigma, setting.range_sigma_m, len(pairs)))
        counts["healthy"] += k
        counts["majority_false"] += int((judged["beyond"] != 0).sum())
        counts["network_false"] += int((judged["named"] != 0).sum())
        counts["own_false"] += int(np.isin(judged["own"], (SUSPECT, FAULT)).sum())
        counts["link_beyond"] += int((judged["largest_m"] > memory.table["majority_threshold_m"][0]).sum())
        network += _histogram(judged["statistic"])
        mine += _histogram(judged["own_statistic"])
    found = np.zeros((6, len(CASES)), np.int64)
    for index, case in enumerate(CASES):
        errors, noise = _draw(rng, uploads.faulty, sigma, setting.range_sigma_m, len(pairs))
        masks = _inject(rng, case, errors, own, satellites)
        judged = judge(errors, noise)
        found[:, index] = (
            len(judged),
            ((judged["beyond"] >> own) & 1).sum(),
            ((judged["named"] & masks) == masks).sum(),
            (judged["named"] == masks).sum(),
            (judged["own"] == FAULT).sum(),
            (judged["own"] == SUSPECT).sum(),
        )
    names = ("faulty", "majority", "named", "exact", "own_fault", "own_suspect")
    return {
        "t_s": np.array(t_s),
        "own": np.array(own),
        "links": np.array(len(pairs)),
        "dof": np.array(int(memory.own["dof"][0, 0])),
        **{name: np.array(value) for name, value in counts.items()},
        "network_histogram": network,
        "own_histogram": mine,
        **dict(zip(names, found, strict=True)),
    }


def _draw(
    rng: np.random.Generator, k: int, sigma_m: np.ndarray, range_sigma_m: float, links: int
) -> tuple[np.ndarray, np.ndarray]:
    drawn = rng.standard_normal((k, len(sigma_m))) * sigma_m
    return drawn, range_sigma_m * rng.standard_normal((k, links))


def _inject(rng: np.random.Generator, case: Case, errors: np.ndarray, own: int, satellites: int) -> np.ndarray:
    """Add a case to errors (k, 4n) in place; bit masks (k,) of the faulty satellites."""
    masks = np.zeros(len(errors), np.int64)
    for row in range(len(errors)):
        if case.direction >= 0:
            errors[row, 4 * own + case.direction] += case.jump_m
            masks[row] = 1 << own
            continue
        chosen = rng.choice(satellites, case.satellites, replace=False)
        for satellite in chosen:
            errors[row, 4 * satellite + rng.integers(4)] += case.jump_m
        masks[row] = mask_of(chosen)
    return masks


def _histogram(values: np.ndarray) -> np.ndarray:
    return np.bincount(np.clip((values / BIN).astype(int), 0, BINS - 1), minlength=BINS)
