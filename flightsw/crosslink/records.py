"""Records of the inter-satellite monitor: sizes, its table, what it is told, what it remembers, what it says.

As in flightsw/records.py: eight bytes a field, allocated once, refilled in place.
"""

from __future__ import annotations

import numpy as np

from flightsw.icd.enums import REJECT_CAUSES

SATELLITES = 32  # that a monitor can hold
LINKS = 256  # of one epoch; 24 satellites in three planes have some 112 pairs in view
OWN_LINKS = 2 * (SATELLITES - 1)
PARAMETERS = 4  # of a satellite's error: radial, along-track, cross-track, clock
COLUMNS = SATELLITES * PARAMETERS
PAIRS = SATELLITES * SATELLITES
BLOCKS = 120  # of the history that slow faults are sought in
ONSETS = 12  # of a slow fault that can be tried
FAULTY = 6  # satellites that can be named at a time

MONITOR_TABLE = np.dtype(
    [
        ("satellites", "i8"),
        ("own", "i8"),  # index of the satellite that flies this
        ("two_way", "i8"),
        ("both", "i8"),  # 1: every pair is measured by both satellites, each link on its own
        ("faulty_max", "i8"),
        ("block_epochs", "i8"),  # epochs averaged into a block of the history
        ("clear_epochs", "i8"),  # in a row without a finding before a satellite is taken in again
        ("onsets", "i8"),
        ("onset_blocks", "i8", (ONSETS,)),  # ages of a slow fault that are tried; negative: mean of so many blocks
        ("epoch_s", "f8"),
        ("sigma_range_m", "f8"),
        ("sigma_m", "f8", (PARAMETERS,)),  # of what a healthy satellite broadcasts: radial, along, cross, clock
        ("sigma_rate_mps", "f8", (PARAMETERS,)),
        ("majority_threshold_m", "f8"),
        # of statistics with 0 to 4 degrees of freedom; 0 is never compared
        ("network_threshold", "f8", (PARAMETERS + 1,)),
        ("network_slow_threshold", "f8", (PARAMETERS + 1,)),
        ("own_threshold", "f8", (PARAMETERS + 1,)),
        ("own_slow_threshold", "f8", (PARAMETERS + 1,)),
        ("clear_threshold", "f8", (PARAMETERS + 1,)),
        ("certain_noncentrality", "f8"),  # at which a jump is found with near certainty
    ],
    align=True,
)

# What one epoch brings. Positions and velocities in one inertial frame, at the epoch, as broadcast.
EPOCH = np.dtype(
    [
        ("t_gps_ns", "i8"),
        ("known", "i8", (SATELLITES,)),  # 1: an ephemeris of this epoch is there
        ("healthy", "i8", (SATELLITES,)),  # as the satellite says of itself
        ("issue", "i8", (SATELLITES,)),  # of its ephemeris; another number is another upload
        ("r_m", "f8", (SATELLITES, 3)),
        ("v_mps", "f8", (SATELLITES, 3)),
        ("clock_m", "f8", (SATELLITES,)),
        ("links", "i8"),
        ("receiver", "i8", (LINKS,)),
        ("sender", "i8", (LINKS,)),
        ("range_m", "f8", (LINKS,)),
    ],
    align=True,
)

