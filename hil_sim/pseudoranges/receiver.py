"""What a receiver in low orbit measures of its sky: visibility, light time, clocks, delays, noise; before faults."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hil_sim.gnss.precise_ephemeris import LIGHT_MPS
from hil_sim.gps_time import NS
from hil_sim.pseudorange_schema import Pseudoranges
from hil_sim.pseudoranges import ionosphere
from hil_sim.pseudoranges.sky import Sky
from hil_sim.scenario_schema import Gnss, Outage
from hil_sim.sensors.attitude import Pointing
from hil_sim.sensors.gnss_receiver import epochs_ns, in_outage, latch
from hil_sim.sensors.oscillator import Oscillator
from hil_sim.truth.interface import Truth

EARTH_RADIUS_M = 6_378_137.0
LIMB_M = 50_000.0  # a ray that passes lower is bent and weak
_SPIKE_SHARE, _SPIKE_SIZE = 0.01, 10.0
_BLOCK = 4096  # epochs at a time
_AFTER_START_NS = NS  # the receiver's clock may be milliseconds off: its epochs must lie in the run


@dataclass
class RawSeries:
    """Pseudoranges of a run, n epochs of s satellites. `seen` (n,s): measured; range_m, sigma_m (n,s) as they are sent.

    t_true_gps_ns (n,): instants measured; t_gps_ns (n,): by the receiver's clock; t_counter_ns (n,); sent (n,).
    system, number (s,). repeats (n,s): times that a row is sent; system_sent (n,s): the constellation told.
    elevation_rad (n,s). usable (n,s): the place of the satellite may be sent; healthy (n,s): as one to be used.
    struck: satellites (s,) bool of each fault of the scenario.
    """

    t_true_gps_ns: np.ndarray
    t_gps_ns: np.ndarray
    t_counter_ns: np.ndarray
    sent: np.ndarray
    seen: np.ndarray
    range_m: np.ndarray
    sigma_m: np.ndarray
    elevation_rad: np.ndarray
    system: np.ndarray
    number: np.ndarray
    repeats: np.ndarray
    system_sent: np.ndarray
    usable: np.ndarray
    healthy: np.ndarray
    r_true_gcrf_m: np.ndarray
    struck: tuple[np.ndarray, ...] = ()


def noise(law: str, stream: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Errors of zero mean and unit variance."""
    if law == "uniform":
        return stream.uniform(-math.sqrt(3.0), math.sqrt(3.0), shape)
    if law == "laplace":
        return stream.laplace(0.0, math.sqrt(0.5), shape)
    if law == "student":
        return stream.standard_t(5, shape) * math.sqrt(3.0 / 5.0)
    white = stream.standard_normal(shape)
    if law == "spikes":
        size = np.where(stream.random(shape) < _SPIKE_SHARE, _SPIKE_SIZE, 1.0)
        return white * size / math.sqrt(1.0 - _SPIKE_SHARE + _SPIKE_SHARE * _SPIKE_SIZE**2)
    return white


