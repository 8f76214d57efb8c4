"""Arcs for studies of the filter: a true motion, a receiver's fixes of it, and the inputs of the step, without frames.

One call of the step a second: at each whole GPS second a fix and a time pulse are measured, AFTER_NS later both are
handed over. Hundreds of arcs share one motion and differ in their noise, or in what is added to the motion. A test
holds these inputs against those that the frames of the same world give.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd.enums import FixType, SyncStatus
from flightsw.icd.table_file import TableImage, decode
from flightsw.memory import Memory
from flightsw.records import INPUT
from ground.accuracy.bench_cases import ORBITS, Case, Orbit, Plan
from ground.accuracy.bench_flight import force_tables
from ground.campaign import arc
from ground.errors import OperatorError
from ground.studies.flights import HOUR_NS, NS, true_motion
from ground.tables.build import build_navigation
from ground.tables.earth_orientation import build_earth_orientation
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.local_frames import argument_of_latitude, rtn_axes

AFTER_NS = 1_000_000  # from a fix to the call that takes it
PULSE_SIGMA_S = 1e-7  # what flight takes a pulse for at best
DRIFT_SPS = 1e-6  # 1-sigma of the oscillator's first drift
COUNTER_0_NS = 1000 * NS

ALL_ORBITS = {
    **ORBITS,
    "simulated_800": ORBITS["simulated"]._replace(
        name="simulated_800",
        settings=tuple(
            "orbit.semi_major_axis_m=7178136.3" if text.startswith("orbit.semi_major_axis_m") else text
            for text in ORBITS["simulated"].settings
        ),
        period_s=None,
    ),
}


class Receiver(NamedTuple):
    """Errors of fixes: white ones, that it claims; a first-order one of positions; an orbit-periodic one of positions.

    periodic_m: sigma of the amplitude of cosine and sine, each RTN axis. All sigmas 1-sigma of an axis.
    """

    sigma_m: float = 10.0
    sigma_mps: float = 0.1
    coloured_m: float = 0.0
    coloured_tau_s: float = 300.0
    periodic_m: float = 0.0


WHITE = Receiver()
COLOURED = Receiver(coloured_m=5.0, periodic_m=2.0)


@dataclass(frozen=True)
class Motion:
    """A satellite's true motion at whole seconds, and where the Earth stands.

    t_gps_ns (n,); r_m, v_mps (n, 3) GCRF; itrf_from_gcrf (n, 3, 3); spin_radps (n, 3) of the Earth, ITRF.
    """

    t_gps_ns: np.ndarray
    r_m: np.ndarray
    v_mps: np.ndarray
    itrf_from_gcrf: np.ndarray
    spin_radps: np.ndarray

    def __len__(self) -> int:
        """Seconds of motion."""
        return len(self.t_gps_ns) - 1

    def to_itrf(self, first: int, r_m: np.ndarray, v_mps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Earth-fixed r, v (n, 3) of those in GCRF at seconds `first` and on. Linear: serves differences as well."""
        span = slice(first, first + len(r_m))
        r = np.einsum("nij,nj->ni", self.itrf_from_gcrf[span], r_m)
        return r, np.einsum("nij,nj->ni", self.itrf_from_gcrf[span], v_mps) - np.cross(self.spin_radps[span], r)


@dataclass(frozen=True)
class Sky(Motion):
    """A true motion with the tables that the flight filter needs for it."""

    orbit: Orbit
    orientation: TableImage
    forces: TableImage
    gravity_field: TableImage

    def memory(self, table_set: str, overrides: dict[str, Any] | None = None) -> Memory:
        """Flight's records with the tables of this sky and a navigation table; no state yet."""
        memory = Memory()
        navigation = decode(build_navigation(table_set, overrides or None))
        memory.load(navigation.values, self.orientation.values)
        memory.load_forces(self.forces.values, self.gravity_field.values)
        return memory


@lru_cache(maxsize=4)
def sky(name: str, span_s: int, gravity: Path | None = None) -> Sky:
    """The named orbit for so many seconds at most. Raises OperatorError where its data are not at hand."""
    if name not in ALL_ORBITS:
        raise OperatorError(f"{name}: no such orbit; one of {', '.join(ALL_ORBITS)}")
    orbit = ALL_ORBITS[name]
    span_s = min(span_s, orbit.span_s - 5)
    # from a whole GPS second on, whatever the time scale of the orbit's own scenario
    start = orbit.start + timedelta(seconds=1)
    settings = (
        "outage=[]",
        'time.scale="gps"',
        f'time.start="{start.isoformat()}"',
        f"time.duration_s={float(span_s)!r}",
        *orbit.settings,
    )
    truth, t0 = true_motion(orbit.scenario, settings)
    t = t0 + np.arange(span_s + 1, dtype=np.int64) * NS
    assert t0 % NS == 0
    r, v = truth.state_gcrf(t)
    matrices, spin = EarthOrientation(int(t[0]), int(t[-1])).rotations(t)
    case = Case(orbit, "white", Plan.of(orbit.span_s), "flight", (), gravity)
    tables = [decode(table) for table in force_tables(case, t0)]
    orientation = decode(build_earth_orientation(t0 - HOUR_NS, int(t[-1]) + HOUR_NS))
    return Sky(t, r, v, matrices, spin, orbit, orientation, *tables)


