"""Onboard time: GPS time as a function of the onboard counter, kept by a two-state filter on time pulses.

State: phase [s] and drift [s/s] of GPS time against the counter, with their covariance. A pulse is (GPS time, counter
latched at it); where none come, the time tags of fixes stand in. The oscillator wanders as the table says and no
faster: a pulse outside what the covariance allows is a fault of the receiver. It becomes the new time only through a
restart, by many that agree, which is announced. Within the covariance a pulse is believed; the covariance is part of
the published one (`phase_variance_s2`), so what is believed there is never more than what was told.
"""

from __future__ import annotations

import math

from flightsw.icd.enums import RejectCause, SyncStatus
from flightsw.kernels.registry import kernel

_SYNC_JUMP = int(RejectCause.SYNC_JUMP)
_SYNC_INVALID = int(RejectCause.SYNC_INVALID)
_VALID = int(SyncStatus.VALID)
# A century: beyond it a pulse is garbage, and differences of int64 nanoseconds stay exact below it.
_LONGEST_NS = 3_155_760_000_000_000_000
# Variance of the clock over that of a pulse up to which one pulse is believed alone. With x the ratio, a wrong pulse at
# the edge of the gate moves the time by k x / sqrt(x + 1) and leaves a gate of k sqrt(x / (x + 1) + 1), in sigmas of a
# pulse: true pulses stay inside where x^2 <= 2 x + 1. Beyond, one wrong pulse could lock the true ones out.
_ALONE = 1.0 + math.sqrt(2.0)

ACCEPTED = -1
RESTARTED = -2


@kernel
def gps_at(nav, counter_ns):
    """GPS time [ns] at a reading of the counter; only meaningful while clock_valid."""
    elapsed = counter_ns - nav.clock_counter_ns
    return nav.clock_gps_ns + elapsed + round(nav.clock_phase_ns + nav.clock_drift * elapsed)


@kernel
def _grown(nav, table, elapsed_s):
    """Covariance of (phase [s], drift [s/s]) so long after the last correction: p00, p01, p11.

    White noise of the frequency and a random walk of the drift, both from the table; exact for any length (two-state
    clock of Zucca and Tavella, IEEE Trans. UFFC 52, 2005).
    """
    p = nav.clock_p
    q = table.clock_q_drift_ps
    p00 = p[0, 0] + elapsed_s * (2.0 * p[0, 1] + table.clock_q_phase_s2ps + elapsed_s * (p[1, 1] + q * elapsed_s / 3.0))
    p01 = p[0, 1] + elapsed_s * (p[1, 1] + q * elapsed_s / 2.0)
    p11 = p[1, 1] + q * elapsed_s
    return p00, p01, p11


@kernel
def phase_variance_s2(nav, table, t_gps_ns):
    """Variance [s2] of onboard GPS time at a time since the last pulse; infinite while there is no onboard time.

    At a time before the last pulse it is that of the pulse.
    """
    if not nav.clock_valid:
        return math.inf
    p00, _, _ = _grown(nav, table, max(t_gps_ns - nav.clock_gps_ns, 0) * 1e-9)
    return p00


@kernel
def tolerance_ns(nav, table, counter_ns):
    """How far a time tag may disagree with the clock at this reading of the counter [ns]: latching, and the clock."""
    p00, _, _ = _grown(nav, table, abs(counter_ns - nav.clock_counter_ns) * 1e-9)
    return 1e9 * (table.latch_tolerance_s + table.agreement_sigmas * math.sqrt(p00))


@kernel
def _disagreement_ns(nav, gps_ns, counter_ns):
    elapsed_ns = counter_ns - nav.clock_counter_ns
    return (gps_ns - nav.clock_gps_ns) - elapsed_ns - (nav.clock_phase_ns + nav.clock_drift * elapsed_ns)


@kernel
def _fits(nav, table, gps_ns, counter_ns, sigma_s):
    """Whether the disagreement is one that covariance and measurement allow."""
    p00, _, _ = _grown(nav, table, abs(counter_ns - nav.clock_counter_ns) * 1e-9)
    error_s = 1e-9 * _disagreement_ns(nav, gps_ns, counter_ns)
    return error_s * error_s <= table.agreement_sigmas**2 * (p00 + sigma_s * sigma_s)


