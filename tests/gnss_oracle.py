"""The consistency test by dense algebra: explicit clock columns, numpy's least squares, every set solved again."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

LIGHT_MPS = 299_792_458.0
EARTH_RATE_RADPS = 7.2921151467e-5


def _inverse(matrix: np.ndarray) -> np.ndarray:
    return np.linalg.solve(matrix, np.eye(len(matrix)))


class Dense:
    """One epoch as matrices about its own fix; rows: which of the epoch's are used."""

    def __init__(self, epoch: np.ndarray, rows: list[int] | None = None) -> None:
        n = int(epoch["count"])
        self.rows = list(range(n)) if rows is None else rows
        self.satellite = np.array(epoch["r_m"][self.rows])
        self.range_m = np.array(epoch["range_m"][self.rows])
        self.sigma = np.array(epoch["sigma_m"][self.rows])
        systems = np.array(epoch["constellation"][self.rows])
        self.present = np.unique(systems)
        self.clocks = (systems[:, None] == self.present).astype(float)
        self.r, self.clock = np.zeros(3), np.zeros(len(self.present))
        for _ in range(30):
            a, y = self.linear()
            step = np.linalg.lstsq(a, y, rcond=None)[0]
            self.r, self.clock = self.r + step[:3], self.clock + step[3:]
            if np.abs(step).max() < 1e-6:
                break
        self.a, self.y = self.linear()
        self.rss = float(self.y @ self.y)
        self.cofactor = _inverse(self.a.T @ self.a)
        self.dof = len(self.rows) - self.a.shape[1]

    def linear(self) -> tuple[np.ndarray, np.ndarray]:
        """Whitened design and misfits about the present place; the Earth turned exactly."""
        flight = np.linalg.norm(self.satellite - self.r, axis=1) / LIGHT_MPS
        c, s = np.cos(EARTH_RATE_RADPS * flight), np.sin(EARTH_RATE_RADPS * flight)
        x, y, z = self.satellite.T
        line = self.r - np.stack((c * x + s * y, c * y - s * x, z), axis=1)
        distance = np.linalg.norm(line, axis=1)
        misfit = self.range_m - distance - self.clocks @ self.clock
        design = np.concatenate((line / distance[:, None], self.clocks), axis=1)
        return design / self.sigma[:, None], misfit / self.sigma

    def without(self, left_out: tuple[int, ...]) -> tuple[np.ndarray, float, np.ndarray]:
        """(shift of the unknowns, RSS, cofactor) of the linear problem without some places, solved anew."""
        kept = [i for i in range(len(self.rows)) if i not in left_out]
        a, y = self.a[kept], self.y[kept]
        columns = np.flatnonzero(np.abs(a).sum(axis=0) > 0)
        step = np.zeros(self.a.shape[1])
        step[columns] = np.linalg.lstsq(a[:, columns], y, rcond=None)[0]
        cofactor = np.full((self.a.shape[1],) * 2, np.nan)
        cofactor[np.ix_(columns, columns)] = _inverse(a[:, columns].T @ a[:, columns])
        return step, float(np.sum((y - a @ step) ** 2)), cofactor

    def cost(self, left_out: tuple[int, ...], odds: float) -> float:
        """Twice the negative logarithm of a set's posterior, by its definition."""
        n, k = len(self.rows), len(left_out)
        space = np.eye(n) - self.a @ self.cofactor @ self.a.T
        block = space[np.ix_(left_out, left_out)]
        size = np.linalg.solve(block, (space @ self.y)[list(left_out)])
        tau2 = max(float(np.mean(size**2)), 1.0)
        _, rss, _ = self.without(left_out)
        return rss + k * odds + 2.0 * math.log(math.comb(n, k)) + float(np.linalg.slogdet(tau2 * block)[1])

    def most_probable(self, most: int, thresholds: np.ndarray, odds: float, further: int) -> set[int]:
        """The cheapest of all consistent sets up to `further` larger than the smallest, every one looked at."""
        best, least = (), math.inf
        for k in range(1, most + 1):
            for left_out in combinations(range(len(self.rows)), k):
                if self.without(left_out)[1] <= thresholds[self.dof - k]:
                    if not best:
                        most = min(most, k + further)
                    cost = self.cost(left_out, odds)
                    if cost < least:
                        best, least = left_out, cost
            if k >= most:
                break
        return {self.rows[i] for i in best}


def protection_m(
    dense: Dense,
    axis: np.ndarray,
    modes: list[tuple[float, tuple[int, ...]]],
    allowed: float,
    k_false_alarm: float,
    bias_m: float,
) -> float:
    """Level [m] along an axis by solution separation, each mode solved anew, the root found by halving to 1 um."""
    terms = []
    for prior, left_out in [(2.0, ()), *modes]:
        kept = [i for i in range(len(dense.rows)) if i not in left_out]
        step, _, cofactor = dense.without(left_out)
        variance = float(axis @ cofactor[:3, :3] @ axis)
        whole = float(axis @ dense.cofactor[:3, :3] @ axis)
        columns = np.flatnonzero(np.isfinite(np.diag(cofactor)))
        gain = axis @ cofactor[:3][:, columns] @ dense.a[np.ix_(kept, columns)].T
        bias = float(np.sum(np.abs(gain) / dense.sigma[kept])) * bias_m
        passed = max(k_false_alarm * math.sqrt(max(variance - whole, 0.0)), abs(float(axis @ step[:3])))
        terms.append((prior, passed + bias, math.sqrt(variance)))
    low, high = 0.0, 1e4
    while high - low > 1e-6:
        level = 0.5 * (low + high)
        risk = sum(p * 0.5 * math.erfc((level - reach) / sigma / math.sqrt(2.0)) for p, reach, sigma in terms)
        low, high = (level, high) if risk > allowed else (low, level)
    return high
