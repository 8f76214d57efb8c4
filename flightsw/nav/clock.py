"""Onboard time: GPS time as a function of the onboard counter, kept by a two-state filter on time pulses.

State: phase [s] and drift [s/s] of GPS time against the counter. A pulse is (GPS time, counter latched at it).
The clock is set by pulses that agree with each other and then moves only within what the oscillator can have
drifted since the last accepted pulse: a step of GPS time is a fault of the receiver, never of the satellite.
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

ACCEPTED = -1
RESTARTED = -2


@kernel
def gps_at(nav, counter_ns):
    """GPS time [ns] at a reading of the counter; only meaningful while clock_valid."""
    elapsed = counter_ns - nav.clock_counter_ns
    return nav.clock_gps_ns + elapsed + round(nav.clock_phase_ns + nav.clock_drift * elapsed)


@kernel
def tolerance_ns(nav, table, counter_ns):
    """How far a time stamp may disagree with the clock at this reading of the counter [ns]."""
    age_ns = abs(counter_ns - nav.clock_counter_ns)
    return 1e9 * table.latch_tolerance_s + table.drift_max_sps * age_ns


@kernel
def _grown(nav, table, elapsed_s):
    """Covariance of (phase [s], drift [s/s]) so long after the last pulse: p00, p01, p11.

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
def _set(nav, table, gps_ns, counter_ns, drift, sigma_s, span_s):
    nav.clock_valid = 1
    nav.clock_gps_ns = gps_ns
    nav.clock_counter_ns = counter_ns
    nav.clock_phase_ns = 0.0
    nav.clock_drift = drift
    p = nav.clock_p
    p[0, 0] = sigma_s * sigma_s
    p[0, 1] = sigma_s * sigma_s / span_s
    p[1, 0] = p[0, 1]
    p[1, 1] = 2.0 * sigma_s * sigma_s / (span_s * span_s)


@kernel
def _chain(nav, table, gps_ns, counter_ns):
    """Count pulses that agree with each other; a pulse that does not agree starts the count anew."""
    elapsed = counter_ns - nav.pulse_counter_ns
    agrees = (
        nav.pulse_chain > 0
        and elapsed > 0
        and elapsed < _LONGEST_NS
        and abs((gps_ns - nav.pulse_gps_ns) - elapsed) <= 1e9 * table.latch_tolerance_s + table.drift_max_sps * elapsed
    )
    if agrees:
        nav.pulse_chain += 1
    else:
        nav.pulse_chain = 1
        nav.pulse_first_gps_ns = gps_ns
        nav.pulse_first_counter_ns = counter_ns
    nav.pulse_gps_ns = gps_ns
    nav.pulse_counter_ns = counter_ns


@kernel
def _start_from_chain(nav, table, sigma_s):
    span_ns = nav.pulse_counter_ns - nav.pulse_first_counter_ns
    drift = ((nav.pulse_gps_ns - nav.pulse_first_gps_ns) - span_ns) / span_ns
    _set(nav, table, nav.pulse_gps_ns, nav.pulse_counter_ns, drift, sigma_s, span_ns * 1e-9)
    nav.pulse_chain = 0


@kernel
def take_pulse(nav, table, status, gps_ns, counter_ns, sigma_ns, counter_now_ns):
    """Correct the clock by one pulse.

    Returns ACCEPTED, RESTARTED (time was set anew from pulses that agreed for long), or a RejectCause.
    """
    in_range = gps_ns > 0 and gps_ns < _LONGEST_NS and counter_ns > -_LONGEST_NS and counter_ns < _LONGEST_NS
    if status != _VALID or not in_range or not (sigma_ns >= 0.0) or not (sigma_ns < 1e9):
        return _SYNC_INVALID
    if counter_ns > counter_now_ns:  # latched in the future
        return _SYNC_INVALID
    sigma_s = max(sigma_ns * 1e-9, table.pulse_sigma_floor_s)

    if not nav.clock_valid:
        _chain(nav, table, gps_ns, counter_ns)
        if nav.pulse_chain >= table.clock_start_pulses:
            _start_from_chain(nav, table, sigma_s)
        return ACCEPTED

    elapsed_ns = counter_ns - nav.clock_counter_ns
    error_ns = (gps_ns - nav.clock_gps_ns) - elapsed_ns - (nav.clock_phase_ns + nav.clock_drift * elapsed_ns)
    if elapsed_ns <= 0 or abs(error_ns) > 1e9 * table.latch_tolerance_s:
        _chain(nav, table, gps_ns, counter_ns)
        # What the oscillator may have drifted since the last accepted pulse is believed of several pulses that agree,
        # not of one: a single wrong pulse after an outage would lock the true ones out.
        drifted = elapsed_ns > 0 and abs(error_ns) <= tolerance_ns(nav, table, counter_ns)
        if drifted and nav.pulse_chain >= table.clock_start_pulses:
            _start_from_chain(nav, table, sigma_s)
            return ACCEPTED
        if 0 < table.clock_restart_pulses <= nav.pulse_chain:
            _start_from_chain(nav, table, sigma_s)
            return RESTARTED
        return _SYNC_JUMP
    nav.pulse_chain = 0

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
    return ACCEPTED
