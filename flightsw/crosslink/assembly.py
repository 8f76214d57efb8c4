"""Frames of the crosslink terminal into epochs: what came in a tick is taken in one call.

An epoch is all ranges of one instant of reception: as many links as its frames announce. Only a complete one goes on;
anything else changes a counter and nothing more. Messages of satellites are kept as they come, and brought to the
instant of the epoch by two-body motion, for some seconds at most. Frames have passed their CRC and nothing else.
"""

from __future__ import annotations

import math

import numpy as np

from flightsw.crosslink.declare import ROOM, entry, kernel
from flightsw.crosslink.records import ASSEMBLY, ASSEMBLY_TABLE, EPOCH, LINKS, SATELLITES
from flightsw.icd.can_frames import CROSSLINK_EPHEMERIS, CROSSLINK_RANGES
from flightsw.icd.enums import RejectCause
from flightsw.kernels.registry import I8, frozen_records, records

MU_M3PS2 = 3.986004418e14
NO_LINK = 255
_RESTART_NS = 60_000_000_000  # an epoch so much older than the last is no late one: the terminal began anew
_INCOMPLETE = int(RejectCause.INCOMPLETE_EPOCH)
_NOT_FINITE = int(RejectCause.NOT_FINITE)
_OUT_OF_RANGE = int(RejectCause.OUT_OF_RANGE)
_SIGMA = int(RejectCause.SIGMA)
_STALE = int(RejectCause.TIME_STALE)
_FUTURE = int(RejectCause.TIME_FUTURE)
_REPEATED = int(RejectCause.TIME_REPEATED)
_OVERFLOW = int(RejectCause.RECEIVE_OVERFLOW)
_TAKEN = -1


@kernel
def _message(table, state, frame):
    """Keep a satellite's message; the cause if it is refused."""
    x, y, z = frame["x_gcrf_m"], frame["y_gcrf_m"], frame["z_gcrf_m"]
    vx, vy, vz = float(frame["vx_gcrf_mps"]), float(frame["vy_gcrf_mps"]), float(frame["vz_gcrf_mps"])
    clock_m, rate_mps = frame["clock_m"], float(frame["clock_rate_mps"])
    finite = math.isfinite(x) and math.isfinite(y) and math.isfinite(z) and math.isfinite(clock_m)
    if not (finite and math.isfinite(vx) and math.isfinite(vy) and math.isfinite(vz) and math.isfinite(rate_mps)):
        return _NOT_FINITE
    radius_m, speed_mps = math.sqrt(x * x + y * y + z * z), math.sqrt(vx * vx + vy * vy + vz * vz)
    satellite = np.int64(frame["satellite"])
    if (
        satellite >= table["satellites"]
        or frame["t_ref_gps_ns"] <= 0
        or not (table["radius_min_m"] <= radius_m <= table["radius_max_m"])
        or not (0.0 < speed_mps <= table["speed_max_mps"])
        or abs(clock_m) > table["radius_max_m"]
    ):
        return _OUT_OF_RANGE
    state["t_ref_ns"][satellite] = frame["t_ref_gps_ns"]
    r, v = state["r_m"][satellite], state["v_mps"][satellite]
    r[0], r[1], r[2] = x, y, z
    v[0], v[1], v[2] = vx, vy, vz
    state["clock_m"][satellite], state["clock_rate_mps"][satellite] = clock_m, rate_mps
    state["issue"][satellite] = frame["issue"]
    state["healthy"][satellite] = 1 if frame["healthy"] != 0 else 0
    return _TAKEN


@kernel
def _untimely(table, state, t_ns, now_ns):
    """Why an epoch of this time cannot be taken any more, or yet; _TAKEN if it can. now_ns: 0, nobody knows."""
    if t_ns == state["last_gps_ns"]:
        return _REPEATED
    if t_ns <= 0 or (now_ns != 0 and t_ns < now_ns - table["latency_ns"]):
        return _STALE
    if now_ns != 0 and t_ns > now_ns + table["future_ns"]:
        return _FUTURE
    newest_ns = max(state["last_gps_ns"], state["t_gps_ns"])
    if newest_ns - t_ns > 0 and newest_ns - t_ns < _RESTART_NS:
        return _STALE
    return _TAKEN


@kernel
def _link(table, state, receiver, sender, range_m, of_sigma):
    """One link of the epoch under way; the cause if it is left out of it."""
    state["accounted"] += 1
    if sender >= table["satellites"] or sender == receiver or state["accounted"] > LINKS:
        return _OUT_OF_RANGE
    if not math.isfinite(range_m):
        return _NOT_FINITE
    if of_sigma != _TAKEN:
        return of_sigma
    if state["seen"][receiver, sender] != 0:
        return _REPEATED
    state["seen"][receiver, sender] = 1
    place = state["links"]
    state["receiver"][place], state["sender"][place], state["range_m"][place] = receiver, sender, range_m
    state["links"] = place + 1
    return _TAKEN


@kernel
def _begin(state, t_ns, total):
    """A new epoch; what there is of another is dropped."""
    if state["t_gps_ns"] >= 0:
        state["rejected"][_INCOMPLETE] += 1
        state["incomplete"] = (state["incomplete"] + 1) & 0xFFFF
    state["t_gps_ns"], state["total"] = t_ns, total
    state["accounted"] = state["links"] = 0
    for a in range(SATELLITES):
        for b in range(SATELLITES):
            state["seen"][a, b] = 0


