"""What a parameter table holds: every field with its shape, unit, permitted range, default and reason.

The schema is part of the contract between ground and flight. A binary table carries the hash of the
schema it was built with; flight refuses any other. Changing a field here changes the hash.
"""

from __future__ import annotations

from flightsw.icd.crosslink_schema import CROSSLINK as CROSSLINK
from flightsw.icd.gnss_schema import GNSS as GNSS
from flightsw.icd.table_field import Field as Field
from flightsw.icd.table_field import Schema as Schema
from flightsw.icd.table_field import group as _group
from flightsw.icd.table_field import real as _real
from flightsw.icd.table_field import whole as _whole
from flightsw.icd.velocity_check_schema import VELOCITY_CHECK as VELOCITY_CHECK

MAX_TUNING_ROWS = 4
MAX_EARTH_ORIENTATION_NODES = 160
EARTH_ORIENTATION_COLUMNS = 6  # X, Y, s, xp, yp [rad], UT1 - GPS [s]
MAX_STORED_ACCELERATION_BINS = 1440
MAX_GRAVITY_DEGREE = 120
# C and S of every degree and order up to the largest, C before S, order by order within a degree
GRAVITY_COEFFICIENTS = (MAX_GRAVITY_DEGREE + 1) * (MAX_GRAVITY_DEGREE + 2)
MAX_GRADIENT_DEGREE = 20


def _row(name: str, unit: str, low: float, high: float, default: float, why: str) -> Field:
    """A column over the tuning rows; rows beyond `tuning_rows` hold the default and are never read."""
    return _real("tuning_" + name, unit, low, high, default, why, MAX_TUNING_ROWS)