class Track(NamedTuple):
    """Where the satellite was, from second `first` of a sky on: r_m, v_mps (n, 3) GCRF, one row a second."""

    first: int
    r_m: np.ndarray
    v_mps: np.ndarray

    @classmethod
    def of(cls, sky: Motion, first: int, count: int) -> Track:
        """The sky's own."""
        return cls(first, sky.r_m[first : first + count], sky.v_mps[first : first + count])

    def moved(self, dr_m: np.ndarray, dv_mps: np.ndarray) -> Track:
        """With something added."""
        return Track(self.first, self.r_m + dr_m, self.v_mps + dv_mps)

    def part(self, begin: int, end: int | None = None) -> Track:
        """Rows begin to end - 1, counted from this track's first."""
        return Track(self.first + begin, self.r_m[begin:end], self.v_mps[begin:end])

    def at_calls(self) -> tuple[np.ndarray, np.ndarray]:
        """True r, v (n, 3) at the instants of the calls, AFTER_NS after the whole seconds."""
        dt = AFTER_NS / NS
        a = np.gradient(self.v_mps, axis=0)  # of a second's steps: to 2e-6 m/s2
        return self.r_m + dt * self.v_mps + 0.5 * dt * dt * a, self.v_mps + dt * a


def oscillator_ns(noise: np.random.Generator, count: int, phase_s2ps: float, drift_ps: float) -> np.ndarray:
    """Counter (n,) int64 [ns] at whole seconds: white frequency noise and a random walk of the drift.

    Exact for the step of a second (Zucca and Tavella, IEEE Trans. UFFC 52, 2005), as flight's table says of its own.
    """
    w = noise.standard_normal((count, 2))
    walk = np.sqrt(drift_ps) * w[:, 0]
    drift = DRIFT_SPS * noise.standard_normal() + np.concatenate(([0.0], np.cumsum(walk[:-1])))
    ahead = drift + 0.5 * walk + np.sqrt(phase_s2ps + drift_ps / 12.0) * w[:, 1]
    error_s = np.concatenate(([0.0], np.cumsum(ahead[:-1])))
    seconds = np.arange(count, dtype=np.int64) * NS
    counter: np.ndarray = COUNTER_0_NS + seconds - np.rint(1e9 * error_s).astype(np.int64)
    return counter


def counter_of(memory: Memory, count: int, noise: np.random.Generator) -> np.ndarray:
    """Counter (n,) [ns] at whole seconds of an oscillator that wanders as the table in `memory` says."""
    table: Any = memory.table[0]
    return oscillator_ns(noise, count, float(table["clock_q_phase_s2ps"]), float(table["clock_q_drift_ps"]))


def blank(counter_ns: np.ndarray) -> np.ndarray:
    """Inputs (n,) of calls that bring nothing but the reading of the counter; counter (n,) [ns] at whole seconds."""
    inputs = np.zeros(len(counter_ns), INPUT)
    inputs["counter_now_ns"] = counter_ns + AFTER_NS
    return inputs


def measured(
    sky: Motion, track: Track, receiver: Receiver, counter_ns: np.ndarray, noise: np.random.Generator
) -> np.ndarray:
    """Inputs (n,) with a fix and a time pulse in each call."""
    n = len(track.r_m)
    inputs = blank(counter_ns)
    lasting = coloured(noise, n, receiver.coloured_m, receiver.coloured_tau_s)
    lasting += periodic(noise, track, receiver.periodic_m)
    axes = rtn_axes(track.r_m, track.v_mps)
    r, v = sky.to_itrf(track.first, track.r_m + np.einsum("nji,nj->ni", axes, lasting), track.v_mps)
    if lasting.any():  # Doppler has none of it
        _, v = sky.to_itrf(track.first, track.r_m, track.v_mps)
    t = sky.t_gps_ns[track.first : track.first + n]
    inputs["pulse_present"] = 1
    inputs["pulse_status"] = int(SyncStatus.VALID)
    inputs["pulse_gps_ns"] = t
    jitter = np.rint(1e9 * PULSE_SIGMA_S * noise.standard_normal(n)).astype(np.int64)
    inputs["pulse_counter_ns"] = counter_ns + jitter
    inputs["pulse_sigma_ns"] = 1e9 * PULSE_SIGMA_S
    inputs["fix_present"] = 1
    inputs["fix_gps_ns"] = t
    inputs["fix_counter_ns"] = counter_ns
    inputs["fix_r_itrf_m"] = r + receiver.sigma_m * noise.standard_normal((n, 3))
    inputs["fix_v_itrf_mps"] = v + receiver.sigma_mps * noise.standard_normal((n, 3))
    inputs["fix_sigma_r_m"] = receiver.sigma_m
    inputs["fix_sigma_v_mps"] = receiver.sigma_mps
    inputs["fix_satellites"] = 12
    inputs["fix_type"] = int(FixType.FIX_3D)
    inputs["fix_has_velocity"] = 1
    return inputs


