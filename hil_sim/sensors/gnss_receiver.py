"""GNSS receiver and its time pulse: what they measure, with noise, before faults.

Fixes are taken at exact GPS epochs (multiples of the fix period since the GPS epoch), in ITRF, at the phase centre of
the antenna; pulses at whole GPS seconds. Each latches the onboard counter at that instant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightsw.icd.enums import FixType
from hil_sim import gps_time
from hil_sim.scenario_schema import Gnss, Outage
from hil_sim.sensors.attitude import Pointing
from hil_sim.sensors.oscillator import Oscillator
from hil_sim.sensors.streams import Streams
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.interface import Truth
from hil_sim.truth.local_frames import argument_of_latitude, rtn_axes

FIX_3D, POSITION_3D = int(FixType.FIX_3D), int(FixType.POSITION_3D)
# no receiver claims to be perfect
MINIMUM_SIGMA_M = 1e-3
MINIMUM_SIGMA_MPS = 1e-5
MINIMUM_SYNC_SIGMA_NS = 1.0


@dataclass
class FixSeries:
    """Fixes of a run, one row an epoch. `t_true_gps_ns` is the instant measured, `t_gps_ns` what the frame will say.

    r_itrf_m, v_itrf_mps, sigma_r_m, sigma_v_mps: (n, 3). `sent` False: the receiver gives nothing.
    counter_position, counter_velocity: alive counters of the two frames, equal unless a fault parts them.
    r_true_gcrf_m (n,3): truth at the epoch, of the centre of mass; error_gcrf_m (n,3): measured minus true position of
    the antenna before faults. `has_velocity` False: no velocity frames go with the positions.
    """

    t_true_gps_ns: np.ndarray
    t_gps_ns: np.ndarray
    t_counter_ns: np.ndarray
    arrival_gps_ns: np.ndarray
    sent: np.ndarray
    r_itrf_m: np.ndarray
    v_itrf_mps: np.ndarray
    sigma_r_m: np.ndarray
    sigma_v_mps: np.ndarray
    satellites: np.ndarray
    fix_type: np.ndarray
    counter_position: np.ndarray
    counter_velocity: np.ndarray
    r_true_gcrf_m: np.ndarray
    error_gcrf_m: np.ndarray
    has_velocity: bool = True


@dataclass
class PulseSeries:
    """Time pulses of a run, one row a GPS second; fields as in FixSeries."""

    t_true_gps_ns: np.ndarray
    t_gps_ns: np.ndarray
    t_counter_ns: np.ndarray
    arrival_gps_ns: np.ndarray
    sent: np.ndarray
    sigma_ns: np.ndarray
    leap_seconds: np.ndarray
    status: np.ndarray
    counter: np.ndarray


def epochs_ns(t_first_gps_ns: int, t_last_gps_ns: int, period_ns: int) -> np.ndarray:
    """Multiples of the period in [first, last], int64 [ns]."""
    start = -(-int(t_first_gps_ns) // period_ns)
    stop = int(t_last_gps_ns) // period_ns
    return np.arange(start, stop + 1, dtype=np.int64) * period_ns


def in_outage(t_gps_ns: np.ndarray, outages: tuple[Outage, ...], t_start_gps_ns: int) -> np.ndarray:
    """(n,) bool: the instant lies in one of the scenario's outages."""
    since_s = (t_gps_ns - t_start_gps_ns) / 1e9
    hidden = np.zeros(len(t_gps_ns), dtype=bool)
    for outage in outages:
        hidden |= (since_s >= outage.start_s) & (since_s < outage.start_s + outage.duration_s)
    return hidden


