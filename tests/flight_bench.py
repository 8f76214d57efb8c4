"""A bench for the compiled navigation code: tables, a two-body truth, Earth orientation by ERFA, inputs of the step.

Truth and frames come from closed forms and from pyerfa, never from the code under test.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Any

import astropy_iers_data
import erfa
import numpy as np

from flightsw.icd.enums import FixType, SyncStatus
from flightsw.icd.table_file import decode
from flightsw.kernels import gravity
from flightsw.memory import Memory
from flightsw.nav import filter
from flightsw.nav.step import step
from flightsw.records import INPUT
from ground.tables.build import build_navigation
from ground.tables.earth_orientation import build_earth_orientation

NS = 1_000_000_000
DAY_NS = 86_400 * NS
T0_GPS_NS = 1_300_000_000 * NS  # 2021-03-18: inside the observed part of finals2000A
COUNTER_AT_T0_NS = 77 * NS  # the onboard counter has an origin of its own
MU_M3PS2 = 3.9860044e14  # of the paper
_MJD_OF_GPS_EPOCH = 44244
_LEAP_SECONDS = 18  # GPS - UTC at T0


def _row(sigma_fix_m: float, integrated: tuple[float, ...], autonomous: tuple[float, ...]) -> dict[str, float]:
    keys = ("q_r_m2", "q_v_m2ps2", "q_a_m2ps4", "sigma_r_floor_m", "sigma_v_floor_mps")
    bound_keys = ("bound_q_r_m2", "bound_q_v_m2ps2", "bound_q_a_m2ps4", "bound_s_r_m", "bound_s_v_mps")
    return {
        "sigma_fix_m": sigma_fix_m,
        **dict(zip(keys, integrated, strict=True)),
        **dict(zip(bound_keys, autonomous, strict=True)),
    }


# Tables of the tests' own: a shipped set that is tuned anew changes nothing here.
TABLE_1_INTEGRATED = (1.0, 0.01, 1e-6, 1.0, 1.0)
TABLE_1_AUTONOMOUS = (500.0, 0.05, 1e-6, 1000.0, 22.0)
COMMON_AUTONOMOUS = (26.1, 0.00423, 1.97e-7, 2.01e4, 39.4)  # REFERENCE S0, finding 11, fixes of 1 m, 1 m/s
_PAPER: dict[str, Any] = {
    "mu_m3ps2": MU_M3PS2,
    "gravity_model": "central",
    "integrator": "Euler",
    "nav_step_ns": NS,
    "overdue_s": 1.5,
    "k_axis": 3.0,
    "limit_m": 2000.0,
    "stored_da_bins": 720,
    "stored_da_after_fixes": 30,
    "tuning": [
        _row(1.5, TABLE_1_INTEGRATED, COMMON_AUTONOMOUS),
        _row(40.0, (30.0, 0.01, 1e-6, 33.0, 5.0), (835.0, 0.027, 1.04e-6, 7.41e4, 34.5)),
    ],
}
_MODEL = {"gravity_model": "J2", "integrator": "RK4", "da_max_mps2": 1e-3}
_SOFT = (0.0, 1e-9, 1e-12, 0.5, 0.01), (10.0, 1e-4, 1e-10, 1e6, 1e3)
SETTINGS: dict[str, dict[str, Any]] = {
    "paper": _PAPER,
    "paper_table1": {**_PAPER, "tuning": [_row(1.0, TABLE_1_INTEGRATED, TABLE_1_AUTONOMOUS)]},
    "j2": {**_PAPER, **_MODEL, "tuning": [_row(100.0, *_SOFT)]},
    "two_body": {**_PAPER, **_MODEL, "gravity_model": "central", "tuning": [_row(100.0, *_SOFT)]},
}


def transition_at(table: Any, x: np.ndarray, dt_s: float, pole: np.ndarray, work: Any) -> None:
    """Blocks of Phi of the paper's filter at x into work."""
    gravity.gradient(table, x[0:3], pole, work.gradient)
    filter.transition(table, dt_s, work.gradient, work)


def phi_of(work: Any) -> np.ndarray:
    """Phi (9, 9) that the blocks in work stand for; 1 + s G with s G = tau / 2 times tau G, or 0."""
    step_s, square_s2 = float(work.phi_step_s), float(work.phi_square_s2)
    one, pull = np.eye(3), np.array(work.phi_pull)
    turn = one + (0.5 * step_s * pull if square_s2 > 0.0 else 0.0)
    rows = ((turn, step_s * one, square_s2 * one), (pull, turn, step_s * one), (0.0 * one, 0.0 * one, one))
    return np.block([list(row) for row in rows])


Truth = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def record(array: np.ndarray) -> Any:
    """The one record of an array, with its fields as attributes, for compiled and plain kernels alike."""
    return array.view(np.recarray)[0]


@cache
def _orientation_values() -> np.ndarray:
    return decode(build_earth_orientation(T0_GPS_NS - DAY_NS, T0_GPS_NS + 3 * DAY_NS)).values


@cache
def _navigation_values(name: str, overrides: tuple[tuple[str, Any], ...]) -> np.ndarray:
    return decode(build_navigation("paper", {**SETTINGS[name], **dict(overrides)})).values


