"""Sections of a scenario whose satellite is one of a constellation with crosslinks."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from hil_sim.scenario_section import Probability, Section, StartAge
from hil_sim.scenario_section import range_meta as _range

MAXIMUM_SATELLITES = 32
_Error = Annotated[float, Meta(ge=0.0, le=1e4)]
_Jump = Annotated[float, Meta(ge=-1e5, le=1e5)]
_Ramp = Annotated[float, Meta(ge=-1e3, le=1e3)]


class Crosslink(Section, frozen=True):
    """A Walker constellation whose satellites range to each other; the one that is flown is `own` of it.

    Its orbit is that of the scenario, the others' are Keplerian. What a satellite broadcasts of itself is the truth
    with the errors of a healthy upload. A terminal hands epochs of ranges, and every satellite's message, to flight.
    """

    satellites: Annotated[int, Meta(ge=4, le=MAXIMUM_SATELLITES, description="of the pattern")] = 24
    planes: Annotated[int, Meta(ge=1, le=8, description="that hold equal numbers of them")] = 3
    phasing: Annotated[int, Meta(ge=0, le=7, description="of the Walker pattern, 0 to planes - 1")] = 1
    own: Annotated[int, Meta(ge=1, le=MAXIMUM_SATELLITES, description="number of the flown satellite, from 1")] = 1
    period_s: Annotated[float, _range(1.0, 5.0, "from one epoch of ranges to the next in seconds")] = 1.0
    sigma_range_m: Annotated[float, _range(0.0, 1e3, "white noise of a range in metres")] = 11.8
    bias_m: Annotated[float, _range(-1e3, 1e3, "the same error of all ranges in metres")] = 0.0
    claimed_sigma_m: (
        Annotated[float, _range(1e-3, 1e3, "sigma the terminal claims, if not sigma_range_m, in metres")] | None
    ) = None
    dropout_probability: Probability = 0.0
    two_way: Annotated[bool, Meta(description="ranges are means of both ways, which know no clocks")] = False
    both: Annotated[bool, Meta(description="every pair is measured by both satellites, not by one")] = True
    exchange: Annotated[bool, Meta(description="whether the others tell what they measured")] = True
    central_angle_max_deg: Annotated[float, _range(1.0, 180.0, "of two satellites that range, in degrees")] = 86.0
    ephemeris_sigma_m: Annotated[
        tuple[_Error, _Error, _Error, _Error],
        Meta(description="1-sigma of a message: radial, along, cross, clock, in metres"),
    ] = (0.5, 3.5, 3.5, 0.0)
    ephemeris_rate_mps: Annotated[
        tuple[_Error, _Error, _Error, _Error],
        Meta(description="1-sigma of its growth: radial, along, cross, clock, in m/s"),
    ] = (0.0017, 0.0002, 0.0002, 0.0)
    upload_s: Annotated[float, _range(60.0, 86400.0, "from one upload to the next in seconds")] = 1800.0
    precise: Annotated[str, Meta(description="precise orbits (SP3) of a day of GLONASS, not a pattern")] | None = None
    broadcast: Annotated[str, Meta(description="messages (RINEX navigation) of that day")] | None = None
    latency_s: Annotated[float, _range(0.0, 10.0, "epoch to the arrival of its first frame in seconds")] = 0.1
    spread_s: Annotated[float, _range(0.0, 10.0, "over which the frames of an epoch are spread, in seconds")] = 0.5


class CrosslinkFault(Section, kw_only=True, frozen=True):
    """A wrong message of some satellites, which still call themselves healthy."""

    satellites: Annotated[tuple[int, ...], Meta(min_length=1, description="whose, numbers from 1")]
    start_s: StartAge
    duration_s: Annotated[float, _range(1.0, 1e7, "seconds")] = 1e7
    jump_m: Annotated[
        tuple[_Jump, _Jump, _Jump, _Jump], Meta(description="at once: radial, along, cross, clock, in metres")
    ] = (0.0, 0.0, 0.0, 0.0)
    ramp_mps: Annotated[
        tuple[_Ramp, _Ramp, _Ramp, _Ramp], Meta(description="growing: radial, along, cross, clock, in m/s")
    ] = (0.0, 0.0, 0.0, 0.0)
