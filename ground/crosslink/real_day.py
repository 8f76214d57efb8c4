"""Real ephemeris errors: what GLONASS broadcast on a day, against precise orbits, on simulated links.

Every satellite of the day ranges to all it sees; the network monitor flies through the whole day. What it names is set
against the true error at that time. The noise table is the paper's Table 2 or one of the day itself (day_noise.py).
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.crosslink.declare import source_hash
from flightsw.crosslink.monitor import monitor_epoch
from flightsw.crosslink.setup import MonitorMemory, Settings
from ground.crosslink.day_noise import ANOMALY, Expected, anomalous, beyond_noise, overbound, robust
from ground.crosslink.scene import fill_epoch
from ground.errors import OperatorError
from hil_sim.truth.constellation.broadcast import broadcast
from hil_sim.truth.constellation.crosslinks import Ranging, View, both
from hil_sim.truth.constellation.glonass_day import DataError, GlonassDay, read_day

PRECISE = "glonass_2009/esa15253.sp3.gz"
BROADCAST = "glonass_2009/brdc0910.09g"
TABLE_2 = (0.5, 3.5, 3.5, 0.0)
OVERBOUND, SPREAD, PRINTED = "overbound of the day", "spread of the day", "Table 2"
NOISE_TABLES = (OVERBOUND, SPREAD, PRINTED)
_PROGRESS_S = 600
_QUICK_EVERY_S, _SLOW_EVERY_S = 60, 31


@dataclass(frozen=True)
class Finding:
    """A satellite excluded from `from_s` to `to_s` of the day, and its true errors (4,) [m] when it was named.

    size_m, largest_m: of position and clock together, then and at most; healthy: what it said of itself.
    slow: named by the search for slow faults. statistic: of the test that named it. beyond: robust sigma that its
    message was off, by the precise orbits, in the twenty minutes before; from ANOMALY on the finding is no false one.
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
    beyond: float


def load_day(data: Path) -> GlonassDay:
    """The day of the shared data. Raises OperatorError where the files are absent or unfit."""
    for name in (PRECISE, BROADCAST):
        if not (data / name).is_file():
            raise OperatorError(f"no file {data / name}; set LEONAV_DATA to the folder of real orbits")
    try:
        return read_day(data / PRECISE, data / BROADCAST)
    except DataError as error:
        raise OperatorError(str(error)) from error


def settings_of(day: GlonassDay, noise: str, range_sigma_m: float) -> Settings:
    """The monitor with one of NOISE_TABLES: the day's own two, or Table 2, which knows no clock and gets the day's."""
    usual = robust(day)
    spread = overbound(day) if noise == OVERBOUND else usual
    table = (*TABLE_2[:3], usual.sigma_m[3]) if noise == PRINTED else spread.sigma_m
    sigma, rate = ([float(x) for x in values] for values in (table, spread.rate_mps))
    return Settings(
        satellites=len(day.names),
        both=True,
        sigma_range_m=range_sigma_m,
        sigma_m=(sigma[0], sigma[1], sigma[2], sigma[3]),
        sigma_rate_mps=(rate[0], rate[1], rate[2], rate[3]),
    )


def errors_of(day: GlonassDay) -> dict[str, Any]:
    """The day's errors every five minutes, for pictures: hours (k,), and by satellite (k,4) [m], null for none."""
    every = slice(None, None, 5)
    return {
        "hours": (day.grid_s[every] / 3600.0).round(4).tolist(),
        "errors_m": {
            name: [[None if np.isnan(x) else round(float(x), 2) for x in row] for row in day.errors_m[index, every]]
            for index, name in enumerate(day.names)
        },
        "unhealthy": {
            name: (~day.healthy[index, every].astype(bool) & (day.issue[index, every] >= 0)).tolist()
            for index, name in enumerate(day.names)
        },
    }


def certain_m(day: GlonassDay, settings: Settings, start_s: float = 900.0) -> list[float]:
    """Jumps (4,) [m] found in one epoch with 0.999, by direction: medians over the day's satellites and hours."""
    found = []
    memory, ranging = MonitorMemory(settings), Ranging(0.0)
    for t_s in np.arange(start_s, float(day.grid_s[-1]) - 900.0, 3600.0):
        memory.reset()
        _put(memory, day, ranging, float(t_s), np.random.default_rng(0), np.zeros(len(day.names), bool))
        monitor_epoch(*memory.arguments())
        information = np.array(memory.network["diagonal"][0, : 4 * len(day.names)]).reshape(-1, 4)
        found.append(np.sqrt(float(memory.table["certain_noncentrality"][0]) / information[information.all(axis=1)]))
    return [float(x) for x in np.median(np.concatenate(found), axis=0)]


