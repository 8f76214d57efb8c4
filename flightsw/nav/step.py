"""The navigation step: the one compiled function that decides state, covariance, mode, bound and flag.

Flight calls it every tick, with whatever the bus has brought; a Monte Carlo arc is a compiled `for` around it.
The filter lives on a grid of epochs, `nav_step` apart and anchored at the last accepted fix. What is published is
that state propagated to the stamp. A bound belongs to an interval of the grid and is the larger of its two ends,
so it does not depend on how often, or when within the interval, it is asked for.
"""

from __future__ import annotations

import math

from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import EditMode, NavCommand, RejectCause
from flightsw.integrity import envelope, failure_flag
from flightsw.kernels import linalg
from flightsw.kernels.registry import entry, frozen_records, kernel, records
from flightsw.modes import next_mode
from flightsw.nav import antenna, chain, clock, fix, fix_checks, flight_filter, flight_model, manoeuvre, monitor, upload
from flightsw.nav.dynamics import Model
from flightsw.nav.publish import publish
from flightsw.records import (
    FIELD,
    FORCE_TABLE,
    FORCE_WORK,
    INPUT,
    MEASUREMENTS,
    NAV,
    ORIENTATION,
    OUTPUT,
    TABLE,
    TYPES,
    WORK,
)

_CLOCK_UNSET = int(RejectCause.CLOCK_UNSET)
_TIME_JUMP = int(RejectCause.TIME_JUMP)
_SYNC_JUMP = int(RejectCause.SYNC_JUMP)
_BURN_LATE = int(RejectCause.BURN_LATE)
_COMMAND_INVALID = int(RejectCause.COMMAND_INVALID)
_EDIT = int(NavCommand.EDIT)
_RESET_FILTER = int(NavCommand.RESET_FILTER)
_INHIBIT = int(EditMode.INHIBIT)
_BURN_REFUSED = 1 << int(AlertId.BURN_REFUSED)
_DIVERGED = 1 << int(AlertId.DIVERGED)
_TIME_JUMP_REJECTED = 1 << int(AlertId.TIME_JUMP_REJECTED)
_CLOCK_REINITIALISED = 1 << int(AlertId.CLOCK_REINITIALISED)
_STATE_UPLOADED = 1 << int(AlertId.STATE_UPLOADED)
_UPLOAD_REFUSED = 1 << int(AlertId.UPLOAD_REFUSED)


@kernel
def _raise(nav):
    """Raise the flag whatever the bound says; only fixes that have proven the state clear it."""
    if nav.flag != failure_flag.RAISED:
        nav.flag = failure_flag.RAISED
        nav.flag_age_s = (nav.t_gps_ns - nav.t_fix_gps_ns) * 1e-9 if nav.initialised else 0.0


@kernel
def _give_up(nav):
    """Forget the state; the flag stays up until fixes have proven a new one."""
    _raise(nav)
    nav.initialised = 0
    nav.candidate_count = 0
    nav.arc_count = 0


@kernel
def _begin_new_time(nav, out):
    """Every time stamp held so far belongs to the old time."""
    out.events |= _CLOCK_REINITIALISED
    _give_up(nav)
    nav.t_seen_gps_ns = 0
    nav.t_evaluated_gps_ns = 0
    nav.attitude_gps_ns = 0
    nav.da_samples[:] = 0


@kernel
def _keep_time(nav, table, inp, out):
    outcome = clock.take_pulse(
        nav,
        table,
        inp.pulse_status,
        inp.pulse_gps_ns,
        inp.pulse_counter_ns,
        inp.pulse_sigma_ns,
        inp.counter_now_ns,
    )
    if outcome == clock.RESTARTED:
        _begin_new_time(nav, out)
    elif outcome >= 0:
        nav.rejected[outcome] += 1
        if outcome == _SYNC_JUMP:
            out.events |= _TIME_JUMP_REJECTED


@kernel
def _take_fix(nav, table, model, inp, work, out):
    tag = clock.take_tag(nav, table, inp.fix_gps_ns, inp.fix_counter_ns, inp.counter_now_ns)
    if tag == clock.RESTARTED:
        _begin_new_time(nav, out)
    if not nav.clock_valid:
        cause = _CLOCK_UNSET
    else:
        cause = fix_checks.check_time(nav, table, inp)
        if cause == _TIME_JUMP:
            out.events |= _TIME_JUMP_REJECTED
        if cause == fix_checks.PASSED:
            cause = fix_checks.check_content(table, inp)
        if cause == fix_checks.PASSED:
            cause = fix.process(nav, table, model, inp, work, out)
    if cause >= 0:
        nav.rejected[cause] += 1
    out.fix_seen = 1
    out.fix_gps_ns = inp.fix_gps_ns
    out.fix_cause = cause
    out.fix_used = 1 if cause < 0 else 0


@kernel
def _take_burn(nav, table, model, inp, work, out):
    """An announced manoeuvre. One that comes too late leaves an error that no bound knows of: the flag is raised."""
    if not nav.clock_valid:
        nav.rejected[_CLOCK_UNSET] += 1
        return
    t_now = clock.gps_at(nav, inp.counter_now_ns)
    slot = manoeuvre.announce(nav, table, inp, t_now)
    if slot <= manoeuvre.REFUSED:
        cause = manoeuvre.REFUSED - slot
        nav.rejected[cause] += 1
        out.events |= _BURN_REFUSED
        if cause == _BURN_LATE:
            _raise(nav)
    elif slot != manoeuvre.KNOWN and nav.initialised:
        chain.catch_up(nav, table, model, slot, work)


