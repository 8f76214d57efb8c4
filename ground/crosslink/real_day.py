"""Real ephemeris errors: what GLONASS broadcast on a day, against precise orbits, on simulated links.

Every satellite of the day ranges to all it sees; the network monitor flies through the whole day. What it names is set
against the true error at that time. The noise table is the paper's Table 2 or that of the day itself, whose robust
spread (1.4826 times the median absolute error) a few bad satellites do not move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.crosslink.monitor import monitor_epoch
from flightsw.crosslink.setup import MonitorMemory, Settings
from ground.crosslink.scene import fill_epoch
from ground.errors import OperatorError
from hil_sim.truth.constellation.broadcast import broadcast
from hil_sim.truth.constellation.crosslinks import Ranging, View, both
from hil_sim.truth.constellation.glonass_day import DataError, GlonassDay, read_day

PRECISE = "glonass_2009/esa15253.sp3.gz"
BROADCAST = "glonass_2009/brdc0910.09g"
TABLE_2 = (0.5, 3.5, 3.5, 0.0)
_PROGRESS_S = 600


@dataclass(frozen=True)
class Finding:
    """A satellite excluded from `from_s` to `to_s` of the day, and its true errors (4,) [m] when it was named.

    size_m, largest_m: of position and clock together, then and at most; healthy: what it said of itself.
    slow: named by the search for slow faults. statistic: of the test that named it.
    """

    satellite: str
    from_s: float
    to_s: float
    errors_m: tuple[float, ...]
    size_m: float
    largest_m: float
    healthy: bool
    slow: bool
    statistic: float


def load_day(data: Path) -> GlonassDay:
    """The day of the shared data. Raises OperatorError where the files are absent or unfit."""
    for name in (PRECISE, BROADCAST):
        if not (data / name).is_file():
            raise OperatorError(f"no file {data / name}; set LEONAV_DATA to the folder of real orbits")
    try:
        return read_day(data / PRECISE, data / BROADCAST)
    except DataError as error:
        raise OperatorError(str(error)) from error


def spread(day: GlonassDay) -> tuple[np.ndarray, np.ndarray]:
    """Robust 1-sigma (4,) [m] of the day's errors and of their rates (4,) [m/s] within an ephemeris."""
    sigma = 1.4826 * np.nanmedian(np.abs(day.errors_m), axis=(0, 1))
    same = day.issue[:, 1:] == day.issue[:, :-1]
    step = day.grid_s[1] - day.grid_s[0]
    rates = np.where(same[:, :, None], np.diff(day.errors_m, axis=1) / step, np.nan)
    return sigma, 1.4826 * np.nanmedian(np.abs(rates), axis=(0, 1))


def settings_of(day: GlonassDay, of_the_day: bool, range_sigma_m: float) -> Settings:
    """The monitor: with the day's own noise table, or with Table 2, which knows no clock and gets the day's."""
    sigma, rate = (tuple(float(x) for x in values) for values in spread(day))
    table = sigma if of_the_day else (*TABLE_2[:3], sigma[3])
    return Settings(
        satellites=len(day.names),
        both=True,
        sigma_range_m=range_sigma_m,
        sigma_m=(table[0], table[1], table[2], table[3]),
        sigma_rate_mps=(rate[0], rate[1], rate[2], rate[3]),
    )


def fly_day(
    day: GlonassDay,
    settings: Settings,
    seed: int = 1,
    start_s: float = 900.0,
    stop_s: float | None = None,
    advance: Any = None,
) -> dict[str, Any]:
    """Fly the network monitor from start to stop at one epoch a second; what it found, as a document."""
    settings = replace(settings, satellites=len(day.names))
    memory = MonitorMemory(settings)
    arguments, verdict = memory.arguments(), memory.verdict
    ranging, view = Ranging(settings.sigma_range_m), View()
    rng = np.random.default_rng(seed)
    stop_s = float(day.grid_s[-1]) - 900.0 if stop_s is None else stop_s
    clock = np.zeros(len(day.names))
    open_since: dict[int, dict[str, Any]] = {}
    findings: list[Finding] = []
    epochs, rank = 0, (0, 0)
    for second in range(int(start_s), int(stop_s)):
        t_s = float(second)
        errors, issue, healthy = day.at(t_s)
        r, v = day.orbits.states(t_s)
        known = np.isfinite(errors).all(axis=1) & np.isfinite(r).all(axis=1)
        seen = view.pairs(np.where(known[:, None], r, np.nan))
        pairs, ranges = ranging.measure(day.orbits, t_s, both(seen), clock, rng)
        said, said_clock = broadcast(r, v, np.where(known[:, None], errors, np.nan))
        fill_epoch(memory, t_s, said, v, np.where(known, said_clock, 0.0), pairs, ranges)
        memory.epoch["issue"][0, : len(issue)] = issue
        memory.epoch["healthy"][0, : len(issue)] = healthy
        monitor_epoch(*arguments)
        epochs += 1
        rank = (int(verdict["rank"][0]), int(verdict["parameters"][0]))
        named, included, faulty = (int(verdict[name][0]) for name in ("named", "included", "faulty"))
        for satellite in range(len(day.names)):
            size = float(np.linalg.norm(errors[satellite]))
            if named >> satellite & 1 and satellite not in open_since:
                slow = bool(memory.state["slow"][0, satellite])
                statistic = verdict["network_slow_statistic" if slow else "network_statistic"][0]
                open_since[satellite] = {
                    "from_s": t_s,
                    "errors_m": tuple(errors[satellite].tolist()),
                    "size_m": size,
                    "largest_m": size,
                    "healthy": bool(healthy[satellite]),
                    "slow": slow,
                    "statistic": float(statistic),
                }
            elif satellite in open_since:
                held = open_since[satellite]
                if size > held["largest_m"]:
                    held["largest_m"] = size
                if included >> satellite & 1 or not faulty >> satellite & 1:
                    findings.append(Finding(day.names[satellite], to_s=t_s, **open_since.pop(satellite)))
        if advance is not None and second % _PROGRESS_S == 0:
            advance(second)
    for satellite, held in open_since.items():
        findings.append(Finding(day.names[satellite], to_s=stop_s, **held))
    findings.sort(key=lambda one: one.from_s)
    return {
        "epochs": epochs,
        "satellites": list(day.names),
        "rank": rank[0],
        "parameters": rank[1],
        "sigma_m": list(settings.sigma_m),
        "sigma_rate_mps": list(settings.sigma_rate_mps),
        "findings": [vars(one) for one in findings],
    }