def coloured(noise: np.random.Generator, n: int, sigma: float, tau_s: float, width: int = 3) -> np.ndarray:
    """First-order Gauss-Markov processes (n, width) at whole seconds, stationary from the first sample.

    x[k+1] = exp(-1/tau) x[k] + sigma sqrt(1 - exp(-2/tau)) w[k] (Gelb 1974, Applied Optimal Estimation, 3.8).
    """
    white = noise.standard_normal((n, width))
    if sigma == 0.0:
        return np.zeros((n, width))
    keep = float(np.exp(-1.0 / tau_s))
    drive = sigma * float(np.sqrt(1.0 - keep * keep))
    x = np.empty((n, width))
    x[0] = sigma * white[0]
    for k in range(1, n):
        x[k] = keep * x[k - 1] + drive * white[k]
    return x


def periodic(noise: np.random.Generator, track: Track, sigma_m: float) -> np.ndarray:
    """A cos u + B sin u (n, 3) [m], RTN, u the argument of latitude, A and B drawn once."""
    amplitude = sigma_m * noise.standard_normal((2, 3))
    if not amplitude.any():
        return np.zeros((len(track.r_m), 3))
    u = argument_of_latitude(track.r_m, track.v_mps)[:, None]
    error: np.ndarray = amplitude[0] * np.cos(u) + amplitude[1] * np.sin(u)
    return error


def fly(memory: Memory, inputs: np.ndarray) -> np.ndarray:
    """Outputs (n,) of the step; the memory's state goes on."""
    return arc.fly(memory, inputs)


def fork(memory: Memory) -> Memory:
    """Another flight from the same state on, with the same tables."""
    other = Memory()
    other.share_tables(memory)
    other.nav[:] = memory.nav
    return other


class Flight:
    """A flight along a sky with fixes throughout: where it is stopped, others may begin with its state.

    t_s: second of the sky up to which it has been flown.
    """

    def __init__(
        self, sky: Sky, table_set: str, receiver: Receiver, noise: np.random.Generator, overrides: Any = None
    ) -> None:
        self.sky, self.receiver = sky, receiver
        self.memory = sky.memory(table_set, overrides)
        self.track = Track.of(sky, 0, len(sky))
        self.counter_ns = counter_of(self.memory, len(sky), noise)
        self.inputs = measured(sky, self.track, receiver, self.counter_ns, noise)
        self.t_s = 0
        self._flown: list[np.ndarray] = []

    def until(self, second: int | None = None) -> None:
        """Fly on up to a second, or to the end."""
        self._flown.append(fly(self.memory, self.inputs[self.t_s : second]))
        self.t_s = len(self.sky) if second is None else second

    @property
    def outputs(self) -> np.ndarray:
        """Of all that has been flown."""
        return np.concatenate(self._flown)

    def blank(self, begin: int, end: int) -> np.ndarray:
        """Inputs of seconds begin to end - 1 without fixes and pulses."""
        return blank(self.counter_ns[begin:end])

    def measured(self, track: Track, noise: np.random.Generator) -> np.ndarray:
        """Inputs with fixes of a track along this flight, their noise drawn anew."""
        begin = track.first
        return measured(self.sky, track, self.receiver, self.counter_ns[begin : begin + len(track.r_m)], noise)


class Errors(NamedTuple):
    """Published minus true at the calls: r_m, v_mps (n, 3) GCRF; NaN while there is no state."""

    r_m: np.ndarray
    v_mps: np.ndarray

    @classmethod
    def of(cls, track: Track, outputs: np.ndarray) -> Errors:
        """Of outputs (n,) published along a track of as many seconds."""
        r, v = track.at_calls()
        return cls(outputs["r_gcrf_m"] - r, outputs["v_gcrf_mps"] - v)

    @property
    def axis_m(self) -> np.ndarray:
        """Largest GCRF axis (n,) [m]: what the bound is for."""
        return np.asarray(np.abs(self.r_m).max(axis=1))

    @property
    def all_m(self) -> np.ndarray:
        """Length of the position error (n,) [m]."""
        return np.asarray(np.linalg.norm(self.r_m, axis=1))

    @property
    def both(self) -> np.ndarray:
        """Position and velocity (n, 6)."""
        return np.hstack((self.r_m, self.v_mps))


def stream(*numbers: int) -> np.random.Generator:
    """A stream of noise of its own for a study, a run, a purpose."""
    return np.random.default_rng(np.random.SeedSequence(numbers))
