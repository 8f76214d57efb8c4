"""Runs of a finished campaign flown again: does this software compute what was certified?

A certificate names the code that flew. Flight's stimulus says of a hundred steps whether the present code answers as
that one did; this says it of whole runs, by the figures that the certificate was made of.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ground.campaign import certify, endurance, executor
from ground.campaign.ensemble import Ensemble
from ground.errors import OperatorError

TOLERANCE = 1e-6  # figures are kept in single precision


class Difference(NamedTuple):
    """A figure that is not what it was: in how many runs, and the largest difference, by its size or by one."""

    name: str
    runs: int
    largest: float


class Again(NamedTuple):
    """Runs flown again, and what of them differs; nothing: the same to TOLERANCE."""

    runs: tuple[int, ...]
    differences: list[Difference]


def fly_again(
    folder: Path,
    table_set: str,
    ensemble: Ensemble,
    runs: int,
    count: int,
    long: bool,
    quick: bool,
    advance: Callable[[int], None],
) -> Again:
    """Fly `count` runs of the campaign in a folder again, evenly spaced, and compare; nothing is written.

    runs: how many the campaign has. Raises OperatorError where it is not that campaign, or not finished.
    """
    if count > runs:
        raise OperatorError(f"{folder}: has {runs} runs; fly at most as many again")
    flight, held = certify.finished(folder, table_set, ensemble, runs, long, quick)
    work = endurance.fly_chunk if long else executor.fly_chunk
    if long:
        flight = endurance.flight_of(flight)
    executor.warm_up()
    numbers = tuple(int(number) for number in np.linspace(0, runs - 1, count))
    largest: dict[str, list[float]] = {name: [] for name in held}
    for number in numbers:
        now = work(flight, number, number)
        for name, values in held.items():
            largest[name].append(_difference(values[number], now[name][0] if name in now else np.asarray(np.nan)))
        advance(1)
    found = [
        Difference(name, sum(one > TOLERANCE for one in by_run), max(by_run))
        for name, by_run in largest.items()
        if max(by_run) > TOLERANCE
    ]
    return Again(numbers, found)


def _difference(then: np.ndarray, now: np.ndarray) -> float:
    """Largest difference of two figures of a run, by their size or by one; infinite where one is not a number."""
    one, other = np.asarray(then, float), np.asarray(now, float)
    if one.shape != other.shape:
        return float("inf")
    same = (one == other) | (np.isnan(one) & np.isnan(other))
    with np.errstate(invalid="ignore"):
        off = np.abs(one - other) / np.maximum(np.abs(one), 1.0)
    off = np.where(same, 0.0, np.where(np.isnan(off), np.inf, off))
    return float(off.max()) if off.size else 0.0
