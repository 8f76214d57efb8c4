"""Random streams of a campaign, keyed by the number of a run: whoever flies it, in whatever order, draws the same.

Tuning and certification draw from roots that cannot meet. The root of a certification is a hash of the table image
that tuning has made, of the ensemble and of the number of the attempt, with its highest bit set; a root of tuning is a
number of the operator below 2^63. They branch differently, besides.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

TUNING, CERTIFICATION = 1, 2
_RUN, _CELL = 0, 1
_CERTIFICATION_BIT = 1 << 256


@dataclass(frozen=True)
class Seeds:
    """A root and its branch; obtain it from `tuning` or `certification`."""

    entropy: int
    branch: int

    def of_run(self, run: int) -> np.random.SeedSequence:
        """What a run draws from."""
        return np.random.SeedSequence(self.entropy, spawn_key=(self.branch, _RUN, run))

    def of_cell(self, cell: int) -> np.random.SeedSequence:
        """What is drawn once for all runs of a cell: the order of its days."""
        return np.random.SeedSequence(self.entropy, spawn_key=(self.branch, _CELL, cell))

    def document(self) -> dict[str, Any]:
        """For files: the root in hexadecimal, the branch."""
        return {"root": f"{self.entropy:x}", "branch": self.branch}


def tuning(seed: int) -> Seeds:
    """Root of an ensemble for tuning and studies; ValueError for a seed outside 0 to 2^63 - 1."""
    if not 0 <= seed < 1 << 63:
        raise ValueError(f"seed {seed}: give 0 to 2^63 - 1")
    return Seeds(seed, TUNING)


def certification(table_image: bytes, ensemble: Mapping[str, Any], attempt: int) -> Seeds:
    """Root of a certification: image of the navigation table, definition of the ensemble, attempt from 1 on."""
    if attempt < 1:
        raise ValueError(f"attempt {attempt}: attempts count from 1")
    digest = hashlib.sha256()
    for part in (table_image, json.dumps(ensemble, sort_keys=True).encode(), str(attempt).encode()):
        digest.update(len(part).to_bytes(8, "big") + part)
    return Seeds(int.from_bytes(digest.digest(), "big") | _CERTIFICATION_BIT, CERTIFICATION)
