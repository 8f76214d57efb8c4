"""Pseudoranges and places of satellites as sealed frames, paced so that no tick of flight is flooded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flightsw.icd.can_frames import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_RANGES
from hil_sim.frames import FrameSeries, series_of
from hil_sim.gps_time import NS
from hil_sim.pseudorange_schema import Pseudoranges
from hil_sim.pseudoranges.receiver import RawSeries
from hil_sim.pseudoranges.sky import Sky

PER_FRAME = 3
SLOPE_MARGIN_RAD = np.radians(5.0)  # places of satellites are told this much below the mask: those about to rise
_CN0_DBHZ = (38.0, 12.0)  # at the horizon, and what the zenith has more


class _Sent(NamedTuple):
    t_true_gps_ns: np.ndarray
    arrival_gps_ns: np.ndarray
    sent: np.ndarray


def encode(series: RawSeries, sky: Sky, settings: Pseudoranges) -> list[FrameSeries]:
    """Frames of ephemerides, ranges, ends of epochs; each in order of arrival."""
    ranges, frames_of_epoch = _ranges(series, settings)
    return [_ephemerides(series, sky, settings), ranges, _epochs(series, settings, frames_of_epoch)]


def _ranges(series: RawSeries, settings: Pseudoranges) -> tuple[FrameSeries, np.ndarray]:
    """The rows of every epoch that is sent, three a frame; and how many frames each epoch takes (n,)."""
    epoch, satellite = np.nonzero(series.seen & series.sent[:, None])
    twice = np.repeat(np.arange(len(epoch)), series.repeats[epoch, satellite])
    epoch, satellite = epoch[twice], satellite[twice]
    first = np.searchsorted(epoch, np.arange(len(series.sent)))
    count = np.searchsorted(epoch, np.arange(len(series.sent)), side="right") - first
    frames_of_epoch = -(-count // PER_FRAME)
    frame_first = np.concatenate(([0], np.cumsum(frames_of_epoch)[:-1])) if len(count) else np.zeros(0, np.int64)
    row = np.arange(len(epoch)) - first[epoch]
    frame, slot = frame_first[epoch] + row // PER_FRAME, row % PER_FRAME
    total = int(frames_of_epoch.sum())
    records = np.zeros(total, GNSS_RANGES.dtype)
    epoch_of = np.repeat(np.arange(len(count)), frames_of_epoch)
    records["t_gps_ns"] = series.t_gps_ns[epoch_of]
    np.add.at(records["count"], frame, 1)
    strength = _CN0_DBHZ[0] + _CN0_DBHZ[1] * np.sin(np.maximum(series.elevation_rad, 0.0))
    for k in range(PER_FRAME):
        here = slot == k
        to, e, s = frame[here], epoch[here], satellite[here]
        records[f"range_{k}_m"][to] = series.range_m[e, s]
        records[f"sigma_{k}_m"][to] = series.sigma_m[e, s]
        records[f"satellite_{k}"][to] = series.number[s]
        records[f"constellation_{k}"][to] = series.system_sent[e, s]
        records[f"cn0_{k}_dbhz"][to] = np.rint(strength[e, s])
    place = np.arange(total) - frame_first[epoch_of]
    arrival = series.t_true_gps_ns[epoch_of] + _ns(settings.latency_s + place * settings.frame_spacing_s)
    sent = _Sent(series.t_true_gps_ns[epoch_of], arrival, np.ones(total, bool))
    return series_of("ranges", records, np.arange(total), sent), frames_of_epoch


def _epochs(series: RawSeries, settings: Pseudoranges, frames_of_epoch: np.ndarray) -> FrameSeries:
    records = np.zeros(len(series.sent), GNSS_EPOCH.dtype)
    records["t_gps_ns"], records["t_counter_ns"] = series.t_gps_ns, series.t_counter_ns
    records["count"] = np.where(series.seen, series.repeats, 0).sum(axis=1)
    arrival = series.t_true_gps_ns + _ns(settings.latency_s + frames_of_epoch * settings.frame_spacing_s)
    sent = _Sent(series.t_true_gps_ns, arrival, series.sent)
    return series_of("epoch", records, np.cumsum(series.sent) - 1, sent)


def _ephemerides(series: RawSeries, sky: Sky, settings: Pseudoranges) -> FrameSeries:
    """Every satellite near or above the mask in turn, once an interval; those of one epoch before its ranges."""
    every = max(1, round(settings.ephemeris_interval_s * settings.rate_hz))
    n, s = series.seen.shape
    turn = (np.arange(n)[:, None] + np.arange(s)) % every == 0
    told = turn & series.usable & (series.elevation_rad > np.radians(settings.mask_deg) - SLOPE_MARGIN_RAD)
    told[:1] |= series.usable[:1] & series.seen[:1]  # a receiver that starts has them from its own memory
    epoch, satellite = np.nonzero(told & series.sent[:, None])
    t = series.t_gps_ns[epoch]  # a round time, near the truth
    r, v = sky.state_itrf(satellite, t)
    later = sky.clock_m(satellite, t + NS)
    clock = sky.clock_m(satellite, t)
    known = np.isfinite(r).all(axis=1) & np.isfinite(clock) & np.isfinite(later)
    records = np.zeros(len(epoch), GNSS_EPHEMERIS.dtype)
    records["t_ref_gps_ns"] = t
    for k, axis in enumerate("xyz"):
        records[f"{axis}_itrf_m"], records[f"v{axis}_itrf_mps"] = r[:, k], v[:, k]
    records["clock_m"], records["clock_drift_mps"] = clock, later - clock
    records["issue"] = (t // (7200 * NS)) & 0xFF
    records["satellite"], records["constellation"] = series.number[satellite], series.system[satellite]
    records["status"] = series.healthy[epoch, satellite]
    first = np.searchsorted(epoch, epoch)
    place = np.arange(len(epoch)) - first
    arrival = series.t_true_gps_ns[epoch] + _ns(0.01 + place * settings.frame_spacing_s)
    sent = _Sent(series.t_true_gps_ns[epoch], arrival, known)
    return series_of("ephemeris", records, np.cumsum(known) - 1, sent)


def _ns(seconds: np.ndarray) -> np.ndarray:
    whole: np.ndarray = np.rint(seconds * 1e9).astype(np.int64)
    return whole
