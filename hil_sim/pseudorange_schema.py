"""What a scenario may say of pseudoranges: the sky, the receiver, faults of satellites.

A scenario with `[pseudoranges]` has a receiver that sends these in the place of fixes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

from msgspec import Meta

from hil_sim.scenario_section import Section, StartAge, range_meta

SYSTEMS = ("gps", "glonass", "galileo", "beidou")  # in the order of flightsw.icd.enums.Constellation
LAWS = ("gauss", "uniform", "laplace", "student", "spikes")


class Kind(NamedTuple):
    """What befalls a satellite; `value`: its unit, None where it takes none."""

    why: str
    value: str | None = None


KINDS: dict[str, Kind] = {
    "step": Kind("its ranges are wrong by so much", "metres"),
    "ramp": Kind("its ranges drift away", "metres per second"),
    "lift": Kind("as a spoofer would: the ranges of all agree on a place that rises", "metres per second"),
    "nan": Kind("its ranges are no numbers"),
    "sigma": Kind("the receiver claims this sigma for it", "metres"),
    "duplicate": Kind("it is sent twice in an epoch"),
    "wrong_constellation": Kind("it is sent as one of this constellation", "number of a constellation"),
    "no_ephemeris": Kind("nothing is sent of its place"),
    "unhealthy": Kind("its place is sent as one not to be used"),
    "silent": Kind("it is not measured"),
}

_Metres = Annotated[float, range_meta(-1e6, 1e6, "metres")]


class Pseudoranges(Section, frozen=True):
    """The sky and a receiver of pseudoranges. Noise of every range is white, with this sigma whatever its law."""

    constellations: Annotated[
        tuple[str, ...], Meta(description="constellations in nominal Walker patterns: " + ", ".join(SYSTEMS))
    ] = ("gps", "glonass", "galileo")
    orbits: Annotated[
        tuple[str, ...], Meta(description="SP3 files: GPS satellites from there, and no other constellation")
    ] = ()
    rate_hz: Annotated[float, range_meta(0.01, 2.0, "epochs per second")] = 1.0
    mask_deg: Annotated[float, range_meta(-30.0, 60.0, "least elevation above the local horizontal in degrees")] = 5.0
    sigma_m: Annotated[float, range_meta(0.0, 1e4, "white noise of a range in metres")] = 1.0
    claimed_sigma_m: (
        Annotated[float, range_meta(1e-3, 1e4, "sigma the receiver claims, if not its noise, in metres")] | None
    ) = None
    law: Annotated[str, Meta(pattern=f"^({'|'.join(LAWS)})$", description=", ".join(LAWS))] = "gauss"
    signal_sigma_m: Annotated[
        float, range_meta(0.0, 1e3, "lasting error of each satellite's orbit and clock in metres")
    ] = 0.0
    ionosphere_m: Annotated[
        float, range_meta(0.0, 100.0, "vertical delay above the satellite, of one frequency, everywhere, in metres")
    ] = 0.0
    ionosphere_day_m: Annotated[
        float, range_meta(0.0, 100.0, "and what is added where it is two in the afternoon, in metres")
    ] = 0.0
    clock_bias_m: Annotated[float, range_meta(-1e6, 1e6, "receiver's clock error at the start, as range")] = 1000.0
    clock_drift_mps: Annotated[float, range_meta(-1e3, 1e3, "its drift in m/s")] = 1.0
    clock_walk_m: Annotated[float, range_meta(0.0, 1e3, "its random walk in m/sqrt(s)")] = 0.5
    inter_system_bias_m: Annotated[
        tuple[_Metres, _Metres, _Metres, _Metres],
        Meta(description="delay of each constellation in the receiver: GPS, GLONASS, Galileo, BeiDou, in metres"),
    ] = (0.0, -4.0, 2.7, 1.0)
    latency_s: Annotated[float, range_meta(0.0, 10.0, "measurement to the first frame on the bus in seconds")] = 0.2
    frame_spacing_s: Annotated[
        float, range_meta(0.0, 0.01, "between frames of an epoch: the bus is not flooded, in seconds")
    ] = 0.002
    ephemeris_interval_s: Annotated[float, range_meta(1.0, 60.0, "between two places of one satellite in seconds")] = (
        10.0
    )


class SatelliteFault(Section, kw_only=True, frozen=True):
    """Something wrong with navigation satellites (kinds: KINDS)."""

    kind: Annotated[str, Meta(description="which fault: " + ", ".join(KINDS))]
    constellation: Annotated[
        str, Meta(pattern=f"^(all|{'|'.join(SYSTEMS)})$", description="whose: all, " + ", ".join(SYSTEMS))
    ] = "all"
    satellites: Annotated[tuple[int, ...], Meta(description="numbers of satellites; none: see count")] = ()
    count: (
        Annotated[int, Meta(ge=1, le=64, description="so many of those in view, highest first; not given: every one")]
        | None
    ) = None
    start_s: StartAge
    duration_s: Annotated[float, range_meta(0.0, 1e7, "seconds")]
    value: Annotated[float, Meta(description="how much, in the unit of the kind")] | None = None


class Wrong(NamedTuple):
    """Key, what is wrong with it, remedy."""

    key: str
    what: str
    remedy: str


def check(sky: Pseudoranges | None, faults: tuple[SatelliteFault, ...], flies: bool, run_s: float) -> Iterator[Wrong]:
    """Everything one key alone cannot show to be impossible. flies: a table of the consistency test is named."""
    if sky is None:
        if faults:
            yield Wrong("satellite_fault.0.kind", "there are no pseudoranges to be wrong", "add [pseudoranges]")
        return
    if not flies:
        yield Wrong("pseudoranges", "no flight function would hear them", 'set flight.functions.gnss = "gnss"')
    for i, name in enumerate(sky.constellations):
        if name not in SYSTEMS or name in sky.constellations[:i]:
            yield Wrong(
                "pseudoranges.constellations", f"{name!r} is none, or twice there", f"from {', '.join(SYSTEMS)}"
            )
    if not sky.constellations and not sky.orbits:
        yield Wrong("pseudoranges.constellations", "there is no satellite", f"name some of {', '.join(SYSTEMS)}")
    period_ns = 1e9 / sky.rate_hz
    if abs(period_ns - round(period_ns)) > 1e-3:
        yield Wrong(
            "pseudoranges.rate_hz", "epochs do not fall on whole nanoseconds", "use for example 0.1, 0.5, 1 or 2"
        )
    for i, fault in enumerate(faults):
        key, kind = f"satellite_fault.{i}", KINDS.get(fault.kind)
        if kind is None:
            yield Wrong(f"{key}.kind", f"no such fault as {fault.kind!r}", "one of " + ", ".join(KINDS))
        elif (fault.value is None) != (kind.value is None):
            remedy = f"give {kind.value}" if kind.value else "remove it"
            yield Wrong(f"{key}.value", f"{fault.kind} takes {'a' if kind.value else 'no'} value", remedy)
        if fault.start_s >= run_s:
            yield Wrong(f"{key}.start_s", f"starts after the run's {run_s:g} s", "start it earlier")
        if fault.satellites and (fault.count is not None or fault.constellation == "all"):
            yield Wrong(f"{key}.satellites", "numbers belong to one constellation", "name it, and give no count")
