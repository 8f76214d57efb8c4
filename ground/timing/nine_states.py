"""The paper's nine-state filter over an arc, by flight's own kernels and by what else one might have taken.

Every way does the same work: one predict and one update a second, equations (3) and (7) to (10), central gravity,
Euler, position and velocity measured; states and covariances are compared in the end. Figures are the least of some
rounds, the ways taken in turn, so that the machine's other work does not decide between them.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightsw.icd.table_file import decode
from flightsw.kernels import gravity, integrators, registry
from flightsw.kernels.registry import MATRIX, VECTOR, entry, records
from flightsw.nav import filter
from flightsw.records import OUTPUT, TABLE, WORK
from ground.tables.build import build_navigation

EPOCHS = 2000
DT_S = 1.0
_STATES, _MEASURED = 9, 6
_RADIUS_M = 6_878_136.3
_SIGMA = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0])  # of the fixes [m, m/s]
_P0 = np.diag([1e4, 1e4, 1e4, 1.0, 1.0, 1.0, 1e-6, 1e-6, 1e-6])
_C = Path(__file__).with_name("nine_states.c")
_FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC")


class Way(NamedTuple):
    """One way of doing it: nanoseconds for a predict and update, and the largest relative difference to flight's P."""

    name: str
    step_ns: float
    difference: float


@entry(records(TABLE), MATRIX, VECTOR, VECTOR, MATRIX, records(WORK), records(OUTPUT))
def _arc(tables, z, pole, x, p, works, outs):
    table, work, out = tables[0], works[0], outs[0]
    for k in range(z.shape[0]):
        gravity.gradient(table, x[0:3], pole, work.gradient)
        filter.transition(table, DT_S, work.gradient, work)
        integrators.advance(table, x, 1.0, pole, work.stages)
        filter.predict_covariance(table, 0, 1.0, p, work, p)
        for i in range(6):
            work.z[i] = z[k, i]
        if filter.innovate(table, x, p, work, out):
            filter.correct(x, p, work, out)


class Arc(NamedTuple):
    """What every way is given: start, measurements (n, 6), variances of the noise and of the measurements."""

    x0: np.ndarray
    p0: np.ndarray
    z: np.ndarray
    q: np.ndarray
    variance: np.ndarray
    mu_m3ps2: float


State = tuple[np.ndarray, np.ndarray]
Doing = Callable[[Arc], State]


def draw(epochs: int = EPOCHS) -> Arc:
    """A circular orbit at 500 km with fixes of 1 m and 1 m/s, and the noise of the paper's Table 1."""
    mu = 3.9860044e14
    turn = math.sqrt(mu / _RADIUS_M**3) * DT_S * np.arange(epochs + 1)
    speed = math.sqrt(mu / _RADIUS_M)
    tilt = np.array([[1.0, 0.0], [0.0, math.cos(1.1)], [0.0, math.sin(1.1)]])
    r = _RADIUS_M * np.stack([np.cos(turn), np.sin(turn)], 1) @ tilt.T
    v = speed * np.stack([-np.sin(turn), np.cos(turn)], 1) @ tilt.T
    noise = np.random.default_rng(1).normal(size=(epochs, _MEASURED)) * _SIGMA
    truth = np.concatenate((r, v), axis=1)
    x0 = np.concatenate((truth[0], np.zeros(3)))
    return Arc(x0, _P0, truth[1:] + noise, np.array([1.0, 0.01, 1e-6]), _SIGMA**2, mu)


def flight(at_a_time: int = EPOCHS) -> Doing:
    """Flight's own kernels, the tuning row as the arc's noise; so many steps to a call from Python."""
    registry.warm_up()
    table = np.zeros(1, TABLE)
    values = decode(build_navigation("paper")).values
    for name in values.dtype.names or ():
        table[name] = values[name]
    work, out = np.zeros(1, WORK), np.zeros(1, OUTPUT)

    def do(arc: Arc) -> State:
        for name, value in zip(("tuning_q_r_m2", "tuning_q_v_m2ps2", "tuning_q_a_m2ps4"), arc.q, strict=True):
            table[name][0, 0] = value
        table["mu_m3ps2"] = arc.mu_m3ps2
        work["R"][0] = np.diag(arc.variance)
        x, p, pole = arc.x0.copy(), arc.p0.copy(), np.array([0.0, 0.0, 1.0])
        for first in range(0, len(arc.z), at_a_time):
            _arc(table, arc.z[first : first + at_a_time], pole, x, p, work, out)
        return x, p

    return do


