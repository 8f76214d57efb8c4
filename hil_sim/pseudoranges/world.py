"""The pseudoranges of a scenario: sky, measurements, faults, frames, from its sections to what goes on the bus."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from hil_sim.frames import FrameSeries
from hil_sim.pseudoranges import recorded
from hil_sim.pseudoranges.faults import corrupt
from hil_sim.pseudoranges.frames import encode
from hil_sim.pseudoranges.receiver import RawSeries, measure
from hil_sim.pseudoranges.sky import PreciseSky, Sky, WalkerSky
from hil_sim.scenario import LoadedScenario, resolve_data_file
from hil_sim.sensors.attitude import Pointing
from hil_sim.sensors.oscillator import Oscillator
from hil_sim.sensors.streams import Streams
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.interface import Truth


class Sent(NamedTuple):
    """What was measured, with faults, and the frames of it."""

    series: RawSeries
    frames: list[FrameSeries]


def build(
    loaded: LoadedScenario,
    truth: Truth,
    orientation: EarthOrientation,
    oscillator: Oscillator,
    t_start_gps_ns: int,
    t_last_gps_ns: int,
    streams: Streams,
) -> Sent:
    """Pseudoranges of the run; the scenario has a section of them. Raises DataError where a file is missing."""
    scenario = loaded.scenario
    settings = scenario.pseudoranges
    assert settings is not None
    gnss, jitter_ns = scenario.gnss, scenario.oscillator.pulse_jitter_ns
    sky: Sky
    if gnss.recorded is not None:
        paths = _paths(loaded, gnss.recorded_orbits, "gnss.recorded_orbits")
        sky = PreciseSky(paths, orientation, gnss.recorded_antennas)
        series = recorded.measure(
            resolve_data_file(gnss.recorded, loaded.path, "gnss.recorded"),
            paths,
            gnss.recorded_antennas,
            truth,
            oscillator,
            scenario.outage,
            t_start_gps_ns,
            t_last_gps_ns,
            jitter_ns,
            streams.pseudoranges,
        )
    else:
        if settings.orbits:
            sky = PreciseSky(_paths(loaded, settings.orbits, "pseudoranges.orbits"), orientation)
        else:
            sky = WalkerSky(settings.constellations, t_start_gps_ns, orientation, streams.pseudoranges)
        series = measure(
            sky,
            truth,
            oscillator,
            settings,
            gnss,
            scenario.outage,
            t_start_gps_ns,
            t_last_gps_ns,
            jitter_ns,
            streams.pseudoranges,
            Pointing.of(scenario.attitude),
        )
    corrupt(scenario.satellite_fault, series, t_start_gps_ns)
    return Sent(series, encode(series, sky, settings))


def _paths(loaded: LoadedScenario, texts: tuple[str, ...], key: str) -> list[Path]:
    return [resolve_data_file(text, loaded.path, f"{key}.{i}") for i, text in enumerate(texts)]
