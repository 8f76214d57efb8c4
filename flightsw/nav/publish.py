"""What the navigation step says: the state at the stamp, its bound, the verdict, the alerts that hold."""

from __future__ import annotations

import math

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import EditMode, FlagState, Validity, Verdict
from flightsw.integrity import envelope
from flightsw.kernels import frames, linalg
from flightsw.kernels.integrators import rk4
from flightsw.kernels.registry import kernel
from flightsw.modes import AUTONOMOUS, INIT
from flightsw.nav import clock, flight_model, manoeuvre
from flightsw.nav.chain import HELD, grid_step_ns, is_overdue
from flightsw.nav.measurement import editing
from flightsw.nav.stored_acceleration import coverage_pct
from flightsw.records import MEASUREMENTS, TYPES

_RAISED = int(FlagState.RAISED)
_STALE = int(FlagState.STALE)
_NOT_READY = int(Verdict.NOT_READY)
_TRUSTED = int(Verdict.TRUSTED)
_TRUSTED_COASTING = int(Verdict.TRUSTED_COASTING)
_DO_NOT_USE = int(Verdict.DO_NOT_USE)
_NOT_CERTIFIED = int(Verdict.NOT_CERTIFIED)
_STATE_VALID = int(Validity.STATE_VALID)
_TIME_VALID = int(Validity.TIME_VALID)
_HAS_STATE = int(Validity.INITIALISED)
_FLAG_RAISED_BIT = 1 << int(AlertId.FLAG_RAISED)
_BOUND_STALE_BIT = 1 << int(AlertId.BOUND_STALE)
_OUTAGE_BIT = 1 << int(AlertId.OUTAGE_START)
_DA_MISSING_BIT = 1 << int(AlertId.STORED_DA_MISSING)
_FORCES_BIT = 1 << int(AlertId.FORCES_EXPIRED)
_BURN_BIT = 1 << int(AlertId.BURN_ACTIVE)
_DOUBT_BIT = 1 << int(AlertId.FIXES_IN_DOUBT)
_SLOW_FAULT_BIT = 1 << int(AlertId.SLOW_FAULT)
_EDITING_BIT = 1 << int(AlertId.EDITING_OVERRIDDEN)
_AUTO = int(EditMode.AUTO)
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
    out.covariance[:, :] = math.nan
    out.drag_scale = math.nan


@kernel
def _covariance(nav, table, t_gps_ns, work, out):
    """Covariance of the published (r, v), and the drag scale that is estimated beside it.

    The flight filter's is carried from the newest epoch to the stamp, up to a step of an outage: where the error lies
    along the track, its direction counts. The noise of so short a time does not, but for that of the clock.
    """
    if table.filter_model != flight_model.FLIGHT:
        for i in range(MEASUREMENTS):
            for j in range(MEASUREMENTS):
                out.covariance[i, j] = nav.P[i, j]
        out.drag_scale = 1.0
        return
    out.drag_scale = 1.0 + nav.x[9] + nav.x[10]
    flight_model.set_motion((t_gps_ns - nav.t_gps_ns) * 1e-9, nav.gradient_ps2, work)
    r2 = out.r_gcrf_m[0] ** 2 + out.r_gcrf_m[1] ** 2 + out.r_gcrf_m[2] ** 2
    rate = work.column  # of (r, v), by a sphere
    for i in range(3):
        rate[i] = out.v_gcrf_mps[i]
        rate[3 + i] = -table.mu_m3ps2 / (r2 * math.sqrt(r2)) * out.r_gcrf_m[i]
    since_s2 = clock.phase_variance_s2(nav, table, t_gps_ns) - clock.phase_variance_s2(nav, table, nav.t_gps_ns)
    half = work.square  # motion times covariance
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            total = 0.0
            for k in range(MEASUREMENTS):
                total += work.motion[i, k] * nav.covariance[k, j]
            half[i, j] = total
    for i in range(MEASUREMENTS):
        for j in range(i + 1):
            total = 0.0
            for k in range(MEASUREMENTS):
                total += half[i, k] * work.motion[j, k]
            total += since_s2 * rate[i] * rate[j]
            out.covariance[i, j] = total
            out.covariance[j, i] = total


