"""Cells of a certification: bands of altitude by solar flux, and the real days that belong to each."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from datetime import date, timedelta
from functools import lru_cache
from statistics import median
from typing import NamedTuple

import numpy as np

from ground.errors import OperatorError
from ground.tables.forces import packaged_space_weather

ALTITUDE_BANDS_KM = ((350.0, 450.0), (450.0, 600.0), (600.0, 900.0), (900.0, 1400.0))
F107_RANGES_SFU = ((0.0, 100.0), (100.0, 170.0), (170.0, math.inf))
# Days of the ensembles: measured space weather and Earth orientation, a solar cycle and a half and more.
FIRST_DAY, LAST_DAY = date(1996, 1, 1), date(2025, 6, 30)
_MEAN_DAYS = 81  # three solar rotations, backwards
# A radio burst at the hour of the reading (939 sfu once, between 143 and 167) heats no atmosphere, but the truth's
# density model believes it. Bursts last a day at most; the sun's rotation changes a week's flux by less than this.
_BURST = 1.35  # over the median of the week around
_REACH_DAYS = (-1, 0, 1, 2)  # of the readings that the truth and flight take on a day


class Cell(NamedTuple):
    """A band of perigee altitude [km] by a range of F10.7 [sfu], each from .. to below."""

    altitude_km: tuple[float, float]
    f107_sfu: tuple[float, float]

    @property
    def label(self) -> str:
        """`350-450 km, F10.7 < 100`."""
        low, high = self.f107_sfu
        flux = f"< {high:g}" if low == 0.0 else f">= {low:g}" if math.isinf(high) else f"{low:g}-{high:g}"
        return f"{self.altitude_label}, F10.7 {flux}"

    @property
    def altitude_label(self) -> str:
        """`350-450 km`."""
        return f"{self.altitude_km[0]:g}-{self.altitude_km[1]:g} km"


CELLS = tuple(Cell(band, flux) for band in ALTITUDE_BANDS_KM for flux in F107_RANGES_SFU)


class Weather(NamedTuple):
    """Space weather as flight's force table knows it on a day: F10.7 of the day before, its mean, ap of the day."""

    day: date
    f107: float
    f107_mean: float
    ap: float


@lru_cache(maxsize=1)
def weather() -> tuple[Weather, ...]:
    """Every day of the ensembles with measured values and no radio burst near, rising.

    Raises OperatorError where the file has none.
    """
    path = packaged_space_weather()
    flux: dict[date, float] = {}
    ap: dict[date, float] = {}
    try:
        with path.open(encoding="ascii", errors="replace", newline="") as lines:
            for row in csv.DictReader(lines):
                if row["F10.7_DATA_TYPE"] in ("OBS", "INT"):
                    at = date.fromisoformat(row["DATE"])
                    flux[at], ap[at] = float(row["F10.7_OBS"]), float(row["AP_AVG"])
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise OperatorError(f"{path}: not CelesTrak's SW-All.csv: {error}; install satkit-data anew") from None
    bursts = bursts_of(flux)
    found = []
    for k in range((LAST_DAY - FIRST_DAY).days + 1):
        day = FIRST_DAY + timedelta(days=k)
        before = [flux[d] for back in range(1, _MEAN_DAYS + 1) if (d := day - timedelta(days=back)) in flux]
        read = [day + timedelta(days=days) for days in _REACH_DAYS]
        if day not in ap or len(before) < _MEAN_DAYS or not all(d in flux and d not in bursts for d in read):
            continue
        found.append(Weather(day, flux[day - timedelta(days=1)], sum(before) / len(before), ap[day]))
    if not found:
        raise OperatorError(f"{path}: no measured days between {FIRST_DAY} and {LAST_DAY}; install satkit-data anew")
    return tuple(found)


def bursts_of(flux: Mapping[date, float]) -> frozenset[date]:
    """The days whose flux [sfu] a radio burst has spoilt: far above the median of the week around."""
    found = set()
    for day, value in flux.items():
        week = [flux[d] for days in range(-3, 4) if (d := day + timedelta(days=days)) in flux]
        if value > _BURST * median(week):
            found.add(day)
    return frozenset(found)


@lru_cache(maxsize=len(F107_RANGES_SFU))
def days_of(f107_sfu: tuple[float, float]) -> tuple[Weather, ...]:
    """The days whose F10.7 of the day before, which is what flight is told, lies in the range."""
    return tuple(day for day in weather() if f107_sfu[0] <= day.f107 < f107_sfu[1])


def permuted(count: int, sequence: np.random.SeedSequence) -> np.ndarray:
    """A permutation (count,) of 0 to count - 1."""
    return np.random.default_rng(sequence).permutation(count)
