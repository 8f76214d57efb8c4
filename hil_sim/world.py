"""The world of one run: truth, sensors, faults, frames, prepared before the first tick.

Flight ticks when its own counter says so: tick k is the instant at which the onboard counter reads
counter_ns(k) = counter_ns(0) + k tick_period. No true time reaches flight but through frames.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import can
import numpy as np

from hil_sim import announcements, crosslinks, faults, frames, gps_time
from hil_sim.bus import SEND_TIMEOUT_S
from hil_sim.errors import BusError, ScenarioError
from hil_sim.pseudoranges import evaluation as pseudorange_evaluation
from hil_sim.pseudoranges import world as pseudoranges
from hil_sim.pseudoranges.receiver import RawSeries
from hil_sim.scenario import LoadedScenario, resolve_data_file
from hil_sim.sensors import gnss_receiver, recorded
from hil_sim.sensors.attitude import Pointing
from hil_sim.sensors.oscillator import Oscillator
from hil_sim.sensors.streams import open_streams
from hil_sim.truth import burns, propagated, replayed
from hil_sim.truth.constellation.glonass_day import read_day
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.interface import TrackTruth

RESIDUAL_STEP_NS = 10 * gps_time.NS
MARGIN_NS = 2 * gps_time.NS


def build_truth(loaded: LoadedScenario) -> TrackTruth:
    """The scenario's true motion over its whole run; DataError when data are missing or do not cover it."""
    scenario, start = loaded.scenario, loaded.t_start_gps_ns
    # a slow oscillator ends its last tick after the nominal end of the run
    drift = abs(scenario.oscillator.drift_ppm) * 1e-6
    stop = start + round(scenario.time.duration_s * (1.0 + 2.0 * drift) * 1e9) + MARGIN_NS
    finals, weather = earth_orientation_file(loaded), space_weather_file(loaded)
    orbit = scenario.orbit
    if orbit.source == "propagated":
        return propagated.propagate(orbit, scenario.truth, start, stop - start, finals, weather, flown_burns(loaded))
    assert orbit.file is not None  # cross_check has seen to it
    path = resolve_data_file(orbit.file, loaded.path, "orbit.file")
    return replayed.load_truth(path, start, stop, orbit.satellite, orbit.velocity_unit, orbit.time_scale, finals)


def flown_burns(loaded: LoadedScenario) -> tuple[burns.FlownBurn, ...]:
    """The scenario's burns as they are flown, with the errors of execution that its seed gives."""
    scenario = loaded.scenario
    return burns.fly(scenario.burn, loaded.t_start_gps_ns, open_streams(scenario.seed).burns) if scenario.burn else ()


def earth_orientation_file(loaded: LoadedScenario) -> Path | None:
    """The finals2000A file the scenario names, or None for the packaged one."""
    return _optional(loaded, "earth_orientation_file")


def space_weather_file(loaded: LoadedScenario) -> Path | None:
    """The space weather file the scenario names, or None for the packaged one."""
    return _optional(loaded, "space_weather_file")


class Sensed(NamedTuple):
    """What the sensors of a run give: the onboard counter, fixes before they are frames, every frame that arrives."""

    oscillator: Oscillator
    fixes: gnss_receiver.FixSeries
    frames: frames.FrameSeries
    raw: RawSeries | None


def sense(loaded: LoadedScenario, truth: TrackTruth, tell: Callable[[str], None]) -> Sensed:
    """Sensors, faults and frames of a scenario along a truth that covers it. `tell` hears each stage in words."""
    scenario, start = loaded.scenario, loaded.t_start_gps_ns
    duration_ns = round(scenario.time.duration_s * 1e9)
    tell("sensors and faults")
    streams = open_streams(scenario.seed)
    oscillator = Oscillator(scenario.oscillator, start, duration_ns, streams.oscillator)
    orientation = EarthOrientation(start, start + duration_ns, earth_orientation_file(loaded))
    jitter_ns = scenario.oscillator.pulse_jitter_ns
    receiver = gnss_receiver.measure_fixes if scenario.gnss.recorded is None else recorded.receiver_of(loaded)
    fixes = receiver(
        truth,
        orientation,
        oscillator,
        scenario.gnss,
        scenario.outage,
        start,
        start + duration_ns,
        jitter_ns,
        streams,
        Pointing.of(scenario.attitude),
    )
    pulses = gnss_receiver.measure_pulses(
        oscillator, scenario.gnss, scenario.outage, start, start + duration_ns, jitter_ns, streams
    )
    raw = None
    if scenario.pseudoranges is not None:
        fixes.sent[:] = False  # the receiver gives pseudoranges; fixes are made of them on board
        raw = pseudoranges.build(loaded, truth, orientation, oscillator, start, start + duration_ns, streams)
    injector = faults.FaultInjector(scenario.fault, start, streams.faults)
    injector.corrupt_content(fixes, pulses)
    encoded = frames.encode(fixes, pulses)
    if raw is not None:
        encoded = frames.in_order([encoded, *raw.frames])
    sent = injector.corrupt_frames(encoded)
    # a late frame does not slip into an outage either
    sent = sent.keep(~gnss_receiver.in_outage(sent.arrival_gps_ns, scenario.outage, start))
    if scenario.burn or scenario.command or scenario.attitude is not None:
        flown = flown_burns(loaded)
        others = announcements.encode(scenario, flown, truth, start, start + duration_ns, streams)
        sent = frames.in_order([sent, injector.corrupt_frames(others, receiver=False)])
    if scenario.crosslink is not None:
        tell("crosslinks")
        links = crosslinks.encode(scenario, truth, start, start + duration_ns, streams.crosslinks, real_day(loaded))
        sent = frames.in_order([sent, injector.corrupt_frames(links, receiver=False)])
    return Sensed(oscillator, fixes, sent, None if raw is None else raw.series)


