"""The crosslink terminal of the flown satellite: what the constellation measures and broadcasts, as CAN frames.

The flown satellite moves as the scenario's truth says; its orbit places the Walker pattern, in which the others move as
Kepler says. Ranges are those of signals that took their time; messages are the truth with errors and faults on top, and
carry the instant that they belong to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flightsw.icd.can_frames import CROSSLINK_EPHEMERIS, CROSSLINK_RANGES
from hil_sim.crosslink_schema import Crosslink, CrosslinkFault
from hil_sim.errors import DataError
from hil_sim.frames import FrameSeries, in_order, series_of
from hil_sim.gps_time import NS
from hil_sim.scenario_schema import Orbit, Scenario, semi_major_axis_m
from hil_sim.truth.constellation.broadcast import Fault, HealthyErrors, broadcast
from hil_sim.truth.constellation.crosslinks import Ranging, View, both, once
from hil_sim.truth.constellation.glonass_day import GlonassDay
from hil_sim.truth.constellation.orbits import Walker
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.interface import Truth

LINKS_IN_FRAME = 5
NO_LINK = 255
_CLOCK_SIGMA_M = 3e4  # true clocks are a tenth of a millisecond apart, and drift by 1e-11
_DRIFT_SIGMA_MPS = 3e-3
_ERROR_STEP_S = 10.0


class Pattern:
    """The constellation: `own` (from 0) moves as the truth, the others in the pattern that its elements belong to."""

    def __init__(self, link: Crosslink, orbit: Orbit, truth: Truth, t_start_gps_ns: int) -> None:
        self.own = link.own - 1
        each = link.satellites // link.planes
        plane, slot = divmod(self.own, each)
        ahead = 360.0 * (slot / each + plane * link.phasing / link.satellites)
        self._walker = Walker(
            link.satellites,
            link.planes,
            link.phasing,
            semi_major_axis_m(orbit),
            orbit.inclination_deg,
            orbit.argument_of_latitude_deg - ahead,
        )
        turn = math.radians(orbit.raan_deg - 360.0 * plane / link.planes)
        cosine, sine = math.cos(turn), math.sin(turn)
        self._turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        self._truth, self._t_start_gps_ns = truth, t_start_gps_ns

    @property
    def names(self) -> tuple[str, ...]:
        """Numbers from 1."""
        return self._walker.names

    def states(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,3) [m] and velocities (n,3) [m/s], GCRF, t_s after the start."""
        r, v = self._walker.states(t_s)
        r, v = r @ self._turn.T, v @ self._turn.T
        own_r, own_v = self._truth.state_gcrf(np.array([self._t_start_gps_ns + round(t_s * NS)], np.int64))
        r[self.own], v[self.own] = own_r[0], own_v[0]
        return r, v