def loaded_memory(name: str = "paper", **overrides: Any) -> Memory:
    """A memory with one of SETTINGS and Earth orientation around T0; `tuning__0__q` stands for `tuning.0.q`."""
    memory = Memory()
    settings = tuple(sorted((key.replace("__", "."), value) for key, value in overrides.items()))
    memory.load(_navigation_values(name, settings), _orientation_values())
    return memory


# -- two-body truth


def circular_orbit(
    altitude_m: float = 500e3, inclination_deg: float = 51.6, node_deg: float = 40.0, u_deg: float = 25.0
) -> np.ndarray:
    """Position and velocity (6,) of a circular orbit."""
    r = 6378137.0 + altitude_m
    i, node, u = np.radians([inclination_deg, node_deg, u_deg])
    p = np.array([math.cos(node), math.sin(node), 0.0])
    q = np.array([-math.sin(node) * math.cos(i), math.cos(node) * math.cos(i), math.sin(i)])
    v = math.sqrt(MU_M3PS2 / r)
    return np.concatenate((r * (math.cos(u) * p + math.sin(u) * q), v * (-math.sin(u) * p + math.cos(u) * q)))


def two_body(state: np.ndarray, t_gps_ns: np.ndarray, mu: float = MU_M3PS2, t0_gps_ns: int = T0_GPS_NS):
    """Kepler's solution by f and g in the difference of eccentric anomaly: r, v (n, 3) at times (n,) [ns]."""
    dt = (np.atleast_1d(np.asarray(t_gps_ns)) - t0_gps_ns) * 1e-9
    r0, v0 = state[:3], state[3:6]
    r = math.sqrt(r0 @ r0)
    a = 1.0 / (2.0 / r - v0 @ v0 / mu)
    n = math.sqrt(mu / a**3)
    c0 = 1.0 - r / a
    s0 = (r0 @ v0) / math.sqrt(mu * a)
    e = n * dt
    for _ in range(30):
        e = e - (e - c0 * np.sin(e) + s0 * (1.0 - np.cos(e)) - n * dt) / (1.0 - c0 * np.cos(e) + s0 * np.sin(e))
    now = a * (1.0 - c0 * np.cos(e) + s0 * np.sin(e))
    f = 1.0 - a / r * (1.0 - np.cos(e))
    g = dt - (e - np.sin(e)) / n
    df = -math.sqrt(mu * a) / (now * r) * np.sin(e)
    dg = 1.0 - a / now * (1.0 - np.cos(e))
    return f[:, None] * r0 + g[:, None] * v0, df[:, None] * r0 + dg[:, None] * v0


# -- Earth orientation by ERFA and a reading of finals2000A of its own


@cache
def _finals() -> np.ndarray:
    """MJD (UTC), xp, yp [arcsec], UT1-UTC [s], dX, dY [mas] of the days around T0."""
    rows = []
    middle = _MJD_OF_GPS_EPOCH + T0_GPS_NS // DAY_NS
    with open(astropy_iers_data.IERS_A_FILE, encoding="ascii") as lines:
        for line in lines:
            mjd = float(line[7:15])
            if abs(mjd - middle) < 12:
                cells = (line[18:27], line[37:46], line[58:68], line[97:106], line[116:125])
                rows.append([mjd, *(float(cell) for cell in cells)])
    return np.array(rows)


def itrf_from_gcrf_oracle(t_gps_ns: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) by erfa: CIP of IAU 2006/2000A with observed offsets, ERA, polar motion with s'."""
    t = np.atleast_1d(np.asarray(t_gps_ns, dtype=np.int64))
    days, rest = np.divmod(t, DAY_NS)
    seconds = rest / NS
    table = _finals()
    utc = _MJD_OF_GPS_EPOCH + days + (seconds - _LEAP_SECONDS) / 86400.0
    first = np.floor(utc).astype(int) - int(table[0, 0]) - 1
    u = utc - np.floor(utc)
    weights = (
        -u * (u - 1) * (u - 2) / 6,
        (u + 1) * (u - 1) * (u - 2) / 2,
        -(u + 1) * u * (u - 2) / 2,
        (u + 1) * u * (u - 1) / 6,
    )
    xp, yp, dut1, dx, dy = sum(w[:, None] * table[first + k, 1:] for k, w in enumerate(weights)).T
    arcsec = math.pi / 648000.0
    jd = 2400000.5 + _MJD_OF_GPS_EPOCH + days
    tt = (seconds + 51.184) / 86400.0
    x, y, s = erfa.xys06a(jd, tt)
    x, y, s = x + dx * 1e-3 * arcsec, y + dy * 1e-3 * arcsec, s
    era = erfa.era00(jd, (seconds - _LEAP_SECONDS + dut1) / 86400.0)
    wobble = erfa.pom00(xp * arcsec, yp * arcsec, erfa.sp00(jd, tt))
    return erfa.c2tcio(erfa.c2ixys(x, y, s), era, wobble)


