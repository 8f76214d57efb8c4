"""Cells of a certification: bands of altitude by solar flux, and the real days that belong to each."""

from __future__ import annotations

import csv
import math
from datetime import date, timedelta
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_schema import FORCES
from ground.errors import OperatorError
from ground.tables.forces import packaged_space_weather

ALTITUDE_BANDS_KM = ((350.0, 450.0), (450.0, 600.0), (600.0, 900.0), (900.0, 1400.0))
F107_RANGES_SFU = ((0.0, 100.0), (100.0, 170.0), (170.0, math.inf))
# Days of the ensembles: measured space weather and Earth orientation, a solar cycle and a half and more.
FIRST_DAY, LAST_DAY = date(1996, 1, 1), date(2025, 6, 30)
_MEAN_DAYS = 81  # three solar rotations, backwards
# A reading in the middle of a flare (655 sfu once) says nothing of the atmosphere, and the force table refuses it.
_HIGHEST_SFU = next(field.maximum for field in FORCES.fields if field.name == "f107")


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
    """Every day of the ensembles with measured values, rising. Raises OperatorError where the file lacks them."""
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
    found = []
    for k in range((LAST_DAY - FIRST_DAY).days + 1):
        day = FIRST_DAY + timedelta(days=k)
        before = [flux[d] for back in range(1, _MEAN_DAYS + 1) if (d := day - timedelta(days=back)) in flux]
        # the truth reads the days around, too: all of them must be there
        if day not in ap or day + timedelta(days=2) not in flux or len(before) < _MEAN_DAYS:
            continue
        if flux[day - timedelta(days=1)] <= _HIGHEST_SFU:
            found.append(Weather(day, flux[day - timedelta(days=1)], sum(before) / len(before), ap[day]))
    if not found:
        raise OperatorError(f"{path}: no measured days between {FIRST_DAY} and {LAST_DAY}; install satkit-data anew")
    return tuple(found)


@lru_cache(maxsize=len(F107_RANGES_SFU))
def days_of(f107_sfu: tuple[float, float]) -> tuple[Weather, ...]:
    """The days whose F10.7 of the day before, which is what flight is told, lies in the range."""
    return tuple(day for day in weather() if f107_sfu[0] <= day.f107 < f107_sfu[1])


def permuted(count: int, sequence: np.random.SeedSequence) -> np.ndarray:
    """A permutation (count,) of 0 to count - 1."""
    return np.random.default_rng(sequence).permutation(count)