# A weighted test made ready: what depends on geometry and noise, not on the measurements.
TEST = np.dtype(
    [
        ("ready", "i8"),
        ("links", "i8"),
        ("columns", "i8"),
        ("receiver", "i8", (LINKS,)),
        ("sender", "i8", (LINKS,)),
        ("h", "f8", (LINKS, 2, PARAMETERS)),  # sensitivity to a fault, of receiver and sender
        ("h_bias", "f8", (LINKS, 2, PARAMETERS)),  # to a healthy satellite's constant error
        ("h_rate", "f8", (LINKS, 2, PARAMETERS)),  # to its rate
        ("noise_m2", "f8", (LINKS,)),
        # rows: a link, or the sum or the difference of the two of a pair that measures both ways
        ("link_of", "i8", (PAIRS,)),  # of receiver and sender
        ("mate", "i8", (LINKS,)),  # the link the other way, or -1
        ("first", "i8", (LINKS,)),
        ("second", "i8", (LINKS,)),  # or -1
        ("sign", "f8", (LINKS,)),
        ("bias", "f8", (LINKS, 2, PARAMETERS)),  # h_bias, h_rate of a row's two ends, in sigma of a healthy satellite
        ("rate", "f8", (LINKS, 2, PARAMETERS)),
        ("head", "i8", (SATELLITES,)),  # list of a satellite's ends: 2 row + end, -1 at its end
        ("following", "i8", (2 * LINKS,)),
        ("reach", "i8", (LINKS,)),  # matrices.py
        ("factor", "f8", (LINKS, LINKS)),
        ("white", "f8", (LINKS, COLUMNS)),  # sensitivities of rows, whitened; W in information form
        # information form: information.py
        ("informed", "i8"),  # 1: the test is in that form
        ("rows", "i8"),  # of W and z: there errors of healthy satellites, else links
        ("information", "f8", (COLUMNS, COLUMNS)),
        ("inverse", "f8", (COLUMNS, COLUMNS)),
        ("shared", "i8", (COLUMNS,)),  # column of each error that healthy satellites broadcast
        ("deviation", "f8", (COLUMNS,)),  # its standard deviation
        ("near", "f8", (PARAMETERS, COLUMNS)),  # of the gram matrix, what is near its diagonal
        ("whole", "i8"),  # 1: the gram matrix is there
        ("gram", "f8", (COLUMNS, COLUMNS)),
        ("root", "f8", (SATELLITES, PARAMETERS, PARAMETERS)),  # statistic = |root g|^2
        ("dof", "i8", (SATELLITES,)),
        ("diagonal", "f8", (COLUMNS,)),
        # of one epoch
        ("z", "f8", (LINKS,)),
        ("g", "f8", (COLUMNS,)),
        ("statistic", "f8", (SATELLITES,)),
        # scratch of the search for the faulty ones
        ("gram_left", "f8", (COLUMNS, COLUMNS)),
        ("g_left", "f8", (COLUMNS,)),
        ("root_left", "f8", (PARAMETERS, PARAMETERS)),
        ("reduced", "f8", (PARAMETERS, COLUMNS)),
        ("reduced_g", "f8", (PARAMETERS,)),
        ("block", "f8", (PARAMETERS, PARAMETERS)),
        ("eliminated", "f8", (PARAMETERS, PARAMETERS)),
        ("used", "i8", (PARAMETERS,)),
        ("column", "f8", (LINKS,)),
        ("small", "f8", (PARAMETERS,)),
    ],
    align=True,
)

# What slow faults are sought in: sums of residuals by block and pair, geometry at the middle of each block.
HISTORY = np.dtype(
    [
        ("block", "i8"),  # being filled, counted from the start
        ("epochs", "i8"),  # in it
        ("since", "i8", (SATELLITES,)),  # first block of a satellite's present ephemeris
        ("issue", "i8", (SATELLITES,)),
        ("sum_m", "f8", (PAIRS, BLOCKS)),
        ("count", "f8", (PAIRS, BLOCKS)),
        ("r_m", "f8", (BLOCKS, SATELLITES, 3)),
        ("axes", "f8", (BLOCKS, SATELLITES, 3, 3)),
        ("onset", "i8"),  # next of the bank to be tried; -1: none before the first block is finished
    ],
    align=True,
)

# What is latched of every satellite.
STATE = np.dtype(
    [
        ("faulty", "i8", (SATELLITES,)),  # 1: excluded
        ("slow", "i8", (SATELLITES,)),  # 1: named by the search for slow faults, not yet clear there
        ("clear", "i8", (SATELLITES,)),  # epochs in a row without a finding
        ("slow_clear", "i8", (SATELLITES,)),  # ages in a row without a finding
        ("own_state", "i8"),  # own.py
        ("own_clear", "i8"),
        ("own_slow", "i8"),  # ages still to be tried without a finding before a slow fault is over
        ("majority", "i8"),  # latched
        ("majority_clear", "i8"),
        ("epochs", "i8"),
        ("code", "i8"),  # declare.py: the code that judged last
        ("linked", "i8"),  # links for which the rank below was found
    ],
    align=True,
)

