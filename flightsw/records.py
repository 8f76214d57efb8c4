"""Every record of flight: its fields, shapes, units. Allocated once by `memory`, then only refilled in place.

All fields are eight bytes wide, so that records are aligned and compiled code reads them directly. Times are
int64 nanoseconds: `t_*_gps_ns` since the GPS epoch, `*_counter_ns` on the onboard oscillator's counter.
"""

from __future__ import annotations

import numpy as np

from flightsw.icd.enums import REJECT_CAUSES
from flightsw.icd.table_schema import (
    EARTH_ORIENTATION,
    FORCES,
    GRAVITY_FIELD,
    MAX_GRADIENT_DEGREE,
    MAX_GRAVITY_DEGREE,
    MAX_STORED_ACCELERATION_BINS,
    NAVIGATION,
    Schema,
)

PAPER_STATES = 9  # of the paper's filter; its covariances are whole matrices
STATES = 20  # of the flight filter; its covariance is held in factors, kernels/udu.py
DYNAMIC_STATES = 11  # of them, those that move the satellite
MEASUREMENTS = 6
TYPES = 2  # of measurement, MeasurementType: each edited, tested and recorded on its own
BURNS = 4  # announced manoeuvres held at a time
MONITOR_SLOTS = 32  # onsets that the monitor of slow faults holds open
MONITOR_HYPOTHESES = 4
HISTORY = 12  # grid epochs kept for late fixes: latency_max over nav_step must stay below

# Slices of the filter state x.
POSITION = slice(0, 3)  # m, GCRF
VELOCITY = slice(3, 6)  # m/s, GCRF
ACCELERATION = slice(6, 9)  # m/s2: the paper's dA in GCRF; empirical acceleration in RTN of the flight filter
DRAG = slice(9, 11)  # 1: what drag has beyond the model, as share of it; a fast and a slow part
GNSS_BIAS = slice(11, 14)  # m, RTN: error of GNSS positions that lasts for minutes
GNSS_PERIODIC = slice(14, 20)  # m, RTN: error with the period of the orbit; (in phase, in quadrature) for each axis

# Where a table's certificate holds, and its grade, in the units of icd/certificate.py; all zero without one.
_BOX = (
    "grade altitude_min_km altitude_max_km certified_age_s f107_min f107_max fix_sigma_min_m fix_sigma_max_m "
    "velocity_sigma_min_mps velocity_sigma_max_mps positions_alone convergence_s burns"
)
ENVELOPE = tuple("envelope_" + name for name in _BOX.split())


def _aligned(schema: Schema) -> np.dtype:
    return np.dtype([(f.name, "<" + f.kind, f.shape) for f in schema.fields], align=True)


TABLE = np.dtype([*_aligned(NAVIGATION).descr, *((name, "<f8") for name in ENVELOPE)], align=True)
ORIENTATION = _aligned(EARTH_ORIENTATION)
GRAVITY_TABLE = _aligned(GRAVITY_FIELD)
FORCE_TABLE = _aligned(FORCES)