def measure_fixes(
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
    """All fixes of [t_start, t_last]. pointing: how the body is turned; None for exactly to nadir.

    The claimed sigma is that of the white noise: a receiver does not know of an error that lasts.
    """
    t = epochs_ns(t_start_gps_ns, t_last_gps_ns, round(1e9 / gnss.rate_hz))
    n = len(t)
    r_gcrf_m, v_gcrf_mps = truth.state_gcrf(t)
    if any(gnss.antenna_offset_m):
        lever = (pointing or Pointing()).lever(truth, t, np.array(gnss.antenna_offset_m))
        r_itrf_m, v_itrf_mps = orientation.to_itrf(t, r_gcrf_m + lever[0], v_gcrf_mps + lever[1])
    else:
        r_itrf_m, v_itrf_mps = orientation.to_itrf(t, r_gcrf_m, v_gcrf_mps)
    noise_m = gnss.sigma_position_m * streams.position_noise.standard_normal((n, 3))
    noise_m += coloured_noise(streams.coloured_noise, n, 1.0 / gnss.rate_hz, gnss.coloured_sigma_m, gnss.coloured_tau_s)
    matrices, _ = orientation.rotations(t)
    periodic = gnss.periodic_sigma_m * streams.periodic_error.standard_normal((2, 3))
    if periodic.any():
        noise_m += np.einsum("nij,nj->ni", matrices, periodic_error(periodic, r_gcrf_m, v_gcrf_mps))
    dropped = streams.dropouts.random(n) < gnss.dropout_probability
    claimed_m = gnss.sigma_position_m if gnss.claimed_sigma_m is None else gnss.claimed_sigma_m
    sigma_m = max(claimed_m, MINIMUM_SIGMA_M)
    sent = ~(dropped | in_outage(t, outages, t_start_gps_ns))
    counter = count_sent(sent)
    return FixSeries(
        t_true_gps_ns=t,
        t_gps_ns=t.copy(),
        t_counter_ns=latch(oscillator, t, jitter_ns, streams.pulse_jitter),
        arrival_gps_ns=t + round(gnss.latency_s * 1e9),
        sent=sent,
        r_itrf_m=r_itrf_m + noise_m,
        v_itrf_mps=v_itrf_mps + gnss.sigma_velocity_mps * streams.velocity_noise.standard_normal((n, 3)),
        sigma_r_m=np.full((n, 3), sigma_m),
        sigma_v_mps=np.full((n, 3), max(gnss.sigma_velocity_mps, MINIMUM_SIGMA_MPS)),
        satellites=np.full(n, gnss.satellites, dtype=np.uint8),
        fix_type=np.full(n, FIX_3D if gnss.velocity else POSITION_3D, dtype=np.uint8),
        counter_position=counter,
        counter_velocity=counter.copy(),
        r_true_gcrf_m=r_gcrf_m,
        error_gcrf_m=np.einsum("nji,nj->ni", matrices, noise_m),
        has_velocity=gnss.velocity,
    )


def measure_pulses(
    oscillator: Oscillator,
    gnss: Gnss,
    outages: tuple[Outage, ...],
    t_start_gps_ns: int,
    t_last_gps_ns: int,
    jitter_ns: float,
    streams: Streams,
) -> PulseSeries:
    """All time pulses of [t_start, t_last]; in an outage there are none, as they come from the receiver."""
    t = epochs_ns(t_start_gps_ns, t_last_gps_ns, gps_time.NS)
    n = len(t)
    sent = ~in_outage(t, outages, t_start_gps_ns)
    return PulseSeries(
        t_true_gps_ns=t,
        t_gps_ns=t.copy(),
        t_counter_ns=latch(oscillator, t, jitter_ns, streams.pulse_jitter),
        arrival_gps_ns=t + round(gnss.latency_s * 1e9),
        sent=sent,
        sigma_ns=np.full(n, max(jitter_ns, MINIMUM_SYNC_SIGMA_NS)),
        leap_seconds=np.full(n, gps_time.leap_seconds(t_start_gps_ns), dtype=np.int64),
        status=np.ones(n, dtype=np.uint8),
        counter=count_sent(sent),
    )


def latch(oscillator: Oscillator, t: np.ndarray, jitter_ns: float, stream: np.random.Generator) -> np.ndarray:
    """Counter readings (n,) int64 [ns] latched at instants t, with the pulse's jitter."""
    jitter = np.rint(jitter_ns * stream.standard_normal(len(t))).astype(np.int64)
    return oscillator.counter_ns(t) + jitter


def count_sent(sent: np.ndarray) -> np.ndarray:
    """Alive counter of each epoch, advanced by every epoch that is sent (int64, not yet modulo 256)."""
    return np.cumsum(sent, dtype=np.int64) - 1


def periodic_error(amplitudes_m: np.ndarray, r_gcrf_m: np.ndarray, v_gcrf_mps: np.ndarray) -> np.ndarray:
    """Error (n,3) [m], GCRF, with the period of the orbit: A cos(u) + B sin(u) along the RTN axes.

    amplitudes_m: (2,3), A and B; u is the argument of latitude of the true r and v (n,3). The velocity, which is
    measured by Doppler, has none of it.
    """
    u = argument_of_latitude(r_gcrf_m, v_gcrf_mps)[:, None]
    error_rtn_m = amplitudes_m[0] * np.cos(u) + amplitudes_m[1] * np.sin(u)
    return np.einsum("nji,nj->ni", rtn_axes(r_gcrf_m, v_gcrf_mps), error_rtn_m)


def coloured_noise(stream: np.random.Generator, n: int, step_s: float, sigma: float, tau_s: float) -> np.ndarray:
    """First-order Gauss-Markov noise (n, 3), stationary from the first sample.

    x[k+1] = exp(-step/tau) x[k] + sigma sqrt(1 - exp(-2 step/tau)) w[k] (Gelb 1974, Applied Optimal Estimation, 3.8).
    """
    white = stream.standard_normal((n, 3))
    if sigma == 0.0 or n == 0:
        return np.zeros((n, 3))
    keep = float(np.exp(-step_s / tau_s))
    drive = sigma * float(np.sqrt(1.0 - keep * keep))
    state = np.empty((n, 3))
    state[0] = sigma * white[0]
    for k in range(1, n):
        state[k] = keep * state[k - 1] + drive * white[k]
    return state
