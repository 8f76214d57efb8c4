"""The paper's rule: a satellite's own message is unreliable if more than half of its range differences exceed a limit.

V. Kurshin, R. Syatkovskiy, D. Panov (2023), algorithm steps 5 to 7. A tie is not a majority: with two links of four the
message counts as reliable, as the paper's four variants for three links leave open. Without links there is no verdict.
"""

from __future__ import annotations

from flightsw.crosslink.declare import kernel

NO_VERDICT, RELIABLE, UNRELIABLE = -1, 0, 1


@kernel
def majority(residual_m, links, threshold_m):
    """RELIABLE or UNRELIABLE from the first `links` residuals [m]; NO_VERDICT for none. NaN never exceeds."""
    if links < 1:
        return NO_VERDICT
    beyond = 0
    for index in range(links):
        if abs(residual_m[index]) > threshold_m:
            beyond += 1
    return UNRELIABLE if 2 * beyond > links else RELIABLE


@kernel
def heard_by(satellite, receiver, sender, both):
    """Whether a link counts for a satellite's majority: one that it received, or one with it, if pairs range once."""
    return receiver == satellite or (sender == satellite and not both)
