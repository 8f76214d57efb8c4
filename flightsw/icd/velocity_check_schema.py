"""Table of the velocity check: a receiver's velocity against the derivative of its own positions.

Without a table of this kind the check does not run. The threshold follows from `reference` and the wanted rate of false
alarms: docs/derivative.md.
"""

from __future__ import annotations

from flightsw.icd.table_field import Field, Schema


def _real(name: str, unit: str, low: float, high: float, default: float, why: str) -> Field:
    return Field(name, "f8", (), unit, low, high, default, why, "velocity_check")


VELOCITY_CHECK = Schema(
    "velocity_check",
    7,
    (
        _real("q_m2ps3", "m^2/s^3", 1e-14, 1e3, 1e-9, "density of what accelerates the error of the predicted orbit"),
        _real("start_sigma_mps", "m/s", 1e-3, 1e4, 1.0, "1-sigma of the derivative of positions at the beginning"),
        _real("armed_sigma_mps", "m/s", 1e-6, 1e3, 0.004, "1-sigma of the derivative above which nothing is tested"),
        _real("reference", "sigma", 0.01, 10.0, 0.3, "what a fix takes off the sum: half of the bias sought, or more"),
        _real("threshold", "sigma", 1.0, 1e4, 30.1, "sum that is a fault: 45 days between alarms of white errors"),
        _real("clear", "sigma", 0.0, 1e4, 8.0, "sum below which a fault is over"),
        _real("step_max", "sigma", 1.0, 100.0, 5.0, "largest step of the sum by one fix: a spike is no bias"),
        _real("gap_s", "s", 1.0, 1e5, 60.0, "without usable fixes for longer the check begins anew"),
        _real("coloured_r_m", "m", 0.0, 1e3, 0.0, "1-sigma of errors of positions that last"),
        _real("coloured_v_mps", "m/s", 0.0, 1e2, 0.0, "1-sigma of errors of velocities that last"),
        _real("coloured_s", "s", 0.1, 1e5, 300.0, "for which they do: a first-order Gauss-Markov process"),
    ),
)
