"""Records of the GNSS consistency test: sizes, its table, what an epoch brings, scratch, what it says.

As in flightsw/records.py: eight bytes a field, allocated once, refilled in place. Positions are Earth-fixed, in metres;
clocks are ranges.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from flightsw.icd.enums import Constellation as Constellation
from flightsw.icd.enums import GnssVerdict

SATELLITES = 64  # rows of one epoch; bit masks of rows are one int64
CONSTELLATIONS = 4
AXES = 3
WIDTH = SATELLITES + 1 + AXES  # of a row of the reduced system: residual space, residual, east, north, up
EXCLUDED = 8  # satellites that can be left out of one epoch
BEAM = 64  # sets kept from one number of exclusions to the next
# fault modes of a protection level: none, satellites, constellations, and pairs of them
_EVENTS = SATELLITES + CONSTELLATIONS
MODES = 1 + _EVENTS + _EVENTS * (_EVENTS - 1) // 2


Verdict = GnssVerdict


class Row(IntEnum):
    """What became of one row of an epoch."""

    USED = 0
    EXCLUDED = 1  # by the test
    BAD_NUMBER = 2  # range, sigma or position is not a finite number
    BAD_CONSTELLATION = 3
    BAD_SIGMA = 4  # not positive
    BAD_EPHEMERIS = 5  # position where no navigation satellite is
    BAD_RANGE = 6
    DUPLICATE = 7  # another row has the same constellation and number: neither is believed
    EMPTY = 8


class Rule(IntEnum):
    """Which exclusion."""

    GREEDY = 0  # the paper's: largest weighted squared residual, again and again
    PROBABLE = 1  # most probable set whose absence leaves a consistent rest, by a bounded search


class Consistency(IntEnum):
    """Which consistency test."""

    CHI_SQUARE = 0
    MARKOV = 1  # law of the errors unknown; only their variance is bounded
    NONE = 2  # every epoch passes: what a flight without the test would do


GNSS_TABLE = np.dtype(
    [
        ("rule", "i8"),
        ("faulty_max", "i8"),  # satellites that may be left out
        ("candidates_max", "i8"),  # sets that may be looked at in one epoch
        ("protect", "i8"),  # 1: protection levels
        ("sigma_factor", "f8"),  # bound of the unit-weight standard deviation in normal operation
        ("threshold", "f8", (SATELLITES + 1,)),  # of RSS by degrees of freedom
        ("local_threshold", "f8"),  # squared normalised residual that one satellite may have
        ("further", "i8"),  # exclusions more than the fewest that are looked at
        ("isolate_odds", "f8"),  # 2 ln of the odds against a fault, once an epoch is inconsistent
        ("ambiguity", "f8"),  # gap of RSS below which two explanations are not told apart
        ("earth_rate_radps", "f8"),
        ("ephemeris_age_max_s", "f8"),
        ("signal_sigma_m", "f8", (CONSTELLATIONS,)),  # of orbit and clock, added to the receiver's
        ("iono_share", "f8"),  # of the vertical delay of the ground; 0: ranges have none
        ("iono_layer_m", "f8"),  # above the receiver
        ("iono_error", "f8"),  # 1-sigma of the model, as a share of what it says
        ("iono_floor_m", "f8"),  # and besides, of the vertical
        ("iono_alpha", "f8", (4,)),  # of Klobuchar: s, s/semicircle, ...
        ("iono_beta", "f8", (4,)),
        ("iono_dispersion", "f8", (CONSTELLATIONS,)),  # delay at the constellation's frequency over that at L1
        ("radius_min_m", "f8"),  # of a navigation satellite
        ("radius_max_m", "f8"),
        ("range_min_m", "f8"),
        ("range_max_m", "f8"),
        # protection levels
        ("p_satellite", "f8", (CONSTELLATIONS,)),  # prior of a fault of one satellite, per epoch
        ("p_constellation", "f8", (CONSTELLATIONS,)),  # of a whole constellation
        ("p_hmi", "f8", (AXES,)),  # allowed: east, north, up
        ("p_unmonitored", "f8"),  # share of the above below which pairs need not be modes
        ("k_false_alarm", "f8"),  # separations a mode may show, in sigmas
        ("bias_m", "f8"),  # largest nominal bias of a range
        ("alert_limit_m", "f8", (AXES,)),
    ],
    align=True,
)

EPOCH = np.dtype(
    [
        ("t_gps_ns", "i8"),
        ("count", "i8"),
        ("satellite", "i8", (SATELLITES,)),
        ("constellation", "i8", (SATELLITES,)),
        ("range_m", "f8", (SATELLITES,)),  # pseudorange plus satellite clock, less what is modelled
        ("sigma_m", "f8", (SATELLITES,)),
        ("r_m", "f8", (SATELLITES, 3)),  # satellite, Earth-fixed, at transmission
        ("start_known", "i8"),
        ("start_m", "f8", (3,)),  # a place to begin from; otherwise the centre of the Earth
    ],
    align=True,
)

# What a receiver says of one epoch: pseudoranges by its own clock, before anything is known of the satellites.
RAW = np.dtype(
    [
        ("t_gps_ns", "i8"),  # by the receiver's clock
        ("t_counter_ns", "i8"),
        ("count", "i8"),
        ("satellite", "i8", (SATELLITES,)),
        ("constellation", "i8", (SATELLITES,)),
        ("range_m", "f8", (SATELLITES,)),
        ("sigma_m", "f8", (SATELLITES,)),
    ],
    align=True,
)

# The last known place of every satellite, by constellation and number less one.
EPHEMERIDES = np.dtype(
    [
        (name, kind, (CONSTELLATIONS, SATELLITES, *shape))
        for name, kind, shape in (
            ("known", "i8", ()),
            ("issue", "i8", ()),
            ("t_ref_gps_ns", "i8", ()),
            ("r_m", "f8", (3,)),  # Earth-fixed, at the reference time
            ("v_mps", "f8", (3,)),  # as seen from the turning Earth
            ("clock_m", "f8", ()),  # satellite's clock less GPS time, relativity included
            ("clock_drift_mps", "f8", ()),
        )
    ],
    align=True,
)

WORK = np.dtype(
    [
        ("count", "i8"),
        ("search", "i8"),  # 1: who is to be left out is still to be found
        ("fix", "f8", (3,)),
        ("row", "i8", (SATELLITES,)),  # of the epoch, for each usable satellite
        ("clock_of", "i8", (SATELLITES,)),
        ("used", "i8", (SATELLITES,)),
        ("line", "f8", (SATELLITES, 3)),
        ("misfit_m", "f8", (SATELLITES,)),
        ("weight", "f8", (SATELLITES,)),
        ("sum", "f8", (CONSTELLATIONS, 5)),  # weight, weighted line, weighted misfit
        ("place", "f8", (3,)),
        ("normal", "f8", (3, 3)),
        ("cofactor", "f8", (3, 3)),
        ("right", "f8", (3,)),
        ("white", "f8", (SATELLITES, 3)),
        ("axes", "f8", (3, 3)),
        ("reduced", "f8", (SATELLITES, WIDTH)),
        ("levels", "f8", (SATELLITES + 1, WIDTH)),  # rows of a partial Cholesky factor
        ("diagonal", "f8", (SATELLITES,)),
        ("left", "f8", (SATELLITES,)),
        ("size", "f8", (EXCLUDED,)),
        ("member", "i8", (EXCLUDED,)),
        ("beam_mask", "i8", (2, BEAM)),
        ("beam_rss", "f8", (2, BEAM)),
        ("mode_p", "f8", (MODES,)),
        ("mode_odds", "f8", (MODES,)),  # 2 ln (p / 2)
        ("mode_reach_m", "f8", (MODES, AXES)),
        ("mode_sigma_m", "f8", (MODES, AXES)),
        # those that matter beyond the least level that one axis can have, one after the other
        ("near_p", "f8", (MODES,)),
        ("near_reach_m", "f8", (MODES,)),
        ("near_sigma_m", "f8", (MODES,)),
    ],
    align=True,
)

RESULT = np.dtype(
    [
        ("t_gps_ns", "i8"),
        ("verdict", "i8"),
        ("usable", "i8"),  # rows that passed the screen
        ("used", "i8"),
        ("unknowns", "i8"),  # three, and one clock a constellation used
        ("dof", "i8"),
        ("statistic", "f8"),  # RSS over the variance bound, of the satellites used
        ("threshold", "f8"),
        ("first_statistic", "f8"),  # of all usable satellites
        ("first_dof", "i8"),
        ("largest", "f8"),  # squared normalised residual of the satellites used
        ("excluded", "i8"),  # bit mask of rows
        ("candidates", "i8"),  # sets looked at
        ("out_of_budget", "i8"),
        ("rival", "i8"),  # bit mask of the next best explanation with as many exclusions
        ("rival_gap", "f8"),  # its RSS less that of the one taken; inf: there is none
        ("lone", "i8"),  # bit mask of rows used whose redundancy is zero: nothing can contradict them
        ("least_redundancy", "f8"),  # of the others
        ("inseparable", "f8"),  # largest |correlation| of two residuals: 1, and their faults look alike
        ("iterations", "i8"),
        ("r_m", "f8", (3,)),
        ("covariance_m2", "f8", (3, 3)),  # Earth-fixed
        ("clock_m", "f8", (CONSTELLATIONS,)),  # NaN where none is used
        ("axes", "f8", (3, 3)),  # rows: east, north, up
        ("sigma_m", "f8", (AXES,)),  # east, north, up
        ("protection_m", "f8", (AXES,)),  # inf: not available
        ("available", "i8"),  # 1: every level is within its alert limit
        ("modes", "i8"),
        ("row_state", "i8", (SATELLITES,)),  # Row
        ("redundancy", "f8", (SATELLITES,)),  # share of an error that its residual shows, before exclusion
        ("residual_m", "f8", (SATELLITES,)),  # to the fix, also of the excluded
        ("code", "i8"),
    ],
    align=True,
)
