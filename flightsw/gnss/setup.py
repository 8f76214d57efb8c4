"""A consistency test made ready: its table from wanted false-alarm rates, budgets and fault priors; its memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flightsw.crosslink.thresholds import chi2_quantile, normal_quantile
from flightsw.gnss.records import (
    CONSTELLATIONS,
    EPOCH,
    EXCLUDED,
    GNSS_TABLE,
    RESULT,
    SATELLITES,
    WORK,
    Consistency,
    Rule,
)

EARTH_RATE_RADPS = 7.2921151467e-5  # IS-GPS-200
_L1_MHZ = 1575.42
# of the civil signals on the first frequency; GLONASS in the middle of its channels
_FIRST_MHZ = (_L1_MHZ, 1602.0, _L1_MHZ, 1561.098)


@dataclass(frozen=True)
class Settings:
    """What a test is built from.

    alpha: false alarms per epoch of the test of all residuals together. local_alpha: of the largest normalised
    residual, over all satellites; 0: no such test. sigma_factor: bound of the unit-weight standard deviation.
    isolate_odds: 2 ln of the odds against one more fault, once an epoch is inconsistent; further: how many exclusions
    beyond the fewest are weighed. ambiguity: 2 ln of the odds below which two explanations are not told apart (4.6: ten
    to one). p_satellite, p_constellation: fault priors per epoch, by constellation; p_hmi: allowed east, north, up.
    iono_share: of Klobuchar's vertical delay that is above a receiver of one frequency; 0: no correction; iono_layer_m:
    how far above it the layer is; iono_error, iono_floor_m: 1-sigma of the delay as a share, and besides.
    """

    rule: Rule = Rule.PROBABLE
    test: Consistency = Consistency.CHI_SQUARE
    alpha: float = 5e-4
    local_alpha: float = 5e-4
    sigma_factor: float = 1.0
    faulty_max: int = 7
    candidates_max: int = 20_000
    isolate_odds: float = 7.0
    further: int = 2
    ambiguity: float = 4.6
    earth_rate_radps: float = EARTH_RATE_RADPS
    protect: bool = False
    p_satellite: tuple[float, ...] = (1e-5, 1e-5, 1e-5, 1e-5)
    p_constellation: tuple[float, ...] = (1e-8, 1e-5, 1e-5, 1e-5)
    p_hmi: tuple[float, float, float] = (1e-7, 1e-7, 1e-7)
    p_unmonitored: float = 0.7
    bias_m: float = 0.0
    alert_limit_m: tuple[float, float, float] = (10.0, 10.0, 10.0)
    ephemeris_age_max_s: float = 60.0
    signal_sigma_m: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    iono_share: float = 0.0
    iono_layer_m: float = 300_000.0
    iono_error: float = 0.5
    iono_floor_m: float = 0.0
    iono_alpha: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    iono_beta: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Raises ValueError, naming the setting, for what no test can be built from."""
        for name, bad in (
            ("alpha", not 0.0 < self.alpha < 1.0),
            ("local_alpha", not 0.0 <= self.local_alpha < 1.0),
            ("sigma_factor", not 0.0 < self.sigma_factor < 1e6),
            ("faulty_max", not 0 <= self.faulty_max <= EXCLUDED),
            ("candidates_max", not 0 <= self.candidates_max < 1 << 40),
            ("isolate_odds", not abs(self.isolate_odds) < 1e3),
            ("further", not 0 <= self.further <= EXCLUDED),
            ("ambiguity", not self.ambiguity >= 0.0),
            ("earth_rate_radps", not abs(self.earth_rate_radps) < 1e-3),
            ("p_satellite", not _priors(self.p_satellite)),
            ("p_constellation", not _priors(self.p_constellation)),
            ("p_hmi", len(self.p_hmi) != 3 or not all(0.0 < p < 1.0 for p in self.p_hmi)),
            ("p_unmonitored", not 0.0 <= self.p_unmonitored <= 1.0),
            ("bias_m", not 0.0 <= self.bias_m < 1e3),
            ("ephemeris_age_max_s", not 0.0 < self.ephemeris_age_max_s <= 600.0),
            ("signal_sigma_m", len(self.signal_sigma_m) != CONSTELLATIONS or not min(self.signal_sigma_m) >= 0.0),
            ("iono_share", not 0.0 <= self.iono_share <= 1.0),
            ("iono_layer_m", not 1e3 <= self.iono_layer_m <= 1e7),
            ("iono_error", not 0.0 <= self.iono_error <= 10.0),
            ("iono_floor_m", not 0.0 <= self.iono_floor_m < 1e3),
            ("iono_alpha", len(self.iono_alpha) != 4 or not all(abs(a) < 1e-3 for a in self.iono_alpha)),
            ("iono_beta", len(self.iono_beta) != 4 or not all(abs(b) < 1e9 for b in self.iono_beta)),
            ("alert_limit_m", len(self.alert_limit_m) != 3 or not all(a > 0.0 for a in self.alert_limit_m)),
        ):
            if bad:
                raise ValueError(f"GNSS consistency test: {name} = {getattr(self, name)} is out of its range")


