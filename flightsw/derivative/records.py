"""Records of derivative estimation: sizes, tables, what each algorithm remembers and says.

As in flightsw/records.py: eight bytes a field, allocated once, refilled in place. A chain of n integrators has the
states position, velocity, acceleration, ... in the unit of its positions and seconds.
"""

from __future__ import annotations

import numpy as np

STATES = 6  # of the longest chain
AXES = 3  # measured at once, with one manoeuvre and one noise law each
MODELS = 4
LAG = 1024  # epochs that the smoother can look back
CANDIDATES = 64  # Q that the paper's algorithm chooses from

BANK_TABLE = np.dtype(
    [
        ("models", "i8"),
        ("axes", "i8"),
        ("order", "i8", (MODELS,)),  # integrators of the chain: 2 is constant velocity
        ("q", "f8", (MODELS,)),  # density of the white noise that drives the last one, unit^2 / s^(2 order - 1)
        ("stay_s", "f8", (MODELS,)),  # mean time that a model holds
        ("enter", "f8", (MODELS, MODELS)),  # where it goes then: rows sum to one, diagonal zero
        ("gap_s", "f8"),  # longer gaps begin anew
        ("start_sigma", "f8", (STATES,)),  # of the derivatives when it begins; the first is not read
    ],
    align=True,
)

BANK = np.dtype(
    [
        ("epochs", "i8"),  # since it began
        ("weight", "f8", (MODELS,)),  # probability of each model
        ("x", "f8", (MODELS, AXES, STATES)),
        ("P", "f8", (MODELS, AXES, STATES, STATES)),
        # of all models together
        ("mean", "f8", (AXES, STATES)),
        ("covariance", "f8", (AXES, STATES, STATES)),
        ("nis", "f8"),  # of the last epoch, against the weighted prediction: mean over the axes
        # scratch
        ("x_mixed", "f8", (MODELS, AXES, STATES)),
        ("P_mixed", "f8", (MODELS, AXES, STATES, STATES)),
        ("phi", "f8", (STATES, STATES)),
        ("noise", "f8", (STATES, STATES)),
        ("square", "f8", (STATES, STATES)),
        ("gain", "f8", (STATES,)),
        ("ahead", "f8", (MODELS,)),
        ("jump", "f8", (MODELS, MODELS)),
        ("logarithm", "f8", (MODELS,)),
    ],
    align=True,
)

# One chain with its last epochs, for a smoother that answers a fixed time late.
LAG_TABLE = np.dtype(
    [
        ("order", "i8"),
        ("axes", "i8"),
        ("q", "f8"),
        ("lag_s", "f8"),
        ("gap_s", "f8"),
        ("start_sigma", "f8", (STATES,)),
    ],
    align=True,
)

LAG_STATE = np.dtype(
    [
        ("epochs", "i8"),
        ("newest", "i8"),  # place in the rings
        ("count", "i8"),
        ("t_s", "f8", (LAG,)),
        # of each axis and epoch: before the measurement, and what the measurement said
        ("x", "f8", (LAG, AXES, STATES)),
        ("P", "f8", (LAG, AXES, STATES, STATES)),
        ("gain", "f8", (LAG, AXES, STATES)),
        ("misfit", "f8", (LAG, AXES)),
        ("variance", "f8", (LAG, AXES)),
        # running filter
        ("x_now", "f8", (AXES, STATES)),
        ("P_now", "f8", (AXES, STATES, STATES)),
        # answer, of the epoch that is lag_s or more old
        ("ready", "i8"),
        ("t_answer_s", "f8"),
        ("mean", "f8", (AXES, STATES)),
        ("covariance", "f8", (AXES, STATES, STATES)),
        # scratch
        ("phi", "f8", (STATES, STATES)),
        ("noise", "f8", (STATES, STATES)),
        ("square", "f8", (STATES, STATES)),
        ("turn", "f8", (STATES, STATES)),
        ("adjoint", "f8", (STATES,)),
        ("carried", "f8", (STATES,)),
        ("information", "f8", (STATES, STATES)),
    ],
    align=True,
)