def to_itrf(t_gps_ns: np.ndarray, r_gcrf_m: np.ndarray, v_gcrf_mps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity (n, 3) Earth-fixed; the derivative of the rotation is a central difference over 2 s."""
    t = np.atleast_1d(np.asarray(t_gps_ns, dtype=np.int64))
    m = itrf_from_gcrf_oracle(t)
    rate = (itrf_from_gcrf_oracle(t + NS) - itrf_from_gcrf_oracle(t - NS)) / 2.0
    r = np.einsum("nij,nj->ni", m, r_gcrf_m)
    v = np.einsum("nij,nj->ni", m, v_gcrf_mps) + np.einsum("nij,nj->ni", rate, r_gcrf_m)
    return r, v


# -- inputs of the step


def counter_at(t_gps_ns: Any, drift: float = 0.0) -> Any:
    """Onboard counter [ns] at GPS time for an oscillator that runs fast by `drift`."""
    elapsed = np.asarray(t_gps_ns) - T0_GPS_NS
    return COUNTER_AT_T0_NS + elapsed + np.rint(drift * elapsed).astype(np.int64)


def calls(t_now_gps_ns: Any, drift: float = 0.0) -> np.ndarray:
    """Inputs of steps at these true times with nothing on the bus."""
    inputs = np.zeros(len(np.atleast_1d(t_now_gps_ns)), INPUT)
    inputs["counter_now_ns"] = counter_at(np.atleast_1d(t_now_gps_ns), drift)
    return inputs


def put_pulses(inputs: np.ndarray, where: Any, t_gps_ns: Any, drift: float = 0.0) -> None:
    """Valid time pulses at these GPS times into the inputs at these places."""
    inputs["pulse_present"][where] = 1
    inputs["pulse_status"][where] = int(SyncStatus.VALID)
    inputs["pulse_gps_ns"][where] = t_gps_ns
    inputs["pulse_counter_ns"][where] = counter_at(t_gps_ns, drift)
    inputs["pulse_sigma_ns"][where] = 20.0


def put_fixes(
    inputs: np.ndarray,
    where: Any,
    t_gps_ns: Any,
    truth: Truth,
    sigma_r_m: float = 1.0,
    sigma_v_mps: float = 1.0,
    noise: np.random.Generator | None = None,
    drift: float = 0.0,
) -> None:
    """3-D fixes of the truth at these GPS times, with or without white noise, into the inputs at these places."""
    t = np.atleast_1d(np.asarray(t_gps_ns, dtype=np.int64))
    where = np.atleast_1d(np.arange(len(inputs))[where])
    r, v = truth(t)
    if noise is not None:
        r = r + sigma_r_m * noise.standard_normal(r.shape)
        v = v + sigma_v_mps * noise.standard_normal(v.shape)
    r_itrf, v_itrf = to_itrf(t, r, v)
    inputs["fix_present"][where] = 1
    inputs["fix_gps_ns"][where] = t
    inputs["fix_counter_ns"][where] = counter_at(t, drift)
    inputs["fix_r_itrf_m"][where] = r_itrf
    inputs["fix_v_itrf_mps"][where] = v_itrf
    inputs["fix_sigma_r_m"][where] = sigma_r_m
    inputs["fix_sigma_v_mps"][where] = sigma_v_mps
    inputs["fix_satellites"][where] = 9
    inputs["fix_type"][where] = int(FixType.FIX_3D)
    inputs["fix_has_velocity"][where] = 1


def seconds(first: int, stop: int) -> np.ndarray:
    """GPS times [ns] of whole seconds after T0, `stop` excluded."""
    return T0_GPS_NS + np.arange(first, stop, dtype=np.int64) * NS


def steady_calls(
    stop_s: int,
    truth: Truth,
    fix_from_s: int = 3,
    fix_stop_s: int | None = None,
    noise: np.random.Generator | None = None,
    **sigmas: float,
) -> np.ndarray:
    """One step a second from T0 on: a pulse in each, a fix in those of [fix_from_s, fix_stop_s)."""
    t = seconds(0, stop_s)
    inputs = calls(t)
    put_pulses(inputs, slice(None), t)
    fixes = slice(fix_from_s, stop_s if fix_stop_s is None else fix_stop_s)
    put_fixes(inputs, fixes, t[fixes], truth, noise=noise, **sigmas)
    return inputs


def run(memory: Memory, inputs: np.ndarray) -> Iterator[Any]:
    """Step through the inputs; yields the output record after each, the same one, refilled."""
    out = record(memory.output)
    for index in range(len(inputs)):
        step(
            memory.nav,
            inputs[index : index + 1],
            memory.table,
            memory.orientation,
            memory.forces,
            memory.field,
            memory.work,
            memory.scratch,
            memory.output,
        )
        yield out


def finish(steps: Iterable[Any]) -> Any:
    """Run to the end; the last output."""
    last = None
    for last in steps:  # noqa: B007
        pass
    return last


def changed_fields(before: np.ndarray, after: np.ndarray) -> set[str]:
    """Names of the fields of two arrays of one record that differ in any bit."""
    return {name for name in before.dtype.names or () if before[name].tobytes() != after[name].tobytes()}
