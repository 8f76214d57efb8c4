"""The envelope of a certificate: whether what was proven covers the state here and now.

A table without a certificate has none; what that means for its users is said where the state is published.
"""

from __future__ import annotations

import math

from flightsw.icd.enums import Uncovered
from flightsw.kernels.registry import kernel

_EQUATOR_KM = 6378.137  # heights of a certificate are above a sphere
_NOTHING = int(Uncovered.NOTHING)
_HEIGHT = int(Uncovered.HEIGHT)
_AGE = int(Uncovered.AGE)
_ACTIVITY = int(Uncovered.ACTIVITY)
_OVERRULED = int(Uncovered.OVERRULED)
_CONVERGENCE = int(Uncovered.CONVERGENCE)


@kernel
def is_certified(table):
    """Whether the table in use carries a certificate, of whatever grade."""
    return table.envelope_grade > 0.0


@kernel
def outlived(nav, table, t_gps_ns):
    """Whether the outage is older than the age up to which the bound was proven."""
    return is_certified(table) and (t_gps_ns - nav.t_fix_gps_ns) * 1e-9 > table.envelope_certified_age_s


@kernel
def note_burn(nav, table, burning, t_gps_ns):
    """A burn that the certificate does not cover: what was estimated before it proves nothing after it."""
    if burning and is_certified(table) and table.envelope_burns == 0.0:
        nav.t_start_gps_ns = t_gps_ns


@kernel
def note_fix(nav, table, t_gps_ns, sigma_m, sigma_mps):
    """An accepted fix: of a kind that was never proven, convergence begins anew after it.

    What it claims, largest axis [m, m/s]; sigma_mps is 0 where it brought no velocity, or none that was held against
    the state. A state made of fixes of another kind than its campaign's, better ones too, was never put to the proof.
    """
    if not is_certified(table):
        return
    # written so that NaN is outside
    if sigma_mps == 0.0:
        covered = table.envelope_positions_alone != 0.0
    else:
        covered = (
            table.envelope_velocity_sigma_min_mps <= sigma_mps and sigma_mps <= table.envelope_velocity_sigma_max_mps
        )
    covered = covered and table.envelope_fix_sigma_min_m <= sigma_m and sigma_m <= table.envelope_fix_sigma_max_m
    if not covered:
        nav.t_start_gps_ns = t_gps_ns + 1  # after the fix: it proves nothing, even where no time is asked for


@kernel
def note_contradiction(nav, table):
    """Fixes that agree with each other are about to replace a state that has converged and refuses them.

    Which of the two is wrong cannot be told on board, a spoofer's fixes agree as well: the operator has to look.
    """
    if is_certified(table) and _has_converged(nav, table):
        nav.contradicted = 1


@kernel
def _has_converged(nav, table):
    return (nav.t_fix_gps_ns - nav.t_start_gps_ns) * 1e-9 >= table.envelope_convergence_s


@kernel
def uncovered(nav, table, f107, t_gps_ns):
    """What of this state a certified table was not proven for (Uncovered): height, age, activity, how it came about.

    f107: solar activity [sfu] of the force table in use; 0 where none flies.
    """
    r = nav.x
    height_km = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * 1e-3 - _EQUATOR_KM
    # written so that NaN, which compares false with everything, is outside
    if not (table.envelope_altitude_min_km <= height_km and height_km <= table.envelope_altitude_max_km):
        return _HEIGHT
    if not ((t_gps_ns - nav.t_fix_gps_ns) * 1e-9 <= table.envelope_certified_age_s):
        return _AGE
    if not (f107 == 0.0 or (table.envelope_f107_min <= f107 and f107 <= table.envelope_f107_max)):
        return _ACTIVITY
    if nav.contradicted != 0:
        return _OVERRULED
    if not _has_converged(nav, table):
        return _CONVERGENCE
    return _NOTHING
