"""What the navigation step says: the state at the stamp, its bound, the verdict, the alerts that hold."""

from __future__ import annotations

import math

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import FlagState, Validity, Verdict
from flightsw.kernels import frames
from flightsw.kernels.integrators import rk4
from flightsw.kernels.registry import kernel
from flightsw.modes import AUTONOMOUS, INIT
from flightsw.nav.chain import HELD, is_overdue
from flightsw.nav.stored_acceleration import coverage_pct

_RAISED = int(FlagState.RAISED)
_STALE = int(FlagState.STALE)
_NOT_READY = int(Verdict.NOT_READY)
_TRUSTED = int(Verdict.TRUSTED)
_TRUSTED_COASTING = int(Verdict.TRUSTED_COASTING)
_DO_NOT_USE = int(Verdict.DO_NOT_USE)
_STATE_VALID = int(Validity.STATE_VALID)
_TIME_VALID = int(Validity.TIME_VALID)
_HAS_STATE = int(Validity.INITIALISED)
_FLAG_RAISED_BIT = 1 << int(AlertId.FLAG_RAISED)
_BOUND_STALE_BIT = 1 << int(AlertId.BOUND_STALE)
_OUTAGE_BIT = 1 << int(AlertId.OUTAGE_START)
_DA_MISSING_BIT = 1 << int(AlertId.STORED_DA_MISSING)
_ORIENTATION_BIT = 1 << int(AlertId.EARTH_ORIENTATION_EXPIRED)


@kernel
def _nothing(out):
    for i in range(3):
        out.r_gcrf_m[i] = math.nan
        out.v_gcrf_mps[i] = math.nan
        out.da_gcrf_mps2[i] = math.nan
    out.bound_m = math.nan
    out.bound_3d_m = math.nan
    out.fix_age_s = math.nan
    out.outage_age_s = 0.0


@kernel
def _state_at(nav, table, t_gps_ns, work, out):
    """The newest epoch carried to the stamp. RK4 whatever the table's integrator: it adds no error of its own."""
    x = work.x_publish
    x[:] = nav.x
    for i in range(3):
        x[6 + i] = nav.beyond_mps2[i]
    rk4(table, x, (t_gps_ns - nav.t_gps_ns) * 1e-9, nav.pole, work.stages)
    for i in range(3):
        out.r_gcrf_m[i] = x[i]
        out.v_gcrf_mps[i] = x[3 + i]
        out.da_gcrf_mps2[i] = x[6 + i]


@kernel
def publish(nav, table, eop, t_gps_ns, work, out):
    """Fill the output record for the stamp; t_gps_ns is ignored while the clock is not valid."""
    out.mode = nav.mode
    out.flag = nav.flag
    out.flag_age_s = nav.flag_age_s
    out.limit_m = table.limit_m
    out.driver = table.flag_driver
    out.streak = nav.streak
    out.mean_nis = nav.mean_nis
    out.alerts = 0
    out.validity = 0
    out.da_source = nav.da_source
    out.da_coverage_pct = coverage_pct(nav, table, t_gps_ns)
    out.t_gps_ns = 0
    if nav.clock_valid:
        out.validity |= _TIME_VALID
        out.t_gps_ns = t_gps_ns
        if not frames.covers(eop, t_gps_ns):
            out.alerts |= _ORIENTATION_BIT

    if nav.clock_valid and nav.initialised:
        out.validity |= _HAS_STATE
        _state_at(nav, table, t_gps_ns, work, out)
        out.fix_age_s = (t_gps_ns - nav.t_fix_gps_ns) * 1e-9
        out.outage_age_s = out.fix_age_s if out.fix_age_s > table.autonomous_after_s else 0.0
        if is_overdue(nav, table, t_gps_ns):
            out.bound_m = nav.bound_coast_m
            out.bound_3d_m = nav.bound_coast_3d_m
        else:
            out.bound_m = nav.bound_own_m
            out.bound_3d_m = nav.bound_own_3d_m
        # A chain that has not caught up with the stamp has no bound for it.
        if t_gps_ns - nav.t_gps_ns > table.nav_step_ns:
            out.bound_m = math.nan
            out.bound_3d_m = math.nan
            if out.flag != _RAISED:
                out.flag = _STALE
    else:
        _nothing(out)

    if out.flag == _RAISED or out.flag == _STALE:
        out.verdict = _DO_NOT_USE
    elif out.mode == INIT or nav.fixes_accepted == 0:  # a start that no later fix has confirmed yet
        out.verdict = _NOT_READY
    elif out.mode == AUTONOMOUS:
        out.verdict = _TRUSTED_COASTING
    else:
        out.verdict = _TRUSTED
    if out.verdict == _TRUSTED or out.verdict == _TRUSTED_COASTING:
        out.validity |= _STATE_VALID

    if out.flag == _RAISED:
        out.alerts |= _FLAG_RAISED_BIT
    if out.flag == _STALE:
        out.alerts |= _BOUND_STALE_BIT
    if out.outage_age_s > 0.0:
        out.alerts |= _OUTAGE_BIT
        if nav.da_source == HELD:
            out.alerts |= _DA_MISSING_BIT