@kernel
def _complete(state):
    """The epoch under way is whole, and waits to be judged."""
    if state["ready"] != 0:  # two in one tick: the older one is not judged
        state["rejected"][_OVERFLOW] += 1
    state["ready"] = 1
    state["last_gps_ns"], state["done_links"] = state["t_gps_ns"], state["links"]
    for k in range(state["links"]):
        state["done_receiver"][k] = state["receiver"][k]
        state["done_sender"][k] = state["sender"][k]
        state["done_range_m"][k] = state["range_m"][k]
    state["t_gps_ns"] = -1


@kernel
def _ranges(table, state, frame, now_ns):
    """Links of one frame, all of one receiver; the cause if none of it can be used."""
    t_ns, total, receiver = frame["t_gps_ns"], np.int64(frame["links_total"]), np.int64(frame["receiver"])
    cause = _untimely(table, state, t_ns, now_ns)
    if cause != _TAKEN:
        return cause
    two_way = np.int64(frame["two_way"])
    if total > LINKS or total < 1 or two_way != table["two_way"] or receiver >= table["satellites"]:
        return _OUT_OF_RANGE
    if state["t_gps_ns"] != t_ns or state["total"] != total:
        _begin(state, t_ns, total)
    sigma_m, of_sigma = float(frame["sigma_m"]), _TAKEN
    if not math.isfinite(sigma_m):
        of_sigma = _NOT_FINITE
    elif not (0.0 < sigma_m <= table["sigma_range_max_m"]):
        of_sigma = _SIGMA
    for k in range(5):
        if k == 0:
            sender, range_m = frame["sender_1"], frame["range_1_m"]
        elif k == 1:
            sender, range_m = frame["sender_2"], frame["range_2_m"]
        elif k == 2:
            sender, range_m = frame["sender_3"], frame["range_3_m"]
        elif k == 3:
            sender, range_m = frame["sender_4"], frame["range_4_m"]
        else:
            sender, range_m = frame["sender_5"], frame["range_5_m"]
        if sender == NO_LINK:
            continue
        cause = _link(table, state, receiver, np.int64(sender), range_m, of_sigma)
        if cause != _TAKEN:
            state["rejected"][cause] += 1
    if state["accounted"] >= state["total"]:
        _complete(state)
    return _TAKEN


@kernel
def _advance(state, satellite, dt_s, r, v):
    """State after dt_s [s] of two-body motion into r, v: Taylor series, better than a centimetre in five seconds."""
    r0, v0 = state["r_m"][satellite], state["v_mps"][satellite]
    square = r0[0] * r0[0] + r0[1] * r0[1] + r0[2] * r0[2]
    radius = math.sqrt(square) if square > 0.0 else 1.0
    cube = radius * radius * radius
    radial = 3.0 * (r0[0] * v0[0] + r0[1] * v0[1] + r0[2] * v0[2]) / (radius * radius)
    for axis in range(3):
        a = -MU_M3PS2 * r0[axis] / cube
        jerk = -MU_M3PS2 / cube * (v0[axis] - radial * r0[axis])
        r[axis] = r0[axis] + dt_s * (v0[axis] + dt_s * (0.5 * a + dt_s / 6.0 * jerk))
        v[axis] = v0[axis] + dt_s * (a + 0.5 * dt_s * jerk)


@kernel
def _fill(table, state, epoch):
    """Put the complete epoch into a monitor's record: every message at the instant of the epoch."""
    state["ready"] = 0
    t_ns = state["last_gps_ns"]
    for satellite in range(table["satellites"]):
        t_ref_ns = state["t_ref_ns"][satellite]
        dt_s = (t_ns - t_ref_ns) * 1e-9
        known = t_ref_ns > 0 and abs(dt_s) <= table["ephemeris_age_max_s"]
        if not known:
            dt_s = 0.0
        epoch["known"][satellite] = 1 if known else 0
        _advance(state, satellite, dt_s, epoch["r_m"][satellite], epoch["v_mps"][satellite])
        epoch["clock_m"][satellite] = state["clock_m"][satellite] + state["clock_rate_mps"][satellite] * dt_s
        epoch["issue"][satellite] = state["issue"][satellite]
        epoch["healthy"][satellite] = state["healthy"][satellite]
    epoch["t_gps_ns"], epoch["links"] = t_ns, state["done_links"]
    for k in range(state["done_links"]):
        epoch["receiver"][k] = state["done_receiver"][k]
        epoch["sender"][k] = state["done_sender"][k]
        epoch["range_m"][k] = state["done_range_m"][k]


def _declare(room):
    message, link = CROSSLINK_EPHEMERIS.dtype, CROSSLINK_RANGES.dtype

    @entry(frozen_records(ASSEMBLY_TABLE), records(ASSEMBLY), records(message), I8, records(link), I8, I8)
    def crosslink_take(tables, states, messages, message_count, ranges, range_count, now_ns):
        """Take messages and ranges, the first so many of each; what is refused is counted in `rejected`."""
        table, state = tables[0], states[0]
        for k in range(message_count):
            cause = _message(table, state, messages[k])
            if cause != _TAKEN:
                state["rejected"][cause] += 1
        for k in range(range_count):
            cause = _ranges(table, state, ranges[k], now_ns)
            if cause != _TAKEN:
                state["rejected"][cause] += 1
        state["code"] = room

    @entry(frozen_records(ASSEMBLY_TABLE), records(ASSEMBLY), records(EPOCH))
    def crosslink_fill(tables, states, epochs):
        """Hand the complete epoch over; nothing waits then."""
        _fill(tables[0], states[0], epochs[0])
        return room

    return crosslink_take, crosslink_fill


crosslink_take, crosslink_fill = _declare(ROOM)