# What flight remembers from one navigation step to the next.
NAV = np.dtype(
    [
        # onboard clock: GPS time = clock_gps_ns + (1 + clock_drift) * (counter - clock_counter_ns)
        ("clock_valid", "i8"),
        ("clock_gps_ns", "i8"),
        ("clock_counter_ns", "i8"),
        ("clock_phase_ns", "f8"),  # part of a nanosecond that clock_gps_ns cannot hold
        ("clock_drift", "f8"),  # s/s
        ("clock_p", "f8", (2, 2)),  # covariance of (phase [s], drift [s/s])
        ("pulse_gps_ns", "i8"),  # last pulse of the chain that may start or restart the clock
        ("pulse_counter_ns", "i8"),
        ("pulse_first_gps_ns", "i8"),
        ("pulse_first_counter_ns", "i8"),
        ("pulse_chain", "i8"),
        # filter: newest grid epoch
        ("initialised", "i8"),
        ("t_gps_ns", "i8"),
        ("x", "f8", (STATES,)),
        # the paper's covariances, whole matrices
        ("P", "f8", (PAPER_STATES, PAPER_STATES)),  # the filter's own, (7) to (10)
        ("P_bound", "f8", (PAPER_STATES, PAPER_STATES)),  # the bound's, (17); equals P at an accepted fix
        ("P_ahead", "f8", (PAPER_STATES, PAPER_STATES)),  # the two, one step ahead: a bound serves the whole interval
        ("P_bound_ahead", "f8", (PAPER_STATES, PAPER_STATES)),
        # the flight filter's, in factors
        ("UD", "f8", (STATES, STATES)),
        ("UD_ahead", "f8", (STATES, STATES)),
        ("covariance", "f8", (MEASUREMENTS, MEASUREMENTS)),  # of (r, v) as published, with stamp and antenna
        ("unmodelled", "i8"),  # a step since the last fix went without the force model
        ("beyond_mps2", "f8", (3,)),  # acceleration that the model of the publication lacks, at the epoch (dynamics.py)
        ("drag_mps2", "f8", (3,)),  # drag for a scale of one, there
        ("gradient_ps2", "f8", (3, 3)),  # of gravity at the epoch; flight filter: half a step on
        ("pole", "f8", (3,)),  # Earth's pole in GCRF
        ("row", "i8"),  # tuning row in force: that of the last accepted fix
        # epochs since the last accepted fix, a ring, for fixes that arrive late
        ("history_first", "i8"),
        ("history_count", "i8"),
        ("history_t_gps_ns", "i8", (HISTORY,)),
        ("history_x", "f8", (HISTORY, STATES)),
        ("history_P", "f8", (HISTORY, PAPER_STATES, PAPER_STATES)),
        ("history_UD", "f8", (HISTORY, STATES, STATES)),
        # fixes
        ("t_fix_gps_ns", "i8"),  # last accepted
        ("t_start_gps_ns", "i8"),  # of the state, or the last burn or fix that the certificate does not cover
        ("contradicted", "i8"),  # fixes replaced a state against its bound; until the operator resets the filter
        ("t_seen_gps_ns", "i8"),  # last that passed the time checks
        ("streak", "i8"),  # accepted without a rejection or an outage between
        ("mean_nis", "f8"),  # per degree of freedom, over the last clear_fixes of the streak
        ("candidate_count", "i8"),  # fixes in a row that agree with each other but not with the state
        ("candidate_t_gps_ns", "i8"),
        ("candidate_x", "f8", (STATES,)),
        ("candidate_sigma_r_m", "f8"),
        ("candidate_sigma_v_mps", "f8"),
        ("start_count", "i8"),  # good fixes in a row before aiding starts again
        # positions without velocity, from which a state starts: first, one between, last
        ("arc_count", "i8"),
        ("arc_t_gps_ns", "i8", (2,)),
        ("arc_r_m", "f8", (2, 3)),
        # how measurements are edited
        ("edit_ordered", "i8", (TYPES,)),  # by command: 0 as the table says, else 1 + EditMode
        ("excluded", "i8", (TYPES,)),  # by the monitor of slow faults
        # announced manoeuvres; duration 0: free
        ("burn_id", "i8", (BURNS,)),
        ("burn_frame", "i8", (BURNS,)),
        ("burn_start_gps_ns", "i8", (BURNS,)),
        ("burn_duration_ns", "i8", (BURNS,)),
        ("burn_dv_mps", "f8", (BURNS, 3)),
        ("burn_sigma_mps", "f8", (BURNS, 3)),
        # attitude, as last received
        ("attitude_gps_ns", "i8"),
        ("attitude_q", "f8", (4,)),
        ("attitude_sigma_rad", "f8"),
        # monitor of slow faults, by onset and hypothesis: information (upper triangle) and what speaks for it
        ("monitor_next", "i8", (2,)),
        ("monitor_t_gps_ns", "i8", (MONITOR_SLOTS,)),  # 0: free
        ("monitor_information", "f8", (MONITOR_SLOTS, MONITOR_HYPOTHESES, 6)),
        ("monitor_evidence", "f8", (MONITOR_SLOTS, MONITOR_HYPOTHESES, 3)),
        ("monitor_absorbed", "f8", (MONITOR_SLOTS, MONITOR_HYPOTHESES, 2)),  # of a unit fault, in r [m], v [m/s]
        ("monitor_last_gps_ns", "i8"),
        ("monitor_energy", "f8", (MONITOR_SLOTS,)),  # sum of the NIS since the onset
        ("monitor_dof", "f8", (MONITOR_SLOTS,)),
        ("monitor_fixes", "i8"),  # accepted since the start
        ("monitor_watched", "i8"),  # fixes that it has seen
        ("gate_run", "i8", (TYPES,)),  # refused by the gate one after the other
        ("monitor_statistic", "f8"),  # largest of the last fix
        ("monitor_kind", "i8"),  # its hypothesis
        ("monitor_doubt_m", "f8"),  # what the bound has on top while a manoeuvre and a fault both explain the fixes
        ("monitor_pause", "i8"),  # fixes for which nothing but a manoeuvre is believed, after one
        ("monitor_good", "i8", (TYPES,)),  # fixes of an excluded type in the present window
        ("monitor_sum", "f8", (TYPES, 3)),  # of their innovations, ITRF axes
        # bound, flag, mode
        ("t_evaluated_gps_ns", "i8"),
        ("bound_own_m", "f8"),
        ("bound_own_3d_m", "f8"),
        ("bound_coast_m", "f8"),
        ("bound_coast_3d_m", "f8"),
        ("bound_fix_m", "f8", (2,)),  # own and own 3-D of the last accepted fix: an outage begins with no less
        ("over_limit", "i8"),
        ("flag", "i8"),
        ("flag_age_s", "f8"),
        ("mode", "i8"),
        ("da_source", "i8"),
        # dA along the orbit
        ("da_bin", "i8"),
        ("da_mean", "f8", (MAX_STORED_ACCELERATION_BINS, 3)),
        ("da_samples", "i8", (MAX_STORED_ACCELERATION_BINS,)),
        ("da_t_gps_ns", "i8", (MAX_STORED_ACCELERATION_BINS,)),
        # counts since start
        ("fixes_accepted", "i8"),
        ("rejected", "i8", (REJECT_CAUSES,)),
    ],
    align=True,
)

