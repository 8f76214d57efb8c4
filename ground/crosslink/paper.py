"""The paper's own experiment: its injection model, its tables 5 to 9, and what its printed numbers say of it.

In the paper's tables every link of the faulty satellite grows by the whole error, whatever its direction:
dR = |nominal| + error (the scalar model). No link of a real error does that but for a clock's, one way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ground.crosslink.paper_tables import JUMP_AT_S, TABLES, PrintedTable
from ground.crosslink.scene import Setting, ready
from hil_sim.truth.constellation.orbits import Walker

THRESHOLD_M = 59.7  # as the paper rounds it


@dataclass(frozen=True)
class Compared:
    """A printed table beside the scalar model.

    healthy_rms_m: of dR before the jump, printed and of the model; excess_*_m: dR minus the error after it, mean and
    least; ks, ks_p: Kolmogorov and Smirnov's distance of the excess from the model, and its probability.
    first_printed_s, first_model_s: first strict majority in the printed rows; median (and 5, 95 %) of the model.
    equal_columns: pairs of satellites whose columns are the same to the centimetre in every row after the jump.
    """

    number: int
    fault: str
    neighbours: tuple[int, ...]
    healthy_rms_m: float
    model_rms_m: float
    excess_mean_m: float
    excess_least_m: float
    model_excess_mean_m: float
    ks: float
    ks_p: float
    first_printed_s: float
    first_model_s: tuple[float, float, float]
    equal_columns: tuple[tuple[int, int], ...]


def nominal_sigma_m(setting: Setting) -> float:
    """1-sigma [m] of a link's healthy residual, mean over the links of satellite 1."""
    memory, pairs = ready(setting, 0.0)
    test = memory.network[0]
    mine = np.flatnonzero((pairs[:, 0] == 0) | (pairs[:, 1] == 0))
    h = np.array(test["h"])[mine]
    variance = np.einsum("lek,k->l", h**2, np.array(setting.errors.sigma_m) ** 2)
    return math.sqrt(float(variance.mean()) + setting.range_sigma_m**2)


def compare(table: PrintedTable, setting: Setting, rng: np.random.Generator, runs: int = 400) -> Compared:
    """A printed table against the scalar model with this setting's noise."""
    sigma_m = nominal_sigma_m(setting)
    rows = np.array([row[1:] for row in table.rows])
    times = np.array([row[0] for row in table.rows])
    fault = np.where(times >= JUMP_AT_S, table.jump_m, 0.0) + table.ramp_mps * times
    healthy = rows[(times < JUMP_AT_S) & (table.jump_m > 0.0)] if table.jump_m else rows[:1]
    healthy = healthy[np.isfinite(healthy)]
    after = (times >= JUMP_AT_S) if table.jump_m else np.zeros(len(times), bool)
    excess = (rows - fault[:, None])[after].ravel()
    model = np.abs(rng.normal(0.0, sigma_m, 200_000))
    distance = _distance(excess, model) if len(excess) else math.nan
    firsts = np.sort([first_majority_s(table, sigma_m, rng) for _ in range(runs)])
    beyond = 2 * (rows > THRESHOLD_M).sum(axis=1) > np.isfinite(rows).sum(axis=1)
    equal = tuple(
        (table.neighbours[a], table.neighbours[b])
        for a in range(rows.shape[1])
        for b in range(a + 1, rows.shape[1])
        if after.any() and np.array_equal(rows[after, a], rows[after, b])
    )
    return Compared(
        table.number,
        f"jump {table.jump_m:g} m" if table.jump_m else f"ramp {table.ramp_mps:g} m/s",
        table.neighbours,
        float(np.sqrt(np.mean(healthy**2))),
        sigma_m,
        float(excess.mean()) if len(excess) else math.nan,
        float(excess.min()) if len(excess) else math.nan,
        float(model.mean()),
        distance,
        _ks_probability(distance, len(excess)) if len(excess) else math.nan,
        float(times[beyond][0]) if beyond.any() else math.nan,
        (float(np.quantile(firsts, 0.5)), float(np.quantile(firsts, 0.05)), float(np.quantile(firsts, 0.95))),
        equal,
    )


def first_majority_s(table: PrintedTable, sigma_m: float, rng: np.random.Generator) -> float:
    """First second at which the scalar model has a strict majority beyond the threshold."""
    n = len(table.neighbours)
    if table.jump_m:
        start, stop = 1, round(JUMP_AT_S) + 600
    else:
        start, stop = 1, round(1.5 * THRESHOLD_M / table.ramp_mps)
    times = np.arange(start, stop, dtype=float)
    fault = np.where(times >= JUMP_AT_S, table.jump_m, 0.0) + table.ramp_mps * times
    dr = np.abs(rng.normal(0.0, sigma_m, (len(times), n))) + fault[:, None]
    beyond = 2 * (dr > THRESHOLD_M).sum(axis=1) > n
    return float(times[np.argmax(beyond)]) if beyond.any() else math.nan


def reproduced(setting: Setting, table: PrintedTable, rng: np.random.Generator) -> np.ndarray:
    """A table of ours at the printed instants, by the scalar model (rows, 1 + neighbours): time, dR."""
    times = np.array([row[0] for row in table.rows])
    fault = np.where(times >= JUMP_AT_S, table.jump_m, 0.0) + table.ramp_mps * times
    noise = np.abs(rng.normal(0.0, nominal_sigma_m(setting), (len(times), len(table.neighbours))))
    return np.column_stack((times, noise + fault[:, None]))


def printed() -> tuple[PrintedTable, ...]:
    """Tables 5 to 9."""
    return TABLES


def neighbour_sets(setting: Setting, samples: int = 2880) -> dict[tuple[int, ...], int]:
    """Neighbour sets of satellite 1 over a revolution, and at how many of the instants."""
    found: dict[tuple[int, ...], int] = {}
    for latitude in np.arange(samples) * (360.0 / samples):
        r, _ = Walker(first_latitude_deg=float(latitude)).states(0.0)
        key = tuple(int(k) + 1 for k in np.flatnonzero(setting.view.pairs(r)[0]))
        found[key] = found.get(key, 0) + 1
    return found


def _distance(sample: np.ndarray, model: np.ndarray) -> float:
    ordered, reference = np.sort(sample), np.sort(model)
    cdf = np.searchsorted(reference, ordered, side="right") / len(reference)
    n = len(ordered)
    return float(max(np.abs(np.arange(1, n + 1) / n - cdf).max(), np.abs(np.arange(n) / n - cdf).max()))


def _ks_probability(distance: float, n: int) -> float:
    """Asymptotic probability of a larger distance (Stephens 1970)."""
    x = (math.sqrt(n) + 0.12 + 0.11 / math.sqrt(n)) * distance
    return max(0.0, min(1.0, 2.0 * sum((-1) ** (k - 1) * math.exp(-2.0 * (k * x) ** 2) for k in range(1, 101))))