class _Messages:
    """Errors of what the satellites broadcast: a draw for every upload; uploads are staggered."""

    def __init__(self, link: Crosslink, duration_s: float, rng: np.random.Generator) -> None:
        n = link.satellites
        self._healthy = HealthyErrors(link.ephemeris_sigma_m, link.ephemeris_rate_mps, link.upload_s)
        uploads = int(duration_s / link.upload_s) + 2
        self._age_s = rng.random(n) * link.upload_s  # of the upload in force at the start
        drawn = [self._healthy.draw(n, rng) for _ in range(uploads)]
        self._bias, self._rate = np.array([one for one, _ in drawn]), np.array([one for _, one in drawn])
        self._upload_s = link.upload_s

    def at(self, t_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Errors (n,4): radial, along, cross, clock [m]; number (n,) of the upload; 1 where said healthy (n,)."""
        total_s = self._age_s + t_s
        upload = (total_s // self._upload_s).astype(np.int64)
        age_s = (total_s - upload * self._upload_s)[:, None]
        satellite = np.arange(len(upload))
        errors = self._healthy.at_age(self._bias[upload, satellite], self._rate[upload, satellite], age_s)
        return errors, upload, np.ones(len(upload), np.int64)


class RealDay:
    """GLONASS on a real day: slot k is satellite k - 1; what the files do not know of is NaN.

    The day's axes are Earth-fixed ones that stopped turning at its beginning; here they are turned into GCRF of that
    instant. A day of precession, the same for all, is nothing that a range shows.
    """

    def __init__(self, day: GlonassDay, satellites: int, t_start_gps_ns: int, finals: Path | None) -> None:
        self._day, self._ahead_s = day, (t_start_gps_ns - day.t0_gps_ns) / NS
        self._slots = np.array([int(name[1:]) - 1 for name in day.names])
        if self._slots.max() >= satellites:
            raise DataError(f"crosslink.satellites: the day has slot {self._slots.max() + 1}; give at least that")
        if not day.grid_s[0] <= self._ahead_s < day.grid_s[-1]:
            raise DataError("time.start: not on the day of crosslink.precise")
        self._n = satellites
        matrices, _ = EarthOrientation(day.t0_gps_ns, day.t0_gps_ns + 1, finals).rotations(np.array([day.t0_gps_ns]))
        self._to_gcrf = matrices[0].T

    @property
    def names(self) -> tuple[str, ...]:
        """Slots."""
        return tuple(f"R{slot + 1:02d}" for slot in range(self._n))

    def states(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,3) [m] and velocities (n,3) [m/s], GCRF, t_s after the start."""
        r, v = np.full((self._n, 3), np.nan), np.full((self._n, 3), np.nan)
        day_r, day_v = self._day.orbits.states(self._ahead_s + t_s)
        r[self._slots], v[self._slots] = day_r @ self._to_gcrf.T, day_v @ self._to_gcrf.T
        errors, _, _ = self.at(t_s)
        r[~np.isfinite(errors).all(axis=1)] = np.nan  # without a message nobody ranges to it
        return r, v

    def at(self, t_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As of `_Messages`; errors are NaN where there is no message."""
        errors, issue, healthy = np.full((self._n, 4), np.nan), np.zeros(self._n, np.int64), np.zeros(self._n, np.int64)
        day_errors, day_issue, day_healthy = self._day.at(self._ahead_s + t_s)
        errors[self._slots], issue[self._slots], healthy[self._slots] = day_errors, day_issue, day_healthy
        return errors, issue, healthy


@dataclass
class _Sent:
    """When each of n frames was measured and arrives."""

    t_true_gps_ns: np.ndarray
    arrival_gps_ns: np.ndarray

    @property
    def sent(self) -> np.ndarray:
        return np.ones(len(self.t_true_gps_ns), dtype=bool)


def fault_of(fault: CrosslinkFault) -> Fault:
    """A scenario's fault as truth has it: satellites from 0."""
    satellites = tuple(number - 1 for number in fault.satellites)
    return Fault(satellites, fault.jump_m, fault.ramp_mps, fault.start_s, fault.duration_s)


def encode(
    scenario: Scenario,
    truth: Truth,
    t_start_gps_ns: int,
    t_last_gps_ns: int,
    rng: np.random.Generator,
    day: RealDay | None = None,
) -> FrameSeries:
    """Frames of all epochs of a run, in order of arrival: of an epoch first the messages, then the ranges.

    day: who flies and says what, instead of the pattern; the scenario's faults come on top.
    """
    link = scenario.crosslink
    assert link is not None
    n, own, period_ns = link.satellites, link.own - 1, round(link.period_s * NS)
    times_ns = np.arange(t_start_gps_ns, t_last_gps_ns, period_ns, dtype=np.int64)
    pattern = day or Pattern(link, scenario.orbit, truth, t_start_gps_ns)
    messages = day or _Messages(link, (t_last_gps_ns - t_start_gps_ns) / NS, rng)
    faults = [fault_of(fault) for fault in scenario.crosslink_fault]
    clock0_m, drift_mps = _CLOCK_SIGMA_M * rng.standard_normal(n), _DRIFT_SIGMA_MPS * rng.standard_normal(n)
    ranging = Ranging(link.sigma_range_m, link.bias_m, link.dropout_probability, link.two_way)
    view = View(link.central_angle_max_deg)
    sigma_m = link.claimed_sigma_m or max(link.sigma_range_m, 1e-3)
    parts: dict[str, list[np.ndarray]] = {"crosslink_ephemeris": [], "crosslink_ranges": []}
    arrivals: dict[str, list[np.ndarray]] = {kind: [] for kind in parts}
    for t_ns in times_ns.tolist():
        t_s = (t_ns - t_start_gps_ns) / NS
        r, v = pattern.states(t_s)
        clock_m = clock0_m + t_s * drift_mps
        pairs = (both if link.both else once)(view.pairs(r))
        pairs, range_m = ranging.measure(pattern, t_s, pairs, clock_m, rng)
        if not link.exchange:
            mine = (pairs[:, 0] == own) | (~np.bool_(link.both) & (pairs[:, 1] == own))
            pairs, range_m = pairs[mine], range_m[mine]
        errors_m, issue, healthy = messages.at(t_s)
        for fault in faults:
            errors_m[list(fault.satellites)] += fault.error_m(t_s)
        said = _message_records(t_ns, r, v, errors_m, clock_m, drift_mps, issue, healthy)
        found = _range_records(t_ns, pairs, range_m, sigma_m, link.two_way)
        frames = len(said) + len(found)
        offsets_ns = np.arange(frames) * (link.spread_s * NS / max(frames, 1))
        arrival = t_ns + round(link.latency_s * NS) + offsets_ns.astype(np.int64)
        for kind, records, when in zip(parts, (said, found), np.split(arrival, [len(said)]), strict=True):
            parts[kind].append(records)
            arrivals[kind].append(when)
    series = []
    for kind, epochs in parts.items():
        t = np.repeat(times_ns, [len(one) for one in epochs])
        # as bytes: numpy leaves out the unused ones of records that it joins
        whole = np.frombuffer(b"".join(one.tobytes() for one in epochs), epochs[0].dtype)
        series.append(series_of(kind, whole, np.arange(len(whole)), _Sent(t, np.concatenate(arrivals[kind]))))
    return in_order(series)


def _message_records(
    t_ns: int,
    r: np.ndarray,
    v: np.ndarray,
    errors_m: np.ndarray,
    clock_m: np.ndarray,
    drift_mps: np.ndarray,
    issue: np.ndarray,
    healthy: np.ndarray,
) -> np.ndarray:
    """Frames of the messages of an epoch, of those satellites that have one."""
    said_m, clock_error_m = broadcast(r, v, errors_m)
    known = np.flatnonzero(np.isfinite(said_m).all(axis=1))
    records = np.zeros(len(known), CROSSLINK_EPHEMERIS.dtype)
    records["t_ref_gps_ns"] = t_ns
    for k, axis in enumerate("xyz"):
        records[f"{axis}_gcrf_m"] = said_m[known, k]
        records[f"v{axis}_gcrf_mps"] = v[known, k]
    records["clock_m"] = (clock_m + clock_error_m)[known]
    records["clock_rate_mps"] = drift_mps[known]
    records["satellite"] = known
    records["healthy"] = healthy[known]
    records["issue"] = issue[known]
    return records


def _range_records(t_ns: int, pairs: np.ndarray, range_m: np.ndarray, sigma_m: float, two_way: bool) -> np.ndarray:
    """Frames of an epoch's links (m,2), ranges (m,): five of one receiver in a frame."""
    chunks = []
    for receiver in np.unique(pairs[:, 0]):
        mine = np.flatnonzero(pairs[:, 0] == receiver)
        chunks += [(receiver, mine[at : at + LINKS_IN_FRAME]) for at in range(0, len(mine), LINKS_IN_FRAME)]
    records = np.zeros(len(chunks), CROSSLINK_RANGES.dtype)
    records["t_gps_ns"], records["sigma_m"] = t_ns, sigma_m
    records["links_total"], records["two_way"] = len(pairs), two_way
    for place in range(LINKS_IN_FRAME):
        records[f"sender_{place + 1}"] = NO_LINK
    for record, (receiver, rows) in zip(records, chunks, strict=True):
        record["receiver"] = receiver
        for place, row in enumerate(rows):
            record[f"range_{place + 1}_m"] = range_m[row]
            record[f"sender_{place + 1}"] = pairs[row, 1]
    return records


def truth_arrays(scenario: Scenario, day: RealDay | None) -> dict[str, np.ndarray]:
    """What truth.npz holds of the faults (k,): masks of satellites, from 0; start and end [s]; jump, ramp (k,4).

    Of a real day besides, every ten seconds (m,), the size (m,n) [m] of the error of every message, NaN for none.
    """
    if scenario.crosslink is None:
        return {}
    faults = [fault_of(fault) for fault in scenario.crosslink_fault]
    arrays = {
        "crosslink_own": np.array(scenario.crosslink.own - 1),
        "crosslink_fault_mask": np.array([sum(1 << s for s in set(f.satellites)) for f in faults], dtype=np.int64),
        "crosslink_fault_start_s": np.array([f.onset_s for f in faults]),
        "crosslink_fault_end_s": np.array([f.onset_s + f.duration_s for f in faults]),
        "crosslink_fault_jump_m": np.array([f.jump_m for f in faults]).reshape(-1, 4),
        "crosslink_fault_ramp_mps": np.array([f.ramp_mps for f in faults]).reshape(-1, 4),
    }
    if day is not None:
        t_s = np.arange(0.0, scenario.time.duration_s, _ERROR_STEP_S)
        arrays["crosslink_error_t_s"] = t_s
        arrays["crosslink_error_m"] = np.array([np.linalg.norm(day.at(t)[0], axis=1) for t in t_s])
    return arrays
