"""The paper's own algorithm on its own scenario: as described, with the printed gain, and with every constant gain."""

from __future__ import annotations

from typing import Any

import numpy as np

from flightsw.derivative.setup import TunedSettings, norms
from ground.derivative import scenario, tracks

ORDER = 5
PRINTED_GAIN = (9.19e-2, 6.55e-3, 2.26e-4, 4.04e-6, 3.2e-8)
PRINTED_RMS = (0.019, 0.090, 0.003, 0.01)
TUNED_UNTIL_S = 168.8
# Q of the last integrator alone, per step of 0.2 s: nothing drives the chain between
CANDIDATES = tuple((0.0, 0.0, 0.0, 0.0, float(q)) for q in np.logspace(-22.0, -4.0, 55))


def described() -> TunedSettings:
    """Q tuned by J until the paper's 168.8 s, then constant."""
    return TunedSettings(ORDER, scenario.STEP_S, q=CANDIDATES, tune_s=TUNED_UNTIL_S)


def printed(normalised: bool = False) -> TunedSettings:
    """The printed gain, read in SI units; normalised: read as one of the normalised variables."""
    if not normalised:
        return TunedSettings(ORDER, scenario.STEP_S, gain=PRINTED_GAIN)
    gain = tuple((np.array(PRINTED_GAIN) / normalisation()).tolist())
    return TunedSettings(ORDER, scenario.STEP_S, gain=gain)


def normalisation(order: int = ORDER, step_s: float = scenario.STEP_S, rho: float = 1.0) -> np.ndarray:
    """Diagonal (order,) of D_s D_f."""
    powers = np.cumprod([1.0, *(step_s / j for j in range(1, order))])
    return np.asarray(norms(order) * powers * np.where(np.arange(order) > 0, rho, 1.0))


def transition(order: int = ORDER, step_s: float = scenario.STEP_S) -> np.ndarray:
    """Transition (order, order) of the chain in SI units."""
    answer = np.zeros((order, order))
    for i in range(order):
        answer[i, i:] = np.cumprod([1.0, *(step_s / j for j in range(1, order - i))])
    return answer


def radius(gain: tuple[float, ...], past: bool = False) -> float:
    """Spectral radius of the error of a constant gain: Phi - K H Phi; past: Phi - K H_p Phi, with H_p for H."""
    phi = transition(len(gain))
    row = (phi if past else np.eye(len(gain)))[0:1]
    return float(np.abs(np.linalg.eigvals(phi - np.array(gain)[:, None] @ row @ phi)).max())


def literal_gain(seed: int, epochs: int = 40) -> float:
    """K1 of the argmin of J of one epoch as printed, residual after the update: median over epochs of a settled filter.

    Diagonal Q sought on a grid of the noise of position and velocity, from nothing to a thousand sigmas a step.
    """
    true, phi = scenario.truth(), transition()
    z = true.y_m + scenario.errors(scenario.tuning_stream(seed, 0), len(true.t_s))
    x, p = np.array([z[0], *[0.0] * (ORDER - 1)]), np.diag([1.0, 1e4, 9.0, 0.09, 9e-4])
    usual = np.diag([0.0] * (ORDER - 1) + [1e-12])
    gains = []
    for k in range(1, 1000 + epochs):
        ahead, p_ahead = phi @ x, phi @ p @ phi.T
        if k >= 1000:
            costs = []
            for q1 in (0.0, *np.logspace(-12.0, 6.0, 37)):
                for q2 in (0.0, *np.logspace(-12.0, 0.0, 13)):
                    trial = p_ahead + np.diag([q1, q2, 0.0, 0.0, 0.0])
                    gain = trial[:, 0] / (trial[0, 0] + 1.0)
                    after = ahead + gain * (z[k] - ahead[0])
                    costs.append(((z[k] - after[0]) ** 2 + ((after[1:3] - x[1:3]) ** 2).sum(), gain[0]))
            gains.append(min(costs)[1])
        p_ahead = p_ahead + usual
        gain = p_ahead[:, 0] / (p_ahead[0, 0] + 1.0)
        x, p = ahead + gain * (z[k] - ahead[0]), p_ahead - np.outer(gain, gain) * (p_ahead[0, 0] + 1.0)
    return float(np.median(gains))


def printed_late(seed: int) -> float:
    """RMS of velocity [m/s] with the printed gain on the straight, from 600 s on: its own transient lasts minutes."""
    true = scenario.truth()
    z = true.y_m + scenario.errors(scenario.tuning_stream(seed, 0), len(true.t_s))
    late = (true.t_s >= 600.0) & (true.t_s < scenario.JUMPS_S[0])
    return float(np.sqrt(np.mean((tracks.tuned(printed(), z).mean[late, 1] - true.v_mps[late]) ** 2)))


def sweep(seed: int, runs: int) -> list[dict[str, Any]]:
    """Every constant gain of the family: what it reaches straight and yawing, pooled over tuning runs."""
    true = scenario.truth()
    rows = []
    for candidate in CANDIDATES[::2]:
        settings = TunedSettings(ORDER, scenario.STEP_S, q=(candidate,), tune_s=900.0)
        total = np.zeros(6)
        for run in range(runs):
            z = true.y_m + scenario.errors(scenario.tuning_stream(seed, run), len(true.t_s))
            track = tracks.tuned(settings, z)
            total += np.square(scenario.judge(track.mean))
        found = np.sqrt(total / runs)
        rows.append({"q": candidate[-1], "gain": track.gain.tolist(), "figures": found.tolist()})
    return rows