@kernel
def _obey(nav, table, inp):
    """A command of the operator."""
    if inp.command_id == _EDIT and 0 <= inp.command_target < TYPES and 0 <= inp.command_value <= _INHIBIT:
        nav.edit_ordered[inp.command_target] = 1 + inp.command_value
    elif inp.command_id == _RESET_FILTER:
        _give_up(nav)
        nav.excluded[:] = 0
        nav.contradicted = 0  # the operator has looked
    else:
        nav.rejected[_COMMAND_INVALID] += 1


@kernel
def _take_upload(nav, table, model, inp, work, out):
    """A state from the ground, as start or as correction."""
    cause = _CLOCK_UNSET
    if nav.clock_valid:
        cause = upload.take(nav, table, model, inp, clock.gps_at(nav, inp.counter_now_ns), work, out)
    out.upload_cause = cause
    if cause == upload.USED:
        out.events |= _STATE_UPLOADED
    else:
        out.events |= _UPLOAD_REFUSED
        nav.rejected[cause] += 1


@kernel
def _end_watch(nav, table, model, work, out):
    """Fixes have ended, used or refused: what they spoke for cannot be settled any more.

    A manoeuvre in doubt is taken for one, uncertain as it is: the outage begins with a bound that covers it.
    """
    slot = monitor.manoeuvre_in_doubt(nav, nav.t_gps_ns, work)
    if slot != monitor.NOTHING:
        linalg.copy_vector(nav.x, work.x)
        linalg.copy_matrix(nav.UD, work.UD)
        flight_filter.adopt(nav, table, nav.t_gps_ns, slot, work, out)
        chain.commit_aside(nav, table, model, nav.t_gps_ns, work)
    monitor.forget(nav)


@entry(
    records(NAV),
    records(INPUT),
    frozen_records(TABLE),
    frozen_records(ORIENTATION),
    frozen_records(FORCE_TABLE),
    frozen_records(FIELD),
    records(WORK),
    records(FORCE_WORK),
    records(OUTPUT),
)
def step(
    nav_record,
    input_record,
    table_record,
    orientation_record,
    forces_record,
    field_record,
    work_record,
    scratch_record,
    output_record,
):
    """Advance navigation to the reading of the counter in the input. Arrays of one record each; see `records`.

    The force table and the gravity field are read by the flight filter only.

    A pulse and a fix may come with a call; call again with the same reading for more of them. Rejections are
    counted by cause in NAV.rejected and change nothing else.
    """
    nav = nav_record[0]
    inp = input_record[0]
    table = table_record[0]
    model = Model(orientation_record[0], forces_record[0], field_record[0], scratch_record[0])
    work = work_record[0]
    out = output_record[0]
    out.events = 0
    out.fix_seen = 0
    out.fix_used = 0
    out.fix_cause = -1
    out.fix_gps_ns = 0
    out.gate = table.gate_nis
    out.nis = math.nan  # a fix refused before the filter has no innovation, least of all that of the fix before it
    for i in range(MEASUREMENTS):
        out.innovation[i] = math.nan
        out.innovation_sigma[i] = math.nan

    for kind in range(TYPES):
        out.type_cause[kind] = flight_filter.ABSENT
        out.type_nis[kind] = math.nan
        out.type_gate[kind] = math.nan
    out.monitor_statistic = 0.0
    out.upload_cause = flight_filter.ABSENT
    out.upload_nis = math.nan

    if inp.pulse_present:
        _keep_time(nav, table, inp, out)
    if inp.command_present:
        _obey(nav, table, inp)
    if inp.attitude_present:
        cause = _CLOCK_UNSET
        if nav.clock_valid:
            cause = antenna.take_attitude(nav, table, inp, clock.gps_at(nav, inp.counter_now_ns))
        if cause >= 0:
            nav.rejected[cause] += 1
    if inp.burn_present:
        _take_burn(nav, table, model, inp, work, out)
    if inp.upload_present:
        _take_upload(nav, table, model, inp, work, out)
    if inp.fix_present:
        _take_fix(nav, table, model, inp, work, out)
    t_now = clock.gps_at(nav, inp.counter_now_ns) if nav.clock_valid else 0

    age_s = 0.0
    if nav.initialised:
        steps = 0
        while nav.t_gps_ns + chain.grid_step_ns(nav, table) <= t_now and steps < chain.CATCH_UP:
            chain.advance(nav, table, model, work)
            steps += 1
        if table.filter_model == flight_model.FLIGHT and not flight_filter.is_sound(table, nav.x, nav.UD):
            out.events |= _DIVERGED
            _give_up(nav)
    if nav.initialised:
        age_s = (t_now - nav.t_fix_gps_ns) * 1e-9
        envelope.note_burn(nav, table, manoeuvre.is_active(nav, t_now, 1e-9), t_now)
        if envelope.outlived(nav, table, t_now):
            _raise(nav)  # as if the bound had crossed the limit: nothing is proven from here on
    coasting = age_s > table.autonomous_after_s
    if coasting:
        nav.streak = 0
        if (t_now - nav.t_seen_gps_ns) * 1e-9 > table.autonomous_after_s:
            _end_watch(nav, table, model, work, out)
        nav.da_bin = -1  # the passage of a bin of stored dA ends with the fixes
    nav.mode = next_mode(nav.mode, nav.initialised, nav.flag, coasting, nav.streak >= table.integrated_after_fixes)
    publish(nav, table, model, t_now, work, out)