NAVIGATION = Schema(
    "navigation",
    1,
    (
        *_group(
            "loop",
            _whole("tick_period_ns", "ns", 1_000_000, 1_000_000_000, 100_000_000, "period of the fixed-step loop"),
            _whole("nav_step_ns", "ns", 10_000_000, 60_000_000_000, 1_000_000_000, "tau, step of the filter grid"),
            _whole("coast_step_ns", "ns", 0, 60_000_000_000, 0, "step of the grid in an outage; 0: nav_step"),
        ),
        *_group(
            "dynamics",  # equation (2) and its discretisation (3)
            _real("mu_m3ps2", "m3/s2", 3.9e14, 4.1e14, 3.9860044e14, "gravitational parameter; paper's value"),
            _whole("gravity_model", "0 central, 1 J2", 0, 1, 0, "onboard force model"),
            _real("j2", "1", 0.0, 2e-3, 1.0826261738522e-3, "second zonal coefficient (EGM2008, tide free)"),
            _real("equatorial_radius_m", "m", 6.37e6, 6.39e6, 6378136.3, "reference radius that belongs to j2"),
            _whole(
                "integrator",
                "0 Euler, 1 RK4",
                0,
                1,
                0,
                "the paper's explicit Euler, or classical Runge-Kutta",
            ),
        ),
        *_group(
            "filter",  # equations (5)-(10)
            _real(
                "da_max_mps2",
                "m/s2",
                1e-9,
                1.0,
                0.02,
                "largest |dA| component expected; start sigma is a third",
            ),
            _real("gate_nis", "1", 1.0, 1e9, 60.0, "largest NIS (6 dof) of an accepted fix"),
            _real("correlation_excess", "1", 0.0, 1e-2, 1e-6, "a squared correlation beyond 1 by more is divergence"),
        ),
        *_group(
            "flight_filter",  # beside the paper's filter: empirical accelerations
            _whole("filter_model", "0 paper, 1 flight", 0, 1, 0, "which process model the filter flies"),
            _real("split_step_max_s", "s", 0.0, 10.0, 2.0, "up to here one evaluation of the forces a step; 0: never"),
            _real("empirical_sigma_mps2", "m/s2", 0.0, 1e-3, 5e-8, "steady sigma of each RTN acceleration"),
            _real("empirical_tau_s", "s", 1.0, 1e6, 600.0, "correlation time of the RTN accelerations"),
            _real("omitted_gravity_sigma_mps2", "m/s2", 0.0, 1e-3, 0.0, "what the field leaves out adds at 500 km"),
            _real("omitted_gravity_degree", "1", 2.0, 1000.0, 75.0, "it fades as r^-(degree + 2)"),
            _real("white_radial_m2ps3", "m2/s3", 0.0, 1.0, 0.0, "density of white radial acceleration"),
            _real("white_along_m2ps3", "m2/s3", 0.0, 1.0, 0.0, "density of white along-track acceleration"),
            _real("white_cross_m2ps3", "m2/s3", 0.0, 1.0, 0.0, "density of white cross-track acceleration"),
            _real("drag_sigma", "1", 0.0, 10.0, 0.4, "steady sigma of the fast part of the drag scale"),
            _real("drag_tau_s", "s", 1.0, 1e7, 5000.0, "its correlation time"),
            _real("drag_slow_sigma", "1", 0.0, 10.0, 0.3, "steady sigma of the slow part of the drag scale"),
            _real("drag_slow_tau_s", "s", 1.0, 1e8, 86400.0, "its correlation time"),
            _real("drag_step_sigma", "1", 0.0, 10.0, 0.0, "share by which drag may change at once when GNSS is lost"),
            _real("drag_step_after_s", "s", 1.0, 86400.0, 60.0, "fix age at which that is taken into account"),
            _real("gnss_bias_sigma_m", "m", 0.0, 1e4, 0.0, "steady sigma of the lasting GNSS error, RTN; 0: no states"),
            _real("gnss_bias_tau_s", "s", 1.0, 1e7, 300.0, "its correlation time"),
            _real("gnss_periodic_sigma_m", "m", 0.0, 1e4, 0.0, "sigma of the orbit-periodic GNSS error; 0: no states"),
            _real("gnss_periodic_tau_s", "s", 1.0, 1e8, 1e6, "time over which its phase is lost"),
            _real("underweight", "1", 0.0, 10.0, 0.2, "share of the state's variance added to R where it dominates"),
            _real("underweight_above_m", "m", 0.0, 1e9, 1000.0, "position sigma from which that is done"),
        ),
        *_group(
            "editing",  # of the flight filter's measurements, position and velocity each on its own
            _real("gate_start_nis", "1", 1.0, 1e9, 30.0, "largest NIS (3 dof) of a fix that may start aiding"),
            _real("gate_continue_nis", "1", 1.0, 1e9, 30.0, "largest NIS (3 dof) while aiding goes on"),
            _whole("start_fixes", "count", 1, 100, 2, "fixes in a row within the start gate before one is used"),
            _whole("edit_position", "EditMode", 0, 3, 0, "positions: 0 auto, 1 accept, 2 reject, 3 inhibit"),
            _whole("edit_velocity", "EditMode", 0, 3, 0, "velocities: 0 auto, 1 accept, 2 reject, 3 inhibit"),
        ),
        *_group(
            "monitor",  # of slow faults and unannounced manoeuvres: generalised likelihood ratio
            _whole("monitor_use", "0 no, 1 yes", 0, 1, 0, "whether it runs"),
            _real("monitor_threshold", "1", 1.0, 1e6, 40.0, "statistic (chi-square, 3 dof) that counts as found"),
            _real("monitor_margin", "1", 0.0, 1e6, 20.0, "by which a fault must beat a manoeuvre to be believed"),
            _real("monitor_doubt_s", "s", 1.0, 1e5, 500.0, "doubt between the two that lasts longer is a manoeuvre"),
            _whole("monitor_pause_fixes", "count", 0, 100000, 300, "after a manoeuvre only another is believed"),
            _whole("monitor_step_fixes", "count", 1, 1000, 5, "fixes between the 16 dense onsets; 8 x the sparse"),
            _whole("monitor_settle_fixes", "count", 1, 100000, 900, "accepted fixes since the start before it runs"),
            _whole("monitor_clear_fixes", "count", 1, 100000, 60, "fixes whose mean decides about an excluded type"),
        ),
        *_group(
            "manoeuvre",  # announced burns
            _real("burn_late_max_s", "s", 0.0, 60.0, 5.0, "a burn announced later after its start is refused"),
            _real("burn_ahead_max_s", "s", 0.0, 1e7, 7200.0, "a burn announced earlier before its start is refused"),
            _real("burn_dv_max_mps", "m/s", 0.0, 1e4, 500.0, "largest component"),
            _real("burn_duration_max_s", "s", 0.0, 1e5, 7200.0, "longest burn"),
        ),
        *_group(
            "antenna",  # from the centre of mass to the phase centre, body axes: nadir-pointing z down, y against h
            _real("lever_x_m", "m", -100.0, 100.0, 0.0, "antenna phase centre in body axes, x"),
            _real("lever_y_m", "m", -100.0, 100.0, 0.0, "antenna phase centre in body axes, y"),
            _real("lever_z_m", "m", -100.0, 100.0, 0.0, "antenna phase centre in body axes, z"),
            _real("lever_sigma_m", "m", 0.0, 100.0, 0.0, "1-sigma of the lever arm, each axis"),
            _whole("attitude_source", "0 nadir-pointing, 1 bus", 0, 1, 0, "where the attitude comes from"),
            _real("attitude_max_age_s", "s", 0.01, 3600.0, 5.0, "an older attitude gives way to nadir-pointing"),
            _real("attitude_sigma_rad", "rad", 0.0, 3.2, 0.02, "1-sigma of nadir-pointing"),
        ),
        *_group(
            "tuning",  # Table 1 of the paper: rows chosen by the position sigma that fixes claim
            _whole("tuning_rows", "count", 1, MAX_TUNING_ROWS, None, "rows in use"),
            _row("sigma_fix_m", "m", 0.0, 1e6, 0.0, "the row serves fixes up to this sigma; the last also worse ones"),
            _row("q_r_m2", "m2 per step", 0.0, 1e12, 0.0, "process noise on position in (7)"),
            _row("q_v_m2ps2", "m2/s2 per step", 0.0, 1e8, 0.0, "process noise on velocity in (7)"),
            _row("q_a_m2ps4", "m2/s4 per step", 0.0, 1.0, 0.0, "process noise on dA in (7)"),
            _row("sigma_r_floor_m", "m", 1e-3, 1e6, 1e6, "in (5) a fix is never taken as better than this"),
            _row("sigma_v_floor_mps", "m/s", 1e-5, 1e4, 1e4, "in (5) a fix is never taken as better than this"),
            _row("bound_q_r_m2", "m2 per step", 0.0, 1e12, 0.0, "q_R of (17)"),
            _row("bound_q_v_m2ps2", "m2/s2 per step", 0.0, 1e8, 0.0, "q_V of (17)"),
            _row("bound_q_a_m2ps4", "m2/s4 per step", 0.0, 1.0, 0.0, "q_A of (17)"),
            _row("bound_s_r_m", "m", 1e-3, 1e12, 1e12, "s_R of (17)"),
            _row("bound_s_v_mps", "m/s", 1e-5, 1e12, 1e12, "s_V of (17)"),
        ),
        *_group(
            "bound",  # equations (12) and (14)
            _real("k_axis", "1", 1.0, 10.0, 3.0, "factor of the per-axis bound; the paper's 3"),
            _real("k_radius", "1", 1.0, 20.0, 3.73, "factor of the 3-D bound; 0.997 when isotropic"),
            _real("fixes_margin", "1", 1.0, 5.0, 1.0, "flight filter: both bounds are so much larger while fixes come"),
            _whole("flag_driver", "0 axis, 1 3-D", 0, 1, 0, "which bound is compared with the limit"),
            _real("limit_m", "m", 0.1, 1e6, 2000.0, "epsilon, the permitted error"),
            _whole("flag_persist", "epochs", 1, 60, 1, "consecutive epochs above the limit before the flag"),
            _real("clear_limit_m", "m", 0.1, 1e6, 1000.0, "the flag clears only at or below; default eps/2"),
            _whole("clear_fixes", "count", 1, 10000, 30, "consecutive accepted fixes before the flag clears"),
            _real("clear_nis_low", "1", 0.0, 1e6, 0.0, "mean NIS per degree of freedom, lower end to clear"),
            _real("clear_nis_high", "1", 0.0, 1e6, 3.0, "mean NIS per degree of freedom, upper end to clear"),
            _real("overdue_s", "s", 0.0, 3600.0, 1.5, "fix age beyond which the bound follows (17)"),
        ),
        *_group(
            "time_to_flag",
            _whole(
                "ahead_step_ns", "ns", 1_000_000_000, 60_000_000_000, 10_000_000_000, "step; paper's filter: nav_step"
            ),
            _whole("ahead_steps", "count", 1, 10000, 30, "steps of the prediction in one tick"),
            _real("ahead_refresh_s", "s", 0.0, 3600.0, 25.0, "a prediction is made anew when it is older; 0: none"),
            _real("ahead_horizon_s", "s", 60.0, 1e6, 100000.0, "outage age beyond which it does not look"),
        ),
        *_group(
            "modes",
            _real("autonomous_after_s", "s", 0.1, 3600.0, 3.0, "fix age at which the mode becomes AUTONOMOUS"),
            _whole(
                "integrated_after_fixes",
                "count",
                1,
                1000,
                3,
                "accepted fixes before AUTONOMOUS becomes INTEGRATED",
            ),
            _whole("init_fixes", "count", 1, 100, 3, "consistent fixes before INIT ends (1: the paper's start)"),
            _whole("reinit_fixes", "count", 3, 1000, 10, "rejected fixes that agree before a new start from them"),
            _real(
                "agreement_sigmas",
                "1",
                1.0,
                100.0,
                6.0,
                "two fixes agree within so many sigmas",
            ),
            _real("position_arc_s", "s", 10.0, 600.0, 60.0, "positions alone start a state over such an arc"),
            _real("agreement_gap_max_s", "s", 0.1, 60.0, 5.0, "fixes further apart start the agreement anew"),
        ),
        *_group(
            "stored_da",
            _whole("stored_da_use", "0 no, 1 yes", 0, 1, 1, "fly the stored dA in an outage"),
            _whole(
                "stored_da_bins",
                "count",
                8,
                MAX_STORED_ACCELERATION_BINS,
                720,
                "bins of argument of latitude",
            ),
            _whole("stored_da_min_samples", "count", 1, 1000, 1, "samples before a bin counts as covered"),
            _whole("stored_da_after_fixes", "count", 1, 100000, 120, "accepted fixes before dA is stored"),
            _real("stored_da_max_age_s", "s", 1.0, 1e7, 86400.0, "an older bin counts as missing"),
        ),
        *_group(
            "time",
            _real("latency_max_s", "s", 0.0, 10.0, 1.0, "an older fix is stale"),
            _real("future_max_s", "s", 0.0, 1.0, 1e-3, "a fix may not be later than now by more"),
            _real(
                "latch_tolerance_s",
                "s",
                1e-9,
                1.0,
                2e-5,
                "disagreement of a time stamp with the onboard clock",
            ),
            _real("drift_max_sps", "s/s", 0.0, 1e-3, 5e-6, "largest oscillator drift the tolerance allows for"),
            _real(
                "pulse_sigma_floor_s",
                "s",
                1e-10,
                1e-3,
                1e-7,
                "a time pulse is never taken as better than this",
            ),
            _real("clock_q_phase_s2ps", "s2/s", 0.0, 1e-6, 1e-20, "white frequency noise: 1e-10 s after 1 s"),
            _real(
                "clock_q_drift_ps",
                "1/s",
                0.0,
                1e-6,
                4e-19,
                "random walk of its frequency: 3e-8 in 2000 s, a TCXO whose temperature swings with the orbit",
            ),
            _whole("clock_start_pulses", "count", 2, 100, 3, "consistent time pulses before time is valid"),
            _whole(
                "clock_restart_pulses",
                "count",
                0,
                1000000,
                300,
                "agreeing rejected pulses that restart time; 0 never",
            ),
        ),
        *_group(
            "fix",  # content of a fix
            _real("radius_min_m", "m", 6.4e6, 1e8, 6.5e6, "smaller is not in orbit"),
            _real("radius_max_m", "m", 6.4e6, 1e8, 9.0e6, "larger is not in this orbit"),
            _real("speed_max_mps", "m/s", 1e3, 2e4, 9.0e3, "Earth-fixed speed beyond this is absurd"),
            _real("sigma_r_max_m", "m", 1e-3, 1e6, 1000.0, "a fix that claims to be worse is not used"),
            _real("sigma_v_max_mps", "m/s", 1e-5, 1e4, 100.0, "a fix that claims to be worse is not used"),
            _whole("satellites_min", "count", 1, 64, 4, "satellites in a usable fix"),
        ),
        *_group(
            "bus",
            _whole("drain_frames_max", "count", 1, 1024, 64, "frames taken from the bus in one tick"),
        ),
        *_group(
            "telemetry",  # in ticks (0: never)
            _whole(
                "rate_nav_state_ticks",
                "ticks",
                0,
                100000,
                5,
                "NAV_STATE and INTEGRITY on the link every so many ticks",
            ),
            _whole("rate_status_ticks", "ticks", 0, 100000, 10, "HEARTBEAT, SYS_STATUS, time, fix, innovation"),
            _whole("rate_counters_ticks", "ticks", 0, 100000, 50, "counters"),
            _whole("rate_table_status_ticks", "ticks", 0, 100000, 600, "table identity"),
        ),
    ),
)