@kernel
def _correct(nav, table, gps_ns, counter_ns, sigma_s):
    """The measurement update of the filter (Kalman)."""
    elapsed_ns = counter_ns - nav.clock_counter_ns
    error_ns = _disagreement_ns(nav, gps_ns, counter_ns)
    p00, p01, p11 = _grown(nav, table, elapsed_ns * 1e-9)
    s = p00 + sigma_s * sigma_s
    gain_phase = p00 / s
    gain_drift = p01 / s
    phase_ns = nav.clock_phase_ns + nav.clock_drift * elapsed_ns + gain_phase * error_ns
    whole_ns = round(phase_ns)
    nav.clock_gps_ns = nav.clock_gps_ns + elapsed_ns + whole_ns
    nav.clock_phase_ns = phase_ns - whole_ns
    nav.clock_counter_ns = counter_ns
    nav.clock_drift += gain_drift * error_ns * 1e-9
    p = nav.clock_p
    p[0, 0] = (1.0 - gain_phase) * p00
    p[0, 1] = (1.0 - gain_phase) * p01
    p[1, 0] = p[0, 1]
    p[1, 1] = p11 - gain_drift * p01


@kernel
def _continues(nav, table, gps_ns, counter_ns, sigma_s):
    """Whether a measurement agrees with those of the chain.

    With one it need only differ by a drift that the oscillator can have; with more it must lie on their line.
    """
    elapsed_ns = counter_ns - nav.pulse_counter_ns
    if nav.pulse_chain == 0 or abs(elapsed_ns) > 1e9 * table.agreement_gap_max_s:
        return False
    elapsed_s = abs(elapsed_ns) * 1e-9
    error_s = 1e-9 * ((gps_ns - nav.pulse_gps_ns) - elapsed_ns)
    variance = 2.0 * sigma_s * sigma_s
    slack_s = table.drift_max_sps * elapsed_s
    if nav.pulse_chain > 1:
        span_ns = nav.pulse_counter_ns - nav.pulse_first_counter_ns
        span_s = span_ns * 1e-9
        error_s -= 1e-9 * ((nav.pulse_gps_ns - nav.pulse_first_gps_ns) - span_ns) / span_ns * elapsed_ns
        share = elapsed_s / span_s
        # of the line's two ends and the measurement, and of the oscillator meanwhile
        variance = sigma_s * sigma_s * ((1.0 + share) ** 2 + share * share + 1.0)
        variance += table.clock_q_phase_s2ps * elapsed_s * (1.0 + share)
        variance += table.clock_q_drift_ps * elapsed_s * elapsed_s * (span_s + elapsed_s) / 3.0
        slack_s = 0.0
    return abs(error_s) <= slack_s + table.agreement_sigmas * math.sqrt(variance)


@kernel
def _chain(nav, table, gps_ns, counter_ns, sigma_s, spacing_ns):
    """Count measurements that agree with each other, so far apart; one that does not agree starts the count anew."""
    if not _continues(nav, table, gps_ns, counter_ns, sigma_s):
        nav.pulse_chain = 1
        nav.pulse_first_gps_ns = gps_ns
        nav.pulse_first_counter_ns = counter_ns
    elif counter_ns - nav.pulse_counter_ns > spacing_ns:
        nav.pulse_chain += 1
    else:
        return
    nav.pulse_gps_ns = gps_ns
    nav.pulse_counter_ns = counter_ns


@kernel
def _start_from_chain(nav, table, sigma_s):
    """Time from the last of the chain; drift from its line, weighed against what a drift can be at all."""
    span_ns = nav.pulse_counter_ns - nav.pulse_first_counter_ns
    span_s = span_ns * 1e-9
    slope = ((nav.pulse_gps_ns - nav.pulse_first_gps_ns) - span_ns) / span_ns
    r = sigma_s * sigma_s
    slope_variance = 2.0 * r / (span_s * span_s) + table.clock_q_phase_s2ps / span_s
    slope_variance += table.clock_q_drift_ps * span_s / 3.0
    prior = table.drift_max_sps * table.drift_max_sps
    weight = prior / (prior + slope_variance)
    nav.clock_valid = 1
    nav.clock_gps_ns = nav.pulse_gps_ns
    nav.clock_counter_ns = nav.pulse_counter_ns
    nav.clock_phase_ns = 0.0
    nav.clock_drift = weight * slope
    p = nav.clock_p
    p[0, 0] = r
    p[0, 1] = weight * r / span_s
    p[1, 0] = p[0, 1]
    p[1, 1] = weight * slope_variance


