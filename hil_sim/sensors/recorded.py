"""A real receiver in the place of the simulated one: its recorded observations, solved, are the fixes of the run.

Outages, dropouts, latency and faults of the scenario befall them as any other. The time pulse is still simulated: none
was recorded.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError
from hil_sim.gnss.recording import Recording, solve_recording
from hil_sim.scenario import LoadedScenario, resolve_data_file
from hil_sim.scenario_schema import Gnss, Outage
from hil_sim.sensors.attitude import Pointing
from hil_sim.sensors.gnss_receiver import FIX_3D, POSITION_3D, FixSeries, count_sent, in_outage, latch
from hil_sim.sensors.oscillator import Oscillator
from hil_sim.sensors.streams import Streams
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.interface import Truth

# what stands in the place of a velocity that is not there, and is not sent
_NO_VELOCITY_SIGMA_MPS = 1.0


class Files(NamedTuple):
    """Observations (RINEX), precise orbits and clocks (SP3), and whether the satellites' antennas are put in place."""

    observations: Path
    orbits: tuple[Path, ...]
    antennas: bool


class Receiver(Protocol):
    """What measures the fixes of a run; arguments as in `gnss_receiver.measure_fixes`."""

    def __call__(
        self,
        truth: Truth,
        orientation: EarthOrientation,
        oscillator: Oscillator,
        gnss: Gnss,
        outages: tuple[Outage, ...],
        t_start_gps_ns: int,
        t_last_gps_ns: int,
        jitter_ns: float,
        streams: Streams,
        pointing: Pointing | None = None,
    ) -> FixSeries: ...


def receiver_of(loaded: LoadedScenario) -> Receiver:
    """The receiver whose observations the scenario names. Raises DataError where a file is missing."""
    gnss = loaded.scenario.gnss
    assert gnss.recorded is not None
    observations = resolve_data_file(gnss.recorded, loaded.path, "gnss.recorded")
    orbits = (
        resolve_data_file(text, loaded.path, f"gnss.recorded_orbits.{i}") for i, text in enumerate(gnss.recorded_orbits)
    )
    return partial(measure_fixes, Files(observations, tuple(orbits), gnss.recorded_antennas))


def measure_fixes(
    files: Files,
    truth: Truth,
    orientation: EarthOrientation,
    oscillator: Oscillator,
    gnss: Gnss,
    outages: tuple[Outage, ...],
    t_start_gps_ns: int,
    t_last_gps_ns: int,
    jitter_ns: float,
    streams: Streams,
    pointing: Pointing | None = None,
) -> FixSeries:
    """The recorded fixes of [t_start, t_last]; where `gnss.velocity` is set, those that have one. Raises DataError.

    error_gcrf_m is against the true position of the antenna, `gnss.antenna_offset_m` from the centre of mass.
    """
    recording = solve_recording(files.observations, files.orbits, files.antennas, orientation.path)
    rows = _rows(recording, files, gnss, t_start_gps_ns, t_last_gps_ns)
    t = recording.t_gps_ns[rows]
    n = len(t)
    r_gcrf_m, _ = truth.state_gcrf(t)
    antenna_gcrf_m = r_gcrf_m
    if any(gnss.antenna_offset_m):
        antenna_gcrf_m = r_gcrf_m + (pointing or Pointing()).lever(truth, t, np.array(gnss.antenna_offset_m))[0]
    r_itrf_m = recording.r_itrf_m[rows].copy()
    found_gcrf_m, _ = orientation.to_gcrf(t, r_itrf_m, np.zeros_like(r_itrf_m))
    dropped = streams.dropouts.random(n) < gnss.dropout_probability
    sent = ~(dropped | in_outage(t, outages, t_start_gps_ns))
    counter = count_sent(sent)
    has_velocity = recording.has_velocity[rows, None]
    return FixSeries(
        t_true_gps_ns=t.copy(),
        t_gps_ns=t.copy(),
        t_counter_ns=latch(oscillator, t, jitter_ns, streams.pulse_jitter),
        arrival_gps_ns=t + round(gnss.latency_s * 1e9),
        sent=sent,
        r_itrf_m=r_itrf_m,
        v_itrf_mps=np.where(has_velocity, recording.v_itrf_mps[rows], 0.0),
        sigma_r_m=recording.sigma_r_m[rows].copy(),
        sigma_v_mps=np.where(has_velocity, recording.sigma_v_mps[rows], _NO_VELOCITY_SIGMA_MPS),
        satellites=recording.satellites[rows].astype(np.uint8),
        fix_type=np.full(n, FIX_3D if gnss.velocity else POSITION_3D, dtype=np.uint8),
        counter_position=counter,
        counter_velocity=counter.copy(),
        r_true_gcrf_m=r_gcrf_m,
        error_gcrf_m=found_gcrf_m - antenna_gcrf_m,
        has_velocity=gnss.velocity,
    )


def _rows(recording: Recording, files: Files, gnss: Gnss, t_first_gps_ns: int, t_last_gps_ns: int) -> np.ndarray:
    """Fixes of the run. Raises DataError where there is none."""
    t = recording.t_gps_ns
    inside = (t >= t_first_gps_ns) & (t <= t_last_gps_ns)
    if gnss.velocity:
        inside &= recording.has_velocity
    if not inside.any():
        has = f"{gps_time.to_calendar(int(t[0]))} to {gps_time.to_calendar(int(t[-1]))}"
        what = "velocities" if gnss.velocity and not recording.has_velocity.any() else "fixes"
        raise DataError(
            f"{files.observations}: no {what} in the run, which begins {gps_time.to_calendar(t_first_gps_ns)} GPS; "
            f"fixes are from {has}; set time.start and time.duration_s inside it, or gnss.velocity = false"
        )
    return np.flatnonzero(inside)
