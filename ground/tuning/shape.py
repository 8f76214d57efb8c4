"""Whether a bound has the shape of the errors: the same number of sigmas at every altitude and every age.

k is one number. Where errors are fewer sigmas than elsewhere, the bound is loose by just as much; process noise that is
wrong with altitude or age costs tightness which no k brings back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ground.campaign.cells import ALTITUDE_BANDS_KM, CELLS
from ground.campaign.certificate import AGE_BINS_S
from ground.campaign.ensemble import Ensemble
from ground.campaign.outage import Arrays, ages_s

# settings of the flight filter that are tried, dearest in tightness first
NOISES = (
    "flight_filter.empirical_sigma_mps2",
    "flight_filter.omitted_gravity_sigma_mps2",
    "flight_filter.drag_sigma",
    "flight_filter.drag_slow_sigma",
)
_SUBSETS = 10
_LEAST_GAIN = 0.02


class Shape(NamedTuple):
    """sigmas (bands, bins): rms of error / sigma of the largest axis, NaN for what was not flown; loss: mean logarithm
    of the largest over each, what the bound is too loose by for its shape; parts (10,): the loss with a tenth of the
    outages left out."""

    sigmas: np.ndarray
    loss: float
    parts: np.ndarray

    @property
    def sigma(self) -> float:
        """Of the loss, by the jackknife."""
        n = len(self.parts)
        return float(np.sqrt((n - 1) / n * np.sum((self.parts - self.parts.mean()) ** 2)))


def shape(figures: Arrays, ensemble: Ensemble) -> Shape:
    """The shape of an ensemble's bound."""
    every = np.arange(len(figures["run"]))
    sigmas = _sigmas(figures, ensemble, figures["started"])
    # cells come in turn: parts take whole rounds of them
    part = every // len(ensemble.cells) % _SUBSETS
    parts = [_loss(_sigmas(figures, ensemble, figures["started"] & (part != k))) for k in range(_SUBSETS)]
    return Shape(sigmas, _loss(sigmas), np.array(parts))


def better(one: Shape, other: Shape) -> bool:
    """Whether the first loses less, by more than chance: the same outages, so differences of the parts are paired."""
    n = len(one.parts)
    difference = one.parts - other.parts
    sigma = float(np.sqrt((n - 1) / n * np.sum((difference - difference.mean()) ** 2)))
    return one.loss < other.loss - max(_LEAST_GAIN, 2.0 * sigma)


def _sigmas(figures: Arrays, ensemble: Ensemble, rows: np.ndarray) -> np.ndarray:
    ages = ages_s(ensemble.outage_s[1])
    with np.errstate(invalid="ignore"):
        ratio = np.abs(figures["error_m"]).max(axis=2) / figures["sigma_m"].max(axis=2)
    found = np.full((len(ALTITUDE_BANDS_KM), len(AGE_BINS_S)), np.nan)
    for i, band in enumerate(ALTITUDE_BANDS_KM):
        inside = rows & np.isin(figures["cell"], [k for k, cell in enumerate(CELLS) if cell.altitude_km == band])
        for j, (low, high) in enumerate(AGE_BINS_S):
            values = ratio[inside][:, (ages >= low) & (ages < high)]
            values = values[np.isfinite(values)]
            if len(values):
                found[i, j] = np.sqrt(np.mean(values**2))
    return found


def _loss(sigmas: np.ndarray) -> float:
    known = sigmas[np.isfinite(sigmas)]
    return float(np.mean(np.log(known.max() / known))) if len(known) else float("nan")