# What one navigation step is told.
INPUT = np.dtype(
    [
        ("counter_now_ns", "i8"),
        ("pulse_present", "i8"),
        ("pulse_status", "i8"),
        ("pulse_gps_ns", "i8"),
        ("pulse_counter_ns", "i8"),
        ("pulse_sigma_ns", "f8"),
        ("fix_present", "i8"),
        ("fix_gps_ns", "i8"),
        ("fix_counter_ns", "i8"),
        ("fix_r_itrf_m", "f8", (3,)),
        ("fix_v_itrf_mps", "f8", (3,)),
        ("fix_sigma_r_m", "f8", (3,)),
        ("fix_sigma_v_mps", "f8", (3,)),
        ("fix_satellites", "i8"),
        ("fix_type", "i8"),
        ("fix_has_velocity", "i8"),  # 0: the receiver gives positions only; the velocity fields mean nothing
        ("burn_present", "i8"),  # an announced manoeuvre
        ("burn_id", "i8"),
        ("burn_frame", "i8"),  # BurnFrame
        ("burn_start_gps_ns", "i8"),
        ("burn_duration_ns", "i8"),
        ("burn_dv_mps", "f8", (3,)),
        ("burn_sigma_mps", "f8", (3,)),  # 1-sigma of each component of burn_dv_mps
        ("attitude_present", "i8"),
        ("attitude_gps_ns", "i8"),
        ("attitude_q", "f8", (4,)),  # scalar first: v_body = q* v_gcrf q
        ("attitude_sigma_rad", "f8"),
        ("command_present", "i8"),
        ("command_id", "i8"),  # NavCommand
        ("command_target", "i8"),  # MeasurementType
        ("command_value", "i8"),  # EditMode
        ("upload_present", "i8"),  # a state from the ground
        ("upload_gps_ns", "i8"),
        ("upload_frame", "i8"),  # StateFrame
        ("upload_x", "f8", (MEASUREMENTS,)),  # r, v
        ("upload_covariance", "f8", (MEASUREMENTS, MEASUREMENTS)),
    ],
    align=True,
)

