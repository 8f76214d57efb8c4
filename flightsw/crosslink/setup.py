"""A monitor made ready: its table from the wanted false-alarm rate and the noise table, and its memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flightsw.crosslink.records import (
    BLOCKS,
    EPOCH,
    HISTORY,
    MONITOR_TABLE,
    ONSETS,
    PARAMETERS,
    SATELLITES,
    STATE,
    TEST,
    VERDICT,
    WORK,
)
from flightsw.crosslink.thresholds import certain_noncentrality, chi2_quantile, paper_threshold_m

DETECTION = 0.999  # what the weakest jump is reported for


@dataclass(frozen=True)
class Settings:
    """What a monitor is built from: noise, wanted false-alarm rate, sizes. Defaults: the paper's Table 2.

    sigma_m, sigma_rate_mps: radial, along-track, cross-track, clock, of what a healthy satellite broadcasts.
    p_false_alarm: per epoch, of each monitor, over all its tests and satellites; half of it belongs to slow faults.
    """

    satellites: int = 24
    own: int = 0
    two_way: bool = False
    both: bool = False
    sigma_range_m: float = 11.8
    sigma_m: tuple[float, float, float, float] = (0.5, 3.5, 3.5, 0.0)
    sigma_rate_mps: tuple[float, float, float, float] = (0.0017, 0.0002, 0.0002, 0.0)
    p_false_alarm: float = 2e-7
    slow_share: float = 0.5
    p_clear: float = 1e-3
    clear_epochs: int = 30
    faulty_max: int = 6
    epoch_s: float = 1.0
    block_epochs: int = 10
    onset_blocks: tuple[int, ...] = (-3, -12, 4, 7, 10, 16, 24, 36, 54, 80)

    def __post_init__(self) -> None:
        """Raises ValueError, naming the setting, for what no monitor can be built from."""
        for name, bad in (
            ("satellites", not 2 <= self.satellites <= SATELLITES),
            ("own", not 0 <= self.own < self.satellites),
            ("sigma_range_m", not 0.0 < self.sigma_range_m < math.inf),
            ("sigma_m", len(self.sigma_m) != PARAMETERS or not all(0.0 <= s < math.inf for s in self.sigma_m)),
            (
                "sigma_rate_mps",
                len(self.sigma_rate_mps) != PARAMETERS or not all(0.0 <= s < math.inf for s in self.sigma_rate_mps),
            ),
            ("p_false_alarm", not 0.0 < self.p_false_alarm < 0.1),
            ("slow_share", not 0.0 <= self.slow_share < 1.0),
            ("p_clear", not 0.0 < self.p_clear < 1.0),
            ("clear_epochs", self.clear_epochs < 1),
            ("faulty_max", not 1 <= self.faulty_max < self.satellites),
            ("epoch_s", not self.epoch_s > 0.0),
            ("block_epochs", self.block_epochs < 1),
            ("onset_blocks", not 0 <= len(self.onset_blocks) <= min(ONSETS, self.block_epochs)),
            ("onset_blocks", not all(1 <= abs(blocks) < BLOCKS - 1 for blocks in self.onset_blocks)),
        ):
            if bad:
                raise ValueError(f"crosslink monitor: {name} = {getattr(self, name)} is out of its range")


def thresholds(p_tail: float) -> list[float]:
    """Chi-square thresholds for 0 (never exceeded) to 4 degrees of freedom."""
    return [math.inf, *(chi2_quantile(p_tail, dof) for dof in range(1, PARAMETERS + 1))]


def build_table(settings: Settings) -> np.ndarray:
    """The monitor's table (1,): every threshold follows from the settings.

    Bonferroni: of P_fa, each satellite's test has an equal share, so that the rate of all together is not above it.
    """
    table = np.zeros(1, MONITOR_TABLE)
    record = table[0]
    for name in ("satellites", "own", "two_way", "both", "faulty_max", "block_epochs", "clear_epochs", "epoch_s"):
        record[name] = getattr(settings, name)
    record["sigma_range_m"] = settings.sigma_range_m
    record["sigma_m"], record["sigma_rate_mps"] = settings.sigma_m, settings.sigma_rate_mps
    record["onsets"] = len(settings.onset_blocks)
    record["onset_blocks"][: len(settings.onset_blocks)] = settings.onset_blocks
    radial, along, cross, _clock = settings.sigma_m
    record["majority_threshold_m"] = paper_threshold_m(along, cross, radial)
    # one finding in an epoch comes from the test of the epoch or from the one age of slow faults that it tries
    slow = settings.p_false_alarm * settings.slow_share
    quick = settings.p_false_alarm - slow
    parameters = 3 if settings.two_way else 4
    record["network_threshold"] = thresholds(quick / settings.satellites)
    record["own_threshold"] = thresholds(quick)
    if slow > 0.0:
        record["network_slow_threshold"] = thresholds(slow / settings.satellites)
        record["own_slow_threshold"] = thresholds(slow)
    else:
        record["network_slow_threshold"] = record["own_slow_threshold"] = math.inf
        record["onsets"] = 0
    record["clear_threshold"] = thresholds(settings.p_clear)
    record["certain_noncentrality"] = certain_noncentrality(
        float(record["network_threshold"][parameters]), parameters, DETECTION
    )
    table.flags.writeable = False
    return table


class MonitorMemory:
    """The records of one monitor, allocated once. A fresh instance holds no state."""

    __slots__ = ("epoch", "history", "network", "own", "state", "table", "verdict", "work")

    def __init__(self, settings: Settings) -> None:
        self.table = build_table(settings)
        self.epoch = np.zeros(1, EPOCH)
        self.state = np.zeros(1, STATE)
        self.history = np.zeros(1, HISTORY)
        self.network = np.zeros(1, TEST)
        self.own = np.zeros(1, TEST)
        self.work = np.zeros(1, WORK)
        self.verdict = np.zeros(1, VERDICT)
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after power-up; the table stays."""
        for record in (self.epoch, self.state, self.history, self.network, self.own, self.work, self.verdict):
            record.view(np.uint8)[:] = 0
        self.history["issue"] = self.history["onset"] = -1
        self.epoch["healthy"] = 1

    def arguments(self) -> tuple[np.ndarray, ...]:
        """Arguments of `monitor_epoch`, and of `monitor_step` but the last, in order."""
        return (
            self.table,
            self.epoch,
            self.state,
            self.history,
            self.network,
            self.own,
            self.work,
            self.verdict,
        )
