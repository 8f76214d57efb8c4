"""What a scenario may say: every section, key, unit, range and default.

The unit stands in the key's name. Ranges are physical, so narrow that a value in the wrong unit (km for
m, minutes for s) falls outside. `scenario.py` loads, overrides and explains; here is only what is allowed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import msgspec
from msgspec import Meta, Struct, field

from hil_sim.crosslink_schema import Crosslink, CrosslinkFault
from hil_sim.fault_kinds import CAN_FD_LENGTHS, KINDS, TARGETS
from hil_sim.pseudorange_schema import Pseudoranges, SatelliteFault
from hil_sim.scenario_section import Probability as Probability
from hil_sim.scenario_section import Section as Section
from hil_sim.scenario_section import StartAge as StartAge
from hil_sim.scenario_section import range_meta as _range

EARTH_RADIUS_M = 6_378_137.0
MINIMUM_ALTITUDE_M = 150e3


Moment = Annotated[str, Meta(description="calendar date and time, e.g. 2019-01-01T00:00:00")]


# each component, and what the three are
_Offset = Annotated[float, Meta(ge=-100.0, le=100.0)]
_Change = Annotated[float, Meta(ge=-200.0, le=200.0)]
_Sigma = Annotated[float, Meta(ge=0.0, le=50.0)]
AntennaOffset = Annotated[
    tuple[_Offset, _Offset, _Offset],
    Meta(description="body axes (flight direction, -normal, nadir), from the centre of mass, in metres"),
]
VelocityChange = Annotated[
    tuple[_Change, _Change, _Change], Meta(description="velocity change in the axes of `frame` in m/s")
]
VelocitySigma = Annotated[
    tuple[_Sigma, _Sigma, _Sigma],
    Meta(description="announced 1-sigma of dv_mps; what is flown is drawn from it; in m/s"),
]


class Time(Section, kw_only=True, frozen=True):
    start: Moment
    scale: Annotated[str, Meta(pattern="^(gps|utc|tai)$", description="gps, utc or tai")] = "gps"
    duration_s: Annotated[float, _range(10.0, 2e6, "simulated time in seconds")]


class Orbit(Section, frozen=True):
    """Where the truth comes from: osculating elements in GCRF at the start, or a file of a real orbit."""

    source: Annotated[
        str, Meta(pattern="^(propagated|file|sp3|georb)$", description="propagated, or file (sp3, georb: the same)")
    ] = "propagated"
    period_s: Annotated[float, _range(5200.0, 90000.0, "the Keplerian period in seconds")] | None = None
    semi_major_axis_m: Annotated[float, _range(6.5e6, 4.3e7, "semi-major axis in metres")] | None = None
    eccentricity: Annotated[float, _range(0.0, 0.2, "eccentricity")] = 0.001
    inclination_deg: Annotated[float, _range(0.0, 180.0, "inclination in degrees")] = 65.0
    raan_deg: Annotated[float, _range(-360.0, 360.0, "right ascension of the node in degrees")] = 0.0
    argument_of_perigee_deg: Annotated[float, _range(-360.0, 360.0, "argument of perigee in degrees")] = 0.0
    argument_of_latitude_deg: Annotated[float, _range(-360.0, 360.0, "argument of latitude in degrees")] = 0.0
    file: Annotated[str, Meta(description="file of a real orbit")] | None = None
    satellite: Annotated[str, Meta(description="which satellite of the file, if it holds several")] | None = None
    velocity_unit: Annotated[
        str,
        Meta(pattern="^(auto|dm/s|m/s|km/s|derive)$", description="auto, dm/s, m/s, km/s, or derive from positions"),
    ] = "auto"
    time_scale: (
        Annotated[str, Meta(pattern="^(gps|utc|tai|tt)$", description="gps, utc, tai or tt instead of the file's")]
        | None
    ) = None


class AreaStep(Section, kw_only=True, frozen=True):
    """The cross-section jumps once: a satellite that falls into safe mode turns, and its panels with it."""

    at_s: Annotated[float, _range(1.0, 1e7, "seconds after the scenario's start, 1 at least")]
    factor: Annotated[float, _range(0.1, 10.0, "cross-section afterwards over that before")]


class TruthModel(Section, frozen=True):
    """Forces of the propagated truth."""

    gravity_degree: Annotated[int, Meta(ge=2, le=70, description="degree and order of EGM2008")] = 70
    gravity_beyond: Annotated[
        int, Meta(ge=0, le=120, description="degree to which gravity above gravity_degree is added; 0: none")
    ] = 0
    area_to_mass_m2pkg: Annotated[float, _range(0.0, 1.0, "area over mass in m2/kg")] = 0.01
    drag_coefficient: Annotated[float, _range(0.0, 10.0, "drag coefficient")] = 2.2
    srp_coefficient: Annotated[float, _range(0.0, 5.0, "radiation-pressure coefficient")] = 1.3
    area_step: Annotated[AreaStep, Meta(description="step of the cross-section: at_s, factor")] | None = None
    sun: Annotated[bool, Meta(description="attraction of the Sun, true or false")] = True
    moon: Annotated[bool, Meta(description="attraction of the Moon, true or false")] = True
    tides: Annotated[bool, Meta(description="solid tides, true or false")] = True
    solar: Annotated[
        str,
        Meta(pattern=r"^(data|fixed:\d+(\.\d+)?)$", description='"data", or "fixed:120" for F10.7 = 120'),
    ] = "data"
    space_weather_file: Annotated[str, Meta(description="SW-All.csv, not the packaged one")] | None = None
    earth_orientation_file: Annotated[str, Meta(description="finals2000A.all, not the packaged one")] | None = None

    @property
    def fixed_f107(self) -> float | None:
        """F10.7 in solar flux units if the scenario fixes it."""
        return float(self.solar.partition(":")[2]) if self.solar.startswith("fixed:") else None


class Gnss(Section, kw_only=True, frozen=True):
    """Receiver model. Sigmas are per axis."""

    rate_hz: Annotated[float, _range(0.01, 20.0, "fixes per second")] = 1.0
    sigma_position_m: Annotated[float, _range(0.0, 1e4, "white position noise per axis in metres")]
    sigma_velocity_mps: Annotated[float, _range(0.0, 1e3, "white velocity noise per axis in m/s")]
    coloured_sigma_m: Annotated[float, _range(0.0, 1e4, "correlated position error per axis in metres")] = 0.0
    coloured_tau_s: Annotated[float, _range(1.0, 1e6, "correlation time in seconds")] = 600.0
    periodic_sigma_m: Annotated[
        float, _range(0.0, 1e4, "amplitude of the error with the period of the orbit per RTN axis in metres")
    ] = 0.0
    claimed_sigma_m: (
        Annotated[float, _range(1e-3, 1e4, "sigma the receiver claims, if not its white noise, in metres")] | None
    ) = None
    velocity: Annotated[bool, Meta(description="whether fixes come with a velocity")] = True
    antenna_offset_m: AntennaOffset = (0.0, 0.0, 0.0)
    # fixes solved from a real receiver's RINEX observations and SP3 orbits; the simulated receiver is then silent
    recorded: Annotated[str, Meta(description="observations of a real receiver instead of a model")] | None = None
    recorded_orbits: Annotated[tuple[str, ...], Meta(description="precise orbits of the days of `recorded`")] = ()
    recorded_antennas: Annotated[
        bool, Meta(description="whether the places of the satellites' antennas are corrected for, true or false")
    ] = True
    latency_s: Annotated[float, _range(0.0, 10.0, "measurement to arrival on the bus in seconds")] = 0.2
    dropout_probability: Probability = 0.0
    satellites: Annotated[int, Meta(ge=0, le=64, description="satellites reported in a fix")] = 12


class Outage(Section, frozen=True):
    """No GNSS position, velocity or time pulse reaches flight in [start_s, start_s + duration_s)."""

    start_s: StartAge
    duration_s: Annotated[float, _range(1.0, 1e7, "seconds")]


class Oscillator(Section, frozen=True):
    """The onboard counter: offset + (1 + drift) t + random walks of its phase and of its drift."""

    offset_s: Annotated[float, _range(-1e8, 1e8, "reading at the scenario's start in seconds")] = 1000.0
    drift_ppm: Annotated[float, _range(-100.0, 100.0, "frequency error in parts per million")] = 1.0
    random_walk: Annotated[float, _range(0.0, 1e-6, "phase random walk in s/sqrt(s)")] = 1e-10
    drift_walk: Annotated[float, _range(0.0, 1e-6, "random walk of the drift in 1/sqrt(s)")] = 0.0
    pulse_jitter_ns: Annotated[float, _range(0.0, 1e6, "1-sigma of a latched pulse in nanoseconds")] = 50.0


class Attitude(Section, kw_only=True, frozen=True):
    """The attitude that is reported on the bus, and by how much the body is turned from nadir (yaw, pitch, roll)."""

    rate_hz: Annotated[float, _range(0.01, 20.0, "attitudes per second")] = 1.0
    sigma_rad: Annotated[float, _range(0.0, 0.5, "white error about each body axis in radians")]
    yaw_deg: Annotated[float, _range(-180.0, 180.0, "first turn, about the body's z axis, in degrees")] = 0.0
    pitch_deg: Annotated[float, _range(-90.0, 90.0, "second turn, about the body's y axis, in degrees")] = 0.0
    roll_deg: Annotated[float, _range(-180.0, 180.0, "third turn, about the body's x axis, in degrees")] = 0.0
    latency_s: Annotated[float, _range(0.0, 10.0, "attitude to arrival on the bus in seconds")] = 0.05


class Burn(Section, kw_only=True, frozen=True):
    """A manoeuvre: a velocity change, spread evenly over its duration. Propagated truth only."""

    start_s: Annotated[float, _range(1.0, 1e7, "seconds after the scenario's start, 1 at least")]
    duration_s: Annotated[float, _range(0.1, 1e5, "how long the thrust lasts in seconds")]
    dv_mps: VelocityChange
    frame: Annotated[str, Meta(pattern="^(gcrf|rtn)$", description="axes of dv_mps: gcrf or rtn")] = "rtn"
    announced: Annotated[bool, Meta(description="whether a BURN frame tells flight of it")] = True
    announce_lead_s: Annotated[
        float, _range(-1e6, 1e6, "how long before the start it is announced in seconds; negative: afterwards")
    ] = 60.0
    sigma_mps: VelocitySigma = (0.0, 0.0, 0.0)


class Command(Section, kw_only=True, frozen=True):
    """What an onboard commander tells navigation, in a NAV_COMMAND frame."""

    at_s: StartAge
    command: Annotated[str, Meta(pattern="^(edit|reset_filter)$", description="edit or reset_filter")]
    target: (
        Annotated[str, Meta(pattern="^(position|velocity)$", description="what is edited: position or velocity")] | None
    ) = None
    value: (
        Annotated[
            str, Meta(pattern="^(auto|accept|reject|inhibit)$", description="how: auto, accept, reject or inhibit")
        ]
        | None
    ) = None


class Flight(Section, frozen=True):
    """Which tables fly, and overrides of their fields (checked when the table is built)."""

    table_set: Annotated[str, Meta(description="set of navigation parameters, by name")]
    table: Annotated[dict[str, Any], Meta(description="fields of the table to override")] = field(default_factory=dict)
    functions: Annotated[
        dict[str, str], Meta(description="functions beside navigation that fly: kind of table = name of the set")
    ] = field(default_factory=dict)
    function_table: Annotated[
        dict[str, dict[str, Any]], Meta(description="fields of their tables to override, by kind of table")
    ] = field(default_factory=dict)
    allow_saturating: Annotated[
        bool, Meta(description="for a study: fly a table whose bound settles below its limit, which flight refuses")
    ] = False


class Fault(Section, frozen=True):
    """Something that goes wrong between receiver and bus (kinds: fault_kinds.py)."""

    kind: Annotated[str, Meta(description="which fault")]
    start_s: StartAge
    duration_s: Annotated[float, _range(0.0, 1e7, "seconds")] = 1.0
    value: Annotated[float, Meta(description="how much, in the unit of the kind")] | None = None
    axis: Annotated[str, Meta(pattern="^(x|y|z|all)$", description="x, y, z or all (ITRF)")] = "x"
    target: Annotated[str, Meta(description="whose frames: " + ", ".join(TARGETS))] = "all"
    probability: Probability = 1.0
    hold_time: Annotated[bool, Meta(description="whether a frozen fix keeps its time stamp too")] = False


class Scenario(Section, kw_only=True, frozen=True):
    """One run, whole. Obtain it from `scenario.load`, never by hand."""

    name: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_\-]*$", description="lower-case letters, digits, _, -")]
    description: Annotated[str, Meta(description="one line for `hil_sim list`")] = ""
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1, description="seed of every random stream")] = 1
    time: Time
    orbit: Orbit
    truth: TruthModel = field(default_factory=TruthModel)
    gnss: Gnss
    attitude: Attitude | None = None
    outage: tuple[Outage, ...] = ()
    burn: tuple[Burn, ...] = ()
    command: tuple[Command, ...] = ()
    oscillator: Oscillator = field(default_factory=Oscillator)
    flight: Flight
    fault: tuple[Fault, ...] = ()
    crosslink: Crosslink | None = None
    crosslink_fault: tuple[CrosslinkFault, ...] = ()
    pseudoranges: Pseudoranges | None = None
    satellite_fault: tuple[SatelliteFault, ...] = ()


class Problem(NamedTuple):
    """What is wrong with a key, and what to do about it."""

    key: str
    what: str
    remedy: str


def cross_check(scenario: Scenario) -> Iterator[Problem]:
    """Everything one key alone cannot show to be impossible."""
    yield from _check_orbit(scenario.orbit)
    yield from _check_outages(scenario)
    for i, fault in enumerate(scenario.fault):
        yield from _check_fault(f"fault.{i}", fault, scenario.time.duration_s)
    period_ns = 1e9 / scenario.gnss.rate_hz
    if abs(period_ns - round(period_ns)) > 1e-3:
        yield Problem(
            "gnss.rate_hz",
            f"{scenario.gnss.rate_hz} fixes per second do not fall on whole GPS epochs",
            "use for example 0.1, 0.5, 1, 2, 4, 5 or 10",
        )


def _check_orbit(orbit: Orbit) -> Iterator[Problem]:
    if orbit.source == "propagated":
        if (orbit.period_s is None) == (orbit.semi_major_axis_m is None):
            yield Problem(
                "orbit.period_s",
                "period_s and semi_major_axis_m are both given" if orbit.period_s else "no size of the orbit",
                "give exactly one of period_s and semi_major_axis_m",
            )
            return
        if orbit.file is not None:
            yield Problem("orbit.file", "a propagated orbit reads no file", 'set source = "file"')
        if perigee_altitude_m(orbit) < MINIMUM_ALTITUDE_M:
            yield Problem(
                "orbit.eccentricity",
                f"perigee would be {perigee_altitude_m(orbit) / 1e3:.0f} km above the equator",
                f"keep it above {MINIMUM_ALTITUDE_M / 1e3:.0f} km",
            )
    elif orbit.file is None:
        yield Problem(
            "orbit.file",
            f'source = "{orbit.source}" needs a file',
            "give its path",
        )
    elif orbit.period_s is not None or orbit.semi_major_axis_m is not None:
        yield Problem("orbit.period_s", "elements have no effect on a replayed orbit", "remove them")


def semi_major_axis_m(orbit: Orbit) -> float:
    """Semi-major axis [m]; from the Keplerian period with GM of EGM2008 when the period is given."""
    if orbit.semi_major_axis_m is not None:
        return orbit.semi_major_axis_m
    assert orbit.period_s is not None
    return float((MU_EGM2008_M3PS2 * (orbit.period_s / (2.0 * 3.141592653589793)) ** 2) ** (1.0 / 3.0))


MU_EGM2008_M3PS2 = 3.986004415e14


def perigee_altitude_m(orbit: Orbit) -> float:
    """Perigee height above the equatorial radius [m]."""
    return semi_major_axis_m(orbit) * (1.0 - orbit.eccentricity) - EARTH_RADIUS_M


def _check_outages(scenario: Scenario) -> Iterator[Problem]:
    end_before = 0.0
    for i, outage in enumerate(scenario.outage):
        if outage.start_s >= scenario.time.duration_s:
            yield Problem(
                f"outage.{i}.start_s",
                f"starts at {outage.start_s:g} s, after the run's {scenario.time.duration_s:g} s",
                "start it earlier or lengthen time.duration_s",
            )
        if outage.start_s < end_before:
            yield Problem(f"outage.{i}.start_s", "overlaps the one before it", "list them in order of time")
        end_before = outage.start_s + outage.duration_s


def _check_fault(key: str, fault: Fault, run_s: float) -> Iterator[Problem]:
    kind = KINDS.get(fault.kind)
    if kind is None:
        yield Problem(f"{key}.kind", f"no such fault as {fault.kind!r}", "one of " + ", ".join(KINDS))
        return
    if fault.start_s >= run_s:
        yield Problem(f"{key}.start_s", f"starts after the run's {run_s:g} s", "start it earlier")
    if fault.target not in TARGETS:
        yield Problem(f"{key}.target", f"no such target as {fault.target!r}", "one of " + ", ".join(TARGETS))
    if kind.value is None and fault.value is not None:
        yield Problem(f"{key}.value", f"{fault.kind} takes no value", "remove it")
    if kind.value is not None:
        if fault.value is None and kind.default is None:
            yield Problem(f"{key}.value", f"{fault.kind} needs a value", f"give {kind.value}")
        if fault.value is not None and not kind.minimum <= fault.value <= kind.maximum:
            yield Problem(
                f"{key}.value",
                f"{fault.value:g} is outside {kind.minimum:g} to {kind.maximum:g}",
                f"it is {kind.value}",
            )
    if fault.kind == "truncate" and fault.value is not None and fault.value not in CAN_FD_LENGTHS:
        yield Problem(
            f"{key}.value",
            f"{fault.value:g} bytes is no CAN FD length",
            f"one of {', '.join(map(str, CAN_FD_LENGTHS))}",
        )
    if fault.hold_time and fault.kind != "frozen_fix":
        yield Problem(f"{key}.hold_time", "only frozen_fix can hold the time", "remove it")


def field_docs(section: type[Struct]) -> dict[str, str]:
    """Description of every key of a section, for error texts and `hil_sim show`."""
    docs = {}
    for info in msgspec.inspect.type_info(section).fields:  # type: ignore[attr-defined]
        extra = getattr(info.type, "extra_json_schema", None) or {}
        if not extra and hasattr(info.type, "types"):
            for option in info.type.types:
                extra = getattr(option, "extra_json_schema", None) or extra
        docs[info.name] = str(extra.get("description", ""))
    return docs