# What one navigation step says; refilled by every step.
OUTPUT = np.dtype(
    [
        ("t_gps_ns", "i8"),  # the stamp: the state below is propagated to it
        ("r_gcrf_m", "f8", (3,)),
        ("v_gcrf_mps", "f8", (3,)),
        ("da_gcrf_mps2", "f8", (3,)),
        ("bound_m", "f8"),
        ("bound_3d_m", "f8"),
        ("limit_m", "f8"),
        ("fix_age_s", "f8"),
        ("outage_age_s", "f8"),
        ("flag_age_s", "f8"),
        ("mode", "i8"),
        ("flag", "i8"),
        ("verdict", "i8"),
        ("uncovered", "i8"),  # Uncovered: why a certified table's verdict is NOT_CERTIFIED
        ("validity", "i8"),
        ("driver", "i8"),
        ("streak", "i8"),
        ("mean_nis", "f8"),
        ("da_source", "i8"),
        ("da_coverage_pct", "i8"),
        ("alerts", "i8"),  # bit i: condition of alert i holds now
        ("events", "i8"),  # bit i: alert i happened in this step
        ("covariance", "f8", (MEASUREMENTS, MEASUREMENTS)),  # of (r, v) as published, GCRF, with the clock's share
        ("sigma_time_s", "f8"),  # of the stamp
        ("drag_scale", "f8"),  # estimated: 1 is the model's drag
        # innovation of the fix of this step, if it had one: of every measurement one record, used or not
        ("fix_seen", "i8"),
        ("fix_used", "i8"),
        ("fix_cause", "i8"),  # RejectCause, or -1
        ("fix_gps_ns", "i8"),
        ("innovation", "f8", (MEASUREMENTS,)),
        ("innovation_sigma", "f8", (MEASUREMENTS,)),
        ("nis", "f8"),  # of all measurements tested
        ("gate", "f8"),
        ("type_cause", "i8", (TYPES,)),  # of each type: RejectCause, -1 used, -2 there was none
        ("type_nis", "f8", (TYPES,)),
        ("type_gate", "f8", (TYPES,)),
        ("monitor_statistic", "f8"),
        ("monitor_kind", "i8"),  # FaultKind
        ("upload_cause", "i8"),  # of the state that the ground sent: RejectCause, -1 used, -2 there was none
        ("upload_nis", "f8"),  # against the state that there was; NaN: none, or not compared
    ],
    align=True,
)

# Columns of the factors and of the noise of a step: 9 of the empirical accelerations, 6 white, 6 of drag, 9 of the
# GNSS errors, 12 of burns; a multiple of four (kernels/udu.py).
NOISE_WIDTH = STATES + 44

# Scratch of kernels/frames.py.
_ROTATION: list[tuple[str, str, tuple[int, ...]]] = [
    *((name, "f8", (6,)) for name in ("orientation", "orientation_rate")),
    *((name, "f8", (3, 3)) for name in ("cirs", "cirs_rate", "spin", "spin_rate", "wobble", "product", "product_rate")),
    *((name, "f8", (3, 3)) for name in ("itrf_from_gcrf", "itrf_from_gcrf_rate")),
]

# Scratch of the compiled code; its content means nothing between calls.
WORK = np.dtype(
    [
        *_ROTATION,
        ("stages", "f8", (6, 3)),
        ("gradient", "f8", (3, 3)),
        ("rtn", "f8", (3, 3)),  # columns: radial, along-track, cross-track unit vectors in GCRF
        ("empirical_sigma_mps2", "f8"),  # at the radius of the step
        ("drag_scale", "f8"),  # at its start
        *((name, "f8", (3,)) for name in ("empirical_rtn", "small_mps2", "split_beyond_mps2", "split_drag_mps2")),
        ("split", "i8"),  # the last step left in split_... what the forces were in its middle
        ("x_model", "f8", (STATES,)),
        # the paper's filter
        ("phi_pull", "f8", (3, 3)),  # blocks of the transition, see filter.transition
        *((name, "f8") for name in ("phi_step_s", "phi_square_s2")),
        ("square", "f8", (PAPER_STATES, PAPER_STATES)),
        ("gain", "f8", (MEASUREMENTS, PAPER_STATES)),  # transposed
        ("innovation_variance", "f8", (MEASUREMENTS,)),
        ("weight_d", "f8", (MEASUREMENTS,)),  # 1 / D of the factors of the innovation covariance
        # the flight filter
        ("motion", "f8", (6, DYNAMIC_STATES)),  # transition of r and v
        ("decay", "f8", (STATES,)),  # of the states that only decay
        *((name, "f8") for name in ("turn_cos", "turn_sin")),  # of the orbit-periodic pairs over the step
        ("W", "f8", (STATES, NOISE_WIDTH)),
        ("q", "f8", (NOISE_WIDTH,)),
        ("scaled", "f8", (NOISE_WIDTH,)),
        ("UD", "f8", (STATES, STATES)),
        ("P_start", "f8", (STATES, STATES)),
        ("H", "f8", (3, STATES)),
        ("f", "f8", (3, STATES)),
        ("gain_one", "f8", (STATES,)),
        ("correction", "f8", (STATES,)),
        *((name, "f8", (3,)) for name in ("residual", "sigma", "lever_m", "three", "node", "momentum")),
        *((name, "f8", (3, 3)) for name in ("S", "S_lower", "weight", "burn_rtn")),
        ("weight_type", "f8", (TYPES, 3, 3)),
        ("innovation_type", "f8", (TYPES, 3)),
        ("mean_gain", "f8", (TYPES, 2)),  # of r and v by a measurement of each type, mean of the axes
        ("P_rv", "f8", (MEASUREMENTS, MEASUREMENTS)),
        *((name, "f8", (3,)) for name in ("burn_dr_m", "burn_dv_mps")),
        *((name, "f8", (MEASUREMENTS,)) for name in ("column", "z")),
        *((name, "f8", (MEASUREMENTS, MEASUREMENTS)) for name in ("innovation_p", "lower", "R", "R_pseudo")),
        ("x", "f8", (STATES,)),
        ("P", "f8", (PAPER_STATES, PAPER_STATES)),
        *((name, "f8", (STATES,)) for name in ("x_publish", "x_candidate")),
    ],
    align=True,
)

