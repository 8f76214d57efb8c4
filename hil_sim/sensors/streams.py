"""Independent random streams, one per purpose, from one seed (numpy SeedSequence.spawn).

Every stream draws for every epoch of the run, used or not: an outage or a fault added to a scenario leaves the
noise of all other epochs as it was.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

WORLD_BRANCH = 0  # other branches of the same seed are free for ensembles and certification


class Streams(NamedTuple):
    """Generators by purpose. New ones are added at the end: the order is part of reproducibility."""

    position_noise: np.random.Generator
    velocity_noise: np.random.Generator
    coloured_noise: np.random.Generator
    dropouts: np.random.Generator
    oscillator: np.random.Generator
    pulse_jitter: np.random.Generator
    faults: np.random.SeedSequence
    burns: np.random.Generator
    periodic_error: np.random.Generator
    attitude: np.random.Generator
    crosslinks: np.random.Generator
    pseudoranges: np.random.Generator


def open_streams(seed: int) -> Streams:
    """Streams of one run."""
    root = np.random.SeedSequence(seed, spawn_key=(WORLD_BRANCH,))
    seeds = dict(zip(Streams._fields, root.spawn(len(Streams._fields)), strict=True))
    generators = {name: np.random.default_rng(seed) for name, seed in seeds.items() if name != "faults"}
    return Streams(**generators, faults=seeds["faults"])
