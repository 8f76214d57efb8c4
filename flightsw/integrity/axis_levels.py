"""The bound axis by axis: what each axis has of the bound that is published, which is that of the largest.

The bound of an interval of the grid is that of the larger of its two ends, times margins, plus what is in doubt; it
begins an outage with no less than it had at the last fix. All of that is one factor and one summand, the same for every
axis: an axis whose standard deviation is half the largest has half of what is beyond the doubt. So nothing is decided
here, and no level contradicts the bound: the largest of GCRF is the bound itself, to the bit.
"""

from __future__ import annotations

import math

from flightsw.kernels.registry import F8, I8, MATRIX, entry, frozen_records, kernel, records
from flightsw.nav import chain, clock, flight_filter, flight_model
from flightsw.records import NAV, TABLE, WORK

GCRF = 0  # rows of the levels
RTN = 1


@kernel
def _larger(a, b):
    """The larger of two; NaN where either is, which `max` would drop."""
    return a if a >= b or math.isnan(a) else b


@kernel
def _widen(p, rtn, levels):
    """Take the standard deviations along both sets of axes into the levels where they are larger."""
    for i in range(3):
        variance = 0.0
        for j in range(3):
            for k in range(3):
                variance += rtn[j, i] * p[j, k] * rtn[k, i]
        levels[GCRF, i] = _larger(levels[GCRF, i], math.sqrt(p[i, i]))
        levels[RTN, i] = _larger(levels[RTN, i], math.sqrt(max(variance, 0.0)))


@kernel
def _spread(nav, table, t_gps_ns, work, levels):
    """The larger standard deviation of both ends of the interval, as the bound takes it."""
    dt_s = chain.grid_step_ns(nav, table) * 1e-9
    rtn = work.burn_rtn
    flight_model.rtn_basis(nav.x, rtn)
    levels[:, :] = 0.0
    if table.filter_model == flight_model.FLIGHT:
        _widen(nav.covariance, rtn, levels)
        flight_model.turn_rtn(rtn, flight_model.orbital_rate_radps(nav.x) * dt_s)
        end_gps_ns = nav.t_gps_ns + round(dt_s * 1e9)
        variance_s2 = clock.phase_variance_s2(nav, table, end_gps_ns)
        flight_filter.published_covariance(nav, table, end_gps_ns, nav.UD_ahead, nav.x, variance_s2, work)
        _widen(work.P_rv, rtn, levels)
    elif chain.is_overdue(nav, table, t_gps_ns):
        _widen(nav.P_bound, rtn, levels)
        flight_model.turn_rtn(rtn, flight_model.orbital_rate_radps(nav.x) * dt_s)
        _widen(nav.P_bound_ahead, rtn, levels)
    else:
        _widen(nav.P, rtn, levels)
        flight_model.turn_rtn(rtn, flight_model.orbital_rate_radps(nav.x) * dt_s)
        _widen(nav.P_ahead, rtn, levels)


@entry(records(NAV), frozen_records(TABLE), records(WORK), F8, I8, MATRIX)
def axis_levels(nav_record, table_record, work_record, bound_m, t_gps_ns, levels):
    """Levels (2, 3) [m] of a published bound: along x, y, z of GCRF; radial, along-track, cross-track.

    bound_m, t_gps_ns: bound (12) and stamp as published with this record. All NaN where the bound is not finite.
    Changes nothing but `levels` and scratch. The orbit's axes are not those that the flag looks at: along the error, a
    level can be up to sqrt(3) times the bound.
    """
    nav, table, work = nav_record[0], table_record[0], work_record[0]
    if not math.isfinite(bound_m):
        levels[:, :] = math.nan
        return
    _spread(nav, table, t_gps_ns, work, levels)
    largest = _larger(_larger(levels[GCRF, 0], levels[GCRF, 1]), levels[GCRF, 2])
    # a bound without a covariance behind it (a table that has just been swapped) is that of every axis
    known = largest > 0.0 and math.isfinite(largest)
    for frame in range(2):
        for i in range(3):
            share = levels[frame, i] / largest if known else 1.0
            level_m = nav.monitor_doubt_m + share * (bound_m - nav.monitor_doubt_m)
            levels[frame, i] = bound_m if share == 1.0 else level_m
