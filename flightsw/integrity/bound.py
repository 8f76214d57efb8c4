"""Bounds on the position error from a covariance: per axis (12), and in three dimensions."""

from __future__ import annotations

import math

from flightsw.kernels.linalg import largest_eigenvalue_3x3
from flightsw.kernels.registry import kernel


@kernel
def axis_bound_m(table, p):
    """s = k max_i sqrt(P_ii), i = x, y, z in GCRF; equation (12). NaN where a variance is negative or NaN."""
    largest = 0.0
    for i in range(3):
        # Not max(): it drops a NaN, and a bound over the two good axes would look healthy.
        if not (p[i, i] >= 0.0):
            return math.nan
        if p[i, i] > largest:
            largest = p[i, i]
    return table.k_axis * math.sqrt(largest)


@kernel
def radius_bound_m(table, p):
    """r = k3 sqrt(lambda_max(P_rr)): a sphere, whatever the axes."""
    return table.k_radius * math.sqrt(largest_eigenvalue_3x3(p))
