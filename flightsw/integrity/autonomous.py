"""The bound's covariance in an outage, equation (17): the structure of an update without a measurement.

It is a Riccati recursion and settles where noise and pseudo-update balance: parameters that are too strong give a
bound that stops growing while the error does not. The parameters therefore come from tuned tables only.
"""

from __future__ import annotations

from flightsw.kernels.registry import kernel
from flightsw.nav.filter import condition, gain, propagate


@kernel
def predict_bound_covariance(table, row, p, work, out):
    """One step of (17) from `p` into `out`, with Phi in work.phi; False if it cannot be computed."""
    propagate(
        p,
        table.tuning_bound_q_r_m2[row],
        table.tuning_bound_q_v_m2ps2[row],
        table.tuning_bound_q_a_m2ps4[row],
        work,
        out,
    )
    r = work.R_pseudo
    r[:, :] = 0.0
    for i in range(3):
        r[i, i] = table.tuning_bound_s_r_m[row] ** 2
        r[3 + i, 3 + i] = table.tuning_bound_s_v_mps[row] ** 2
    if not gain(out, r, work):
        return False
    condition(out, r, work, out)
    return True