def measure(
    sky: Sky,
    truth: Truth,
    oscillator: Oscillator,
    settings: Pseudoranges,
    gnss: Gnss,
    outages: tuple[Outage, ...],
    t_start_gps_ns: int,
    t_last_gps_ns: int,
    jitter_ns: float,
    stream: np.random.Generator,
    pointing: Pointing,
) -> RawSeries:
    """All epochs of the run, at whole multiples of the period by the receiver's own clock."""
    tag = epochs_ns(t_start_gps_ns + _AFTER_START_NS, t_last_gps_ns - _AFTER_START_NS, round(1e9 / settings.rate_hz))
    n, s = len(tag), len(sky.number)
    clock_m = _receiver_clock_m(settings, tag - t_start_gps_ns, stream)
    t_true = tag - np.rint(clock_m / LIGHT_MPS * 1e9).astype(np.int64)
    clock_m = (tag - t_true) / 1e9 * LIGHT_MPS
    r_gcrf_m, _ = truth.state_gcrf(t_true)
    antenna = r_gcrf_m
    if any(gnss.antenna_offset_m):
        antenna = r_gcrf_m + pointing.lever(truth, t_true, np.array(gnss.antenna_offset_m))[0]
    range_m, elevation, delay_m = np.empty((n, s)), np.empty((n, s)), np.zeros((n, s))
    layer = (settings.ionosphere_m, settings.ionosphere_day_m)
    for first in range(0, n, _BLOCK):
        part = slice(first, first + _BLOCK)
        range_m[part], elevation[part], ray = _geometry(sky, t_true[part], antenna[part])
        if any(layer):
            delay_m[part] = ionosphere.delay_m(*layer, sky.system, t_true[part], antenna[part], ray, elevation[part])
    radius = np.linalg.norm(antenna, axis=1)[:, None]
    past_limb = (elevation > 0.0) | (radius * np.cos(elevation) > EARTH_RADIUS_M + LIMB_M)
    seen = (elevation >= math.radians(settings.mask_deg)) & past_limb & np.isfinite(range_m)
    satellite = np.broadcast_to(np.arange(s), (n, s))
    emitted = t_true[:, None] - np.rint(np.nan_to_num(range_m) / LIGHT_MPS * 1e9).astype(np.int64)
    sky_clock_m = sky.clock_m(satellite, emitted)
    seen &= np.isfinite(sky_clock_m)
    range_m += clock_m[:, None] - sky_clock_m + np.array(settings.inter_system_bias_m)[sky.system]
    range_m += settings.sigma_m * noise(settings.law, stream, (n, s))
    range_m += settings.signal_sigma_m * stream.standard_normal(s)
    range_m += np.nan_to_num(delay_m)
    claimed_m = settings.sigma_m if settings.claimed_sigma_m is None else settings.claimed_sigma_m
    return RawSeries(
        t_true_gps_ns=t_true,
        t_gps_ns=tag,
        t_counter_ns=latch(oscillator, t_true, jitter_ns, stream),
        sent=~in_outage(t_true, outages, t_start_gps_ns),
        seen=seen,
        range_m=range_m,
        sigma_m=np.full((n, s), max(claimed_m, 1e-2)),
        elevation_rad=elevation,
        system=sky.system,
        number=sky.number,
        repeats=np.ones((n, s), np.int64),
        system_sent=np.broadcast_to(sky.system, (n, s)).copy(),
        usable=np.ones((n, s), bool),
        healthy=np.ones((n, s), bool),
        r_true_gcrf_m=r_gcrf_m,
    )


def _receiver_clock_m(settings: Pseudoranges, age_ns: np.ndarray, stream: np.random.Generator) -> np.ndarray:
    """Error of the receiver's clock (n,) as range [m]: bias, drift, random walk."""
    steps = settings.clock_walk_m * np.sqrt(1.0 / settings.rate_hz) * stream.standard_normal(len(age_ns))
    return settings.clock_bias_m + settings.clock_drift_mps * age_ns / 1e9 + np.cumsum(steps)


def _geometry(sky: Sky, t_true: np.ndarray, antenna_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (n,s) [m] that the light went, elevations (n,s) [rad] above the local horizontal, rays (n,s,3)."""
    emitted = np.repeat(t_true[:, None], len(sky.number), axis=1)
    for _ in range(3):  # light time: each round is 1e5 times nearer
        line = sky.r_gcrf_m(emitted) - antenna_m[:, None, :]
        distance = np.linalg.norm(line, axis=2)
        flight_ns = np.nan_to_num(distance) / LIGHT_MPS * 1e9
        emitted = t_true[:, None] - np.rint(flight_ns).astype(np.int64)
    up = antenna_m / np.linalg.norm(antenna_m, axis=1)[:, None]
    sine = np.einsum("nsk,nk->ns", line, up) / distance
    return distance, np.arcsin(np.clip(sine, -1.0, 1.0)), line / distance[..., None]
