"""The crosslink terminal of the flown satellite: what the constellation measures and broadcasts, as CAN frames.

The flown satellite moves as the scenario's truth says; its orbit places the Walker pattern, in which the others move as
Kepler says. Ranges are those of signals that took their time; messages are the truth with errors and faults on top, and
carry the instant that they belong to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flightsw.icd.can_frames import CROSSLINK_EPHEMERIS, CROSSLINK_RANGES
from hil_sim.crosslink_schema import Crosslink, CrosslinkFault
from hil_sim.frames import FrameSeries, in_order, series_of
from hil_sim.gps_time import NS
from hil_sim.scenario_schema import Orbit, Scenario, semi_major_axis_m
from hil_sim.truth.constellation.broadcast import Fault, HealthyErrors, broadcast
from hil_sim.truth.constellation.crosslinks import Ranging, View, both, once
from hil_sim.truth.constellation.orbits import Walker
from hil_sim.truth.interface import Truth

LINKS_IN_FRAME = 5
NO_LINK = 255
_CLOCK_SIGMA_M = 3e4  # true clocks are a tenth of a millisecond apart, and drift by 1e-11
_DRIFT_SIGMA_MPS = 3e-3


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
    """Errors of what the satellites broadcast: a draw for every upload; uploads are staggered.

    An error swings about zero as fast as its rate allows, so that at every age both it and its rate have the sigma that
    the scenario names. Growing on at that rate it would be no healthy one after half an hour: 3 m, six sigma, radially.
    """

    def __init__(self, link: Crosslink, duration_s: float, faults: list[Fault], rng: np.random.Generator) -> None:
        n = link.satellites
        healthy = HealthyErrors(link.ephemeris_sigma_m, link.ephemeris_rate_mps, link.upload_s)
        uploads = int(duration_s / link.upload_s) + 2
        self._age_s = rng.random(n) * link.upload_s  # of the upload in force at the start
        drawn = [healthy.draw(n, rng) for _ in range(uploads)]
        self._bias, self._rate = np.array([one for one, _ in drawn]), np.array([one for _, one in drawn])
        sigma, rate = np.array(link.ephemeris_sigma_m), np.array(link.ephemeris_rate_mps)
        self._swing_radps = np.where(sigma > 0.0, rate / np.where(sigma > 0.0, sigma, 1.0), 0.0)
        self._upload_s, self._faults = link.upload_s, faults

    def at(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Errors (n,4): radial, along, cross, clock [m], and number (n,) of the upload in force."""
        total_s = self._age_s + t_s
        upload = (total_s // self._upload_s).astype(np.int64)
        age_s = (total_s - upload * self._upload_s)[:, None]
        satellite = np.arange(len(upload))
        angle = self._swing_radps * age_s
        # sin(angle) / swing, also where the swing is zero
        errors = self._bias[upload, satellite] * np.cos(angle)
        errors += self._rate[upload, satellite] * age_s * np.sinc(angle / np.pi)
        for fault in self._faults:
            errors[list(fault.satellites)] += fault.error_m(t_s)
        return errors, upload


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
    scenario: Scenario, truth: Truth, t_start_gps_ns: int, t_last_gps_ns: int, rng: np.random.Generator
) -> FrameSeries:
    """Frames of all epochs of a run, in order of arrival: of an epoch first the messages, then the ranges."""
    link = scenario.crosslink
    assert link is not None
    pattern = Pattern(link, scenario.orbit, truth, t_start_gps_ns)
    n, period_ns = link.satellites, round(link.period_s * NS)
    times_ns = np.arange(t_start_gps_ns, t_last_gps_ns, period_ns, dtype=np.int64)
    messages = _Messages(
        link, (t_last_gps_ns - t_start_gps_ns) / NS, list(map(fault_of, scenario.crosslink_fault)), rng
    )
    clock0_m, drift_mps = _CLOCK_SIGMA_M * rng.standard_normal(n), _DRIFT_SIGMA_MPS * rng.standard_normal(n)
    ranging = Ranging(link.sigma_range_m, link.bias_m, link.dropout_probability, link.two_way)
    view = View(link.central_angle_max_deg)
    sigma_m = link.claimed_sigma_m or max(link.sigma_range_m, 1e-3)
    ephemerides = np.zeros(len(times_ns) * n, CROSSLINK_EPHEMERIS.dtype)
    sent: list[tuple[np.ndarray, np.ndarray]] = []  # arrivals of messages and of ranges, by epoch
    ranges = []
    for k, t_ns in enumerate(times_ns.tolist()):
        t_s = (t_ns - t_start_gps_ns) / NS
        r, v = pattern.states(t_s)
        clock_m = clock0_m + t_s * drift_mps
        pairs = (both if link.both else once)(view.pairs(r))
        pairs, range_m = ranging.measure(pattern, t_s, pairs, clock_m, rng)
        if not link.exchange:
            mine = (pairs[:, 0] == pattern.own) | (~np.bool_(link.both) & (pairs[:, 1] == pattern.own))
            pairs, range_m = pairs[mine], range_m[mine]
        errors_m, issue = messages.at(t_s)
        _put_messages(ephemerides[k * n : (k + 1) * n], t_ns, r, v, errors_m, clock_m, drift_mps, issue)
        ranges.append(_range_records(t_ns, pairs, range_m, sigma_m, link.two_way))
        frames = n + len(ranges[-1])
        arrival = (
            t_ns + round(link.latency_s * NS) + (np.arange(frames) * (link.spread_s * NS / frames)).astype(np.int64)
        )
        sent.append((arrival[:n], arrival[n:]))
    counts = [len(records) for records in ranges]
    parts = []
    for kind, records, t, arrivals in (
        ("crosslink_ephemeris", ephemerides, np.repeat(times_ns, n), [one for one, _ in sent]),
        ("crosslink_ranges", np.concatenate(ranges), np.repeat(times_ns, counts), [one for _, one in sent]),
    ):
        parts.append(series_of(kind, records, np.arange(len(records)), _Sent(t, np.concatenate(arrivals))))
    return in_order(parts)


