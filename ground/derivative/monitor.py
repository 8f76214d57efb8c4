"""The velocity check by Monte Carlo: false alarms over simulated months, times to detect, coloured errors."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.derivative.check import take_fix
from flightsw.derivative.declare import ROOM, entry, source_hash
from flightsw.derivative.records import CHECK, CHECK_TABLE
from flightsw.derivative.setup import Check, CheckSettings
from flightsw.kernels.registry import F8, I8, MATRIX, VECTOR, frozen_records, records
from ground.campaign import executor, seeds, store
from ground.campaign.statistics import lower_limit, upper_limit
from ground.derivative.limit import deflection, most_found
from ground.derivative.run_length import mean_run_length

DAY_S = 86_400.0
DAYS = 30.0
SETTLE_S = 3_000.0  # before a fault, and before alarms count
BIASES_MPS = (0.02, 0.03, 0.05, 0.07, 0.1, 0.2, 0.5)
GIVE_UP_S = 3_000.0
WANTED_S = 120.0
_ROWS, _BLOCK = 100_000, 100  # fixes drawn at a time
_LONG = 4  # of so many runs one also flies a month of coloured errors
_ORBIT_RADPS = 2.0 * math.pi / 5_670.0
DIRECTIONS = ("one axis", "any direction", "every axis")


@dataclass(frozen=True)
class Noise:
    """Errors of fixes: white parts and first-order Gauss-Markov parts; of the predicted orbit, at orbital rate."""

    sigma_r_m: float = 10.0
    sigma_v_mps: float = 0.1
    coloured_r_m: float = 0.0
    coloured_v_mps: float = 0.0
    coloured_s: float = 300.0
    orbit_m: float = 0.7


# ground/tables/functions/velocity_check_coloured.toml
AWARE = CheckSettings(
    reference=0.22, threshold=21.5, clear=7.0, coloured_r_m=3.0, coloured_v_mps=0.005, coloured_s=300.0
)


@dataclass(frozen=True)
class Flown:
    """One campaign; picklable."""

    seeds: seeds.Seeds
    settings: CheckSettings = field(default_factory=CheckSettings)
    white: Noise = field(default_factory=Noise)
    coloured: Noise = field(default_factory=lambda: Noise(coloured_r_m=3.0, coloured_v_mps=0.005))
    aware: CheckSettings = field(default_factory=lambda: AWARE)  # a table that knows of the coloured errors
    days: float = DAYS


SIM = np.dtype(
    [
        *(
            (name, "f8")
            for name in ("sigma_r_m", "sigma_v_mps", "coloured_r_m", "coloured_v_mps", "coloured_s", "orbit_m")
        ),
        ("phase", "f8", (3,)),
        ("slow_r", "f8", (3,)),  # Gauss-Markov parts, in sigmas
        ("slow_v", "f8", (3,)),
        ("told_r_m", "f8", (3,)),  # sigmas that the receiver claims
        ("told_v_mps", "f8", (3,)),
        ("dr_m", "f8", (3,)),
        ("dv_mps", "f8", (3,)),
    ],
    align=True,
)


@entry(frozen_records(CHECK_TABLE), records(CHECK), records(SIM), VECTOR, F8, MATRIX, I8)
def _stretch(table, check, sims, bias, onset_s, drawn, first):
    """Fixes 1 s apart from t = first on, one for each row of drawn (m, 12): white r, v, what renews the coloured r, v.

    Returns the first epoch from onset_s on that holds a fault, or -1 after all of them.
    """
    _ = ROOM
    sim = sims[0]
    keep = math.exp(-1.0 / sim["coloured_s"])
    renew = math.sqrt(1.0 - keep * keep)
    for k in range(drawn.shape[0]):
        t_s = float(first + k)
        for axis in range(3):
            sim["slow_r"][axis] = keep * sim["slow_r"][axis] + renew * drawn[k, 6 + axis]
            sim["slow_v"][axis] = keep * sim["slow_v"][axis] + renew * drawn[k, 9 + axis]
            angle = _ORBIT_RADPS * t_s + sim["phase"][axis]
            dr_m = sim["sigma_r_m"] * drawn[k, axis] + sim["coloured_r_m"] * sim["slow_r"][axis]
            dv_mps = sim["sigma_v_mps"] * drawn[k, 3 + axis] + sim["coloured_v_mps"] * sim["slow_v"][axis]
            sim["dr_m"][axis] = dr_m + sim["orbit_m"] * math.sin(angle)
            sim["dv_mps"][axis] = dv_mps + sim["orbit_m"] * _ORBIT_RADPS * math.cos(angle)
            if t_s >= onset_s:
                sim["dv_mps"][axis] += bias[axis]
        fault = take_fix(table[0], check[0], t_s, sim["dr_m"], sim["dv_mps"], sim["told_r_m"], sim["told_v_mps"])
        if t_s >= onset_s and fault == 1:
            return first + k
    return -1


def _begin(noise: Noise, rng: np.random.Generator) -> np.ndarray:
    sim = np.zeros(1, SIM)
    for name in ("sigma_r_m", "sigma_v_mps", "coloured_r_m", "coloured_v_mps", "coloured_s", "orbit_m"):
        sim[0][name] = getattr(noise, name)
    sim["phase"] = rng.uniform(0.0, 2.0 * math.pi, 3)
    sim["slow_r"], sim["slow_v"] = rng.standard_normal((2, 3))
    sim["told_r_m"], sim["told_v_mps"] = noise.sigma_r_m, noise.sigma_v_mps
    return sim


def alarms(settings: CheckSettings, noise: Noise, rng: np.random.Generator, days: float) -> int:
    """False alarms over days of healthy fixes, after the check has settled; each is cleared by its own rule."""
    check, sim = Check(settings), _begin(noise, rng)
    nothing = np.zeros(3)
    stop, first, before = int(SETTLE_S + days * DAY_S), 0, 0
    while first < stop:
        rows = min(_ROWS, stop - first)
        _stretch(check.table, check.state, sim, nothing, math.inf, rng.standard_normal((rows, 12)), first)
        first += rows
        if first <= SETTLE_S:
            before = int(check.state["alarms"][0])
    return int(check.state["alarms"][0]) - before


def delay(settings: CheckSettings, noise: Noise, rng: np.random.Generator, bias_mps: np.ndarray) -> float:
    """Seconds from the onset of a bias (3,) until a fault is held; infinite: not within GIVE_UP_S."""
    check, sim = Check(settings), _begin(noise, rng)
    onset = int(SETTLE_S + rng.integers(600))
    drawn = rng.standard_normal((onset, 12))
    _stretch(check.table, check.state, sim, bias_mps, float(onset), drawn, 0)
    if check.state["fault"][0]:  # a false alarm just before: not counted as found
        return math.inf
    for first in range(onset, onset + int(GIVE_UP_S), _BLOCK):
        found = _stretch(
            check.table, check.state, sim, bias_mps, float(onset), rng.standard_normal((_BLOCK, 12)), first
        )
        if found >= 0:
            return float(found - onset + 1)
    return math.inf


def _direction(kind: str, rng: np.random.Generator) -> np.ndarray:
    """Direction (3,) of a bias; of `every axis` the length is root three: each axis has the whole bias."""
    if kind == "one axis":
        return np.asarray(np.eye(3)[rng.integers(3)] * rng.choice((-1.0, 1.0)))
    if kind == "every axis":
        return rng.choice((-1.0, 1.0), 3)
    drawn = rng.standard_normal(3)
    return np.asarray(drawn / np.linalg.norm(drawn))


def fly_run(flight: Flown, run: int) -> dict[str, np.ndarray]:
    """One stretch of healthy fixes with white errors, every few runs one with coloured ones; every bias once."""
    rng = np.random.default_rng(flight.seeds.of_run(run))
    coloured = run % _LONG == 0
    delays = [
        [delay(flight.settings, flight.white, rng, bias * _direction(kind, rng)) for bias in BIASES_MPS]
        for kind in DIRECTIONS
    ]
    answer = {
        "alarms": np.array(alarms(flight.settings, flight.white, rng, flight.days)),
        "coloured": np.array(alarms(flight.settings, flight.coloured, rng, flight.days) if coloured else -1),
        "delays": np.array(delays),
        "aware": np.array(alarms(flight.aware, flight.coloured, rng, flight.days) if coloured else -1),
    }
    answer["aware_delays"] = np.array(
        [delay(flight.aware, flight.coloured, rng, bias * _direction("one axis", rng)) for bias in BIASES_MPS]
    )
    return answer


def work(flight: Flown, first: int, last: int) -> store.Arrays:
    """Figures of runs first to last, stacked."""
    return store.stacked(fly_run(flight, run) for run in range(first, last + 1))


def monitor_part(
    folder: Path, seed: int, runs: int, advance: Callable[[int], None], days: float = DAYS, **how: Any
) -> dict[str, Any]:
    """False alarms over `days` of healthy fixes a run, times to detect; finished runs are not flown again.

    Nothing was tuned on these streams: the threshold is that of an equation.
    """
    flight = Flown(seeds.tuning(seed), days=days)
    own = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
    what = {
        "format": "leonav velocity check 1",
        "flight": repr(flight),
        "code_sha256": source_hash(),
        "study_sha256": own,
    }
    store.open_folder(folder, what)
    figures = executor.complete(folder, flight, runs, advance, work=work, **how)
    coloured, aware = (figures[name][figures[name] >= 0] for name in ("coloured", "aware"))
    document: dict[str, Any] = {
        "runs": runs,
        "settings": asdict(flight.settings),
        "white": asdict(flight.white),
        "coloured": asdict(flight.coloured),
        "exact_days": mean_run_length(flight.settings.reference, flight.settings.threshold) / DAY_S,
        "false_alarm_days": DAYS,
        "give_up_s": GIVE_UP_S,
        "alarms": {
            "white errors": _rate(int(figures["alarms"].sum()), runs * flight.days),
            "coloured errors": _rate(int(coloured.sum()), len(coloured) * flight.days),
            "coloured errors, a table that knows them": _rate(int(aware.sum()), len(aware) * flight.days),
        },
        "limits": {
            name: most_found(
                deflection(0.05, noise.sigma_v_mps, noise.coloured_v_mps, noise.coloured_s, round(WANTED_S)),
                WANTED_S,
                DAYS * DAY_S,
            )
            for name, noise in (("white errors", flight.white), ("coloured errors", flight.coloured))
        },
        "delays": {},
    }
    for row, kind in enumerate(DIRECTIONS):
        document["delays"][kind] = [
            _delays(figures["delays"][:, row, column], bias) for column, bias in enumerate(BIASES_MPS)
        ]
    document["delays"]["one axis, coloured errors, a table that knows them"] = [
        _delays(figures["aware_delays"][:, column], bias) for column, bias in enumerate(BIASES_MPS)
    ]
    return document


def _delays(found: np.ndarray, bias_mps: float) -> dict[str, float]:
    within, trials = int((found <= WANTED_S).sum()), len(found)
    q05, median, q95 = (float(min(np.quantile(found, q, method="higher"), GIVE_UP_S)) for q in (0.05, 0.5, 0.95))
    return {
        "bias_mps": bias_mps,
        "q05_s": q05,
        "median_s": median,
        "q95_s": q95,
        "mean_s": float(np.minimum(found, GIVE_UP_S).mean()),
        "within": within / trials,
        "within_lower": lower_limit(within, trials),
        "within_upper": upper_limit(within, trials),
    }


def _rate(count: int, days: float) -> dict[str, float]:
    """Alarms in 30 days with the limits of Clopper and Pearson, an alarm in a second being rare."""
    seconds = int(days * DAY_S)
    scale = DAYS * DAY_S
    return {
        "count": count,
        "days": days,
        "per_30_days": count / days * DAYS,
        "lower": lower_limit(count, seconds) * scale,
        "upper": upper_limit(count, seconds) * scale,
    }
