"""Monitor of slow faults: which onset, and which sort of fault, do the innovations of the last minutes speak for?

A generalised likelihood ratio test (A. S. Willsky and H. L. Jones, IEEE Trans. AC-21 (1976) 108) over a bank of onsets
and four hypotheses: an unannounced change of velocity, a ramp of the measured position, a step of it, a bias of the
measured velocity. Innovations of a healthy filter are white with covariance S, so under no fault each statistic is
chi-square with three degrees of freedom, whatever the filter does. A fault of a receiver is excluded; a manoeuvre is
the satellite's and opens the covariance. A receiver that lies consistently in position and velocity is a manoeuvre
to any test of a single receiver: that it cannot see.
"""

from __future__ import annotations

import math

from flightsw.icd.enums import FaultKind, MeasurementType, RejectCause
from flightsw.kernels.linalg import cholesky, solve_lower
from flightsw.kernels.registry import kernel
from flightsw.records import MONITOR_HYPOTHESES, MONITOR_SLOTS

MANOEUVRE = int(FaultKind.MANOEUVRE)
POSITION_RAMP = int(FaultKind.POSITION_RAMP)
POSITION_STEP = int(FaultKind.POSITION_STEP)
VELOCITY_BIAS = int(FaultKind.VELOCITY_BIAS)
POSITION = int(MeasurementType.POSITION)
VELOCITY = int(MeasurementType.VELOCITY)

_GATE = int(RejectCause.GATE)
_USED = -1
NOTHING = -1
# measurements that the gate refuses count from the third in a row: one or two are spikes, and the gate has dealt with
# them
_SPIKES = 2
# share of its own statistic that a manoeuvre may leave unexplained: a burn takes time
_UNEXPLAINED = 0.5
# two rings of onsets: dense ones for what is found at once, sparse ones for what takes minutes
_RING = MONITOR_SLOTS // 2
_SPARSE = 8
# chi-square of three degrees of freedom, 0.999
_RETURN = 16.27
_AHEAD_S = 2.0  # until the next fix has been seen
# doubt ends where the statistic has fallen to this share of the threshold: noise carries it across again and again
_DOUBT_ENDS = 0.5


@kernel
def forget(nav):
    """Close all onsets: after an outage, a new start, a change of what is used."""
    nav.monitor_t_gps_ns[:] = 0
    nav.monitor_statistic = 0.0
    nav.monitor_kind = MANOEUVRE
    nav.monitor_doubt_m = 0.0


@kernel
def _open(nav, ring, t_gps_ns):
    k = ring * _RING + nav.monitor_next[ring]
    nav.monitor_next[ring] = (nav.monitor_next[ring] + 1) % _RING
    nav.monitor_t_gps_ns[k] = t_gps_ns
    nav.monitor_information[k] = 0.0
    nav.monitor_evidence[k] = 0.0
    nav.monitor_absorbed[k] = 0.0
    nav.monitor_energy[k] = 0.0
    nav.monitor_dof[k] = 0.0


@kernel
def _gather(nav, k, hypothesis, signature, weight, innovation):
    """Add a measurement that the fault would shift by signature times its size."""
    information = nav.monitor_information[k, hypothesis]
    evidence = nav.monitor_evidence[k, hypothesis]
    at = 0
    for i in range(3):
        for j in range(i, 3):
            information[at] += signature * signature * weight[i, j]
            at += 1
        total = 0.0
        for j in range(3):
            total += weight[i, j] * innovation[j]
        evidence[i] += signature * total


@kernel
def _solve(nav, k, hypothesis, work):
    """Statistic b' J^-1 b of one onset and hypothesis; leaves L^-1 b in work.three. Zero while J is singular."""
    information = nav.monitor_information[k, hypothesis]
    j = work.S
    at = 0
    for row in range(3):
        for column in range(row, 3):
            j[row, column] = information[at]
            j[column, row] = information[at]
            at += 1
    if not cholesky(j, work.S_lower):
        return 0.0
    solve_lower(work.S_lower, nav.monitor_evidence[k, hypothesis], work.three)
    return work.three[0] ** 2 + work.three[1] ** 2 + work.three[2] ** 2


@kernel
def is_watching(nav, table):
    """Whether the filter has converged far enough for its innovations to be those of a healthy one."""
    return table.monitor_use == 1 and nav.monitor_fixes >= table.monitor_settle_fixes