@kernel
def _state_at(nav, table, t_gps_ns, work, out):
    """The newest epoch carried to the stamp. RK4 whatever the table's integrator: it adds no error of its own."""
    x = work.x_publish
    linalg.copy_vector(nav.x, x)
    for i in range(3):
        x[6 + i] = nav.beyond_mps2[i]
    dt_s = (t_gps_ns - nav.t_gps_ns) * 1e-9
    rk4(table, x, dt_s, nav.pole, work.stages)
    if manoeuvre.is_active(nav, nav.t_gps_ns, dt_s):
        flight_model.rtn_basis(nav.x, work.burn_rtn)
        rate_radps = flight_model.orbital_rate_radps(nav.x)
        manoeuvre.apply(nav, nav.t_gps_ns, dt_s, work.burn_rtn, rate_radps, work, x)
    for i in range(3):
        out.r_gcrf_m[i] = x[i]
        out.v_gcrf_mps[i] = x[3 + i]
        out.da_gcrf_mps2[i] = x[6 + i]


@kernel
def publish(nav, table, model, t_gps_ns, work, out):
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
        if not frames.covers(model.eop, t_gps_ns):
            out.alerts |= _ORIENTATION_BIT
        out.sigma_time_s = math.sqrt(clock.phase_variance_s2(nav, table, t_gps_ns))
        if table.filter_model == flight_model.FLIGHT:
            forces = model.forces
            if t_gps_ns < forces.valid_from_gps_ns or t_gps_ns > forces.valid_until_gps_ns:
                out.alerts |= _FORCES_BIT
        if manoeuvre.is_active(nav, t_gps_ns, 1e-9):
            out.alerts |= _BURN_BIT

    if nav.clock_valid and nav.initialised:
        out.validity |= _HAS_STATE
        _state_at(nav, table, t_gps_ns, work, out)
        _covariance(nav, table, t_gps_ns, work, out)
        out.fix_age_s = (t_gps_ns - nav.t_fix_gps_ns) * 1e-9
        out.outage_age_s = out.fix_age_s if out.fix_age_s > table.autonomous_after_s else 0.0
        if is_overdue(nav, table, t_gps_ns):
            out.bound_m = nav.bound_coast_m
            out.bound_3d_m = nav.bound_coast_3d_m
        else:
            out.bound_m = nav.bound_own_m
            out.bound_3d_m = nav.bound_own_3d_m
        # A chain that has not caught up with the stamp has no bound for it.
        if t_gps_ns - nav.t_gps_ns > grid_step_ns(nav, table):
            out.bound_m = math.nan
            out.bound_3d_m = math.nan
            if out.flag != _RAISED:
                out.flag = _STALE
    else:
        _nothing(out)

    if out.flag == _RAISED or out.flag == _STALE:
        out.verdict = _DO_NOT_USE
    elif out.mode == INIT or (nav.fixes_accepted == 0 and nav.t_start_gps_ns <= nav.t_fix_gps_ns):
        out.verdict = _NOT_READY  # a start that no later fix has confirmed yet; one from the ground is never trusted
    elif out.mode == AUTONOMOUS:
        out.verdict = _TRUSTED_COASTING
    else:
        out.verdict = _TRUSTED
    trusted = out.verdict == _TRUSTED or out.verdict == _TRUSTED_COASTING
    out.uncovered = 0
    if trusted and envelope.is_certified(table):
        f107 = model.forces.f107 if table.filter_model == flight_model.FLIGHT else 0.0
        out.uncovered = envelope.uncovered(nav, table, f107, t_gps_ns)
        if out.uncovered != 0:
            out.verdict = _NOT_CERTIFIED
    if out.verdict == _TRUSTED or out.verdict == _TRUSTED_COASTING:
        out.validity |= _STATE_VALID

    if nav.monitor_doubt_m > 0.0:
        out.alerts |= _DOUBT_BIT
    for kind in range(TYPES):
        if nav.excluded[kind]:
            out.alerts |= _SLOW_FAULT_BIT
        if editing(nav, table, kind) != _AUTO:
            out.alerts |= _EDITING_BIT
    if out.flag == _RAISED:
        out.alerts |= _FLAG_RAISED_BIT
    if out.flag == _STALE:
        out.alerts |= _BOUND_STALE_BIT
    if out.outage_age_s > 0.0:
        out.alerts |= _OUTAGE_BIT
        if nav.da_source == HELD:
            out.alerts |= _DA_MISSING_BIT