VERDICT = np.dtype(
    [
        ("t_gps_ns", "i8"),
        ("links", "i8"),
        ("own_links", "i8"),
        ("majority", "i8"),  # of this epoch: majority.py
        ("majority_latched", "i8"),
        ("own_state", "i8"),  # own.py, latched
        ("own_statistic", "f8"),
        ("own_dof", "i8"),
        ("own_slow_statistic", "f8"),  # of the last age tried
        ("own_peer", "i8"),  # neighbour that explains the own residuals as well, or -1
        ("network_ready", "i8"),
        ("network_statistic", "f8"),  # largest of a satellite that is not excluded
        ("network_worst", "i8"),  # whose it is, or -1
        ("network_slow_statistic", "f8"),
        ("network_slow_worst", "i8"),
        ("slow_age_s", "f8"),  # onset that was tried in this epoch, negative: mean; NaN: none
        ("monitored", "i8"),  # bit mask: the epoch's links show their errors in every direction
        ("faulty", "i8"),  # bit mask of the excluded
        ("named", "i8"),  # bit mask: newly named in this epoch
        ("included", "i8"),  # bit mask: taken in again in this epoch
        ("rank", "i8"),  # of all links' sensitivities
        ("parameters", "i8"),  # that the satellites of this epoch have together
        ("undetectable", "i8"),  # dimension of what no range can show: parameters - rank
        ("weakest", "i8"),  # satellite whose largest undetected jump is the worst, or -1
        ("weakest_m", "f8"),  # smallest jump in its weakest direction that is certain to be found [m]
        ("judged", "i8"),  # 1: the last step was the one that finished the judgement of the epoch
        ("left", "i8"),  # steps that this epoch still waits for, as far as is known
    ],
    align=True,
)

# Scratch of one epoch.
WORK = np.dtype(
    [
        ("axes", "f8", (SATELLITES, 3, 3)),
        ("usable", "i8", (SATELLITES,)),
        ("residual_m", "f8", (LINKS,)),
        ("contrast_m", "f8", (LINKS,)),
        ("onset_blocks", "i8"),  # age that this epoch tries
        ("contrasted", "i8"),  # links whose contrasts are made
        ("kept", "i8"),  # of those, that have one
        ("subspace", "i8"),  # 1: to be found anew
        ("search", "i8"),  # monitor.py: the search for the faulty that is to follow, or none
        ("exchanged", "i8"),  # links that are not the own satellite's
        ("own_residual_m", "f8", (OWN_LINKS,)),
        ("peer", "i8", (SATELLITES,)),  # satellites of the own-satellite test, from its number 1
        ("position", "f8", (3,)),
        ("direction", "f8", (3,)),
        ("h", "f8", (2, PARAMETERS)),
        ("set", "i8", (SATELLITES,)),
        ("found", "i8", (SATELLITES,)),
        ("without", "f8", (SATELLITES,)),  # statistic of a satellite with the others of the set estimated
        ("rank", "f8", (COLUMNS, COLUMNS)),
    ],
    align=True,
)

# What an assembly of epochs accepts.
ASSEMBLY_TABLE = np.dtype(
    [
        ("satellites", "i8"),
        ("two_way", "i8"),
        ("latency_ns", "i8"),  # age from which on an epoch is stale
        ("future_ns", "i8"),
        ("ephemeris_age_max_s", "f8"),
        ("radius_min_m", "f8"),
        ("radius_max_m", "f8"),
        ("speed_max_mps", "f8"),
        ("sigma_range_max_m", "f8"),
    ],
    align=True,
)

# Messages as they came last, the epoch under way, and the one that waits to be judged.
ASSEMBLY = np.dtype(
    [
        ("rejected", "i8", (REJECT_CAUSES,)),  # since somebody has asked
        ("incomplete", "i8"),  # epochs that never were complete, modulo 65536
        ("ready", "i8"),  # 1: a complete epoch waits
        ("last_gps_ns", "i8"),  # its time, or that of the last one; -1: there was none
        ("t_ref_ns", "i8", (SATELLITES,)),  # GPS time of a satellite's message; 0: none
        ("r_m", "f8", (SATELLITES, 3)),
        ("v_mps", "f8", (SATELLITES, 3)),
        ("clock_m", "f8", (SATELLITES,)),
        ("clock_rate_mps", "f8", (SATELLITES,)),
        ("issue", "i8", (SATELLITES,)),
        ("healthy", "i8", (SATELLITES,)),
        # under way
        ("t_gps_ns", "i8"),  # -1: nothing is
        ("total", "i8"),  # links announced
        ("accounted", "i8"),  # links that have come, used or not
        ("links", "i8"),
        ("receiver", "i8", (LINKS,)),
        ("sender", "i8", (LINKS,)),
        ("range_m", "f8", (LINKS,)),
        ("seen", "i8", (SATELLITES, SATELLITES)),  # receiver, sender
        # complete
        ("done_links", "i8"),
        ("done_receiver", "i8", (LINKS,)),
        ("done_sender", "i8", (LINKS,)),
        ("done_range_m", "f8", (LINKS,)),
        ("code", "i8"),
    ],
    align=True,
)
