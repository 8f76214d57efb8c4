"""Hermite interpolation of position and velocity between equidistant nodes.

On each interval the polynomial of degree 4m - 1 takes position and velocity of the 2m nodes around it
(Hildebrand, Introduction to Numerical Analysis, 2nd ed., section 8.2). Its coefficients are one fixed matrix times the
node values, made once in exact rational arithmetic.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np

NODES_EACH_SIDE = 3


@lru_cache(maxsize=4)
def coefficient_matrix(nodes_each_side: int = NODES_EACH_SIDE) -> np.ndarray:
    """(4m, 4m): maps node values, then node derivatives, to power coefficients in s.

    s is counted in node spacings from the node left of the interval; nodes lie at s = 1-m .. m.
    """
    positions = [Fraction(s) for s in range(1 - nodes_each_side, nodes_each_side + 1)]
    size = 2 * len(positions)
    rows = [[s**k for k in range(size)] for s in positions]
    rows += [[k * s ** (k - 1) if k else Fraction(0) for k in range(size)] for s in positions]
    augmented = [row + [Fraction(int(i == j)) for j in range(size)] for i, row in enumerate(rows)]
    for column in range(size):
        pivot = next(i for i in range(column, size) if augmented[i][column] != 0)
        augmented[column], augmented[pivot] = augmented[pivot], augmented[column]
        scale = augmented[column][column]
        augmented[column] = [x / scale for x in augmented[column]]
        for i in range(size):
            factor = augmented[i][column]
            if i != column and factor:
                augmented[i] = [x - factor * y for x, y in zip(augmented[i], augmented[column], strict=True)]
    return np.array([[float(x) for x in row[size:]] for row in augmented])


class HermiteTrack:
    """Position, velocity and acceleration between equidistant nodes.

    t0_ns: time of the first node; step_ns: spacing; r_m, v_mps: (n, 3) at the nodes, n >= 2m.
    Times are int64 nanoseconds throughout: only the offset within an interval becomes a float.
    """

    def __init__(self, t0_ns: int, step_ns: int, r_m: np.ndarray, v_mps: np.ndarray) -> None:
        m = NODES_EACH_SIDE
        if len(r_m) < 2 * m or r_m.shape != v_mps.shape:
            raise ValueError(f"{2 * m} nodes of position and velocity are the least, got {len(r_m)}")
        self.t0_ns = int(t0_ns)
        self.step_ns = int(step_ns)
        self.count = len(r_m)
        self._step_s = self.step_ns / 1e9
        self._r_m = r_m
        self._dr_m = v_mps * self._step_s  # derivative with respect to s

    @property
    def t_first_ns(self) -> int:
        """Time of the first node [ns]."""
        return self.t0_ns

    @property
    def t_last_ns(self) -> int:
        """Time of the last node [ns]."""
        return self.t0_ns + (self.count - 1) * self.step_ns

    def evaluate(self, t_ns: np.ndarray, derivatives: int = 1) -> list[np.ndarray]:
        """[r (n,3) m, v (n,3) m/s, a (n,3) m/s2, ...] up to `derivatives`; ValueError outside the nodes."""
        t_ns = np.atleast_1d(np.asarray(t_ns, dtype=np.int64))
        if len(t_ns) and (t_ns.min() < self.t_first_ns or t_ns.max() > self.t_last_ns):
            raise ValueError("time outside the nodes of the track")
        m = NODES_EACH_SIDE
        interval = (t_ns - self.t0_ns) // self.step_ns
        # near the ends the window stays inside: s then runs beyond its central interval
        interval = np.clip(interval, m - 1, self.count - m - 1)
        s = ((t_ns - self.t0_ns) - interval * self.step_ns) / self.step_ns
        used, where = np.unique(interval, return_inverse=True)
        window = used[:, None] + np.arange(1 - m, m + 1)
        values = np.concatenate((self._r_m[window], self._dr_m[window]), axis=1)  # (intervals, 4m, 3)
        power = np.einsum("ij,njk->ink", coefficient_matrix(m), values)  # (4m, intervals, 3)
        results = []
        for order in range(derivatives + 1):
            total = power[-1][where]
            for k in range(len(power) - 2, -1, -1):
                total *= s[:, None]
                total += power[k][where]
            results.append(total / self._step_s**order)
            power = power[1:] * np.arange(1, len(power))[:, None, None]
        return results


def interpolate_uneven(
    t_ns: np.ndarray, r_m: np.ndarray, v_mps: np.ndarray, at_ns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position (k,3) [m] and velocity (k,3) [m/s] at `at_ns` between nodes of any spacing, as in HermiteTrack.

    t_ns (n,) rising, r_m and v_mps (n,3). Newton's form on doubled nodes (Hildebrand, section 2.7); at a node its own
    values come back. ValueError outside the nodes.
    """
    m = NODES_EACH_SIDE
    if len(t_ns) < 2 * m:
        raise ValueError(f"{2 * m} nodes are the least, got {len(t_ns)}")
    if len(at_ns) and (at_ns.min() < t_ns[0] or at_ns.max() > t_ns[-1]):
        raise ValueError("time outside the nodes")
    left = np.clip(np.searchsorted(t_ns, at_ns, side="right") - 1, m - 1, len(t_ns) - m - 1)
    window = np.repeat(left[:, None] + np.arange(1 - m, m + 1), 2, axis=1)  # each node twice
    origin_ns = t_ns[left]
    unit_s = (t_ns[window[:, -1]] - t_ns[window[:, 0]]) / (2 * m - 1) / 1e9
    z = (t_ns[window] - origin_ns[:, None]) / 1e9 / unit_s[:, None]
    s = ((at_ns - origin_ns) / 1e9 / unit_s)[:, None]
    column = r_m[window] - r_m[left][:, None, :]
    slopes = v_mps[window] * unit_s[:, None, None]
    newton = [column[:, 0]]
    for order in range(1, 4 * m):
        width = z[:, order:] - z[:, :-order]
        rise = column[:, 1:] - column[:, :-1]
        if order == 1:
            same = width == 0.0
            column = np.where(same[:, :, None], slopes[:, 1:], rise / np.where(same, 1.0, width)[:, :, None])
        else:
            column = rise / width[:, :, None]
        newton.append(column[:, 0])
    value, slope = newton[-1], np.zeros_like(newton[-1])
    for order in range(4 * m - 2, -1, -1):
        x = s - z[:, order : order + 1]
        slope = slope * x + value
        value = value * x + newton[order]
    return value + r_m[left], slope / unit_s[:, None]
