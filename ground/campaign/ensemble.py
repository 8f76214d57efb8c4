"""An ensemble of outages: what varies from run to run, how widely, and the scenario of each run.

Drawn afresh for each run: orbit, phase, epoch with its real space weather, cross-section and how wrong the force table
is about it, the step of the cross-section when GNSS is lost, oscillator, noise of the fixes, how long they came before.
Runs go through the cells in turn; each takes the next day of its cell's permuted days, so that no two runs share a day
while there are days left.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from datetime import datetime, time, timedelta
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ground.campaign.cells import CELLS, Weather, days_of, permuted
from ground.campaign.seeds import Seeds
from ground.errors import OperatorError
from hil_sim.truth.interface import MU_PAPER_M3PS2

EARTH_RADIUS_KM = 6378.137
NOISES = ("white", "coloured")
DRAG_COEFFICIENT, RADIATION_COEFFICIENT = 2.2, 1.3  # of the force table
END_S = 5.0  # of flight with fixes after the last outage, at least
# Runs are flown at one tick a second. Fixes are measured on whole seconds and arrive within half a second: ticks lie
# where each finds the fix of its own second. On the second itself a slow oscillator would make every fix a second old.
_TICK_PHASE = timedelta(milliseconds=600)


@dataclass(frozen=True)
class Ensemble:
    """Ranges are from .. to; those of positive sizes are drawn uniformly in the logarithm. All of it is hashed."""

    noise: str = "white"
    outage_s: tuple[float, float] = (2000.0, 2000.0)
    cells: tuple[int, ...] = tuple(range(len(CELLS)))
    # seconds of fixes before the outage; below 0: so many revolutions
    acquisition_s: tuple[float, ...] = (60.0, 300.0, 600.0, 1800.0, -1.0, -2.0)
    inclination_deg: tuple[float, float] = (0.0, 110.0)  # uniform
    eccentricity: tuple[float, float] = (1e-4, 0.02)  # as far as the apogee stays below
    apogee_km: float = 1450.0
    # degree to which the truth goes beyond degree 70, for perigees below so many km; what flies ends at 70, and what
    # that leaves out fades with altitude
    gravity_beyond: tuple[tuple[float, int], ...] = ((450.0, 110), (600.0, 100))
    area_to_mass_m2pkg: tuple[float, float] = (0.002, 0.02)  # as the force table has it
    drag_error: float = 0.3  # 1-sigma of the true Cd against the table's, cut off at 2.5 sigma
    radiation_error: float = 0.2
    area_step: tuple[float, float] = (0.5, 2.0)
    drift_ppm: float = 2.0  # uniform, either sign
    random_walk: tuple[float, float] = (1e-11, 1e-10)  # of its phase, s/sqrt(s)
    drift_walk: tuple[float, float] = (5e-10, 6.3e-10)  # of its drift, 1/sqrt(s): the worst TCXO that the tables allow
    pulse_jitter_ns: tuple[float, float] = (20.0, 100.0)
    sigma_position_m: tuple[float, float] = (0.5, 15.0)
    velocity_to_position_ps: float = 0.01  # sigma of velocities by that of positions [1/s]
    positions_alone_share: float = 0.25  # of runs whose receiver gives no velocity
    positions_arc_s: float = 62.0  # of fixes that these need before there is a state; theirs are so many more
    coloured_sigma_m: tuple[float, float] = (2.0, 5.0)
    coloured_tau_s: tuple[float, float] = (200.0, 450.0)
    periodic_sigma_m: tuple[float, float] = (0.5, 2.0)
    latency_s: tuple[float, float] = (0.05, 0.5)
    second_share: float = 0.15  # of runs that have a second outage
    second_gap_s: tuple[float, float] = (30.0, 600.0)
    second_s: tuple[float, float] = (300.0, 900.0)
    burn_share: float = 0.1  # of runs with an announced burn within the outage
    burn_dv_mps: tuple[float, float] = (0.01, 1.0)
    burn_s: tuple[float, float] = (10.0, 120.0)
    burn_error: float = 0.02  # announced 1-sigma of each axis over the size

    def __post_init__(self) -> None:
        if self.noise not in NOISES:
            raise OperatorError(f"noise {self.noise!r}: one of {', '.join(NOISES)}")
        if not self.cells or any(not 0 <= cell < len(CELLS) for cell in self.cells):
            raise OperatorError(f"cells {self.cells}: give one or more of 0 to {len(CELLS) - 1}")

    def document(self) -> dict[str, Any]:
        """All that defines it, for files and for its hash."""
        return json.loads(json.dumps(asdict(self)))

    @property
    def hash(self) -> str:
        """SHA-256 of its definition."""
        return hashlib.sha256(json.dumps(self.document(), sort_keys=True).encode()).hexdigest()


class Draw(NamedTuple):
    """One run: its scenario, and what the force table on board says of the satellite and the day."""

    run: int
    cell: int
    tree: dict[str, Any]
    weather: Weather
    area_to_mass_m2pkg: float
    start_s: float  # of fixes before there can be a state
    acquisition_s: float  # these and those after
    outage_s: float
    drawn: dict[str, float]

    @property
    def where(self) -> str:
        """Its name in messages."""
        return f"run {self.run}"


def draw(ensemble: Ensemble, seeds: Seeds, run: int, table_set: str, outage_s: float | None = None) -> Draw:
    """The run of that number. The same for the same ensemble and seeds, whatever else is flown.

    outage_s: whole seconds of its outage instead of those drawn; all else is as it would be.
    """
    cell = ensemble.cells[run % len(ensemble.cells)]
    low_km, high_km = CELLS[cell].altitude_km
    of_run = seeds.of_run(run)
    rng = np.random.default_rng(of_run)
    days = days_of(CELLS[cell].f107_sfu)
    weather = days[_order(seeds, cell, len(days))[run // len(ensemble.cells) % len(days)]]
    start = datetime.combine(weather.day, time()) + timedelta(seconds=int(rng.integers(0, 86_399))) + _TICK_PHASE

    perigee_km = float(rng.uniform(low_km, high_km))
    widest = (ensemble.apogee_km - perigee_km) / (ensemble.apogee_km + perigee_km + 2.0 * EARTH_RADIUS_KM)
    eccentricity = _log(rng, (ensemble.eccentricity[0], min(ensemble.eccentricity[1], widest)))
    axis_m = 1e3 * (EARTH_RADIUS_KM + perigee_km) / (1.0 - eccentricity)
    inclination, node, perigee, latitude = rng.uniform(0.0, 1.0, 4) * (1.0, 360.0, 360.0, 360.0)
    inclination = ensemble.inclination_deg[0] + inclination * (
        ensemble.inclination_deg[1] - ensemble.inclination_deg[0]
    )

    area = _log(rng, ensemble.area_to_mass_m2pkg)
    drag = DRAG_COEFFICIENT * (1.0 + ensemble.drag_error * float(np.clip(rng.standard_normal(), -2.5, 2.5)))
    radiation = RADIATION_COEFFICIENT * (
        1.0 + ensemble.radiation_error * float(np.clip(rng.standard_normal(), -2.5, 2.5))
    )
    step = _log(rng, ensemble.area_step)

    period_s = 2.0 * math.pi * math.sqrt(axis_m**3 / MU_PAPER_M3PS2)
    acquisition = float(rng.choice(ensemble.acquisition_s))
    alone = bool(rng.random() < ensemble.positions_alone_share)
    start_s = ensemble.positions_arc_s if alone else 0.0
    acquisition_s = start_s + float(round(acquisition if acquisition > 0.0 else -acquisition * period_s))
    drawn_s = float(round(_log(rng, ensemble.outage_s)))
    outage_s = drawn_s if outage_s is None else outage_s
    outages = [{"start_s": acquisition_s, "duration_s": outage_s}]
    end_s = acquisition_s + outage_s
    # every draw is made in every run, used or not: a share that changes leaves all else as it was
    gap_s, second_s, has_second = (
        round(_log(rng, ensemble.second_gap_s)),
        round(_log(rng, ensemble.second_s)),
        rng.random() < ensemble.second_share,
    )
    if has_second:
        outages.append({"start_s": end_s + gap_s, "duration_s": float(second_s)})
        end_s += gap_s + second_s
    burns = _burns(ensemble, rng, acquisition_s, outage_s)

    sigma_m = _log(rng, ensemble.sigma_position_m)
    gnss: dict[str, Any] = {
        "rate_hz": 1.0,
        "sigma_position_m": sigma_m,
        "sigma_velocity_mps": sigma_m * ensemble.velocity_to_position_ps,
        "latency_s": float(rng.uniform(*ensemble.latency_s)),
    }
    coloured = {
        "coloured_sigma_m": _log(rng, ensemble.coloured_sigma_m),
        "coloured_tau_s": _log(rng, ensemble.coloured_tau_s),
        "periodic_sigma_m": _log(rng, ensemble.periodic_sigma_m),
    }
    if ensemble.noise == "coloured":
        gnss |= coloured
    if alone:
        gnss["velocity"] = False
    oscillator = {
        "drift_ppm": float(rng.uniform(-ensemble.drift_ppm, ensemble.drift_ppm)),
        "random_walk": _log(rng, ensemble.random_walk),
        "pulse_jitter_ns": _log(rng, ensemble.pulse_jitter_ns),
        "drift_walk": _log(rng, ensemble.drift_walk),
    }
    tree: dict[str, Any] = {
        "name": f"run{run}",
        "seed": int(of_run.generate_state(1, np.uint64)[0] >> np.uint64(1)),
        "time": {"start": start.isoformat(), "scale": "gps", "duration_s": end_s + END_S},
        "orbit": {
            "semi_major_axis_m": axis_m,
            "eccentricity": eccentricity,
            "inclination_deg": float(inclination),
            "raan_deg": float(node),
            "argument_of_perigee_deg": float(perigee),
            "argument_of_latitude_deg": float(latitude),
        },
        "truth": {
            "area_to_mass_m2pkg": area,
            "drag_coefficient": drag,
            "srp_coefficient": radiation,
            "area_step": {"at_s": acquisition_s, "factor": step},
            "gravity_beyond": next((degree for below, degree in ensemble.gravity_beyond if perigee_km < below), 0),
        },
        "gnss": gnss,
        "outage": outages,
        "burn": burns,
        "oscillator": oscillator,
        "flight": {"table_set": table_set},
    }
    drawn = {
        "perigee_km": perigee_km,
        "eccentricity": eccentricity,
        "inclination_deg": float(inclination),
        "argument_of_latitude_deg": float(latitude),
        "area_to_mass_m2pkg": area,
        "drag_factor": drag / DRAG_COEFFICIENT,
        "area_step": step,
        "sigma_position_m": sigma_m,
        "coloured_sigma_m": float(gnss.get("coloured_sigma_m", 0.0)),
        "positions_alone": float(alone),
        "start_s": start_s,
        "drift_ppm": oscillator["drift_ppm"],
        "second_outage": float(has_second),
        "burns": float(len(burns)),
        "f107": weather.f107,
        "ap": weather.ap,
        "day": float(weather.day.toordinal()),
    }
    return Draw(run, cell, tree, weather, area, start_s, acquisition_s, outage_s, drawn)


def _burns(ensemble: Ensemble, rng: np.random.Generator, acquisition_s: float, outage_s: float) -> list[dict[str, Any]]:
    """None or one, in the first six tenths of the outage, whole seconds, announced half a minute before."""
    size, direction = _log(rng, ensemble.burn_dv_mps), rng.standard_normal(3)
    length_s, share, has_burn = _log(rng, ensemble.burn_s), rng.uniform(0.05, 0.6), rng.random() < ensemble.burn_share
    if not has_burn:
        return []
    return [
        {
            "start_s": float(round(acquisition_s + share * outage_s)),
            "duration_s": float(round(length_s)),
            "dv_mps": (size * direction / np.linalg.norm(direction)).tolist(),
            "announce_lead_s": 30.0,
            "sigma_mps": [ensemble.burn_error * size] * 3,
        }
    ]


def _log(rng: np.random.Generator, span: tuple[float, float]) -> float:
    """Uniform in the logarithm."""
    return float(math.exp(rng.uniform(math.log(span[0]), math.log(span[1]))))


@lru_cache(maxsize=4 * len(CELLS))
def _order(seeds: Seeds, cell: int, count: int) -> np.ndarray:
    return permuted(count, seeds.of_cell(cell))
