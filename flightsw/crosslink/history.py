"""Slow faults: a contrast over the last minutes that knows a satellite's constant error as its own, not as a fault.

Residuals are averaged over blocks of some seconds for every pair. Against a fault that began at a given age and has
grown linearly since, each link's best estimate of the growth is a weighted sum of its blocks that any constant drops
out of. These estimates go into the same weighted test as the residuals of one epoch; what turns a healthy satellite's
constant error or its rate into growth, the turning of the lines of sight above all, is in their covariance.

Against a fault that is there from the beginning of an ephemeris the mean of some blocks is tested as well: its noise is
small, and what is left is what healthy satellites may broadcast.

A bank of ages is tried, one in an epoch, whenever a block is finished (Willsky and Jones 1976: a generalised likelihood
ratio over the onset, here on a fixed grid).
"""

from __future__ import annotations

import math

from flightsw.crosslink.declare import kernel
from flightsw.crosslink.geometry import axes, sensitivity
from flightsw.crosslink.records import BLOCKS, PAIRS, PARAMETERS, SATELLITES

_GROUP = 6  # blocks for which the lines of sight are taken as of the middle one


@kernel
def begin_epoch(history, epoch, satellites):
    """Note new ephemerides: what was measured before tells nothing of their errors."""
    for satellite in range(satellites):
        if epoch["known"][satellite] != 0 and epoch["issue"][satellite] != history["issue"][satellite]:
            history["issue"][satellite] = epoch["issue"][satellite]
            history["since"][satellite] = history["block"] + (1 if history["epochs"] > 0 else 0)


@kernel
def enter(history, epoch, residual_m, links, usable, axes_of, satellites, block_epochs):
    """Add the residuals of an epoch to the block under way; finish the block if it is full."""
    row = history["block"] % BLOCKS
    if history["epochs"] == block_epochs // 2:
        for satellite in range(satellites):
            for i in range(3):
                known = usable[satellite] != 0
                history["r_m"][row, satellite, i] = epoch["r_m"][satellite, i] if known else 0.0
                for j in range(3):
                    history["axes"][row, satellite, i, j] = axes_of[satellite, i, j]
    for link in range(links):
        value = residual_m[link]
        receiver, sender = epoch["receiver"][link], epoch["sender"][link]
        block = history["block"]
        if not math.isnan(value) and history["since"][receiver] <= block and history["since"][sender] <= block:
            pair = receiver * SATELLITES + sender
            history["sum_m"][pair, row] += value
            history["count"][pair, row] += 1.0
    history["epochs"] += 1
    if history["epochs"] >= block_epochs:
        history["epochs"] = 0
        history["block"] += 1
        history["onset"] = 0
        row = history["block"] % BLOCKS
        for pair in range(PAIRS):
            history["sum_m"][pair, row] = 0.0
            history["count"][pair, row] = 0.0
        for satellite in range(SATELLITES):
            for i in range(3):
                history["r_m"][row, satellite, i] = 0.0


@kernel
def _add_group(history, test, at, receiver, sender, block, two_way, weight, moment, ramp, work):
    """Add what a group of blocks contributes to the sensitivities of row `at`, lines of sight as of one block."""
    row = block % BLOCKS
    square = 0.0
    for i in range(3):
        work["direction"][i] = history["r_m"][row, receiver, i] - history["r_m"][row, sender, i]
        square += work["direction"][i] * work["direction"][i]
    if not (square > 0.0):
        return False
    length = math.sqrt(square)
    for i in range(3):
        work["direction"][i] /= length
    sensitivity(work["direction"], history["axes"][row, receiver], 1.0, two_way, work["h"][0])
    sensitivity(work["direction"], history["axes"][row, sender], -1.0, two_way, work["h"][1])
    for end in range(2):
        for k in range(PARAMETERS):
            h = work["h"][end, k]
            test["h_bias"][at, end, k] += weight * h
            test["h_rate"][at, end, k] += moment * h
            test["h"][at, end, k] += ramp * h
    return True


@kernel
def contrast_of(history, test, at, receiver, sender, onset_blocks, block_s, sigma_range_m, two_way, work):
    """Row `at` of the test: growth [m/s] of a pair's residual since `onset_blocks` ago; NaN where too little is known.

    The estimate is sum_k n_k (t_k - t_mean) b_k / D with D = sum_k n_k (t_k - t_mean)^2: b_k the mean of n_k residuals
    of block k, t_k its time since the onset, not below zero. Its variance is sigma^2 / D. For a negative `onset_blocks`
    it is the mean [m] of the last so many blocks, which is the same sum with t_k = 1 and t_mean = 0.
    """
    now = history["block"]
    level = onset_blocks < 0
    first = max(max(now - BLOCKS + 1, history["since"][receiver]), max(history["since"][sender], 0))
    onset = now - onset_blocks
    unit_s = block_s
    if level:
        first = max(first, now + onset_blocks)
        unit_s = 1.0
    pair = receiver * SATELLITES + sender
    counts, sums = history["count"][pair], history["sum_m"][pair]
    # a row of the history is a ring; dividing for every place in it would cost more than all the rest
    start_row = first % BLOCKS
    total, mean = 0.0, 0.0
    row = start_row
    for block in range(first, now):
        n = counts[row]
        total += n
        if not level:
            mean += n * max(0.0, block + 0.5 - onset)
        row = row + 1 if row < BLOCKS - 1 else 0
    if not (total > 0.0):
        return math.nan
    mean /= total
    spread = 0.0
    row = start_row
    for block in range(first, now):
        t = 1.0 if level else max(0.0, block + 0.5 - onset) - mean
        spread += counts[row] * t * t
        row = row + 1 if row < BLOCKS - 1 else 0
    if not (spread > 0.0):
        return math.nan
    test["receiver"][at], test["sender"][at] = receiver, sender
    for end in range(2):
        for k in range(PARAMETERS):
            test["h"][at, end, k] = 0.0
            test["h_bias"][at, end, k] = 0.0
            test["h_rate"][at, end, k] = 0.0
    scale = 1.0 / (spread * unit_s)
    estimate, weight, moment, ramp = 0.0, 0.0, 0.0, 0.0
    start = first
    row = start_row
    for block in range(first, now):
        t = 1.0 if level else max(0.0, block + 0.5 - onset)
        share = (t - mean) * scale
        estimate += share * sums[row]
        w = share * counts[row]
        weight += w
        moment += w * (block + 0.5 - now) * block_s
        ramp += w * t * unit_s
        if block - start + 1 == _GROUP or block == now - 1:
            if not _add_group(
                history, test, at, receiver, sender, (start + block) // 2, two_way, weight, moment, ramp, work
            ):
                return math.nan
            start = block + 1
            weight, moment, ramp = 0.0, 0.0, 0.0
        row = row + 1 if row < BLOCKS - 1 else 0
    test["noise_m2"][at] = sigma_range_m * sigma_range_m / (spread * unit_s * unit_s)
    return estimate


@kernel
def local_axes(epoch, usable, axes_of, satellites):
    """Axes of every satellite with an ephemeris that can be; `usable` becomes 0 for the others."""
    for satellite in range(satellites):
        usable[satellite] = 0
        if epoch["known"][satellite] != 0 and axes(
            epoch["r_m"][satellite], epoch["v_mps"][satellite], axes_of[satellite]
        ):
            usable[satellite] = 1