# The paper's algorithm: Kalman-type gain in normalised variables, Q tuned by J, then constant.
TUNED_TABLE = np.dtype(
    [
        ("order", "i8"),
        ("step_s", "f8"),
        ("scale", "f8"),  # rho: unit of the position per unit of the velocity's integral
        ("r", "f8"),  # variance of a position
        ("candidates", "i8"),
        ("q", "f8", (CANDIDATES, STATES)),  # diagonal Q of each, per step, in physical units
        ("settle_epochs", "i8"),  # before J is summed
        ("tune_epochs", "i8"),  # after which the gain is constant
        ("normalised", "i8"),  # 1: in the variables of the two-stage normalisation
        ("fixed", "i8"),  # 1: `gain` from the first epoch on
        ("gain", "f8", (STATES,)),  # in physical units
        ("start_p", "f8", (STATES,)),
        ("norm", "f8", (STATES,)),  # D_s: norms of the columns of N_f
    ],
    align=True,
)

TUNED = np.dtype(
    [
        ("epochs", "i8"),
        ("chosen", "i8"),
        ("frozen", "i8"),
        ("d", "f8", (STATES,)),  # normalised = d * physical
        ("x", "f8", (CANDIDATES, STATES)),  # normalised
        ("P", "f8", (CANDIDATES, STATES, STATES)),
        ("gain", "f8", (CANDIDATES, STATES)),
        ("cost", "f8", (CANDIDATES,)),  # sum of J
        ("mean", "f8", (STATES,)),  # physical
        ("gain_now", "f8", (STATES,)),  # physical
        ("phi", "f8", (STATES, STATES)),
        ("noise", "f8", (STATES, STATES)),  # diagonal
        ("square", "f8", (STATES, STATES)),
        ("before", "f8", (STATES,)),
    ],
    align=True,
)

# A receiver's velocity against the derivative of its own positions, both relative to the predicted orbit.
CHECK_TABLE = np.dtype(
    [
        ("q_m2ps3", "f8"),  # density of what accelerates the predicted orbit's error
        ("start_sigma_mps", "f8"),  # of the derivative when the check begins
        ("armed_sigma_mps", "f8"),  # of the derivative, above which nothing is tested
        ("reference", "f8"),  # sigmas that a bias must have to be summed up: half of the one sought
        ("threshold", "f8"),
        ("clear", "f8"),  # below which a fault is over
        ("step_max", "f8"),  # sigmas that one fix can add: a spike is no bias
        ("gap_s", "f8"),  # longer gaps begin anew
        # errors of the receiver that last, first-order Gauss-Markov: 1-sigma and time
        ("coloured_r_m", "f8"),
        ("coloured_v_mps", "f8"),
        ("coloured_s", "f8"),
    ],
    align=True,
)

CHECK = np.dtype(
    [
        ("fixes", "i8"),  # since it began
        ("armed", "i8"),
        ("fault", "i8"),  # latched until the sum is below `clear`
        ("alarms", "i8"),
        ("t_s", "f8"),
        ("x", "f8", (AXES, 2)),  # offset [m] and derivative [m/s] of the positions, less the orbit
        ("P", "f8", (AXES, 2, 2)),
        ("difference_mps", "f8", (AXES,)),  # velocity less derivative, of the last fix
        ("sum", "f8", (AXES,)),  # in sigmas
        ("statistic", "f8"),  # its length
        ("bias_mps", "f8", (AXES,)),  # mean difference over the last fixes
        ("bias_count", "f8"),
        ("step", "f8", (AXES,)),
        ("phi", "f8", (2, 2)),
        ("noise", "f8", (2, 2)),
        ("square", "f8", (2, 2)),
        ("gain", "f8", (2,)),
    ],
    align=True,
)