@kernel
def _take(nav, table, gps_ns, counter_ns, sigma_s, is_tag, may_correct):
    # Between pulses a tag must not join their chain: its latching may be coarser than theirs.
    spacing_ns = 0.5e9 * table.agreement_gap_max_s if is_tag else 0.0
    if not nav.clock_valid:
        _chain(nav, table, gps_ns, counter_ns, sigma_s, spacing_ns)
        if nav.pulse_chain >= table.clock_start_pulses:
            _start_from_chain(nav, table, sigma_s)
        return ACCEPTED
    later = counter_ns > nav.clock_counter_ns
    fits = may_correct and later and _fits(nav, table, gps_ns, counter_ns, sigma_s)
    if fits:
        p00, _, _ = _grown(nav, table, (counter_ns - nav.clock_counter_ns) * 1e-9)
        if p00 <= _ALONE * sigma_s * sigma_s:
            if not is_tag:  # a tag that contradicts the chain has ended it already
                nav.pulse_chain = 0
            _correct(nav, table, gps_ns, counter_ns, sigma_s)
            return ACCEPTED
    _chain(nav, table, gps_ns, counter_ns, sigma_s, spacing_ns)
    # A chain that began outside what the covariance allowed then is a jump, however far the covariance has grown since.
    fits = fits and _fits(nav, table, nav.pulse_first_gps_ns, nav.pulse_first_counter_ns, sigma_s)
    if fits and nav.pulse_chain >= table.clock_start_pulses:
        _correct(nav, table, gps_ns, counter_ns, sigma_s)
        return ACCEPTED
    if 0 < table.clock_restart_pulses <= nav.pulse_chain:
        _start_from_chain(nav, table, sigma_s)
        nav.pulse_chain = 0
        return RESTARTED
    return ACCEPTED if fits else _SYNC_JUMP


@kernel
def _believable(gps_ns, counter_ns, counter_now_ns):
    """Neither garbage nor latched in the future."""
    in_range = gps_ns > 0 and gps_ns < _LONGEST_NS and counter_ns > -_LONGEST_NS and counter_ns < _LONGEST_NS
    return in_range and counter_ns <= counter_now_ns


@kernel
def take_pulse(nav, table, status, gps_ns, counter_ns, sigma_ns, counter_now_ns):
    """Correct the clock by one pulse.

    Returns ACCEPTED (also of one that waits for others to agree with it), RESTARTED (time was set anew from pulses that
    agreed for long), or a RejectCause.
    """
    if status != _VALID or not (sigma_ns >= 0.0) or not (sigma_ns < 1e9):
        return _SYNC_INVALID
    if not _believable(gps_ns, counter_ns, counter_now_ns):
        return _SYNC_INVALID
    sigma_s = max(sigma_ns * 1e-9, table.pulse_sigma_floor_s)
    return _take(nav, table, gps_ns, counter_ns, sigma_s, False, True)


@kernel
def take_tag(nav, table, gps_ns, counter_ns, counter_now_ns):
    """Correct the clock by the time tag of a fix: the GPS time and the counter latched when it was measured.

    Any fix may be given, whatever else becomes of it. The error of a tag may be the same in all of them, up to the
    latch tolerance: a tag corrects a clock whose variance has become twice that, and never makes it more certain. (To
    correct oftener would lose what a long baseline tells of the drift.) Where pulses fail, tags that agree for long
    start and restart time; pulses that contradict the tags and the clock do not.
    Returns ACCEPTED, RESTARTED, or SYNC_JUMP of a tag that is not of this time: the fix will be refused for it.
    """
    if not _believable(gps_ns, counter_ns, counter_now_ns):
        return _SYNC_JUMP
    sigma_s = table.latch_tolerance_s
    continues = _continues(nav, table, gps_ns, counter_ns, sigma_s)
    if nav.clock_valid and abs(_disagreement_ns(nav, gps_ns, counter_ns)) <= tolerance_ns(nav, table, counter_ns):
        if not continues:
            nav.pulse_chain = 0
        p00, _, _ = _grown(nav, table, (counter_ns - nav.clock_counter_ns) * 1e-9)
        if counter_ns <= nav.clock_counter_ns or p00 < 2.0 * sigma_s * sigma_s:
            return ACCEPTED
        outcome = _take(nav, table, gps_ns, counter_ns, sigma_s, True, True)
        if nav.clock_counter_ns == counter_ns:
            nav.clock_p[0, 0] = max(nav.clock_p[0, 0], sigma_s * sigma_s)
        return outcome
    fresh = abs(counter_ns - nav.pulse_counter_ns) <= 1e9 * table.agreement_gap_max_s
    if nav.pulse_chain > 0 and fresh and not continues:
        return _SYNC_JUMP  # one wrong tag breaks no chain
    return _take(nav, table, gps_ns, counter_ns, sigma_s, True, False)