@kernel
def counts(nav, kind, cause):
    """Whether a tested measurement is evidence: used, or refused by the gate again and again."""
    if cause == _USED:
        nav.gate_run[kind] = 0
        return True
    if cause == _GATE:
        nav.gate_run[kind] += 1
        return nav.gate_run[kind] > _SPIKES
    return False


@kernel
def signature(hypothesis, kind, age_s):
    """How a fault of size one, age_s after its onset, shifts a measurement of a type; zero where it does not."""
    if hypothesis == MANOEUVRE:
        return age_s if kind == POSITION else 1.0
    if hypothesis == VELOCITY_BIAS:
        return 0.0 if kind == POSITION else 1.0
    if kind == VELOCITY:
        return 0.0
    return age_s if hypothesis == POSITION_RAMP else 1.0


@kernel
def _gather_type(nav, k, kind, age_s, work):
    """One measurement into all hypotheses of an onset: what the state has absorbed of the fault is not seen any more.

    What it absorbs follows from the mean gains of the filter, work.mean_gain, axes taken for themselves.
    """
    absorbed = nav.monitor_absorbed[k]
    for hypothesis in range(MONITOR_HYPOTHESES):
        shift = signature(hypothesis, kind, age_s) - absorbed[hypothesis, kind]
        _gather(nav, k, hypothesis, shift, work.weight_type[kind], work.innovation_type[kind])
        absorbed[hypothesis, 0] += work.mean_gain[kind, 0] * shift
        absorbed[hypothesis, 1] += work.mean_gain[kind, 1] * shift


@kernel
def observe(nav, table, t_gps_ns, position_nis, velocity_nis, work):
    """Take the innovations of a fix (work.innovation_type, work.weight_type: S^-1) and test them.

    position_nis, velocity_nis: of what counts as evidence, else NaN. work.mean_gain: what the filter has made of it.
    Returns the slot of the most likely onset of nav.monitor_kind, or NOTHING.

    A hypothesis must leave nothing but noise of the innovations. A fault of the receiver is believed where it beats a
    manoeuvre by a margin, and the other way round: to exclude good fixes after a manoeuvre would leave an error that
    no bound knows of. Doubt that lasts, and what comes soon after a manoeuvre, is a manoeuvre. What fits neither (a
    frozen fix) is left to the gate.
    """
    in_doubt = nav.monitor_doubt_m > 0.0
    nav.monitor_statistic = 0.0
    nav.monitor_doubt_m = 0.0
    if nav.monitor_watched % table.monitor_step_fixes == 0:
        _open(nav, 0, t_gps_ns)
    if nav.monitor_watched % (_SPARSE * table.monitor_step_fixes) == 0:
        _open(nav, 1, t_gps_ns)
    nav.monitor_watched += 1
    passed_s = (t_gps_ns - nav.monitor_last_gps_ns) * 1e-9
    nav.monitor_last_gps_ns = t_gps_ns
    fault = 0.0
    fault_kind = NOTHING
    fault_slot = NOTHING
    manoeuvre = 0.0
    manoeuvre_slot = NOTHING
    for k in range(MONITOR_SLOTS):
        onset = nav.monitor_t_gps_ns[k]
        if onset == 0:
            continue
        age_s = (t_gps_ns - onset) * 1e-9
        absorbed = nav.monitor_absorbed[k]
        for hypothesis in range(MONITOR_HYPOTHESES):
            absorbed[hypothesis, 0] += passed_s * absorbed[hypothesis, 1]
        if not math.isnan(position_nis):
            _gather_type(nav, k, POSITION, age_s, work)
            nav.monitor_energy[k] += position_nis
            nav.monitor_dof[k] += 3.0
        if not math.isnan(velocity_nis):
            _gather_type(nav, k, VELOCITY, age_s, work)
            nav.monitor_energy[k] += velocity_nis
            nav.monitor_dof[k] += 3.0
        for hypothesis in range(MONITOR_HYPOTHESES):
            statistic = _solve(nav, k, hypothesis, work)
            if statistic > nav.monitor_statistic:
                nav.monitor_statistic = statistic
                nav.monitor_kind = hypothesis
            if hypothesis == MANOEUVRE:
                if statistic > manoeuvre and _fits(nav, k, statistic, _UNEXPLAINED * statistic):
                    manoeuvre = statistic
                    manoeuvre_slot = k
            elif statistic > fault and _fits(nav, k, statistic, 0.0):
                fault = statistic
                fault_kind = hypothesis
                fault_slot = k
    calm = nav.monitor_pause == 0
    if nav.monitor_pause > 0:
        nav.monitor_pause -= 1
    if calm and fault > table.monitor_threshold and fault - manoeuvre > table.monitor_margin:
        nav.monitor_kind = fault_kind
        return fault_slot
    found = manoeuvre > table.monitor_threshold
    if found or (in_doubt and manoeuvre > _DOUBT_ENDS * table.monitor_threshold):
        nav.monitor_kind = MANOEUVRE
        age_s = (t_gps_ns - nav.monitor_t_gps_ns[manoeuvre_slot]) * 1e-9
        if found and (not calm or manoeuvre - fault > table.monitor_margin or age_s > table.monitor_doubt_s):
            return manoeuvre_slot
        # in doubt: the next fixes will tell; until then the bound holds for a manoeuvre too
        sigma = fault_size(nav, manoeuvre_slot, work)
        speed = math.sqrt(work.residual[0] ** 2 + work.residual[1] ** 2 + work.residual[2] ** 2) + 3.0 * sigma
        nav.monitor_doubt_m = speed * (age_s + _AHEAD_S)
    return NOTHING