EARTH_ORIENTATION = Schema(
    "earth_orientation",
    2,
    (
        _whole("t0_gps_ns", "ns", 0, 2**62, None, "GPS time of the first node"),
        _whole("step_ns", "ns", 60_000_000_000, 86_400_000_000_000, None, "spacing of the nodes"),
        _whole("count", "count", 4, MAX_EARTH_ORIENTATION_NODES, None, "nodes in use"),
        _real(
            "nodes",
            "rad x5, s",
            -1e3,
            1e3,
            0.0,
            "celestial pole X, Y, s, polar motion xp, yp [rad], UT1 - GPS [s] at each node",
            MAX_EARTH_ORIENTATION_NODES,
            EARTH_ORIENTATION_COLUMNS,
        ),
    ),
)

GRAVITY_FIELD = Schema(
    "gravity_field",
    3,
    (
        _real("gm_m3ps2", "m3/s2", 3.9e14, 4.1e14, None, "gravitational parameter that belongs to the coefficients"),
        _real("radius_m", "m", 6.37e6, 6.39e6, None, "reference radius that belongs to the coefficients"),
        _whole("tide_system", "0 tide_free, 1 zero_tide", 0, 1, None, "whether C20 holds the permanent tide"),
        _whole("degree", "1", 2, MAX_GRAVITY_DEGREE, None, "largest degree in use; coefficients beyond it are zero"),
        _real(
            "coefficients",
            "1",
            -1.0,
            1.0,
            0.0,
            "fully normalised C, S of degree n and order m at 2 (n (n + 1) / 2 + m) and the next",
            GRAVITY_COEFFICIENTS,
        ),
    ),
)

