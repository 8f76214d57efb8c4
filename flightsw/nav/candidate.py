"""Fixes that agree with each other: how navigation starts, and starts anew when it is the state that is wrong."""

from __future__ import annotations

import math

from flightsw.kernels.integrators import rk4
from flightsw.kernels.registry import kernel
from flightsw.records import STATES


@kernel
def offer(nav, table, t_gps_ns, sigma_r_m, sigma_v_mps, work):
    """Count the fix in work.z into the row of fixes that agree under the onboard dynamics; returns the count.

    Two fixes agree when the older one, carried to the time of the newer, differs by no more than
    `agreement_sigmas` of the difference in every component. The carried one has grown by its velocity sigma.
    """
    dt_s = (t_gps_ns - nav.candidate_t_gps_ns) * 1e-9
    agrees = nav.candidate_count > 0 and dt_s > 0.0 and dt_s <= table.agreement_gap_max_s
    if agrees:
        x = work.x_candidate
        for i in range(STATES):
            x[i] = nav.candidate_x[i]
        rk4(table, x, dt_s, nav.pole, work.stages)
        old_r = math.hypot(nav.candidate_sigma_r_m, dt_s * nav.candidate_sigma_v_mps)
        limit_r = table.agreement_sigmas * math.hypot(sigma_r_m, old_r)
        limit_v = table.agreement_sigmas * math.hypot(sigma_v_mps, nav.candidate_sigma_v_mps)
        for i in range(3):
            if not (abs(work.z[i] - x[i]) <= limit_r) or not (abs(work.z[3 + i] - x[3 + i]) <= limit_v):
                agrees = False
    nav.candidate_count = nav.candidate_count + 1 if agrees else 1
    nav.candidate_t_gps_ns = t_gps_ns
    for i in range(6):
        nav.candidate_x[i] = work.z[i]
    for i in range(6, STATES):
        nav.candidate_x[i] = 0.0
    nav.candidate_sigma_r_m = sigma_r_m
    nav.candidate_sigma_v_mps = sigma_v_mps
    return nav.candidate_count
