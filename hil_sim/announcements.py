"""What propulsion, attitude control and the commander say on the bus: BURN, ATTITUDE and NAV_COMMAND frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightsw.icd.can_frames import ATTITUDE, BURN, NAV_COMMAND
from flightsw.icd.enums import BurnFrame, EditMode, MeasurementType, NavCommand
from hil_sim.frames import FrameSeries, in_order, series_of
from hil_sim.gps_time import NS
from hil_sim.scenario_schema import Burn, Command, Scenario
from hil_sim.sensors import attitude
from hil_sim.sensors.gnss_receiver import epochs_ns
from hil_sim.sensors.streams import Streams
from hil_sim.truth.burns import FlownBurn
from hil_sim.truth.interface import Truth


@dataclass
class _Told:
    """When each of n messages is said, which is when it arrives."""

    t_true_gps_ns: np.ndarray

    @property
    def arrival_gps_ns(self) -> np.ndarray:
        return self.t_true_gps_ns

    @property
    def sent(self) -> np.ndarray:
        return np.ones(len(self.t_true_gps_ns), dtype=bool)


def encode(
    scenario: Scenario,
    flown: tuple[FlownBurn, ...],
    truth: Truth,
    t_start_gps_ns: int,
    t_last_gps_ns: int,
    streams: Streams,
) -> FrameSeries:
    """Frames of the scenario's burns, attitude and commands, in order of arrival."""
    parts = [
        _burns(scenario.burn, flown, t_start_gps_ns),
        _commands(scenario.command, t_start_gps_ns),
    ]
    if scenario.attitude is not None:
        t = epochs_ns(t_start_gps_ns, t_last_gps_ns, round(NS / scenario.attitude.rate_hz))
        pointing = attitude.Pointing.of(scenario.attitude)
        parts.append(_attitudes(attitude.measure(truth, pointing, scenario.attitude, t, streams.attitude)))
    return in_order(parts)


def announced_s(burn: Burn) -> float | None:
    """When a burn is announced, seconds after the scenario's start; None when it is not."""
    return burn.start_s - burn.announce_lead_s if burn.announced else None


def _burns(burns: tuple[Burn, ...], flown: tuple[FlownBurn, ...], t_start_gps_ns: int) -> FrameSeries:
    """Announcements in order of the time they are made: what was commanded, not what is flown."""
    told = [(t_s, i) for i, t_s in enumerate(map(announced_s, burns)) if t_s is not None]
    told.sort()
    records = np.zeros(len(told), dtype=BURN.dtype)
    for row, (_, i) in zip(records, told, strict=True):
        burn = burns[i]
        row["t_start_gps_ns"], row["duration_ns"] = flown[i].t_start_gps_ns, flown[i].duration_ns
        for axis, dv, sigma in zip("xyz", burn.dv_mps, burn.sigma_mps, strict=True):
            row[f"dv_{axis}_mps"], row[f"sigma_{axis}_mps"] = dv, sigma
        row["frame"] = BurnFrame[burn.frame.upper()]
        row["burn_id"] = i + 1
    return _told("burn", records, [t_s for t_s, _ in told], t_start_gps_ns)


def _commands(commands: tuple[Command, ...], t_start_gps_ns: int) -> FrameSeries:
    ordered = sorted(commands, key=lambda command: command.at_s)
    records = np.zeros(len(ordered), dtype=NAV_COMMAND.dtype)
    for row, command in zip(records, ordered, strict=True):
        row["command"] = NavCommand[command.command.upper()]
        if command.target is not None and command.value is not None:
            row["target"] = MeasurementType[command.target.upper()]
            row["value"] = EditMode[command.value.upper()]
    return _told("command", records, [command.at_s for command in ordered], t_start_gps_ns)


def _told(kind: str, records: np.ndarray, at_s: list[float], t_start_gps_ns: int) -> FrameSeries:
    t = t_start_gps_ns + np.array([round(t_s * NS) for t_s in at_s], dtype=np.int64)
    return series_of(kind, records, np.arange(len(records)), _Told(t))


def _attitudes(series: attitude.AttitudeSeries) -> FrameSeries:
    records = np.zeros(len(series.q), dtype=ATTITUDE.dtype)
    records["t_gps_ns"] = series.t_true_gps_ns
    for k, name in enumerate("wxyz"):
        records[f"q_{name}"] = series.q[:, k]
    records["sigma_rad"] = series.sigma_rad
    return series_of("attitude", records, np.arange(len(records)), series)