# A prediction of the bound without fixes, and the result of the last one (integrity/time_to_flag.py).
AHEAD = np.dtype(
    [
        ("running", "i8"),
        ("started_gps_ns", "i8"),
        ("t_gps_ns", "i8"),  # how far it has got
        ("x", "f8", (STATES,)),
        ("UD", "f8", (STATES, STATES)),
        ("P", "f8", (PAPER_STATES, PAPER_STATES)),
        ("drag_mps2", "f8", (3,)),
        ("bound_m", "f8"),
        ("valid", "i8"),
        ("t_flag_gps_ns", "i8"),  # when the flag would rise, or how far could be seen
        ("t_result_gps_ns", "i8"),  # when that was so
        ("governing", "i8"),  # Governing
    ],
    align=True,
)

# The gravity field as the kernels sum it, made from its table once (kernels/spherical_harmonics.py): [n, m] throughout.
# The acceleration is a series of one degree more than the potential, the gradient of two. Sums run over HARMONIC_GROUP
# degrees and whole blocks of orders at a time, with zeros for that; 144 columns, not 128: no rows share a cache line.
HARMONIC_GROUP = 4
HARMONIC_ROWS = MAX_GRAVITY_DEGREE + 4
HARMONIC_BLOCK = 8
HARMONIC_WIDTH = 144
_GRADIENT_ROWS = MAX_GRADIENT_DEGREE + 4
_GRADIENT_WIDTH = 32

FIELD = np.dtype(
    [
        ("gm_m3ps2", "f8"),
        ("radius_m", "f8"),
        ("tide_system", "i8"),
        ("degree", "i8"),
        ("order", "i8"),
        ("gradient_degree", "i8"),
        ("gradient_order", "i8"),
        # recursion of the normalised Legendre functions
        ("sectoral", "f8", (HARMONIC_ROWS,)),
        ("ahead", "f8", (HARMONIC_ROWS, HARMONIC_WIDTH)),
        ("behind", "f8", (HARMONIC_ROWS, HARMONIC_WIDTH)),
        # coefficients, C and S of each: of the potential; of its derivatives by x, y, z; the same of the truncated
        # potential that the gradient has; of the second derivatives xx, xy, xz, yx, yy, yz
        ("potential", "f8", (2, HARMONIC_ROWS, HARMONIC_WIDTH)),
        ("acceleration", "f8", (6, HARMONIC_ROWS, HARMONIC_WIDTH)),
        ("truncated", "f8", (6, _GRADIENT_ROWS, _GRADIENT_WIDTH)),
        ("gradient", "f8", (12, _GRADIENT_ROWS, _GRADIENT_WIDTH)),
    ],
    align=True,
)

STAGES = 11  # of the largest integrator

# Scratch of the force model. What `prepare` and `turn` put here serves the evaluations that follow within a step.
FORCE_WORK = np.dtype(
    [
        *_ROTATION,
        # set by `prepare`
        ("sun_m", "f8", (3,)),  # GCRF, geocentric
        ("moon_m", "f8", (3,)),
        ("tide", "f8", (3, 3)),  # quadratic form of the tidal potential, GCRF
        ("semiannual", "f8"),  # variation of density with the season, of the density model
        ("rows", "f8", (HARMONIC_GROUP, HARMONIC_WIDTH)),
        ("sums", "f8", (12, HARMONIC_WIDTH)),
        ("r_itrf", "f8", (3,)),
        ("a_itrf", "f8", (3,)),
        ("body", "f8", (3,)),
        ("gradient_itrf", "f8", (3, 3)),
        ("r", "f8", (3,)),
        ("v", "f8", (3,)),
        ("stage_v", "f8", (STAGES, 3)),
        ("stage_a", "f8", (STAGES, 3)),
        ("drag_mps2", "f8", (3,)),  # of the last evaluation, for a scale of one
    ],
    align=True,
)