class World:
    """Everything outside flight. Obtain it from `World.build`."""

    def __init__(
        self,
        loaded: LoadedScenario,
        truth: TrackTruth,
        oscillator: Oscillator,
        tick_period_ns: int,
        fixes: gnss_receiver.FixSeries,
        sent_frames: frames.FrameSeries,
        raw: RawSeries | None = None,
    ) -> None:
        self.loaded = loaded
        self.scenario = loaded.scenario
        self.truth = truth
        self.oscillator = oscillator
        self.tick_period_ns = tick_period_ns
        self.t_start_gps_ns = loaded.t_start_gps_ns
        self.start_unix_ns = gps_time.to_unix_ns(self.t_start_gps_ns)
        self.leap_seconds = gps_time.leap_seconds(self.t_start_gps_ns)
        duration_ns = round(self.scenario.time.duration_s * 1e9)
        self.n_ticks = duration_ns // tick_period_ns
        self.counter0_ns = int(oscillator.counter_ns(np.array([self.t_start_gps_ns]))[0])
        counters = self.counter0_ns + np.arange(self.n_ticks, dtype=np.int64) * tick_period_ns
        self.t_true_gps_ns = oscillator.true_time_ns(counters)
        self.r_true_gcrf_m, self.v_true_gcrf_mps = truth.state_gcrf(self.t_true_gps_ns)
        self.frames_sent = 0
        self._fixes = fixes
        self.raw = raw  # pseudoranges as they are sent, where the scenario has them
        self._ids = sent_frames.frame_id
        self._payloads = sent_frames.payload
        # how many frames have arrived by the true instant of each tick
        self._due = np.searchsorted(sent_frames.arrival_gps_ns, self.t_true_gps_ns, side="right").tolist()

    @classmethod
    def build(
        cls,
        loaded: LoadedScenario,
        tick_period_ns: int = 100_000_000,
        progress: Callable[[str], None] | None = None,
    ) -> World:
        """Prepare truth, oscillator and every frame of the run. `progress` is told each stage in words."""
        tell = progress if progress is not None else _silent
        if round(loaded.scenario.time.duration_s * 1e9) < tick_period_ns:
            raise ScenarioError(f"{loaded.path}: time.duration_s: shorter than one tick; lengthen it")
        tell(f"truth: {loaded.scenario.orbit.source}")
        truth = build_truth(loaded)
        sensed = sense(loaded, truth, tell)
        return cls(loaded, truth, sensed.oscillator, tick_period_ns, sensed.fixes, sensed.frames, sensed.raw)

    def counter_ns(self, k: int) -> int:
        """Onboard counter at tick k [ns]."""
        return self.counter0_ns + k * self.tick_period_ns

    def frames_due(self, k: int) -> list[tuple[int, bytes]]:
        """Identifier and payload of every frame that arrives between ticks k - 1 and k, in order of arrival."""
        first = self._due[k - 1] if k else 0
        return list(zip(self._ids[first : self._due[k]], self._payloads[first : self._due[k]], strict=True))

    def busy_ticks(self) -> np.ndarray:
        """Ticks on which at least one frame is due, rising (m,) int64."""
        return np.flatnonzero(np.diff(self._due, prepend=0))

    def send_due(self, k: int, bus: can.BusABC, timestamp_s: float) -> int:
        """Send every frame that has arrived by the true instant of tick k, in order of arrival.

        timestamp_s: Unix time stamped on the messages (the caller's log time of the tick).
        Returns how many were sent; BusError when flight does not drain its bus.
        """
        stop = self._due[k]
        first = self.frames_sent
        if first >= stop:
            return 0
        for i in range(first, stop):
            message = can.Message(
                timestamp=timestamp_s,
                arbitration_id=self._ids[i],
                is_extended_id=False,
                is_fd=True,
                bitrate_switch=True,
                data=self._payloads[i],
            )
            try:
                bus.send(message, timeout=SEND_TIMEOUT_S)
            except can.CanError as error:
                raise BusError(f"tick {k}: the bus takes no frame ({error}); flight no longer drains it") from None
        self.frames_sent = stop
        return stop - first

    def skip_before(self, k: int) -> None:
        """Leave out frames that had arrived by tick k and were not sent."""
        if k > 0:
            self.frames_sent = max(self.frames_sent, self._due[k])

    @property
    def outages_gps_ns(self) -> np.ndarray:
        """Start and end of each outage in true GPS time, (k, 2) int64 [ns]."""
        spans = [
            (
                self.t_start_gps_ns + round(o.start_s * 1e9),
                self.t_start_gps_ns + round((o.start_s + o.duration_s) * 1e9),
            )
            for o in self.scenario.outage
        ]
        return np.array(spans, dtype=np.int64).reshape(-1, 2)

    def truth_arrays(self) -> dict[str, np.ndarray]:
        """What truth.npz holds: truth at ticks and at fixes, error of fixes before faults, dA, outages."""
        used = self._fixes.sent
        da_t = np.arange(self.t_true_gps_ns[0], self.t_true_gps_ns[-1] + 1, RESIDUAL_STEP_NS, dtype=np.int64)
        return {
            "tick": np.arange(self.n_ticks, dtype=np.int64),
            "t_true_gps_ns": self.t_true_gps_ns,
            "r_gcrf_m": self.r_true_gcrf_m,
            "v_gcrf_mps": self.v_true_gcrf_mps,
            "fix_t_gps_ns": self._fixes.t_true_gps_ns[used],
            "fix_r_gcrf_m": self._fixes.r_true_gcrf_m[used],
            "fix_error_m": self._fixes.error_gcrf_m[used],
            "da_t_gps_ns": da_t,
            "da_true_mps2": self.truth.acceleration_residual(da_t),
            "outages": self.outages_gps_ns,
            **self._burn_arrays(),
            **pseudorange_evaluation.truth_arrays(self.scenario, self.raw),
            **crosslinks.truth_arrays(self.scenario, real_day(self.loaded)),
        }

    def _burn_arrays(self) -> dict[str, np.ndarray]:
        """Burns (k,) of the run; nothing where there are none: start and announcement [s], NaN if it was not announced,
        commanded and flown velocity change (k,3) [m/s], whether its axes are RTN."""
        commanded = self.scenario.burn
        if not commanded:
            return {}
        told_s = [announcements.announced_s(burn) for burn in commanded]
        return {
            "burn_start_s": np.array([burn.start_s for burn in commanded]),
            "burn_duration_s": np.array([burn.duration_s for burn in commanded]),
            "burn_announced_s": np.array([np.nan if t_s is None else t_s for t_s in told_s]),
            "burn_rtn": np.array([burn.frame == "rtn" for burn in commanded]),
            "burn_dv_mps": np.array([burn.dv_mps for burn in commanded]),
            "burn_flown_dv_mps": np.array([burn.dv_mps for burn in flown_burns(self.loaded)]),
        }

    def save_truth(self, path: Path) -> None:
        """Write truth.npz."""
        np.savez(path, **self.truth_arrays())  # type: ignore[arg-type]


def real_day(loaded: LoadedScenario) -> crosslinks.RealDay | None:
    """The day of GLONASS that the scenario's crosslinks are of; None where they are a pattern's."""
    link = loaded.scenario.crosslink
    if link is None or link.precise is None or link.broadcast is None:
        return None
    precise, broadcast = (
        resolve_data_file(text, loaded.path, f"crosslink.{key}")
        for key, text in (("precise", link.precise), ("broadcast", link.broadcast))
    )
    day = read_day(precise, broadcast)
    return crosslinks.RealDay(day, link.satellites, loaded.t_start_gps_ns, earth_orientation_file(loaded))


def _optional(loaded: LoadedScenario, key: str) -> Path | None:
    text = getattr(loaded.scenario.truth, key)
    return None if text is None else resolve_data_file(text, loaded.path, f"truth.{key}")


def _silent(text: str) -> None:
    del text
