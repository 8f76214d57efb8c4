"""One part of a case flown: the long flight with fixes, or an arc with its outage and the return of fixes.

Only what flight publishes is looked at: state, bound, mode and, where the output has it, the covariance. Errors are
published minus true at the true instant of a tick, in GCRF.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flightsw.icd.enums import Mode
from flightsw.icd.table_file import decode
from flightsw.icd.table_schema import NAVIGATION
from flightsw.kernels.orbit_integrators import propagate
from flightsw.memory import Memory
from flightsw.records import INPUT, OUTPUT
from ground.accuracy.bench_cases import LONG_FLIGHT, Case
from ground.campaign import arc
from ground.studies.flights import COARSE_TICK_NS, NS, Prepared, prepare
from ground.tables.build import choices
from ground.tables.forces import build_forces
from ground.tables.gps_time import day_of_gps
from ground.tables.gravity_field import build_gravity_field

BLOCK_S = 10  # of the error while it converges: the largest of each block is kept
DRAG_SCALES = (0.0, 4.0)  # within which the one that fits is sought
STATES = 6

Arrays = dict[str, np.ndarray]


class Part(NamedTuple):
    """The long flight of a case, or one of its arcs."""

    case: Case
    number: int


def fly(part: Part) -> Arrays:
    """Figures of a part, see `fly_long` and `fly_arc`. Raises OperatorError where data or settings do not allow it."""
    case = part.case
    prepared = prepare(case.orbit.scenario, case.scenario_settings(part.number), COARSE_TICK_NS)
    memory = Memory()
    memory.load(prepared.table().values, prepared.orientation.values)
    memory.load_forces(*(decode(table).values for table in force_tables(case, prepared.world.t_start_gps_ns)))
    return fly_long(prepared, memory) if part.number == LONG_FLIGHT else fly_arc(prepared, memory, case)


def force_tables(case: Case, t_start_gps_ns: int) -> tuple[bytes, bytes]:
    """Binary force table and gravity field: schema's values, the satellite's cross-section, the day's space weather."""
    settings: dict[str, float | int] = {"area_to_mass_m2pkg": case.orbit.area_to_mass_m2pkg}
    if case.degree is not None:
        settings["degree"] = case.degree
    forces = build_forces(settings, day=day_of_gps(t_start_gps_ns))
    return forces, build_gravity_field(case.gravity, int(decode(forces).values["degree"][0]))


def fly_long(prepared: Prepared, memory: Memory) -> Arrays:
    """One flight with fixes throughout, every second (n,).

    flight_t_s, flight_3d_m, flight_3d_mps, flight_axis_m (largest axis), flight_bound_m, and flight_nees where the
    output has a covariance: e' P^-1 e of position and velocity, 6 for a consistent filter in the mean.
    """
    inputs, ticks = prepared.inputs
    outputs = _last_of_tick(arc.fly(memory, inputs), ticks)
    error = Errors.of(prepared, outputs, np.arange(len(outputs)))
    return {
        "flight_t_s": prepared.age_s,
        "flight_3d_m": error.r_3d_m,
        "flight_3d_mps": np.linalg.norm(error.v_mps, axis=1),
        "flight_axis_m": error.axis_m,
        "flight_bound_m": outputs["bound_m"].copy(),
        **({} if error.nees is None else {"flight_nees": error.nees}),
    }


class Errors(NamedTuple):
    """Errors at some ticks: r (n, 3) [m], v (n, 3) [m/s], NaN before the start; nees (n,) or None."""

    r_m: np.ndarray
    v_mps: np.ndarray
    nees: np.ndarray | None

    @classmethod
    def of(cls, prepared: Prepared, outputs: np.ndarray, ticks: np.ndarray) -> Errors:
        """Of outputs (n,) published at these ticks (n,)."""
        world = prepared.world
        r = outputs["r_gcrf_m"] - world.r_true_gcrf_m[ticks]
        v = outputs["v_gcrf_mps"] - world.v_true_gcrf_mps[ticks]
        started = outputs["mode"] != Mode.INIT
        r[~started], v[~started] = np.nan, np.nan
        if "covariance" not in (OUTPUT.names or ()):
            return cls(r, v, None)
        return cls(r, v, nees(np.hstack((r, v)), outputs["covariance"]))

    @property
    def axis_m(self) -> np.ndarray:
        """Largest GCRF axis (n,) [m]."""
        return np.abs(self.r_m).max(axis=1)

    @property
    def r_3d_m(self) -> np.ndarray:
        """Length of the position error (n,) [m]."""
        return np.linalg.norm(self.r_m, axis=1)


