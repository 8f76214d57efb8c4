"""Limits of the paper's model seen along an orbit: dA on neighbouring revolutions, the dip of the bound, the period."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ground.studies.flights import COARSE_TICK_NS, NS, prepare
from ground.studies.outage import largest_dip

PERIOD_S = 5580
SETTLED_S = 900
MEAN_S = 60
LAG_MAX_S = 300
_FIXES_S = 1500
_WEAK = 1e12
_WHITE_Q_V_M2PS2 = 1e-10  # next to none: the bound is the velocity's uncertainty carried along the orbit


class Orbit(NamedTuple):
    """A scenario's orbit: name of the scenario, settings of its orbit, its period."""

    scenario: str
    inclination_deg: float
    period_s: int


class Dip(NamedTuple):
    """How far bounds fall back within one orbit of an outage, as shares: per axis (12), and the 3-D one beside it."""

    axis: float
    radius: float


def bound_dip(orbit: Orbit, phase_deg: float) -> Dip:
    """An outage of one orbit with a bound by plain propagation (11), onboard J2 and RK4."""
    prepared = prepare(
        orbit.scenario,
        (
            f"outage=[{{start_s={_FIXES_S:.1f}, duration_s={orbit.period_s:.1f}}}]",
            f"time.duration_s={_FIXES_S + orbit.period_s:.1f}",
            f"orbit.argument_of_latitude_deg={phase_deg!r}",
            f"orbit.inclination_deg={orbit.inclination_deg!r}",
            "flight.table_set=j2",
        ),
        COARSE_TICK_NS,
    )
    rows = int(prepared.table().values["tuning_rows"][0])
    weak = {"q_r_m2": 0.0, "q_v_m2ps2": _WHITE_Q_V_M2PS2, "q_a_m2ps4": 0.0, "s_r_m": _WEAK, "s_v_mps": _WEAK}
    overrides = {f"tuning.{row}.bound_{key}": value for row in range(rows) for key, value in weak.items()}
    outputs, _ = prepared.fly(prepared.table({"limit_m": 1e6, **overrides}))
    inside = (prepared.age_s > _FIXES_S + 10) & (prepared.age_s < _FIXES_S + orbit.period_s - 10)
    return Dip(largest_dip(outputs["bound_m"][inside]), largest_dip(outputs["bound_3d_m"][inside]))


class AccelerationCorrection(NamedTuple):
    """dA over two revolutions, worst axis of three. Correlations; rms [m/s2]. Estimates are means over a minute.

    neighbours: of the true dA with itself a revolution later; estimate: of the filter's dA with the true one;
    estimate_later: the same once the estimate is moved back by lag_s, by which it trails.
    """

    neighbours: float
    estimate: float
    lag_s: int
    estimate_later: float
    error_rms_mps2: float
    true_rms_mps2: float


def acceleration_correction(integrator: str, sigma_m: float = 1.0) -> AccelerationCorrection:
    """Two revolutions of fixes with the paper's gravity and this integrator (figure 3)."""
    prepared = prepare(
        "paper_outage",
        ("outage=[]", f"time.duration_s={2 * PERIOD_S}.0", f"gnss.sigma_position_m={sigma_m!r}"),
        COARSE_TICK_NS,
    )
    outputs, _ = prepared.fly(prepared.table({"integrator": integrator}))
    # the estimate of a single second is mostly noise
    estimate = np.apply_along_axis(np.convolve, 0, outputs["da_gcrf_mps2"], np.full(MEAN_S, 1.0 / MEAN_S), "same")
    true = prepared.world.truth.acceleration_residual(prepared.world.t_true_gps_ns)
    first = np.arange(SETTLED_S, PERIOD_S)
    both = np.arange(SETTLED_S, len(true) - MEAN_S - LAG_MAX_S)
    by_lag = [sum(_correlations(estimate[both + lag], true[both])) for lag in range(LAG_MAX_S)]
    lag_s = int(np.argmax(by_lag))
    now = _correlations(estimate[both], true[both])
    worst = int(np.argmin(now))
    return AccelerationCorrection(
        neighbours=min(_correlations(true[first], true[first + PERIOD_S])),
        estimate=now[worst],
        lag_s=lag_s,
        estimate_later=min(_correlations(estimate[both + lag_s], true[both])),
        error_rms_mps2=float(np.sqrt(np.mean((estimate[both] - true[both])[:, worst] ** 2))),
        true_rms_mps2=float(np.sqrt(np.mean(true[both][:, worst] ** 2))),
    )


def _correlations(one: np.ndarray, other: np.ndarray) -> list[float]:
    return [float(np.corrcoef(one[:, axis], other[:, axis])[0, 1]) for axis in range(3)]


class Coordinates(NamedTuple):
    """Figure 1: time between ascending nodes [s], and how far the satellite is from where it was a node before [km]."""

    nodal_period_s: float
    largest_km: float


def coordinates() -> Coordinates:
    """The true motion of scenario paper_outage over two revolutions."""
    prepared = prepare("paper_outage", ("outage=[]", f"time.duration_s={2.2 * PERIOD_S:.1f}"), COARSE_TICK_NS)
    r_m, t_ns = prepared.world.r_true_gcrf_m, prepared.world.t_true_gps_ns
    z_m = r_m[:, 2]
    # the start is a node itself and may fall on either side of it
    ups = np.flatnonzero((z_m[:-1] < 0.0) & (z_m[1:] >= 0.0) & (np.arange(len(z_m) - 1) > PERIOD_S // 2))
    nodes_ns = t_ns[ups] - z_m[ups] * (t_ns[ups + 1] - t_ns[ups]) / (z_m[ups + 1] - z_m[ups])
    return Coordinates(float(nodes_ns[1] - nodes_ns[0]) / NS, float(np.abs(r_m).max()) / 1e3)