@kernel
def manoeuvre_in_doubt(nav, t_gps_ns, work):
    """The slot of the most likely manoeuvre, and nav.monitor_kind set to it, where fixes have ended in doubt; else
    NOTHING. What the state has absorbed of it is carried on to t.
    """
    if nav.monitor_doubt_m == 0.0:
        return NOTHING
    nav.monitor_kind = MANOEUVRE
    largest = 0.0
    slot = NOTHING
    for k in range(MONITOR_SLOTS):
        if nav.monitor_t_gps_ns[k] != 0:
            statistic = _solve(nav, k, MANOEUVRE, work)
            if statistic > largest and _fits(nav, k, statistic, _UNEXPLAINED * statistic):
                largest = statistic
                slot = k
    if slot != NOTHING:
        absorbed = nav.monitor_absorbed[slot, MANOEUVRE]
        absorbed[0] += (t_gps_ns - nav.monitor_last_gps_ns) * 1e-9 * absorbed[1]
    return slot


@kernel
def _fits(nav, k, statistic, allowed):
    """Whether what a hypothesis leaves of the innovations since its onset is noise, and at most `allowed` beside."""
    dof = nav.monitor_dof[k] - 3.0
    noise = dof + 5.0 * math.sqrt(2.0 * max(dof, 1.0)) + 5.0
    return nav.monitor_energy[k] - statistic <= noise + allowed


@kernel
def fault_size(nav, k, work):
    """Most likely fault of nav.monitor_kind with onset k: its size J^-1 b into work.residual.

    Returns the largest standard deviation of its components.
    """
    hypothesis = nav.monitor_kind
    _solve(nav, k, hypothesis, work)
    lower = work.S_lower
    y = work.three
    size = work.residual
    size[2] = y[2] / lower[2, 2]
    size[1] = (y[1] - lower[2, 1] * size[2]) / lower[1, 1]
    size[0] = (y[0] - lower[1, 0] * size[1] - lower[2, 0] * size[2]) / lower[0, 0]
    largest = 0.0
    for i in range(3):  # of J^-1 = L^-T L^-1: each element of its diagonal is a column of L^-1, squared
        for j in range(3):
            y[j] = 1.0 if i == j else 0.0
        solve_lower(lower, y, y)
        largest = max(largest, y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
    return math.sqrt(largest)


@kernel
def watch_excluded(nav, table, kind, work):
    """Whether an excluded type may return: the mean of its last innovations, over a full window, fits the state again.

    The mean of n innovations has covariance H P H' + R / n: noise averages out, the state's error does not. To be
    called after `evaluate`, once for each fix.
    """
    for axis in range(3):
        nav.monitor_sum[kind, axis] += work.residual[axis]
    nav.monitor_good[kind] += 1
    n = nav.monitor_good[kind]
    if n < table.monitor_clear_fixes:
        return False
    mean = work.three
    s = work.weight
    for a in range(3):
        mean[a] = nav.monitor_sum[kind, a] / n
        for b in range(3):
            s[a, b] = work.S[a, b]
        s[a, a] -= work.sigma[a] ** 2 * (1.0 - 1.0 / n)
        nav.monitor_sum[kind, a] = 0.0
    nav.monitor_good[kind] = 0
    if not cholesky(s, work.S_lower):
        return False
    solve_lower(work.S_lower, mean, mean)
    return mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2 <= _RETURN