def _put_messages(
    records: np.ndarray,
    t_ns: int,
    r: np.ndarray,
    v: np.ndarray,
    errors_m: np.ndarray,
    clock_m: np.ndarray,
    drift_mps: np.ndarray,
    issue: np.ndarray,
) -> None:
    """Messages of an epoch into records (n,)."""
    said_m, clock_error_m = broadcast(r, v, errors_m)
    records["t_ref_gps_ns"] = t_ns
    for k, axis in enumerate("xyz"):
        records[f"{axis}_gcrf_m"] = said_m[:, k]
        records[f"v{axis}_gcrf_mps"] = v[:, k]
    records["clock_m"] = clock_m + clock_error_m
    records["clock_rate_mps"] = drift_mps
    records["satellite"] = np.arange(len(records))
    records["healthy"] = 1
    records["issue"] = issue


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


def truth_arrays(scenario: Scenario) -> dict[str, np.ndarray]:
    """What truth.npz holds of the faults (k,): masks of satellites, from 0; start and end [s]; jump, ramp (k,4)."""
    if scenario.crosslink is None:
        return {}
    faults = [fault_of(fault) for fault in scenario.crosslink_fault]
    return {
        "crosslink_own": np.array(scenario.crosslink.own - 1),
        "crosslink_fault_mask": np.array([sum(1 << s for s in set(f.satellites)) for f in faults], dtype=np.int64),
        "crosslink_fault_start_s": np.array([f.onset_s for f in faults]),
        "crosslink_fault_end_s": np.array([f.onset_s + f.duration_s for f in faults]),
        "crosslink_fault_jump_m": np.array([f.jump_m for f in faults]).reshape(-1, 4),
        "crosslink_fault_ramp_mps": np.array([f.ramp_mps for f in faults]).reshape(-1, 4),
    }
