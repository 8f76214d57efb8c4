"""dA along the orbit: stored while fixes correct it, flown in an outage.

dA is what the onboard gravity model lacks, almost the same on neighbouring revolutions. It is kept by argument of
latitude in GCRF, in bins that hold the mean of their last passage. A stretch that was never flown with good fixes,
or too long ago, is missing: it is reported and never read as zero.
"""

from __future__ import annotations

import math

from flightsw.kernels.registry import kernel

_TWO_PI = 2.0 * math.pi


@kernel
def argument_of_latitude(x, work):
    """Angle from the ascending node on the GCRF equator to the position, in [0, 2 pi).

    On an equatorial orbit the node is undefined and the x axis takes its place.
    """
    h = work.momentum
    h[0] = x[1] * x[5] - x[2] * x[4]
    h[1] = x[2] * x[3] - x[0] * x[5]
    h[2] = x[0] * x[4] - x[1] * x[3]
    size = math.sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2])
    node = work.node
    node[0] = -h[1]
    node[1] = h[0]
    node[2] = 0.0
    length = math.sqrt(node[0] * node[0] + node[1] * node[1])
    if not (length > 1e-8 * size):
        node[0] = 1.0
        node[1] = 0.0
        length = 1.0
    cos_u = (x[0] * node[0] + x[1] * node[1]) / length
    # h x node / (|h| |node|) is the in-plane direction a quarter turn ahead of the node.
    sin_u = (x[0] * (-h[2] * node[1]) + x[1] * (h[2] * node[0]) + x[2] * (h[0] * node[1] - h[1] * node[0])) / (
        size * length
    )
    u = math.atan2(sin_u, cos_u)
    return u if u >= 0.0 else u + _TWO_PI


@kernel
def store(nav, table, x, t_gps_ns, work):
    """Put dA of a well corrected state into its bin; entering a bin forgets its former passage."""
    bins = table.stored_da_bins
    index = min(bins - 1, int(argument_of_latitude(x, work) / _TWO_PI * bins))
    if index != nav.da_bin:
        nav.da_bin = index
        nav.da_samples[index] = 0
    nav.da_samples[index] += 1
    nav.da_t_gps_ns[index] = t_gps_ns
    for i in range(3):
        mean = 0.0 if nav.da_samples[index] == 1 else nav.da_mean[index, i]
        nav.da_mean[index, i] = mean + (x[6 + i] - mean) / nav.da_samples[index]


@kernel
def _is_covered(nav, table, index, t_gps_ns):
    return (
        nav.da_samples[index] >= table.stored_da_min_samples
        and (t_gps_ns - nav.da_t_gps_ns[index]) * 1e-9 <= table.stored_da_max_age_s
    )


@kernel
def recall(nav, table, x, t_gps_ns, work):
    """Write the stored dA at this place of the orbit into x[6:9]; False, and x untouched, where it is missing."""
    bins = table.stored_da_bins
    place = argument_of_latitude(x, work) / _TWO_PI * bins - 0.5
    below = math.floor(place)
    share = place - below
    first = below % bins
    second = (below + 1) % bins
    has_first = _is_covered(nav, table, first, t_gps_ns)
    has_second = _is_covered(nav, table, second, t_gps_ns)
    if not has_first and not has_second:
        return False
    if not has_first:
        share = 1.0
    elif not has_second:
        share = 0.0
    for i in range(3):
        lower = nav.da_mean[first, i] if has_first else 0.0
        upper = nav.da_mean[second, i] if has_second else 0.0
        x[6 + i] = (1.0 - share) * lower + share * upper
    return True


@kernel
def coverage_pct(nav, table, t_gps_ns):
    """Share of the bins that could be flown now, in per cent, rounded down."""
    covered = 0
    for index in range(table.stored_da_bins):
        if _is_covered(nav, table, index, t_gps_ns):
            covered += 1
    return 100 * covered // table.stored_da_bins