def nees(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Normalised estimation error squared e' P^-1 e (n,) of errors (n, k) and covariances (n, k, k).

    Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4.2. NaN where
    the covariance is not positive definite or not finite: it says nothing there.
    """
    variance = np.einsum("nii->ni", covariance)
    with np.errstate(invalid="ignore"):
        good = np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(error).all(axis=1) & (variance > 0.0).all(axis=1)
    found = np.full(len(error), np.nan)
    # metres and metres per second are decades apart; scaled to correlations the system is well conditioned
    sigma = np.sqrt(variance[good])
    correlation = covariance[good] / (sigma[:, :, None] * sigma[:, None, :])
    positive = np.linalg.eigvalsh(correlation)[:, 0] > 0.0 if len(correlation) else np.zeros(0, bool)
    scaled = (error[good] / sigma)[positive]
    index = np.flatnonzero(good)[positive]
    found[index] = np.einsum("ni,ni->n", scaled, np.linalg.solve(correlation[positive], scaled[..., None])[..., 0])
    return found


def fly_arc(prepared: Prepared, memory: Memory, case: Case) -> Arrays:
    """Convergence, outage, and the return of fixes after several lengths of it.

    Figures of one arc; m ages of the plan's curve, k returns. NaN where the orbit ends before.

    start_phase_deg             argument of latitude at the last fix
    converging_3d_m (c,)        largest 3-D error of every BLOCK_S from the beginning of the arc
    outage_error_m (m, 3)       error without fixes, GCRF; ages count from the last fix
    outage_bound_m (m,)         published bound of the largest axis
    outage_nees (m,)            where the output has a covariance
    outage_ticks, outage_beyond ticks without fixes, and those at which the largest axis was beyond the bound
    floor_m (m, 3)              error of the force model from the true state at the last fix
    floor_drag_m (m, 3)         the same with the drag scale that fits this outage best
    drag_scale                  that scale
    return_3d_m (k, s)          3-D error of every second from the return of fixes
    return_mode_s (k,)          until the mode is INTEGRATED again; infinite: not within the time flown
    return_ticks, return_beyond as for the outage (k,)
    """
    plan, world = case.plan, prepared.world
    inputs, ticks = prepared.inputs
    start = int(np.searchsorted(prepared.age_s, plan.convergence_s))
    call = int(np.searchsorted(ticks, start))
    outputs = _last_of_tick(arc.fly(memory, inputs[:call]), ticks[:call])
    converging = Errors.of(prepared, outputs, np.arange(start)).r_3d_m
    fixes = inputs[:call][inputs["fix_present"][:call] == 1]
    last_fix_ns = int(fixes["fix_gps_ns"][-1])
    blocks = converging[: start // BLOCK_S * BLOCK_S].reshape(-1, BLOCK_S)
    return {
        "start_phase_deg": np.array(_argument_of_latitude_deg(*world.truth.state_gcrf(np.array([last_fix_ns])))),
        "converging_3d_m": np.nan_to_num(blocks, nan=np.inf).max(axis=1),
        **_outage(prepared, memory, case, start, last_fix_ns),
    }


def _outage(prepared: Prepared, memory: Memory, case: Case, start: int, last_fix_ns: int) -> Arrays:
    plan, world = case.plan, prepared.world
    t_ns, count = world.t_true_gps_ns, len(plan.returns_s)
    stop = min(int(np.searchsorted(t_ns, last_fix_ns + plan.ages_s[-1] * NS)) + 1, world.n_ticks)
    returns = {k: int(np.searchsorted(t_ns, last_fix_ns + s * NS)) for k, s in enumerate(plan.returns_s)}
    found: Arrays = {
        "return_3d_m": np.full((count, plan.return_s), np.nan),
        "return_mode_s": np.full(count, np.nan),
        "return_ticks": np.zeros(count, np.int64),
        "return_beyond": np.zeros(count, np.int64),
    }
    flown: list[np.ndarray] = []
    done = start
    for k, tick in sorted(returns.items(), key=lambda pair: pair[1]):
        if tick + plan.return_s > world.n_ticks:
            continue
        flown.append(_coast(prepared, memory, done, tick))
        done = tick
        _fly_return(prepared, memory, k, tick, found)
    flown.append(_coast(prepared, memory, done, max(stop, done)))
    outputs = np.concatenate(flown)
    span = np.arange(start, start + len(outputs))
    error = Errors.of(prepared, outputs, span)
    beyond = ~(error.axis_m <= outputs["bound_m"])
    found |= {"outage_ticks": np.array(len(span)), "outage_beyond": np.array(int(beyond.sum()))}
    found |= _at_ages(case, error, outputs["bound_m"], t_ns[span], last_fix_ns)
    return found | _floor(prepared, memory, case, last_fix_ns)


def _coast(prepared: Prepared, memory: Memory, first: int, after: int) -> np.ndarray:
    """Outputs of ticks first to after - 1 when nothing arrives."""
    world = prepared.world
    blank = np.zeros(after - first, INPUT)
    blank["counter_now_ns"] = world.counter0_ns + np.arange(first, after) * world.tick_period_ns
    return arc.fly(memory, blank)


def _fly_return(prepared: Prepared, memory: Memory, k: int, tick: int, found: Arrays) -> None:
    """Fly on with fixes from a tick, from a copy of the state; fill row k of the figures of returns."""
    inputs, ticks = prepared.inputs
    again = Memory()
    again.share_tables(memory)
    again.nav[:] = memory.nav
    length = found["return_3d_m"].shape[1]
    first, after = np.searchsorted(ticks, [tick, tick + length])
    outputs = _last_of_tick(arc.fly(again, inputs[first:after]), ticks[first:after])
    error = Errors.of(prepared, outputs, np.arange(tick, tick + length))
    found["return_3d_m"][k] = np.nan_to_num(error.r_3d_m, nan=np.inf)
    integrated = np.flatnonzero(outputs["mode"] == Mode.INTEGRATED)
    found["return_mode_s"][k] = integrated[0] if len(integrated) else np.inf
    found["return_ticks"][k] = length
    found["return_beyond"][k] = np.sum(~(error.axis_m <= outputs["bound_m"]))


def _at_ages(case: Case, error: Errors, bound_m: np.ndarray, t_ns: np.ndarray, last_fix_ns: int) -> Arrays:
    curve = np.array(case.plan.curve_s)
    at = np.searchsorted(t_ns, last_fix_ns + curve * NS)
    known = at < len(t_ns)
    found = {
        "outage_error_m": np.full((len(curve), 3), np.nan),
        "outage_bound_m": np.full(len(curve), np.nan),
    }
    # without a state there is no error to speak of, and that is not a good error
    found["outage_error_m"][known] = np.nan_to_num(error.r_m[at[known]], nan=np.inf)
    found["outage_bound_m"][known] = bound_m[at[known]]
    if error.nees is not None:
        found["outage_nees"] = np.full(len(curve), np.nan)
        found["outage_nees"][known] = error.nees[at[known]]
    return found


def _floor(prepared: Prepared, memory: Memory, case: Case, last_fix_ns: int) -> Arrays:
    """What the force model errs by from a perfect state; NaN where another model flies."""
    curve = np.array(case.plan.curve_s)
    nothing = np.full((len(curve), 3), np.nan)
    if not flies_force_model(memory):
        return {"floor_m": nothing, "floor_drag_m": nothing, "drag_scale": np.array(np.nan)}
    truth = prepared.world.truth
    ages = curve[last_fix_ns + curve * NS <= int(prepared.world.t_true_gps_ns[-1])]
    r_m, v_mps = truth.state_gcrf(np.array([last_fix_ns]))
    true_m, _ = truth.state_gcrf(last_fix_ns + ages * NS)
    x = np.hstack((r_m[0], v_mps[0]))
    usual = model_track(memory, last_fix_ns, x, ages, 1.0) - true_m
    by_scale = model_track(memory, last_fix_ns, x, ages, 2.0) - true_m - usual
    scale = best_scale(usual, by_scale)
    floor, fitted = nothing.copy(), nothing.copy()
    floor[: len(ages)] = usual
    fitted[: len(ages)] = usual + (scale - 1.0) * by_scale
    return {"floor_m": floor, "floor_drag_m": fitted, "drag_scale": np.array(scale)}


def best_scale(error_m: np.ndarray, by_scale_m: np.ndarray) -> float:
    """The drag scale of least squares within DRAG_SCALES: errors at scale 1, and their change per unit of it (m, 3)."""
    weight = float(np.sum(by_scale_m**2))
    if weight == 0.0:
        return 1.0
    return float(np.clip(1.0 - np.sum(error_m * by_scale_m) / weight, *DRAG_SCALES))


def model_track(memory: Memory, t_gps_ns: int, x: np.ndarray, ages_s: np.ndarray, drag_scale: float) -> np.ndarray:
    """Positions (m, 3) [m, GCRF] of the loaded force model from x (6,) at t, at rising ages; NaN outside its tables."""
    found = np.full((len(ages_s), 3), np.nan)
    state, done_ns = np.array(x, dtype=np.float64), 0
    for k, age in enumerate(ages_s):
        step_ns = int(age) * NS - done_ns
        tables = (memory.forces, memory.field, memory.orientation)
        if not propagate(*tables, t_gps_ns + done_ns, state, step_ns, drag_scale, np.zeros(3), memory.scratch):
            break
        done_ns += step_ns
        found[k] = state[:3]
    return found


def flies_force_model(memory: Memory) -> bool:
    """Whether the loaded navigation table flies the flight filter and so the force table."""
    field = next(field for field in NAVIGATION.fields if field.name == "filter_model")
    return choices(field)[int(memory.table["filter_model"][0])] == "flight"


def _last_of_tick(outputs: np.ndarray, ticks: np.ndarray) -> np.ndarray:
    """The last output of each tick: a tick has as many calls as it brought fixes and pulses."""
    return outputs[np.r_[np.flatnonzero(np.diff(ticks)), len(ticks) - 1]]


def _argument_of_latitude_deg(r_m: np.ndarray, v_mps: np.ndarray) -> float:
    """Angle from the ascending node along the orbit, 0 to 360, of one state (1, 3) each."""
    normal = np.cross(r_m[0], v_mps[0])
    node = np.array([-normal[1], normal[0], 0.0])
    across = np.cross(normal, node)
    x, y = r_m[0] @ node / np.linalg.norm(node), r_m[0] @ across / np.linalg.norm(across)
    return float(np.degrees(np.arctan2(y, x)) % 360.0)
