"""The paper's numerical experiment: a track at 45 degrees north with a stretch of yawing, positions every 0.2 s.

100 m/s; course 45 deg for 0 to 1000 s and from 2080 s on, 45 + 5 cos(2 pi t / 300) deg between; errors uniform on
[-sqrt 3, sqrt 3] m. North alone, as the paper reports it, in metres: with rho = 1/r the same chain counts radians. The
course jumps at 1000 s and at 2080 s, which no vehicle does: transients are told apart.
"""

from __future__ import annotations

import hashlib
import math
from typing import NamedTuple

import numpy as np

from ground.campaign import seeds

STEP_S = 0.2
STOP_S = 3600.0
SPEED_MPS = 100.0
COURSE_RAD = math.radians(45.0)
YAW_RAD, YAW_PERIOD_S = math.radians(5.0), 300.0
JUMPS_S = (1000.0, 2080.0)
SETTLED_S = 100.0  # after the start and after each jump
_REPORTED_BIT = 1 << 256


class Truth(NamedTuple):
    """Times (m,) [s], north position [m], velocity [m/s], acceleration [m/s^2], and which epochs count for what."""

    t_s: np.ndarray
    y_m: np.ndarray
    v_mps: np.ndarray
    a_mps2: np.ndarray
    straight: np.ndarray
    yawing: np.ndarray


def _yaws(t_s: np.ndarray) -> np.ndarray:
    return np.asarray((t_s >= JUMPS_S[0]) & (t_s < JUMPS_S[1]))


def _velocity(t_s: np.ndarray) -> np.ndarray:
    course = COURSE_RAD + np.where(_yaws(t_s), YAW_RAD * np.cos(2.0 * np.pi * t_s / YAW_PERIOD_S), 0.0)
    return np.asarray(SPEED_MPS * np.cos(course))


def truth(lag_s: float = 0.0) -> Truth:
    """The track. lag_s: an estimate that looks ahead feels a jump before it comes; so much before it is transient."""
    t_s = np.arange(round(STOP_S / STEP_S) + 1) * STEP_S
    # Simpson's rule within a step, on whose ends the jumps lie; their own step takes the side it belongs to
    inside = np.nextafter(t_s[1:], 0.0)
    steps = STEP_S / 6.0 * (_velocity(t_s[:-1]) + 4.0 * _velocity(t_s[:-1] + 0.5 * STEP_S) + _velocity(inside))
    y_m = np.concatenate(([0.0], np.cumsum(steps)))
    yaws = _yaws(t_s)
    phase = 2.0 * np.pi * t_s / YAW_PERIOD_S
    course = COURSE_RAD + np.where(yaws, YAW_RAD * np.cos(phase), 0.0)
    turn = np.where(yaws, YAW_RAD * 2.0 * np.pi / YAW_PERIOD_S * np.sin(phase), 0.0)
    settled = t_s >= SETTLED_S
    for jump_s in JUMPS_S:
        settled &= (t_s < jump_s - lag_s) | (t_s >= jump_s + SETTLED_S)
    settled &= t_s <= STOP_S - lag_s
    return Truth(t_s, y_m, _velocity(t_s), SPEED_MPS * np.sin(course) * turn, settled & ~yaws, settled & yaws)


def errors(stream: np.random.SeedSequence, count: int) -> np.ndarray:
    """Position errors (count,) [m]: uniform, standard deviation 1 m."""
    return np.random.default_rng(stream).uniform(-math.sqrt(3.0), math.sqrt(3.0), count)


def tuning_stream(seed: int, run: int) -> np.random.SeedSequence:
    """What tuning draws from; no reported run can have it."""
    return seeds.tuning(seed).of_run(run)


def reported_stream(tuned: object, seed: int, run: int) -> np.random.SeedSequence:
    """What a reported run draws from: keyed by what was tuned, on a branch and with a root that tuning cannot make."""
    digest = hashlib.sha256(f"{seed}\n{tuned!r}".encode()).digest()
    return seeds.Seeds(int.from_bytes(digest, "big") | _REPORTED_BIT, seeds.CERTIFICATION).of_run(run)


class Figures(NamedTuple):
    """RMS errors: velocity [m/s] and acceleration [m/s^2], straight and yawing, and of the transients."""

    v_straight: float
    v_yawing: float
    a_straight: float
    a_yawing: float
    v_transient: float
    a_transient: float


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def judge(estimate: np.ndarray, lag_s: float = 0.0) -> Figures:
    """Figures of estimates (m, 3) of position, velocity, acceleration."""
    true = truth(lag_s)
    dv, da = estimate[:, 1] - true.v_mps, estimate[:, 2] - true.a_mps2
    rest = (true.t_s >= SETTLED_S) & (true.t_s <= STOP_S - lag_s) & ~true.straight & ~true.yawing
    return Figures(
        *(_rms(d[part]) for d in (dv, da) for part in (true.straight, true.yawing)), *(_rms(d[rest]) for d in (dv, da))
    )
