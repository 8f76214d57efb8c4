"""Faults of navigation satellites, on any number of them. What each kind's value means stands in pseudorange_schema."""

from __future__ import annotations

import numpy as np

from hil_sim.gps_time import NS
from hil_sim.pseudorange_schema import SYSTEMS, SatelliteFault
from hil_sim.pseudoranges.receiver import RawSeries


def struck(fault: SatelliteFault, series: RawSeries, t_start_gps_ns: int) -> np.ndarray:
    """Satellites (s,) bool that a fault strikes."""
    ours = np.ones(len(series.number), bool)
    if fault.constellation != "all":
        ours = series.system == SYSTEMS.index(fault.constellation)
    if fault.satellites:
        return ours & np.isin(series.number, fault.satellites)
    if fault.count is None:
        return ours
    begin = t_start_gps_ns + round(fault.start_s * NS)
    row = min(int(np.searchsorted(series.t_true_gps_ns, begin)), len(series.t_true_gps_ns) - 1)
    height = np.where(ours & series.seen[row], series.elevation_rad[row], -np.inf)
    chosen = np.argsort(-height, kind="stable")[: fault.count]
    hit = np.zeros(len(ours), bool)
    hit[chosen[np.isfinite(height[chosen])]] = True
    return hit


def corrupt(faults: tuple[SatelliteFault, ...], series: RawSeries, t_start_gps_ns: int) -> None:
    """Apply the faults in the order of the scenario, in place."""
    # chosen before any of them has changed what is seen
    hits = series.struck = tuple(struck(fault, series, t_start_gps_ns) for fault in faults)
    for fault, satellites in zip(faults, hits, strict=True):
        start = t_start_gps_ns + round(fault.start_s * NS)
        t = series.t_true_gps_ns
        when = (t >= start) & (t < start + round(fault.duration_s * NS))
        at = np.ix_(when, satellites)
        value = 0.0 if fault.value is None else fault.value
        if fault.kind == "step":
            series.range_m[at] += value
        elif fault.kind == "ramp":
            series.range_m[at] += value * ((t[when] - start) / NS)[:, None]
        elif fault.kind == "lift":  # a receiver that rises by d is nearer by d times the sine of the elevation
            rise_m = value * ((t[when] - start) / NS)[:, None]
            series.range_m[at] -= rise_m * np.sin(series.elevation_rad[at])
        elif fault.kind == "nan":
            series.range_m[at] = np.nan
        elif fault.kind == "sigma":
            series.sigma_m[at] = value
        elif fault.kind == "duplicate":
            series.repeats[at] = 2
        elif fault.kind == "wrong_constellation":
            series.system_sent[at] = round(value) & 0xFF
        elif fault.kind == "no_ephemeris":
            series.usable[at] = False
        elif fault.kind == "unhealthy":
            series.healthy[at] = False
        else:
            series.seen[at] = False