def _priors(values: tuple[float, ...]) -> bool:
    return len(values) == CONSTELLATIONS and all(0.0 <= value < 0.5 for value in values)


def thresholds(settings: Settings) -> list[float]:
    """Of RSS by degrees of freedom 0 (never exceeded) to SATELLITES: chi-square, Markov's inequality, or no test."""
    if settings.test == Consistency.NONE:
        return [math.inf] * (SATELLITES + 1)
    if settings.test == Consistency.MARKOV:
        return [math.inf, *(dof / settings.alpha for dof in range(1, SATELLITES + 1))]
    return [math.inf, *(chi2_quantile(settings.alpha, dof) for dof in range(1, SATELLITES + 1))]


def build_table(settings: Settings) -> np.ndarray:
    """The table (1,), read-only."""
    table = np.zeros(1, GNSS_TABLE)
    record = table[0]
    for name in (
        "rule",
        "faulty_max",
        "candidates_max",
        "protect",
        "sigma_factor",
        "ambiguity",
        "earth_rate_radps",
        "ephemeris_age_max_s",
        "further",
        "isolate_odds",
    ):
        record[name] = getattr(settings, name)
    for name in (
        "p_satellite",
        "p_constellation",
        "p_hmi",
        "p_unmonitored",
        "bias_m",
        "alert_limit_m",
        "signal_sigma_m",
        "iono_share",
        "iono_layer_m",
        "iono_error",
        "iono_floor_m",
        "iono_alpha",
        "iono_beta",
    ):
        record[name] = getattr(settings, name)
    record["iono_dispersion"] = [(_L1_MHZ / first_mhz) ** 2 for first_mhz in _FIRST_MHZ]
    record["threshold"] = thresholds(settings)
    # an equal share of local_alpha for each of as many satellites as an epoch usually has at most
    local = settings.local_alpha > 0.0 and settings.test != Consistency.NONE
    sigmas = normal_quantile(settings.local_alpha / 32) if local else math.inf
    record["local_threshold"] = sigmas * sigmas
    record["k_false_alarm"] = sigmas if local else 0.0
    record["radius_min_m"], record["radius_max_m"] = 2.0e7, 5.0e7
    record["range_min_m"], record["range_max_m"] = 1.0e6, 1.0e8
    table.flags.writeable = False
    return table


class Memory:
    """The records of one test, allocated once; room for `epochs` epochs at a time, one in flight."""

    __slots__ = ("epoch", "result", "table", "work")

    def __init__(self, settings: Settings, epochs: int = 1) -> None:
        self.table = build_table(settings)
        self.epoch = np.zeros(epochs, EPOCH)
        self.work = np.zeros(1, WORK)
        self.result = np.zeros(epochs, RESULT)

    def arguments(self) -> tuple[np.ndarray, ...]:
        """Arguments of `gnss_test`, `gnss_exclude` and `gnss_epoch`, in order."""
        return self.table, self.epoch, self.work, self.result