def c_translation(folder: Path) -> Doing | None:
    """nine_states.c; None where there is no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    library = folder / "nine_states.so"
    subprocess.run([compiler, *_FLAGS, str(_C), "-o", str(library), "-lm"], check=True, capture_output=True)
    code = ctypes.CDLL(str(library)).arc
    doubles = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
    code.argtypes = [ctypes.c_long, doubles, doubles, doubles, ctypes.c_double, ctypes.c_double, doubles, doubles]
    code.restype = None

    def do(arc: Arc) -> State:
        x, p = arc.x0.copy(), arc.p0.copy()
        code(len(arc.z), arc.z, arc.q, arc.variance, arc.mu_m3ps2, DT_S, x, p)
        return x, p

    return do


def numpy_plain(arc: Arc) -> State:
    """As one writes it from the paper: a new array for every result."""
    x, p = arc.x0.copy(), arc.p0.copy()
    noise, h = np.diag(np.repeat(arc.q, 3)), np.eye(_MEASURED, _STATES)
    measured = np.diag(arc.variance)
    for z in arc.z:
        phi, a = _linear(arc, x)
        x = x + DT_S * np.concatenate((x[3:6], a + x[6:9], np.zeros(3)))
        p = phi @ p @ phi.T + noise
        gain = np.linalg.solve(h @ p @ h.T + measured, h @ p).T
        x = x + gain @ (z - h @ x)
        p = (np.eye(_STATES) - gain @ h) @ p
    return x, p


def numpy_out(arc: Arc) -> State:
    """The same with every array made once and the structure of H used, as far as NumPy goes."""
    x, p = arc.x0.copy(), arc.p0.copy()
    noise, measured = np.diag(np.repeat(arc.q, 3)), np.diag(arc.variance)
    square, small, gain = np.empty((_STATES, _STATES)), np.empty((_MEASURED, _MEASURED)), np.empty((_STATES, _MEASURED))
    error, change = np.empty(_MEASURED), np.empty(_STATES)
    for z in arc.z:
        phi, a = _linear(arc, x)
        x[:6] += DT_S * np.concatenate((x[3:6], a + x[6:9]))
        np.matmul(phi, p, out=square)
        np.matmul(square, phi.T, out=p)
        p += noise
        np.add(p[:_MEASURED, :_MEASURED], measured, out=small)
        gain[:] = np.linalg.solve(small, p[:_MEASURED]).T
        np.subtract(z, x[:_MEASURED], out=error)
        np.matmul(gain, error, out=change)
        x += change
        np.matmul(gain, p[:_MEASURED], out=square)
        p -= square
    return x, p


def _linear(arc: Arc, x: np.ndarray) -> State:
    """Phi (9, 9) of an Euler step at x, and the acceleration of gravity there."""
    r = x[:3]
    squared = float(r @ r)
    pull = arc.mu_m3ps2 / squared**1.5
    phi = np.eye(_STATES)
    phi[3:6, :3] = DT_S * pull * (3.0 * np.outer(r, r) / squared - np.eye(3))
    phi[:3, 3:6] = phi[3:6, 6:] = DT_S * np.eye(3)
    return phi, -pull * r


def filterpy() -> Doing | None:
    """filterpy's KalmanFilter with the transition set anew at every step; None where it is not installed."""
    try:
        from filterpy.kalman import KalmanFilter
    except ModuleNotFoundError:
        return None

    def do(arc: Arc) -> State:
        peer = KalmanFilter(_STATES, _MEASURED)
        peer.x, peer.P, peer.H = arc.x0.copy(), arc.p0.copy(), np.eye(_MEASURED, _STATES)
        peer.Q, peer.R = np.diag(np.repeat(arc.q, 3)), np.diag(arc.variance)
        for z in arc.z:
            phi, a = _linear(arc, peer.x)
            mean = peer.x + DT_S * np.concatenate((peer.x[3:6], a + peer.x[6:9], np.zeros(3)))
            peer.predict(F=phi)
            peer.x = mean
            peer.update(z)
        return peer.x, peer.P

    return do


def compare(rounds: int = 7, epochs: int = EPOCHS) -> list[Way]:
    """Every way there is here, flight's own first. The slow ones do a tenth of the rounds' work."""
    with tempfile.TemporaryDirectory() as folder:
        ways: dict[str, Doing | None] = {
            "flight": flight(),
            "flight, a call a step": flight(1),
            "C translation": c_translation(Path(folder)),
            "NumPy, out=": numpy_out,
            "NumPy, plain": numpy_plain,
            "filterpy": filterpy(),
        }
        found = {name: do for name, do in ways.items() if do is not None}
        arc = draw(epochs)
        wanted = found["flight"](arc)[1]
        scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
        differences = {name: float(np.abs((do(arc)[1] - wanted) / scale).max()) for name, do in found.items()}
        least = dict.fromkeys(found, math.inf)
        for _ in range(rounds):
            for name, do in found.items():
                began = time.perf_counter()
                do(arc)
                least[name] = min(least[name], time.perf_counter() - began)
        return [Way(name, 1e9 * least[name] / epochs, differences[name]) for name in found]