FORCES = Schema(
    "forces",
    4,
    (
        *_group(
            "gravity",
            _whole("degree", "1", 2, MAX_GRAVITY_DEGREE, 70, "largest degree flown; not beyond that of the field"),
            _whole("order", "1", 0, MAX_GRAVITY_DEGREE, 70, "largest order flown; not beyond the degree"),
            _whole("gradient_degree", "1", 2, MAX_GRADIENT_DEGREE, 4, "largest degree and order of the gradient"),
            _whole("solid_tides", "0 no, 1 yes", 0, 1, 1, "tide that Sun and Moon raise, degree 2"),
            _whole("sun", "0 no, 1 yes", 0, 1, 1, "attraction of the Sun"),
            _whole("moon", "0 no, 1 yes", 0, 1, 1, "attraction of the Moon"),
            _whole("relativity", "0 no, 1 yes", 0, 1, 1, "Schwarzschild term: 1.6e-8 m/s2, 3 cm after 2000 s"),
        ),
        *_group(
            "surface",  # 0 m2/kg leaves drag and radiation pressure out
            _real("area_to_mass_m2pkg", "m2/kg", 0.0, 1.0, 0.005, "cross-section by mass"),
            _real("drag_coefficient", "1", 0.0, 10.0, 2.2, "Cd; the filter estimates a scale on it"),
            _real("radiation_coefficient", "1", 0.0, 3.0, 1.3, "Cr: 1 absorbs all, 2 reflects all"),
        ),
        *_group(
            "atmosphere",  # of the onboard density model
            _real("f107", "sfu", 50.0, 500.0, 120.0, "observed 10.7 cm flux of the day before"),
            _real("f107_mean", "sfu", 50.0, 400.0, 120.0, "its mean over three solar rotations (81 days)"),
            _real("ap", "2 nT", 0.0, 400.0, 8.0, "planetary geomagnetic index, daily"),
            _whole("valid_from_gps_ns", "GPS ns", 0, 2**62, 0, "begin of the days that this weather stands for"),
            _whole("valid_until_gps_ns", "GPS ns", 0, 2**62, 2**62, "their end: afterwards alert FORCES_EXPIRED holds"),
        ),
        *_group(
            "integration",
            _whole(
                "integrator", "0 RK4, 1 RK8, 2 RKN5", 0, 2, 2, "Runge-Kutta, Cooper-Verner's of order 8, Nystrom's 5"
            ),
            _whole("step_max_ns", "ns", 10_000_000, 60_000_000_000, 15_000_000_000, "longest step of the integrator"),
        ),
    ),
)

# of the functions beside navigation, flightsw/functions.py
_FUNCTIONS = (GNSS, CROSSLINK, VELOCITY_CHECK)
SCHEMAS: dict[str, Schema] = {
    schema.name: schema for schema in (NAVIGATION, EARTH_ORIENTATION, GRAVITY_FIELD, FORCES, *_FUNCTIONS)
}
