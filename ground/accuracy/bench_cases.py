"""What the accuracy bench flies: orbits, profiles of fixes, and the plan of flights along an orbit.

A case is one orbit with one profile. It is one long flight with fixes, and one arc for each outage start: an arc begins
anew, converges on fixes whose noise no other arc shares, loses them, and gets them back.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from ground.errors import OperatorError, did_you_mean
from ground.tables.build import list_sets
from ground.tables.gps_time import NS_PER_S
from hil_sim.truth.orbit_files.read import read_orbit
from hil_sim.truth.real_orbit import DataError, evenly_spaced

AGES_S = (60, 300, 900, 2000, 5580, 7200)  # since the last fix
CURVE_STEP_S = 20  # between the ages at which errors are kept; divides all of AGES_S
RETURNS_S = (600, 2000, 7200)  # outages after which fixes come back
RETURN_S = 900  # of fixes after an outage
CONVERGENCE_S = 12_000  # two revolutions before an outage
SPACING_S = 1000  # between outage starts
LONGEST_S = 86_400
MARGIN_S = 5  # of truth beyond the end of a flight
SHORTEST_CONVERGENCE_S = 1500


class Orbit(NamedTuple):
    """An orbit as a scenario reads it. start is GPS time; what is simulated begins wherever a flight begins."""

    name: str
    scenario: str
    start: datetime
    span_s: int
    area_to_mass_m2pkg: float
    settings: tuple[str, ...] = ()
    file: str | None = None  # of the orbit, below the data folder or absolute
    period_s: float | None = None  # of a simulated orbit


# Cross-section by mass from public figures: GRACE-FO 600 kg and 1.0 m2 (frontal: drag is what counts there), Sentinel-3
# 1150 kg, body of 2.2 m by 3.7 m (ESA, facts and figures) and 2 / pi of an array of 10.5 m2 that turns with the Sun,
# Sentinel-1 2200 kg, Jason-2 510 kg, with their solar arrays.
_SENTINEL_3A = "leo_sp3/ssas3a20.b18358.e19003.DG_.sp3.gz"
_GRACE_FO = "leo_gracefo/GRACE-C_59412_orbit_crf.orb.gz"
_JASON_2 = "leo_sp3/grgja203.b08243.e08247.D_S.sp3.gz"
_SENTINEL_1A = "leo_sentinel1a/S1A_OPER_AUX_RESORB_OPOD_20230823T162050_V20230823T123139_20230823T154909.EOF.gz"
_ANY_FILE = "gracefo_outage"  # the scenario whose orbit any file may replace
_SIMULATED = (
    "orbit.semi_major_axis_m=6878136.3",
    "orbit.inclination_deg=97.5",
    "truth.area_to_mass_m2pkg=0.01",
    'truth.solar="data"',
)
_SIMULATED_PERIOD_S = 2.0 * math.pi * math.sqrt(6878136.3**3 / 3.986004415e14)

ORBITS = {
    orbit.name: orbit
    for orbit in (
        Orbit("sentinel3a", "sentinel3a_outage", datetime(2018, 12, 30), LONGEST_S, 0.013, (), _SENTINEL_3A),
        Orbit("gracefo", "gracefo_outage", datetime(2021, 7, 17, 0, 5), 85_400, 0.0018, (), _GRACE_FO),
        Orbit(
            "jason2",
            _ANY_FILE,
            datetime(2008, 8, 31),
            LONGEST_S,
            0.02,
            ('orbit.source="file"', f'orbit.file="{_JASON_2}"'),
            _JASON_2,
        ),
        Orbit(
            "sentinel1a",
            _ANY_FILE,
            datetime(2023, 8, 23, 12, 32),
            11_840,
            0.01,
            ('orbit.source="file"', f'orbit.file="{_SENTINEL_1A}"'),
            _SENTINEL_1A,
        ),
        Orbit("simulated", "two_orbits", datetime(2019, 1, 1), LONGEST_S, 0.01, _SIMULATED, None, _SIMULATED_PERIOD_S),
        # the real orbits at hand are all of a quiet Sun; this day had F10.7 = 158 and a storm of ap = 94
        Orbit(
            "simulated_storm",
            "two_orbits",
            datetime(2014, 2, 19),
            LONGEST_S,
            0.01,
            _SIMULATED,
            None,
            _SIMULATED_PERIOD_S,
        ),
    )
}

_FIXES = ("gnss.rate_hz=1.0", "gnss.sigma_position_m=10.0", "gnss.sigma_velocity_mps=0.1")
_FREE = "oscillator.drift_ppm=1.0"  # as the scenarios have it: also random walk and pulse jitter

PROFILES: dict[str, tuple[str, ...]] = {
    "white": (*_FIXES, _FREE),
    "position_only": (*_FIXES, _FREE, "gnss.velocity=false"),
    "coloured": (
        *_FIXES,
        _FREE,
        "gnss.coloured_sigma_m=5.0",
        "gnss.coloured_tau_s=300.0",
        "gnss.periodic_sigma_m=2.0",
    ),
    # the white profile with a clock that never errs: what the oscillator costs
    "white_perfect_clock": (
        *_FIXES,
        "oscillator.drift_ppm=0.0",
        "oscillator.random_walk=0.0",
        "oscillator.pulse_jitter_ns=0.0",
    ),
}
PERFECT_CLOCK = "white_perfect_clock"


@dataclass(frozen=True)
class Plan:
    """How an orbit is flown. All in seconds; begins_s: where arcs begin, from the start of the orbit.

    span_s: how long the orbit is known; flight_s: length of the one long flight.
    """

    span_s: int
    flight_s: int
    convergence_s: int
    ages_s: tuple[int, ...]
    returns_s: tuple[int, ...]
    return_s: int
    begins_s: tuple[int, ...]

    @classmethod
    def of(cls, span_s: int) -> Plan:
        """The plan for an orbit known for so long.

        Two revolutions of convergence where all ages fit behind them, else a third of the span; every start after
        which the least age fits, none left out. OperatorError where that would be too short to mean anything.
        """
        span = min(span_s, LONGEST_S)
        convergence = CONVERGENCE_S
        if span < CONVERGENCE_S + AGES_S[-1] + RETURN_S + MARGIN_S:
            convergence = span // 300 * 100
        if convergence < SHORTEST_CONVERGENCE_S:
            raise OperatorError(
                f"an orbit of {span_s} s is too short: {3 * SHORTEST_CONVERGENCE_S} s are the least; "
                "name a longer orbit file"
            )
        known = span - MARGIN_S
        last = known - convergence - AGES_S[0]
        return cls(known, known, convergence, AGES_S, RETURNS_S, RETURN_S, tuple(range(0, last + 1, SPACING_S)))

    def quick(self) -> Plan:
        """A few starts, short flights: whether all works, not how good it is."""
        return replace(
            self,
            flight_s=min(self.flight_s, 6000),
            convergence_s=min(self.convergence_s, 3000),
            ages_s=AGES_S[:3],
            returns_s=RETURNS_S[:1],
            begins_s=self.begins_s[:3],
        )

    @property
    def curve_s(self) -> range:
        """Ages at which errors are kept."""
        return range(CURVE_STEP_S, self.ages_s[-1] + 1, CURVE_STEP_S)

    def arc_s(self, begin_s: int) -> int:
        """Length of the arc that begins there: as long as the plan wants, or the orbit is known."""
        wanted = self.convergence_s + self.ages_s[-1] + self.return_s + MARGIN_S
        return min(wanted, self.span_s - begin_s)

    @property
    def shortened(self) -> bool:
        """Whether the orbit was too short for two revolutions of convergence."""
        return self.convergence_s < CONVERGENCE_S


@dataclass(frozen=True)
class Case:
    """One orbit with one profile. settings: keys of the scenario on top; gravity: an ICGEM file, None the packaged."""

    orbit: Orbit
    profile: str
    plan: Plan
    table_set: str
    settings: tuple[str, ...] = ()
    gravity: Path | None = None
    degree: int | None = None

    @property
    def name(self) -> str:
        """Names its files."""
        return f"{self.orbit.name}-{self.profile}"

    def scenario_settings(self, part: int) -> tuple[str, ...]:
        """Keys of the scenario of a part: LONG_FLIGHT or the number of an arc."""
        begin_s = 0 if part == LONG_FLIGHT else self.plan.begins_s[part]
        length_s = self.plan.flight_s if part == LONG_FLIGHT else self.plan.arc_s(begin_s)
        moved: tuple[str, ...] = ()
        if self.orbit.period_s is not None:
            moved = (f"orbit.argument_of_latitude_deg={360.0 * (begin_s / self.orbit.period_s % 1.0)!r}",)
        start = self.orbit.start + timedelta(seconds=begin_s)
        return (
            "outage=[]",
            'time.scale="gps"',
            f'time.start="{start.isoformat()}"',
            f"time.duration_s={float(length_s)!r}",
            f"seed={seed(self.orbit.name, part)}",
            f'flight.table_set="{self.table_set}"',
            *moved,
            *self.orbit.settings,
            *PROFILES[self.profile],
            *self.settings,
        )


LONG_FLIGHT = -1


def seed(orbit: str, part: int) -> int:
    """Of the noise of a part: each its own, and the same for every profile, so that profiles compare fix by fix."""
    return int.from_bytes(hashlib.sha256(f"{orbit} {part}".encode()).digest()[:6], "little")


def orbit_of_file(
    path: Path,
    area_to_mass_m2pkg: float,
    satellite: str | None = None,
    velocity_unit: str = "auto",
    time_scale: str | None = None,
    start: datetime | None = None,
) -> Orbit:
    """The orbit of a file, named after it, from its beginning or a later start (GPS time), for a day at most.

    Raises OperatorError.
    """
    try:
        t_gps_ns = evenly_spaced(path, read_orbit(path, satellite, velocity_unit, time_scale)).t_gps_ns
    except DataError as error:
        raise OperatorError(str(error)) from error
    # from a whole second on, so that the arcs of an orbit differ by whole seconds
    first_s, last_s = -(-int(t_gps_ns[0]) // NS_PER_S), int(t_gps_ns[-1]) // NS_PER_S
    settings = ['orbit.source="file"', f"orbit.file={json.dumps(str(path.resolve()))}"]
    settings += [f"orbit.velocity_unit={json.dumps(velocity_unit)}"]
    settings += [] if satellite is None else [f"orbit.satellite={json.dumps(satellite)}"]
    settings += [] if time_scale is None else [f"orbit.time_scale={json.dumps(time_scale.lower())}"]
    name = re.sub(r"[^A-Za-z0-9_.]+", "_", path.name.partition(".")[0]) + ("" if satellite is None else f"_{satellite}")
    epoch = datetime(1980, 1, 6)
    begins = epoch + timedelta(seconds=first_s)
    if start is not None:
        wanted_s = math.ceil((start - epoch).total_seconds())
        if not first_s <= wanted_s < last_s:
            ends = epoch + timedelta(seconds=last_s)
            raise OperatorError(
                f"--start {start.isoformat()}: {path.name} is known from {begins.isoformat()} to {ends.isoformat()}"
            )
        first_s, begins = wanted_s, epoch + timedelta(seconds=wanted_s)
        name += f"_{begins:%Y%m%dT%H%M}"
    span_s = min(last_s - first_s, LONGEST_S)
    return Orbit(name, _ANY_FILE, begins, span_s, area_to_mass_m2pkg, tuple(settings), str(path.resolve()))


def chosen_profiles(text: str) -> tuple[str, ...]:
    """Profiles of a comma-separated list. OperatorError for one that does not exist."""
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    for name in names:
        if name not in PROFILES:
            hint = did_you_mean(name, PROFILES)
            raise OperatorError(f"--profiles {name}: none of {', '.join(PROFILES)}{hint}")
    if not names:
        raise OperatorError(f"--profiles: give one or more of {', '.join(PROFILES)}")
    return names


def cases_of(
    orbits: Sequence[Orbit],
    profiles: Sequence[str],
    table_set: str,
    settings: Sequence[str] = (),
    gravity: Path | None = None,
    degree: int | None = None,
    quick: bool = False,
) -> list[Case]:
    """Every orbit with every profile, orbits first; the set that flies is that of `set_of`."""
    found = []
    for orbit in orbits:
        plan = Plan.of(orbit.span_s)
        plan = plan.quick() if quick else plan
        for profile in profiles:
            found.append(Case(orbit, profile, plan, set_of(table_set, profile), tuple(settings), gravity, degree))
    return found


def set_of(table_set: str, profile: str) -> str:
    """The table set that flies with a profile: the one made for receivers of this kind, where such a one ships."""
    made_for_it = f"{table_set}_{profile}"
    return made_for_it if made_for_it in list_sets() else table_set