def expected_false(
    day: GlonassDay, settings: Settings, start_s: float = 900.0, stop_s: float | None = None
) -> dict[str, Any]:
    """Rates at which the day's own errors, but for its anomalies, alarm the network monitor: Expected.document.

    quick: the test of one epoch, every minute, with the anomalous silent, as if excluded; on_air: with them, as long as
    they are not. slow: the search for slow faults, one epoch in 31, so that every age has its turn.
    """
    quick, slow = MonitorMemory(replace(settings, onset_blocks=())), MonitorMemory(settings)
    expected = {"quick": Expected(quick, False), "on_air": Expected(quick, False), "slow": Expected(slow, True)}
    ranging, anomalies, rng = Ranging(0.0), anomalous(day), np.random.default_rng(0)
    step = day.grid_s[1] - day.grid_s[0]
    stop_s = float(day.grid_s[-1]) - 900.0 if stop_s is None else stop_s
    for second in range(int(start_s), int(stop_s)):
        apart = anomalies[:, int(second // step)]
        _put(slow, day, ranging, float(second), rng, apart)
        monitor_epoch(*slow.arguments())
        if second % _SLOW_EVERY_S == 0 and np.isfinite(slow.verdict["slow_age_s"][0]):
            expected["slow"].add(apart)
        if second % _QUICK_EVERY_S == 0:
            for name, silent in (("quick", apart), ("on_air", np.zeros_like(apart))):
                quick.reset()  # nobody is excluded
                _put(quick, day, ranging, float(second), rng, silent)
                monitor_epoch(*quick.arguments())
                expected[name].add(apart)
    return {name: one.document() for name, one in expected.items()}


def _put(
    memory: MonitorMemory, day: GlonassDay, ranging: Ranging, t_s: float, rng: np.random.Generator, silent: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The epoch at t into a monitor, without those in silent (n,); errors (n,4) and health (n,) of the messages."""
    errors, issue, healthy = day.at(t_s)
    r, v = day.orbits.states(t_s)
    known = np.isfinite(errors).all(axis=1) & np.isfinite(r).all(axis=1) & ~silent
    seen = View().pairs(np.where(known[:, None], r, np.nan))
    pairs, ranges = ranging.measure(day.orbits, t_s, both(seen), np.zeros(len(day.names)), rng)
    said, said_clock = broadcast(r, v, np.where(known[:, None], errors, np.nan))
    fill_epoch(memory, t_s, said, v, np.where(known, said_clock, 0.0), pairs, ranges)
    memory.epoch["issue"][0, : len(issue)] = issue
    memory.epoch["healthy"][0, : len(issue)] = healthy
    return errors, healthy


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
    ranging, nobody = Ranging(settings.sigma_range_m), np.zeros(len(day.names), bool)
    rng = np.random.default_rng(seed)
    stop_s = float(day.grid_s[-1]) - 900.0 if stop_s is None else stop_s
    open_since: dict[int, dict[str, Any]] = {}
    findings: list[Finding] = []
    epochs, rank = 0, (0, 0)
    for second in range(int(start_s), int(stop_s)):
        t_s = float(second)
        errors, healthy = _put(memory, day, ranging, t_s, rng, nobody)
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
                    "beyond": beyond_noise(day, satellite, t_s),
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
        "seed": seed,
        "false": sum(one.beyond < ANOMALY for one in findings),
        "satellites": list(day.names),
        "rank": rank[0],
        "parameters": rank[1],
        "sigma_m": list(settings.sigma_m),
        "sigma_rate_mps": list(settings.sigma_rate_mps),
        "findings": [vars(one) for one in findings],
    }


def day_part(
    folder: Path, data: Path, range_sigma_m: float, seed: int, seeds: int, stop_s: float | None, progress: Any
) -> dict[str, Any]:
    """The day with each noise table, the overbound with several seeds. What is finished is kept in the folder."""
    day = load_day(data)
    folder.mkdir(parents=True, exist_ok=True)
    documents = {}
    for number, name in enumerate(NOISE_TABLES):
        settings = settings_of(day, name, range_sigma_m)
        key = f"{source_hash()} {_study_hash()} {settings!r} {stop_s}"
        flown = []
        for one in range(seed, seed + (seeds if name == OVERBOUND else 1)):
            with progress(f"day, {name}, seed {one}", 86_400) as advance:
                flown.append(
                    _kept(
                        folder / f"{number}_seed_{one}.json",
                        key,
                        partial(fly_day, day, settings, one, stop_s=stop_s, advance=_steps(advance)),
                    )
                )
        expected = partial(expected_false, day, settings, stop_s=stop_s)
        documents[name] = {
            **flown[0],
            "others": flown[1:],
            "certain_m": certain_m(day, settings),
            "expected": _kept(folder / f"{number}_expected.json", key, expected),
        }
    return {"errors": errors_of(day), "flights": documents}


def _steps(advance: Any) -> Any:
    """Of a bar that wants counts, for who tells the second he is at."""
    told = [0]

    def tell(second: int) -> None:
        advance(second - told[0])
        told[0] = second

    return tell


def _kept(path: Path, key: str, make: Any) -> dict[str, Any]:
    """What a file holds, if it was made under this key; else it is made and kept."""
    if path.exists():
        held = json.loads(path.read_text(encoding="utf-8"))
        if held["key"] == key:
            return dict(held["found"])
    found = make()
    path.write_text(json.dumps({"key": key, "found": found}, indent=1) + "\n", encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))["found"]  # type: ignore[no-any-return]


def _study_hash() -> str:
    here = Path(__file__).resolve()
    return hashlib.sha256(here.read_bytes() + here.with_name("day_noise.py").read_bytes()).hexdigest()
